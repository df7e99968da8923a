//! A scene with everything a bake makes of it, in memory.

use std::borrow::Cow;
use std::sync::OnceLock;

use rayon::prelude::*;

use super::job::streams::Details;
use crate::basis::Basis;
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::links::Surroundings;
use crate::links::direct::Direct;
use crate::links::lamps::Lamp;
use crate::links::receivers::Receivers;
use crate::links::spread::Spread;
use crate::rays::Bvh;
use crate::scene::Scene;
use crate::sites::{Cells, Neighbours, Plot, Samples, Sites};
use crate::solve::field::{self, FieldParams, Smooth};
use crate::solve::{Field, Problem, Solution};

/// All stages' data; each becomes whole before the next begins.
pub struct Model {
    /// Triangles, materials and lights.
    pub scene: Scene,
    /// The ray engine.
    pub bvh: Bvh,
    /// What proxies in the scene stand for.
    pub details: Details,
    /// Where radiosity is known.
    pub sites: Sites,
    /// Which sites see each other.
    pub graph: Neighbours,
    /// Which site speaks for which bit of surface.
    pub cells: Cells,
    /// How the surface was served.
    pub plots: Vec<Plot>,
    /// Lights aimed at.
    pub lamps: Vec<Lamp>,
    /// Albedo per site.
    pub albedo: Vec<Rgb>,
    /// Exitance per site where rows meet it.
    pub exitance: Vec<Rgb>,
    /// Lamp links.
    pub direct: Direct,
    /// Receivers and their rows.
    pub receivers: Receivers,
    /// Interpolation to sites.
    pub spread: Spread,
    /// The light.
    pub solution: Solution,
    /// How points are answered.
    pub field: FieldParams,
    /// The function of a global basis, made from the solution when first asked for: renew it when the solution changes.
    pub smooth: OnceLock<Smooth>,
}

/// Albedo and glowing exitance of every site, averaged over the surface that it stands for.
pub fn materials(scene: &Scene, sites: &Sites, samples: &Samples, glowing: &[bool]) -> (Vec<Rgb>, Vec<Rgb>) {
    let at = |t: u32, [u, v]: [f32; 2]| {
        let mesh = scene.mesh_of(t);
        let glow = if glowing[mesh] { scene.meshes[mesh].radiance * std::f32::consts::PI } else { Rgb::ZERO };
        (scene.albedo(t, u, v), glow)
    };
    let site = |s: usize| {
        let points = samples.of(s);
        if points.is_empty() {
            return at(sites.triangles[s], sites.barycentrics[s]);
        }
        let area: f32 = points.iter().map(|(_, part)| part).sum();
        let mut sum = (Rgb::ZERO, Rgb::ZERO);
        for (c, part) in points {
            let (albedo, glow) = at(c.triangle, c.barycentric);
            sum = (sum.0 + albedo * *part, sum.1 + glow * *part);
        }
        (sum.0 / area, sum.1 / area)
    };
    (0..sites.len()).into_par_iter().map(site).unzip()
}

impl Model {
    /// The points, set onto the surface where the scene has proxies: what is known of a proxy's vertices, or of what a ray met on it,
    /// lies beside it.
    pub fn set_down<'a>(&self, points: &'a [SurfacePoint]) -> Cow<'a, [SurfacePoint]> {
        if self.details.is_empty() {
            return Cow::Borrowed(points);
        }
        points.iter().map(|point| self.around().footing(point).1).collect()
    }

    /// The rays' world.
    pub fn around(&self) -> Surroundings<'_> {
        Surroundings {
            scene: &self.scene,
            bvh: &self.bvh,
            sites: &self.sites,
            graph: &self.graph,
            cells: &self.cells,
        }
    }

    /// What there is to solve.
    pub fn problem(&self) -> Problem<'_> {
        Problem {
            around: self.around(),
            receivers: &self.receivers,
            spread: &self.spread,
            lamps: &self.lamps,
            direct: &self.direct,
            albedo: &self.albedo,
            exitance: &self.exitance,
            sky: self.direct.sky.as_ref(),
        }
    }

    /// How light is interpolated.
    pub fn basis(&self) -> Basis {
        self.spread.basis
    }

    /// The solution, ready to answer.
    pub fn field(&self) -> Field<'_> {
        let smooth = self.basis().is_global().then(|| {
            self.smooth.get_or_init(|| field::smooth(self.basis(), &self.receivers, &self.solution)).as_ref()
        });
        Field { problem: self.problem(), solution: &self.solution, params: self.field, smooth, judge: None }
    }
}
