//! Rays against brute force and against closed surfaces.

use glam::Vec3;
use glowtree::geometry::hash::Stream;
use glowtree::geometry::hemisphere::uniform_sphere;
use glowtree::rays::{Branch, Bvh, BvhView, Child, DEPTH_LIMIT, FAN, Ray};

#[path = "../benches/shapes/mod.rs"]
mod shapes;

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

#[test]
fn vector_kernels_give_the_same_bits_as_plain_code() {
    let mesh = shapes::bumpy_sphere(4);
    let soup = soup(2000, 0.2, 21);
    for (name, (vertices, triangles)) in [("sphere", &mesh), ("soup", &soup)] {
        let bvh = Bvh::build_triangles(vertices, triangles);
        let view = bvh.view();
        let mut rays = shapes::segments(&mesh, 20_000, 22);
        rays.extend(shapes::hemispheres(&mesh, 20_000, 23));
        rays.extend(aimed(vertices, triangles, 20_000, 24));
        // Axis-aligned ones have zeros in the direction, and start in planes of boxes.
        rays.extend((0..vertices.len().min(2000)).map(|k| Ray::new(vertices[k], -Vec3::AXES[k % 3])));
        for ray in rays {
            assert_eq!(view.closest(&ray), view.closest_scalar(&ray), "{name} {ray:?}");
            assert_eq!(view.occluded(&ray), view.occluded_scalar(&ray), "{name} {ray:?}");
        }
    }
}

/// Triangles of which two corners nearly coincide, or the third lies nearly between the others.
fn slivers(count: usize, seed: u64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut stream = Stream::new(seed, 0);
    let (mut vertices, triangles) = soup(count, 0.3, seed);
    for [a, b, c] in &triangles {
        let thin = 10.0f32.powf(-7.0 * stream.unit());
        let (from, to) = (vertices[*a as usize], vertices[*b as usize]);
        let along = if stream.unit() < 0.5 { 0.0 } else { stream.unit() };
        vertices[*c as usize] = from + (to - from) * along + (random_point(&mut stream) - 0.5) * (0.3 * thin);
    }
    (vertices, triangles)
}

#[test]
fn backs_are_met_along_the_normal() {
    let sphere = shapes::bumpy_sphere(5);
    for (name, (vertices, triangles)) in
        [("sphere", &sphere), ("soup", &soup(2000, 0.2, 41)), ("slivers", &slivers(20_000, 42))]
    {
        let bvh = Bvh::build_triangles(vertices, triangles);
        let (mut counts, mut unsure) = ([0, 0], 0);
        let rays = aimed(vertices, triangles, 30_000, 43);
        for (ray, turn) in rays.iter().flat_map(|ray| [(ray, false), (ray, true)]) {
            // From the other side, too, beyond the whole scene.
            let far = Ray::new(ray.origin + ray.direction * 4.0, -ray.direction);
            let ray = if turn { &far } else { ray };
            let Some(hit) = bvh.closest(ray) else { continue };
            assert_eq!(Some(hit), bvh.view().closest_scalar(ray), "{name} {ray:?}");
            let corners = triangles[hit.triangle as usize].map(|v| vertices[v as usize].as_dvec3());
            let [a, b, c] = corners;
            let (direction, origin) = (ray.direction.as_dvec3(), ray.origin.as_dvec3());
            let along = (b - a).cross(c - a).dot(direction);
            // A sheared coordinate x − s z carries five roundings of ε/2, of numbers up to the corner's distance D: it is
            // off by e = 2.5 ε D. Twice the sheared area, `along` over the direction's largest component, is the sum of six
            // products of such coordinates, none above S = 3 L + e, L the longest edge, since the ray passes between the
            // corners: six times off by 2 S e + e², and by 6 ε/2 S² for the products, 3 ε/2 · 2 S² for their differences
            // and 2 ε/2 · 6 S² for the sums.
            let eps = f64::from(f32::EPSILON);
            let reach = corners.iter().map(|p| p.distance(origin)).fold(0.0, f64::max);
            let edge = (b - a).length().max((c - b).length()).max((a - c).length());
            let off = 2.5 * eps * reach;
            let sheared = 3.0 * edge + off;
            let rounding = 6.0 * (2.0 * sheared * off + off * off) + 12.0 * eps * sheared * sheared;
            if along.abs() <= rounding * direction.abs().max_element() {
                unsure += 1;
                continue;
            }
            assert_eq!(
                hit.back,
                along > 0.0,
                "{name} {ray:?} {hit:?}: {along} by definition, {rounding} is rounding"
            );
            counts[usize::from(hit.back)] += 1;
        }
        println!("{name}: {counts:?} fronts and backs, {unsure} too close to tell");
        assert!(
            counts.iter().all(|&n| n > 500),
            "{name}: {counts:?} fronts and backs, {unsure} too close to tell"
        );
    }
}

#[test]
fn rays_that_are_not_finite_meet_nothing() {
    let (vertices, triangles) = shapes::icosphere(2);
    let bvh = Bvh::build_triangles(&vertices, &triangles);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for ray in [
            Ray::new(Vec3::splat(bad), Vec3::X),
            Ray::new(Vec3::ZERO, Vec3::new(bad, 0.0, 1.0)),
            Ray { t_min: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::X) },
            Ray { t_max: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::X) },
            Ray::new(Vec3::ZERO, Vec3::ZERO),
        ] {
            assert!(bvh.closest(&ray).is_none() && !bvh.occluded(&ray), "{ray:?}");
            assert!(
                bvh.view().closest_scalar(&ray).is_none() && !bvh.view().occluded_scalar(&ray),
                "{ray:?}"
            );
        }
    }
}

