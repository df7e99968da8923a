//! Lamps: small emitters and punctual lights, whose light is aimed for rather than met by chance.
//!
//! This work is based on: Lambert, "Photometria", 1760 (the polygon's form factor), as given by Baum, Rushmeier and
//! Winget 1989 (horizon clipping); shadow rays weigh in by the unoccluded kernel (a ratio estimator).

use glam::Vec3;
use smallvec::SmallVec;

use crate::geometry::{SurfacePoint, hemisphere, triangle};
use crate::light::Rgb;
use crate::rays::{Bvh, Ray};
use crate::scene::{LampKind, Scene};

/// Large emitters of few triangles are lamps all the same, their form factors being exact, unless emitters make up this
/// share of the scene's area: in a furnace every point sees them everywhere, and rows are exact.
pub const LARGEST_ANALYTIC_SHARE: f64 = 0.6;

/// Emissive meshes above this share of the scene's area are met by the rows' rays; those below are lamps.
///
/// A row of 256 rays sees an emitter of 5 % of the surroundings with about 13 rays, whose lattice noise is a few
/// per cent of its light; below that, aimed rays are cheaper for the same error.
pub const LARGEST_LAMP_SHARE: f64 = 0.05;

/// Emitters of more triangles than this are sampled rather than summed triangle by triangle.
const MOST_ANALYTIC: usize = 128;

/// How many points of a large emitter are sampled for its unoccluded form factor.
const SAMPLED_POINTS: u32 = 128;

/// A light that receivers link to directly.
#[derive(Debug, Clone)]
pub struct Lamp {
    /// The handle for relighting.
    pub name: String,
    /// Multiplies the coupling: exitance of an emitter (W·m⁻²), irradiance of a sun, intensity of a point or spot.
    pub strength: Rgb,
    /// Geometry.
    pub shape: Shape,
}

/// The geometry of a lamp.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Triangles that emit to their front, or to both sides.
    Emitter(Emitter),
    /// A punctual light; its light fields are unused here.
    Punctual(LampKind),
}

/// The triangles of an emitting mesh.
#[derive(Debug, Clone)]
pub struct Emitter {
    corners: Vec<[Vec3; 3]>,
    normals: Vec<Vec3>,
    /// Running sum of areas, for sampling.
    cumulative: Vec<f64>,
    two_sided: bool,
    /// Mesh index in the scene.
    pub mesh: usize,
}

/// Splits the scene's light sources: lamps to aim at, and for each mesh whether the rows meet its emission.
pub fn split(scene: &Scene) -> (Vec<Lamp>, Vec<bool>) {
    let area_of = |range: &std::ops::Range<u32>| -> f64 {
        range.clone().map(|t| f64::from(triangle::area(scene.corners(t)))).sum()
    };
    let areas: Vec<f64> = scene.meshes.iter().map(|m| area_of(&m.triangles)).collect();
    let total: f64 = areas.iter().sum();
    let emits = |k: usize| scene.meshes[k].radiance.max_element() > 0.0;
    let emitting: f64 = (0..areas.len()).filter(|&k| emits(k)).map(|k| areas[k]).sum();
    let mut lamps = Vec::new();
    let mut glowing = vec![false; scene.meshes.len()];
    for (k, mesh) in scene.meshes.iter().enumerate() {
        if mesh.radiance.max_element() <= 0.0 {
            continue;
        }
        let analytic = mesh.triangles.len() <= MOST_ANALYTIC && emitting < LARGEST_ANALYTIC_SHARE * total;
        if areas[k] > LARGEST_LAMP_SHARE * total && !analytic {
            glowing[k] = true;
        } else if areas[k] > 0.0 {
            lamps.push(Lamp {
                name: mesh.name.clone(),
                strength: mesh.radiance * std::f32::consts::PI,
                shape: Shape::Emitter(Emitter::new(scene, k)),
            });
        }
    }
    for lamp in &scene.lamps {
        let strength = match lamp.kind {
            LampKind::Sun { irradiance, .. } => irradiance,
            LampKind::Point { intensity, .. } | LampKind::Spot { intensity, .. } => intensity,
        };
        lamps.push(Lamp { name: lamp.name.clone(), strength, shape: Shape::Punctual(lamp.kind) });
    }
    (lamps, glowing)
}

