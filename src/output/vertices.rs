//! Light at the vertices of the scene.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::normals::{Weight, vertex_normals};
use super::{Evaluate, exposure};
use crate::geometry::{SurfacePoint, triangle};
use crate::light::Rgb;
use crate::scene::{Albedo, Mesh, Scene};

/// Vertices that the exposure looks at, spread evenly over all.
const EXPOSURE_VERTICES: usize = 2_048;

/// The light of one vertex; all zeros for a vertex that no face with area uses.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct VertexLight {
    /// What leaves its front, W·m⁻²: exitance + albedo · irradiance.
    pub radiosity: Rgb,
    /// What falls on its front, W·m⁻².
    pub irradiance: Rgb,
    /// Cosine-weighted share of the sky that it sees, in [0, 1].
    pub ambient_occlusion: f32,
    /// Estimated standard error of the mean-channel irradiance, W·m⁻².
    pub error: f32,
}

/// Answers for vertices, whose normal is the file's or the area-weighted mean of the faces'.
pub struct VertexField<'a> {
    scene: &'a Scene,
    evaluate: &'a Evaluate<'a>,
    normals: Vec<Vec3>,
}

impl<'a> VertexField<'a> {
    /// Prepares the normals.
    pub fn new(scene: &'a Scene, evaluate: &'a Evaluate<'a>) -> Self {
        Self { scene, evaluate, normals: vertex_normals(scene, Weight::Area) }
    }

    /// The unit normals answered for; zero for unused vertices.
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// The light of a range of vertices, in order. Finite throughout.
    pub fn light(&self, range: Range<usize>) -> Vec<VertexLight> {
        self.light_of(&range.collect::<Vec<usize>>())
    }

    fn light_of(&self, vertices: &[usize]) -> Vec<VertexLight> {
        let used = |v: &usize| self.normals[*v] != Vec3::ZERO && self.scene.vertices[*v].is_finite();
        let point = |v: usize| SurfacePoint { position: self.scene.vertices[v], normal: self.normals[v] };
        let points: Vec<SurfacePoint> = vertices.iter().copied().filter(used).map(point).collect();
        let answers = (self.evaluate)(&points);
        assert_eq!(answers.len(), points.len(), "one irradiance per point");
        let mut answers = answers.into_iter();
        let sound = |value: f32| if value.is_finite() { value } else { 0.0 };
        let sound_rgb = |value: Vec3| if value.is_finite() { value } else { Vec3::ZERO };
        let mut light = vec![VertexLight::default(); vertices.len()];
        for (slot, &vertex) in light.iter_mut().zip(vertices).filter(|(_, v)| used(v)) {
            let Some(answer) = answers.next() else { break };
            let irradiance = sound_rgb(answer.total());
            let (albedo, exitance) = self.material(vertex);
            *slot = VertexLight {
                radiosity: sound_rgb(exitance + albedo * irradiance),
                irradiance,
                ambient_occlusion: sound(answer.sky_visibility),
                error: sound(answer.error),
            };
        }
        light
    }

    /// Albedo and exitance at a vertex.
    fn material(&self, vertex: usize) -> (Rgb, Rgb) {
        let at = self.scene.meshes.partition_point(|mesh| mesh.vertices.end as usize <= vertex);
        match self.scene.meshes.get(at) {
            Some(mesh) if mesh.vertices.start as usize <= vertex => (
                vertex_albedo(mesh, vertex - mesh.vertices.start as usize),
                mesh.radiance * std::f32::consts::PI,
            ),
            _ => (Vec3::ZERO, Vec3::ZERO),
        }
    }

    /// The exposure that shows the vertices' radiosities well, from a spread sample weighted by area.
    pub fn exposure(&self) -> f32 {
        let mut areas = vec![0.0f32; self.scene.vertices.len()];
        for triangle in &self.scene.triangles {
            let area = triangle::area(triangle.map(|k| self.scene.vertices[k as usize]));
            for &k in triangle {
                areas[k as usize] += area;
            }
        }
        let stride = self.scene.vertices.len().div_ceil(EXPOSURE_VERTICES).max(1);
        let spread: Vec<usize> = (0..self.scene.vertices.len()).step_by(stride).collect();
        let light = self.light_of(&spread);
        let weighted = light.iter().zip(&spread).map(|(l, &v)| (exposure::luminance(l.radiosity), areas[v]));
        exposure::automatic(weighted)
    }
}

/// The albedo at vertex `k` of a mesh.
pub fn vertex_albedo(mesh: &Mesh, k: usize) -> Rgb {
    match &mesh.albedo {
        Albedo::Constant(albedo) => *albedo,
        Albedo::Vertex(values) => values.get(k).copied().unwrap_or(Vec3::ZERO),
        Albedo::Texture { texture, uv, factor } => {
            let at: Vec2 = uv.get(k).copied().unwrap_or(Vec2::ZERO);
            texture.bilinear_repeat(at) * *factor
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;

    #[test]
    fn radiosity_is_exitance_plus_reflected_irradiance() {
        let mut scene = synthetic::square();
        scene.meshes[0].radiance = Vec3::splat(2.0);
        scene.vertices.push(Vec3::splat(f32::NAN));
        scene.meshes[0].vertices.end = 5;
        let field = VertexField::new(&scene, &synthetic::light);
        let light = field.light(0..5);
        // Irradiance (0.5, 0.5, 1) + 0.25 on a surface that looks to +z, albedo 0.5, exitance 2π.
        assert!((light[0].irradiance - Vec3::new(0.75, 0.75, 1.25)).length() < 1e-6);
        let exitance = 2.0 * std::f32::consts::PI;
        assert!((light[0].radiosity - Vec3::splat(exitance) - 0.5 * light[0].irradiance).length() < 1e-6);
        assert_eq!(light[4], VertexLight::default());
        assert!(field.exposure().is_finite());
    }

    #[test]
    fn answers_that_are_no_numbers_become_zero() {
        let scene = synthetic::square();
        let broken = |points: &[SurfacePoint]| {
            let mut answers = synthetic::light(points);
            answers[0].direct.x = f32::NAN;
            answers
        };
        let light = VertexField::new(&scene, &broken).light(0..4);
        assert_eq!((light[0].irradiance, light[0].radiosity), (Vec3::ZERO, Vec3::ZERO));
        assert!(light[1].irradiance.x > 0.0);
    }
}