/// Rays from around the middle at vertices, at the middles of edges, and anywhere, in turn.
fn aimed(vertices: &[Vec3], triangles: &[[u32; 3]], count: u64, seed: u64) -> Vec<Ray> {
    let mut stream = Stream::new(seed, 0);
    let (lower, upper) = vertices.iter().fold((vertices[0], vertices[0]), |(l, u), &v| (l.min(v), u.max(v)));
    let middle = lower * 0.5 + upper * 0.5;
    let reach = (upper - lower).max_element();
    let one = |k: u64| {
        // 0.2 of the extent stays within every bumpy sphere, whose radius is at least 0.3 of it.
        let origin = middle + uniform_sphere(stream.unit_pair()) * (0.2 * reach * stream.unit());
        let number = ((stream.bits() >> 32) * triangles.len() as u64) >> 32;
        let [a, b, _] = triangles[number as usize].map(|v| vertices[v as usize]);
        let direction = match k % 3 {
            0 => a - origin,
            1 => (a * 0.5 + b * 0.5) - origin,
            _ => uniform_sphere(stream.unit_pair()),
        };
        Ray::new(origin, direction.normalize())
    };
    (0..count).map(one).collect()
}

/// Rays of `count` that leave closed surfaces of several sizes and places from the inside.
fn leaks(levels: &[u32], count: u64) -> u64 {
    let mut leaks = 0;
    for &level in levels {
        let (unit, triangles) = shapes::bumpy_sphere(level);
        for (k, (scale, offset)) in [
            (1.0, Vec3::ZERO),
            (1.0, Vec3::new(10.0, -3.0, 7.0)),
            (1e-4, Vec3::ZERO),
            (1e-4, Vec3::new(0.01, 0.02, -0.01)),
            (1e6, Vec3::new(1e6, 0.0, -2e6)),
            (1e-12, Vec3::ZERO),
        ]
        .into_iter()
        .enumerate()
        {
            let vertices: Vec<Vec3> = unit.iter().map(|&v| v * scale + offset).collect();
            let bvh = Bvh::build_triangles(&vertices, &triangles);
            for ray in aimed(&vertices, &triangles, count, 100 + k as u64) {
                let (hit, occluded) = (bvh.closest(&ray), bvh.occluded(&ray));
                if hit.is_none() || !occluded {
                    println!("leak: level {level}, scale {scale}, offset {offset}: {ray:?}");
                    leaks += 1;
                }
            }
        }
    }
    leaks
}

#[test]
fn closed_surfaces_are_watertight() {
    // 2 meshes × 6 placements × 30,000 rays, each as closest hit and as occlusion.
    assert_eq!(leaks(&[3, 6], 30_000), 0);
}

#[test]
#[ignore = "ten million rays, each asked twice, take about ten CPU seconds; run before a release and after any change to the kernels"]
fn closed_surfaces_are_watertight_at_length() {
    assert_eq!(leaks(&[2, 4, 6, 7], 420_000), 0);
}

#[test]
fn stored_arrays_are_checked_and_answer_alike() {
    let mesh = shapes::bumpy_sphere(3);
    let bvh = Bvh::build_triangles(&mesh.0, &mesh.1);
    let (mut branches, packets) = (bvh.view().branches().to_vec(), bvh.view().packets().to_vec());
    let bytes: &[u8] = bytemuck::cast_slice(&branches);
    assert_eq!(bytes.len(), 256 * branches.len());
    let view = BvhView::checked(&branches, &packets).expect("its own arrays are well-formed");
    for ray in shapes::segments(&mesh, 1000, 31) {
        assert_eq!(view.closest(&ray), bvh.closest(&ray));
    }
    let owned = Bvh::from_slices(&branches, &packets).expect("its own arrays are well-formed");
    assert_eq!(owned.view().packets().len(), packets.len());
    // Sabotage: cut the packets short, let the tree run in a circle, leave the array, and go too deep.
    assert!(BvhView::checked(&branches, &packets[1..]).is_err());
    let whole = branches.clone();
    let last = branches.len() - 1;
    branches[last].children[0] = Child::branch(last);
    assert!(BvhView::checked(&branches, &packets).is_err());
    branches[last].children[0] = Child::branch(last + 1);
    assert!(BvhView::checked(&branches, &packets).is_err());
    let chain: Vec<Branch> = (1..=DEPTH_LIMIT + 1)
        .map(|next| Branch { children: [Child::branch(next); FAN], ..Branch::vacant() })
        .chain([Branch::vacant()])
        .collect();
    assert!(BvhView::checked(&chain, &packets).is_err());
    assert!(BvhView::checked(&whole, &packets).is_ok());
}

#[test]
fn builds_do_not_depend_on_threads() {
    let (vertices, triangles) = shapes::bumpy_sphere(6);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a small pool starts");
        let bvh = pool.install(|| Bvh::build_triangles(&vertices, &triangles));
        let view = bvh.view();
        (
            bytemuck::cast_slice::<_, u8>(view.branches()).to_vec(),
            bytemuck::cast_slice::<_, u8>(view.packets()).to_vec(),
        )
    };
    assert!(build(1) == build(2), "one and two threads give different bytes");
}