impl Emitter {
    fn new(scene: &Scene, mesh: usize) -> Self {
        let m = &scene.meshes[mesh];
        let mut emitter = Self {
            corners: Vec::new(),
            normals: Vec::new(),
            cumulative: Vec::new(),
            two_sided: m.two_sided,
            mesh,
        };
        let mut sum = 0.0;
        for t in m.triangles.clone() {
            let corners = scene.corners(t);
            let area = f64::from(triangle::area(corners));
            if area > 0.0 {
                sum += area;
                emitter.corners.push(corners);
                emitter.normals.push(triangle::normal(corners));
                emitter.cumulative.push(sum);
            }
        }
        emitter
    }

    /// Total area of one side.
    pub fn area(&self) -> f64 {
        self.cumulative.last().copied().unwrap_or(0.0)
    }

    /// A point of the emitter and its normal, uniform by area from the unit square.
    fn sample(&self, [x, y]: [f32; 2]) -> (Vec3, Vec3) {
        let want = f64::from(x) * self.area();
        let k = self.cumulative.partition_point(|&c| c <= want).min(self.corners.len() - 1);
        let before = if k == 0 { 0.0 } else { self.cumulative[k - 1] };
        let within = ((want - before) / (self.cumulative[k] - before)).clamp(0.0, 0.999_999) as f32;
        let (u, v) = triangle::uniform_barycentric([within, y]);
        (triangle::point(self.corners[k], u, v), self.normals[k])
    }

    /// The kernel cosθ cosθ′/(π r²) from a surface point to an emitter point, zero where they do not face.
    fn kernel(&self, at: &SurfacePoint, (target, normal): (Vec3, Vec3)) -> f32 {
        let d = target - at.position;
        let square = d.length_squared();
        let here = d.dot(at.normal);
        let there = if self.two_sided { d.dot(normal).abs() } else { -d.dot(normal) };
        if here <= 0.0 || there <= 0.0 || square <= 0.0 {
            return 0.0;
        }
        here * there / (std::f32::consts::PI * square * square)
    }

    /// The unoccluded form factor from a surface point to the emitter.
    fn form_factor(&self, at: &SurfacePoint) -> f32 {
        if self.corners.len() > MOST_ANALYTIC {
            let sum: f64 = (0..SAMPLED_POINTS)
                .map(|i| f64::from(self.kernel(at, self.sample(hemisphere::r2(i, [0.5, 0.5])))))
                .sum();
            return (sum * self.area() / f64::from(SAMPLED_POINTS)) as f32;
        }
        let faces = |corners: &[Vec3; 3], normal: &Vec3| {
            self.two_sided || (at.position - corners[0]).dot(*normal) > 0.0
        };
        self.corners
            .iter()
            .zip(&self.normals)
            .filter(|(c, n)| faces(c, n))
            .map(|(c, _)| triangle_form_factor(at, c))
            .sum::<f32>()
            .min(1.0)
    }
}

/// The form factor from a surface element to a triangle, clipped at the element's horizon (Lambert's formula).
///
/// F = (1/2π) |Σ γᵢ n·Γᵢ| over the edges of the clipped polygon.
pub fn triangle_form_factor(at: &SurfacePoint, corners: &[Vec3; 3]) -> f32 {
    let relative = corners.map(|c| c - at.position);
    let height = relative.map(|c| c.dot(at.normal));
    if height.iter().all(|&h| h <= 0.0) {
        return 0.0;
    }
    let mut polygon = SmallVec::<[Vec3; 4]>::new();
    for i in 0..3 {
        let j = (i + 1) % 3;
        if height[i] > 0.0 {
            polygon.push(relative[i]);
        }
        if (height[i] > 0.0) != (height[j] > 0.0) {
            polygon.push(relative[i].lerp(relative[j], height[i] / (height[i] - height[j])));
        }
    }
    let mut sum = 0.0;
    for (i, a) in polygon.iter().enumerate() {
        let b = &polygon[(i + 1) % polygon.len()];
        let cross = a.cross(*b);
        let length = cross.length();
        if length > 0.0 {
            sum += length.atan2(a.dot(*b)) * cross.dot(at.normal) / length;
        }
    }
    (sum.abs() / std::f32::consts::TAU).min(1.0)
}

impl Lamp {
    /// Irradiance at a point per unit of strength, were nothing in the way.
    pub fn coupling(&self, at: &SurfacePoint) -> f32 {
        match &self.shape {
            Shape::Emitter(emitter) => emitter.form_factor(at),
            Shape::Punctual(LampKind::Sun { direction, .. }) => (-at.normal.dot(*direction)).max(0.0),
            Shape::Punctual(LampKind::Point { position, .. }) => falloff(at, *position),
            Shape::Punctual(LampKind::Spot { position, direction, inner_cosine, outer_cosine, .. }) => {
                let cosine = (at.position - *position).normalize_or_zero().dot(*direction);
                let width = (inner_cosine - outer_cosine).max(1e-6);
                let x = ((cosine - outer_cosine) / width).clamp(0.0, 1.0);
                falloff(at, *position) * x * x * (3.0 - 2.0 * x)
            }
        }
    }

