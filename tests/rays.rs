//! Rays against brute force and against closed surfaces.

use glam::Vec3;
use glowtree::geometry::hash::Stream;
use glowtree::geometry::hemisphere::uniform_sphere;
use glowtree::rays::{Bvh, Ray};

fn random_point(stream: &mut Stream) -> Vec3 {
    Vec3::new(stream.unit(), stream.unit(), stream.unit())
}

/// Triangles of edge about `size` scattered over the unit cube.
fn soup(count: usize, size: f32, seed: u64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut stream = Stream::new(seed, 0);
    let mut vertices = Vec::new();
    for _ in 0..count {
        let middle = random_point(&mut stream);
        for _ in 0..3 {
            vertices.push(middle + (random_point(&mut stream) - 0.5) * size);
        }
    }
    let triangles = (0..count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    (vertices, triangles)
}

/// Möller and Trumbore in f64: distance and barycentrics.
fn brute_force(corners: [Vec3; 3], ray: &Ray) -> Option<(f64, f64, f64)> {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let (d, o) = (ray.direction.as_dvec3(), ray.origin.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let h = d.cross(e2);
    let determinant = e1.dot(h);
    let s = o - a;
    let u = s.dot(h) / determinant;
    let q = s.cross(e1);
    let v = d.dot(q) / determinant;
    let t = e2.dot(q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > f64::from(ray.t_min) && t < f64::from(ray.t_max))
        .then_some((t, u, v))
}

#[test]
fn hits_agree_with_brute_force() {
    let (vertices, triangles) = soup(3000, 0.1, 11);
    let bvh = Bvh::build_triangles(&vertices, &triangles);
    let mut stream = Stream::new(12, 0);
    let mut differing = 0;
    for _ in 0..3000 {
        let ray = Ray::new(random_point(&mut stream), uniform_sphere(stream.unit_pair()));
        let expected = triangles
            .iter()
            .enumerate()
            .filter_map(|(k, t)| {
                brute_force(t.map(|v| vertices[v as usize]), &ray).map(|hit| (k as u32, hit))
            })
            .min_by(|a, b| a.1.0.total_cmp(&b.1.0));
        match (expected, bvh.closest(&ray)) {
            (None, None) => {}
            (Some((triangle, (t, u, v))), Some(hit)) if triangle == hit.triangle => {
                // Coordinates of size one carry 6e-8, slivers and grazing rays magnify it.
                assert!((f64::from(hit.distance) - t).abs() < 1e-4, "{hit:?} {t}");
                assert!(
                    (f64::from(hit.u) - u).abs() < 1e-2 && (f64::from(hit.v) - v).abs() < 1e-2,
                    "{hit:?} {u} {v}"
                );
            }
            _ => differing += 1,
        }
        assert_eq!(bvh.occluded(&ray), bvh.closest(&ray).is_some());
    }
    // Rays within rounding of an edge or of two triangles' crossing: 3000 rays × ~20 near edges × 1e-6.
    assert!(differing <= 1, "{differing} rays of 3000 differ");
}

#[test]
fn degenerate_input_builds_and_is_never_met() {
    let ray = Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z);
    let empty = Bvh::build_triangles(&[], &[]);
    assert!(empty.closest(&ray).is_none() && !empty.occluded(&ray));
    let vertices =
        [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NAN, Vec3::new(f32::INFINITY, 0.0, 0.0), Vec3::X * 2.0];
    let bad = [[0, 0, 0], [0, 1, 5], [0, 1, 3], [0, 2, 4], [1, 1, 2]];
    let none = Bvh::build_triangles(&vertices, &bad);
    assert!(none.closest(&ray).is_none() && !none.occluded(&ray));
    let mut one = bad.to_vec();
    one.push([0, 1, 2]);
    let one = Bvh::build_triangles(&vertices, &one);
    let hit = one.closest(&ray).expect("the last triangle lies before the ray");
    assert_eq!((hit.triangle, hit.distance), (5, 1.0));
    assert!((hit.u - 0.2).abs() < 1e-6 && (hit.v - 0.2).abs() < 1e-6, "{hit:?}");
    assert!(
        one.closest(&Ray { t_max: 1.0, ..ray }).is_none()
            && one.closest(&Ray { t_min: 1.0, ..ray }).is_none()
    );
}
