//! The surface that a given point stands on.

use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::rays::{Bvh, Hit, Ray};
use crate::scene::Scene;

/// How far above and below a point its surface is looked for, local units: first as far as coordinates written with
/// four digits err, then as far as a simplified or moved mesh may.
const REACHES: [f32; 3] = [1.0e-4, 1.0e-3, 1.0e-2];

/// What a surface does at a point, on the side asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footing {
    /// Diffuse reflectance; black on the back of a one-sided mesh.
    pub albedo: Rgb,
    /// Emitted radiosity, W·m⁻².
    pub exitance: Rgb,
}

/// The surface under `point`: the nearest within a hundredth of the scene that the point's normal line meets.
pub fn footing(scene: &Scene, bvh: &Bvh, point: &SurfacePoint) -> Option<Footing> {
    let hit = REACHES.iter().find_map(|&reach| nearest(bvh, point, reach))?;
    let mesh = &scene.meshes[scene.mesh_of(hit.triangle)];
    if !mesh.two_sided && scene.normal(hit.triangle).dot(point.normal) < 0.0 {
        return Some(Footing { albedo: Rgb::ZERO, exitance: Rgb::ZERO });
    }
    Some(Footing {
        albedo: scene.albedo(hit.triangle, hit.u, hit.v),
        exitance: mesh.radiance * std::f32::consts::PI,
    })
}

/// The hit nearest to the point on its normal line, at most `reach` away.
fn nearest(bvh: &Bvh, point: &SurfacePoint, reach: f32) -> Option<Hit> {
    let origin = point.position + point.normal * reach;
    let mut ray = Ray { origin, direction: -point.normal, t_min: 0.0, t_max: 2.0 * reach };
    let mut best: Option<Hit> = None;
    while let Some(hit) = bvh.closest(&ray) {
        let away = |hit: &Hit| (hit.distance - reach).abs();
        if best.as_ref().is_some_and(|best| away(best) <= away(&hit)) {
            break;
        }
        best = Some(hit);
        ray.t_min = hit.distance;
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;
    use glam::Vec3;

    #[test]
    fn the_nearest_surface_carries_the_point_and_backs_are_black() {
        let mut scene = synthetic::square();
        scene.meshes[0].radiance = Vec3::ONE;
        let bvh = Bvh::build(&scene);
        let at = |z: f32, normal: Vec3| {
            footing(&scene, &bvh, &SurfacePoint { position: Vec3::new(0.3, 0.4, z), normal })
        };
        let front = Footing { albedo: Vec3::splat(0.5), exitance: Vec3::splat(std::f32::consts::PI) };
        assert_eq!(at(0.0, Vec3::Z), Some(front));
        assert_eq!(at(-0.005, Vec3::Z), Some(front));
        assert_eq!(at(0.02, Vec3::Z), None);
        assert_eq!(at(0.0, Vec3::NEG_Z), Some(Footing { albedo: Vec3::ZERO, exitance: Vec3::ZERO }));
    }
}