    /// The visible share of the lamp's light at a point, by up to `rays` shadow rays: Σ k v / Σ k.
    ///
    /// `shift` decorrelates points. None if every sample lies behind or faces away.
    pub fn visibility(&self, at: &SurfacePoint, bvh: &Bvh, rays: u32, shift: [f32; 2]) -> Option<f32> {
        let Shape::Emitter(emitter) = &self.shape else {
            return Some(if bvh.occluded(&self.shadow_ray(at)) { 0.0 } else { 1.0 });
        };
        let (mut seen, mut all) = (0.0f64, 0.0f64);
        for i in 0..rays {
            let sample = emitter.sample(hemisphere::r2(i, shift));
            let kernel = f64::from(emitter.kernel(at, sample));
            if kernel <= 0.0 {
                continue;
            }
            all += kernel;
            let side = if (at.position - sample.0).dot(sample.1) < 0.0 { -1.0 } else { 1.0 };
            let end = sample.0 + sample.1 * (side * crate::geometry::LIFT);
            if !bvh.occluded(&Ray::between(at.lifted(), end)) {
                seen += kernel;
            }
        }
        (all > 0.0).then(|| (seen / all) as f32)
    }

    /// Whether any of a few rays finds the lamp.
    pub fn reaches(&self, at: &SurfacePoint, bvh: &Bvh) -> bool {
        self.coupling(at) > 0.0 && self.visibility(at, bvh, 8, [0.5, 0.5]).is_some_and(|v| v > 0.0)
    }

    /// The one ray that decides over a punctual light.
    fn shadow_ray(&self, at: &SurfacePoint) -> Ray {
        match &self.shape {
            Shape::Punctual(LampKind::Point { position, .. } | LampKind::Spot { position, .. }) => {
                Ray::between(at.lifted(), *position)
            }
            Shape::Punctual(LampKind::Sun { direction, .. }) => Ray::new(at.lifted(), -*direction),
            Shape::Emitter(emitter) => Ray::between(at.lifted(), emitter.sample([0.5, 0.5]).0),
        }
    }

    /// Whether one ray tells all: its visibility is 0 or 1 and jumps.
    pub fn is_punctual(&self) -> bool {
        matches!(self.shape, Shape::Punctual(_))
    }
}

/// cosθ / r² towards a punctual position.
fn falloff(at: &SurfacePoint, position: Vec3) -> f32 {
    let d = position - at.position;
    let square = d.length_squared().max(1e-12);
    (d.dot(at.normal) / square.sqrt()).max(0.0) / square
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(z: f32) -> [[Vec3; 3]; 2] {
        let p = |x, y| Vec3::new(x, y, z);
        [[p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0)], [p(0.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)]]
    }

    #[test]
    fn polygon_factors_match_howells_catalogue() {
        let factor = |position, normal| -> f32 {
            square(1.0).iter().map(|t| triangle_form_factor(&SurfacePoint { position, normal }, t)).sum()
        };
        // Element under the centre and under a corner of a unit square at height 1; f32 arctangents carry 1e-7 each.
        assert!((factor(Vec3::new(0.5, 0.5, 0.0), Vec3::Z) - 0.239_456_47).abs() < 2e-6);
        assert!((factor(Vec3::ZERO, Vec3::Z) - 0.138_531_6).abs() < 2e-6);
        assert_eq!(factor(Vec3::ZERO, -Vec3::Z), 0.0);
    }

    #[test]
    fn the_horizon_clips() {
        // An element perpendicular to a unit square at distance c under its corner, facing along its edge: Howell's
        // figures; moved under the edge's middle, half of the square lies behind.
        let normal = Vec3::X;
        for (c, expected) in [(0.1, 0.221_738_67), (0.5, 0.124_268_91), (1.0, 0.055_734_2)] {
            let at = SurfacePoint { position: Vec3::new(0.0, 0.0, 1.0 - c), normal };
            let got: f32 = square(1.0).iter().map(|t| triangle_form_factor(&at, t)).sum();
            let across = SurfacePoint { position: Vec3::new(0.5, 0.0, 1.0 - c), normal };
            let clipped: f32 = square(1.0).iter().map(|t| triangle_form_factor(&across, t)).sum();
            assert!((got - expected).abs() < 5e-6 && clipped < got, "c = {c}: {got}, clipped {clipped}");
        }
    }
}
