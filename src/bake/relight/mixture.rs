//! Which meshes each site stands for: new albedos and new glow of meshes become those of sites without looking at the scene.

use rayon::prelude::*;

use crate::light::Rgb;
use crate::scene::Scene;
use crate::sites::{Samples, Sites};

/// A mesh within a site's surface.
#[derive(Debug, Clone, Copy)]
struct Part {
    mesh: u32,
    /// Of the site's area.
    share: f32,
    /// Mean as it was baked.
    albedo: Rgb,
}

/// The meshes of all sites, most of which have one.
#[derive(Debug, Clone)]
pub struct Mixture {
    offsets: Vec<u32>,
    parts: Vec<Part>,
}

impl Mixture {
    /// From the samples that sites were settled with: as [`crate::bake::model::materials`] averages them.
    ///
    /// Cost: one look at the albedo a sample. Memory: 20 B a site and mesh.
    pub fn new(scene: &Scene, sites: &Sites, samples: &Samples) -> Self {
        let site = |s: usize| parts_of(scene, sites, samples, s);
        let all: Vec<Vec<Part>> = (0..sites.len()).into_par_iter().with_min_len(256).map(site).collect();
        let mut mixture = Self { offsets: vec![0], parts: Vec::with_capacity(all.len()) };
        for own in all {
            mixture.parts.extend(own);
            mixture.offsets.push(mixture.parts.len() as u32);
        }
        mixture
    }

    /// Per site the mean of what a mesh has, given its number and its baked albedo there.
    pub fn mean(&self, of: impl Fn(usize, Rgb) -> Rgb + Sync) -> Vec<Rgb> {
        let site = |s: usize| {
            let own = &self.parts[self.offsets[s] as usize..self.offsets[s + 1] as usize];
            own.iter().map(|part| of(part.mesh as usize, part.albedo) * part.share).sum()
        };
        (0..self.offsets.len() - 1).into_par_iter().with_min_len(1024).map(site).collect()
    }
}

fn parts_of(scene: &Scene, sites: &Sites, samples: &Samples, site: usize) -> Vec<Part> {
    let points = samples.of(site);
    if points.is_empty() {
        let (triangle, [u, v]) = (sites.triangles[site], sites.barycentrics[site]);
        let mesh = scene.mesh_of(triangle) as u32;
        return vec![Part { mesh, share: 1.0, albedo: scene.albedo(triangle, u, v) }];
    }
    let mut parts: Vec<Part> = Vec::with_capacity(1);
    let mut total = 0.0;
    for (at, area) in points {
        let mesh = scene.mesh_of(at.triangle) as u32;
        let k = parts.iter().position(|part| part.mesh == mesh).unwrap_or_else(|| {
            parts.push(Part { mesh, share: 0.0, albedo: Rgb::ZERO });
            parts.len() - 1
        });
        let [u, v] = at.barycentric;
        parts[k].albedo += scene.albedo(at.triangle, u, v) * *area;
        parts[k].share += area;
        total += area;
    }
    for part in &mut parts {
        part.albedo /= part.share;
        part.share /= total;
    }
    parts
}
