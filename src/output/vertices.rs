//! Light at the vertices of the scene.

use std::ops::Range;

use glam::{Vec2, Vec3};

use rayon::prelude::*;

use super::normals::{Weight, vertex_normals};
use super::{Advance, Evaluate, exposure};
use crate::error::Result;
use crate::geometry::{SurfacePoint, morton, triangle};
use crate::light::Rgb;
use crate::scene::{Albedo, Mesh, Scene};
use crate::solve::Irradiance;

/// Vertices that the exposure looks at, spread evenly over all.
const EXPOSURE_VERTICES: usize = 2_048;

/// Vertices asked together: enough that those of a dense mesh share rows, a second of work or, where all gather, three.
const TOGETHER: usize = 1 << 15;

/// Cells of the curve along the scene's longest side: its codes have 21 bits an axis.
const CURVE_CELLS: f32 = 1_048_576.0;

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

/// Light at all vertices, whose normal is the file's or the area-weighted mean of the faces'.
pub struct VertexField<'a> {
    scene: &'a Scene,
    normals: Vec<Vec3>,
    answers: Vec<Irradiance>,
}

impl<'a> VertexField<'a> {
    /// Asks for the light of all vertices that faces use, block by block along a curve, so that those that are asked together
    /// lie together; which they are depends on the scene alone. `advance` counts vertices. Memory: 44 bytes a vertex.
    ///
    /// # Errors
    /// What `advance` says.
    ///
    /// # Panics
    /// When `evaluate` does not give one irradiance a point.
    pub fn new(scene: &'a Scene, evaluate: &Evaluate<'_>, advance: &Advance<'_>) -> Result<Self> {
        let normals = normals(scene);
        let mut answers = vec![Irradiance::default(); normals.len()];
        let order = along_curve(scene, &normals);
        advance((normals.len() - order.len()) as u64)?;
        for block in order.chunks(TOGETHER) {
            let point =
                |&v: &u32| SurfacePoint { position: scene.vertices[v as usize], normal: normals[v as usize] };
            let lights = evaluate(&block.iter().map(point).collect::<Vec<SurfacePoint>>());
            assert_eq!(lights.len(), block.len(), "one irradiance per point");
            block.iter().zip(lights).for_each(|(&v, light)| answers[v as usize] = light);
            advance(block.len() as u64)?;
        }
        Ok(Self { scene, normals, answers })
    }

    /// The unit normals answered for; zero for unused vertices.
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// The light of a range of vertices, in order. Finite throughout.
    pub fn light(&self, range: Range<usize>) -> Vec<VertexLight> {
        range.map(|vertex| self.light_of(vertex)).collect()
    }

    fn light_of(&self, vertex: usize) -> VertexLight {
        if !is_used(self.scene, &self.normals, vertex) {
            return VertexLight::default();
        }
        let sound = |value: f32| if value.is_finite() { value } else { 0.0 };
        let sound_rgb = |value: Vec3| if value.is_finite() { value } else { Vec3::ZERO };
        let answer = &self.answers[vertex];
        let irradiance = sound_rgb(answer.total());
        let (albedo, exitance) = self.material(vertex);
        VertexLight {
            radiosity: sound_rgb(exitance + albedo * irradiance),
            irradiance,
            ambient_occlusion: sound(answer.sky_visibility),
            error: sound(answer.error),
        }
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
        let luminance = |v: usize| exposure::luminance(self.light_of(v).radiosity);
        exposure::automatic(spread.into_iter().map(|v| (luminance(v), areas[v])))
    }
}

/// The unit normals that vertices are answered for: the file's or the area-weighted mean of the faces', zero for unused ones.
pub fn normals(scene: &Scene) -> Vec<Vec3> {
    vertex_normals(scene, Weight::Area)
}

fn is_used(scene: &Scene, normals: &[Vec3], vertex: usize) -> bool {
    normals[vertex] != Vec3::ZERO && scene.vertices[vertex].is_finite()
}

/// The used vertices in an order in which neighbours are mostly close together: that of asking.
pub fn along_curve(scene: &Scene, normals: &[Vec3]) -> Vec<u32> {
    let at = |v: u32| scene.vertices[v as usize];
    let used: Vec<u32> = (0..normals.len() as u32).filter(|&v| is_used(scene, normals, v as usize)).collect();
    let low = used.iter().fold(Vec3::INFINITY, |low, &v| low.min(at(v)));
    let high = used.iter().fold(Vec3::NEG_INFINITY, |high, &v| high.max(at(v)));
    let cell = ((high - low).max_element() / CURVE_CELLS).max(f32::MIN_POSITIVE);
    let mut order: Vec<(u64, u32)> =
        used.into_par_iter().map(|v| (morton::code(at(v), low, cell), v)).collect();
    order.par_sort_unstable();
    order.into_iter().map(|(_, v)| v).collect()
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
        let field = VertexField::new(&scene, &synthetic::light, &|_| Ok(())).unwrap();
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
        let light = VertexField::new(&scene, &broken, &|_| Ok(())).unwrap().light(0..4);
        let broken = light.iter().filter(|l| (l.irradiance, l.radiosity) == (Vec3::ZERO, Vec3::ZERO)).count();
        // Which of the four is asked about first is the curve's choice.
        assert_eq!((broken, light.iter().filter(|l| l.irradiance.x > 0.0).count()), (1, 3));
    }

    #[test]
    fn blocks_hold_every_used_vertex_once_and_neighbours_together() {
        let mut scene = synthetic::square();
        let side = 300u32;
        // Numbered so that neighbours are far apart in the file: 7919 is prime to the number of vertices.
        let count = side * side;
        let place = |v: u32| (u64::from(v) * 7919 % u64::from(count)) as u32;
        let at = |v: u32| Vec3::new((place(v) % side) as f32, (place(v) / side) as f32, 0.0);
        scene.vertices = (0..count).map(at).collect();
        scene.meshes[0].vertices.end = count;
        let mut normals = vec![Vec3::Z; count as usize];
        normals[5] = Vec3::ZERO;
        let order = along_curve(&scene, &normals);
        let mut all = order.clone();
        all.sort_unstable();
        assert_eq!(all, (0..count).filter(|&v| v != 5).collect::<Vec<u32>>());
        // A Morton curve's step is one in half of all cases, two in a quarter…: on the mean below three of a grid's edges.
        let steps = order.windows(2).map(|w| at(w[0]).distance(at(w[1])));
        let mean = steps.sum::<f32>() / (order.len() - 1) as f32;
        assert!(mean < 3.0, "{mean} edges from one to the next");
    }
}
