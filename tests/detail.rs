//! Meshes cut into chunks hold what the same meshes in memory hold, and their proxies stand in for them.
#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

#[path = "detail/bad.rs"]
mod bad;
#[path = "detail/files.rs"]
mod files;
#[path = "detail/proxy.rs"]
mod proxy;
#[path = "detail/runs.rs"]
mod runs;
mod scene_shared;
#[path = "../benches/shapes/mod.rs"]
#[allow(dead_code)]
mod shapes;

use std::path::Path;
use std::sync::Arc;

use files::{Form, little, ply, shuffled};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use glowtree::archive::{Digest, Digests, Disk, Storage};
use glowtree::detail::{CutParams, Detail, Shards, write};
use glowtree::geometry::octahedral;
use glowtree::output::normals::{Weight, vertex_normals};
use glowtree::rays::{BvhView, Packet};
use glowtree::scene::ply::stream::Stream;
use glowtree::scene::{self, Placement, Scene};
use glowtree::{Error, Result};
use scene_shared::Folder;
use shapes::{Mesh, bumpy_sphere};

const PARAMS: CutParams = CutParams { chunk_triangles: 3000, proxy_triangles: 2000 };

fn digests() -> Digests {
    Digests { inputs: Digest::of_bytes(b"mesh"), options: Digest::of_bytes(b"options") }
}

/// Cuts a file and opens what comes out, with scratch and archive named after it.
fn cut(
    path: &Path,
    transform: &DAffine3,
    placement: Option<Placement>,
    params: &CutParams,
) -> Result<Detail> {
    let scratch = path.with_extension("scratch");
    let stream = Stream::open(path, &scratch)?;
    let pause = &|| Ok(());
    let shards = Shards::make(&stream, transform, params, &scratch, pause)?;
    let [low, high] = shards.bounds();
    let own = Placement { origin: low * 0.5 + high * 0.5, scale: (high - low).max_element() };
    let archive = path.with_extension("glow");
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    let (placement, mut heard) = (placement.unwrap_or(own), 0);
    write((&storage, &archive), digests(), (&stream, &shards, &placement), pause, |count| heard += count)?;
    assert_eq!(heard, shards.triangles(), "all triangles are announced");
    Detail::open(&archive, Some(digests()))
}

type Corners = [[u32; 3]; 3];

/// Corners that do not depend on which comes first.
fn key(corners: [Vec3; 3]) -> Corners {
    let bits = corners.map(|corner| corner.to_array().map(f32::to_bits));
    [[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|turn: [usize; 3]| turn.map(|k| bits[k])).into_iter().min().unwrap()
}

/// All triangles of all chunks, sorted; hierarchies are checked on the way.
fn triangles(detail: &Detail) -> Vec<Corners> {
    let mut all = Vec::new();
    for chunk in 0..detail.chunk_count() {
        let packets: &[Packet] = detail.packets(chunk).array().unwrap();
        BvhView::checked(detail.branches(chunk).array().unwrap(), packets).unwrap();
        let [low, high] = detail.bounds(chunk);
        let mut count = 0;
        for (at, packet) in packets.iter().enumerate() {
            for lane in (0..4).filter(|&lane| packet.triangle[lane] != glowtree::rays::NO_TRIANGLE) {
                let corner = |k: usize| Vec3::from_array([0, 1, 2].map(|axis| packet.corners[k][axis][lane]));
                let corners = [corner(0), corner(1), corner(2)];
                assert!(corners.iter().all(|at| at.clamp(low, high) == *at), "outside of the chunk's box");
                all.push(key(corners));
                assert_eq!(packet.triangle[lane] as usize, 4 * at + lane, "triangles are numbered by place");
                count += 1;
            }
        }
        let range = detail.branches(chunk).range();
        assert_eq!(count, range.end - range.start, "triangles of chunk {chunk}");
    }
    all.sort_unstable();
    all
}

/// Per vertex the sum of the faces' area vectors in doubles, and of their lengths.
fn area_sums(scene: &Scene) -> Vec<(DVec3, f64)> {
    let mut sums = vec![(DVec3::ZERO, 0.0); scene.vertices.len()];
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.map(|corner| scene.vertices[corner as usize].as_dvec3());
        let along = (b - a).cross(c - a);
        for &corner in triangle {
            let (sum, size) = &mut sums[corner as usize];
            *sum += along;
            *size += along.length();
        }
    }
    sums
}

/// Holds a cut mesh to the same mesh in memory.
fn assert_same(detail: &Detail, scene: &Scene, what: &str) {
    let mut expected: Vec<Corners> =
        (0..scene.triangles.len() as u32).map(|id| key(scene.corners(id))).collect();
    expected.sort_unstable();
    assert!(triangles(detail) == expected, "{what}: triangles differ");
    assert_eq!(detail.triangles(), expected.len() as u64, "{what}");
    assert_eq!(detail.vertices(), scene.vertices.len() as u64, "{what}");
    let (normals, sums) = (vertex_normals(scene, Weight::Area), area_sums(scene));
    let mut seen = vec![false; scene.vertices.len()];
    for chunk in 0..detail.chunk_count() {
        let (ids, points) = (detail.ids(chunk).unwrap(), detail.points(chunk).unwrap());
        let codes = detail.normals(chunk).unwrap();
        let colours = detail.colours(chunk).unwrap();
        assert!(ids.is_sorted_by(|a, b| a < b), "{what}: chunk {chunk}");
        for (at, &id) in ids.iter().enumerate() {
            assert!(!std::mem::replace(&mut seen[id as usize], true), "{what}: vertex {id} twice");
            assert_eq!(points[at], scene.vertices[id as usize], "{what}: vertex {id}");
            let (normal, expected) = (octahedral::decode(codes[at]), normals[id as usize]);
            assert_eq!(codes[at] == octahedral::NONE, expected == Vec3::ZERO, "{what}: vertex {id}");
            // Sums run over the same faces in the same order, so that the code's error is all.
            assert!((normal - expected).length() < octahedral::ERROR, "{what}: {normal} for {expected}");
            // Both take their means from one place in the library; this one is its own. Ten f32 terms of an error of four
            // roundings each, over a sum that is a tenth of them at the least: 2.4e-5.
            let (sum, size) = sums[id as usize];
            if scene.meshes[0].normals.is_none() && sum.length() > 0.1 * size {
                let off = (normal.as_dvec3() - sum.normalize()).length();
                assert!(off < f64::from(octahedral::ERROR) + 2.4e-5, "{what}: vertex {id} is {off} off");
            }
            if let Some(colours) = colours {
                let scene::Albedo::Vertex(values) = &scene.meshes[0].albedo else {
                    panic!("{what}: no colours")
                };
                let colour = Vec3::from_array(colours[at].map(f32::from));
                let expected = values[id as usize];
                // Half a unit in the last of eleven bits; below 2^-14, of a fixed step of 2^-25.
                let near = (colour - expected).abs().cmple(expected * 4.9e-4 + 3e-8).all();
                assert!(near, "{what}: {colour} for {expected}");
            }
        }
    }
    let mut used = vec![false; scene.vertices.len()];
    scene.triangles.iter().flatten().for_each(|&corner| used[corner as usize] = true);
    assert!(used.iter().zip(&seen).all(|(used, seen)| *seen || !used), "{what}: a used vertex is missing");
}

#[test]
fn chunks_hold_what_the_reader_reads() {
    let folder = Folder::new();
    let mut mesh = bumpy_sphere(5);
    let count = mesh.0.len() as u32;
    // Two sides of a sheet, a triangle without area, and one in a point: vertices 0 to 2 are used by others too.
    mesh.0.extend([Vec3::splat(1.5), Vec3::new(1.5, 1.6, 1.5), Vec3::new(1.6, 1.5, 1.5), Vec3::splat(1.4)]);
    mesh.1.extend([[count, count + 1, count + 2], [count + 2, count + 1, count], [0, 1, 1]]);
    mesh.1.push([count + 3, count + 3, count + 3]);
    let path = folder.write("mesh.ply", ply(&mesh, &little()));
    let scene = scene::load(&path).unwrap();
    let detail = cut(&path, &DAffine3::IDENTITY, Some(scene.placement), &PARAMS).unwrap();
    assert_same(&detail, &scene, "plain");
    assert_eq!(scene.triangles.len(), mesh.1.len() - 2);
    let chunks = detail.chunk_count();
    assert!((7..20).contains(&chunks), "{chunks} chunks of 3000 for {} triangles", mesh.1.len());
    let sizes = (0..chunks).map(|chunk| detail.branches(chunk).entry().count);
    // A block of cells is an eightieth of the sphere: 256 triangles, and half its neighbours' come with it.
    assert!(sizes.clone().all(|size| size < 3600), "{:?}", sizes.collect::<Vec<_>>());
}

#[test]
fn normals_and_colours_of_the_file_come_along() {
    let folder = Folder::new();
    let mesh = bumpy_sphere(4);
    let towards = |at: &Vec3| if at.x > 0.0 { *at } else { at.any_orthogonal_vector() };
    let byte = |value: f32| ((value + 1.3) * 95.0) as u8;
    let form = Form {
        normals: Some(mesh.0.iter().map(towards).collect()),
        colours: Some(mesh.0.iter().map(|at| [byte(at.x), byte(at.y), byte(at.z)]).collect()),
        ..little()
    };
    let path = folder.write("mesh.ply", ply(&mesh, &form));
    let scene = scene::load(&path).unwrap();
    let params = CutParams { chunk_triangles: 1500, ..PARAMS };
    assert_same(&cut(&path, &DAffine3::IDENTITY, Some(scene.placement), &params).unwrap(), &scene, "plain");

    let turned = "[[mesh]]\nfile = \"mesh.ply\"\n[mesh.transform]\nscale = [-1.0, 2.0, 0.5]\nrotate = [1, 2, 3, 40]\ntranslate = [10, 20, 30]\n[sky]\nradiance = 1.0\n";
    let scene = folder.load("scene.toml", turned).unwrap();
    let axis = DVec3::new(1.0, 2.0, 3.0).normalize();
    let by = DAffine3::from_scale_rotation_translation(
        DVec3::new(-1.0, 2.0, 0.5),
        DQuat::from_axis_angle(axis, 40f64.to_radians()),
        DVec3::new(10.0, 20.0, 30.0),
    );
    let again = folder.write("turned.ply", ply(&mesh, &form));
    assert_same(&cut(&again, &by, Some(scene.placement), &params).unwrap(), &scene, "mirrored");
}

#[test]
fn encodings_give_the_same_bytes() {
    let folder = Folder::new();
    let mesh = bumpy_sphere(4);
    let form = Form {
        colours: Some(mesh.0.iter().map(|at| at.to_array().map(|x| (x * 40.0 + 90.0) as u8)).collect()),
        ..little()
    };
    let made = ["ascii", "binary_little_endian", "binary_big_endian"].map(|format| {
        let path = folder.write(&format!("{format}.ply"), ply(&mesh, &Form { format, ..form.clone() }));
        cut(&path, &DAffine3::IDENTITY, None, &PARAMS).unwrap();
        std::fs::read(path.with_extension("glow")).unwrap()
    });
    assert!(made[0] == made[1] && made[1] == made[2], "archives differ");
}

#[test]
fn the_order_of_faces_does_not_matter() {
    let folder = Folder::new();
    let mesh = bumpy_sphere(4);
    let path = folder.write("mesh.ply", ply(&mesh, &little()));
    let expected = cut(&path, &DAffine3::IDENTITY, None, &PARAMS).unwrap();
    let path = folder.write("shuffled.ply", ply(&shuffled(&mesh, 5), &little()));
    let detail = cut(&path, &DAffine3::IDENTITY, None, &PARAMS).unwrap();
    assert!(triangles(&detail) == triangles(&expected), "triangles differ");
    assert_eq!(detail.chunk_count(), expected.chunk_count());
    for chunk in 0..detail.chunk_count() {
        assert!(detail.ids(chunk).unwrap() == expected.ids(chunk).unwrap(), "vertices of chunk {chunk}");
        assert!(detail.points(chunk).unwrap() == expected.points(chunk).unwrap(), "points of chunk {chunk}");
        for (a, b) in detail.normals(chunk).unwrap().iter().zip(expected.normals(chunk).unwrap()) {
            // Six to ten f32 terms in another order, then two codes: roundings of 1e-6 may turn into a step of either.
            let difference = (octahedral::decode(*a) - octahedral::decode(*b)).length();
            assert!(difference < 2.0 * octahedral::ERROR, "{difference}");
        }
    }
    let (a, b) = (detail.proxy().unwrap(), expected.proxy().unwrap());
    assert!(a.positions == b.positions && a.triangles == b.triangles, "proxies differ");
}

#[test]
fn coordinates_far_from_the_origin_keep_their_digits() {
    let folder = Folder::new();
    let mesh = bumpy_sphere(3);
    let far = DVec3::new(5.1e6, 4.2e6, 310.0);
    let path = folder.write("far.ply", ply(&mesh, &Form { far: Some(far), ..little() }));
    let detail = cut(&path, &DAffine3::IDENTITY, None, &PARAMS).unwrap();
    let placement = detail.placement();
    for chunk in 0..detail.chunk_count() {
        for (&id, &point) in detail.ids(chunk).unwrap().iter().zip(detail.points(chunk).unwrap()) {
            let error = (placement.to_world(point) - far - mesh.0[id as usize].as_dvec3()).length();
            // Half a unit in the last place of coordinates up to 0.5 is 3e-8 of the extent, on three axes.
            assert!(error < 1e-7 * placement.scale, "vertex {id}: {error}");
        }
    }
}

#[test]
fn a_vertex_that_no_face_uses_does_no_harm() {
    let folder = Folder::new();
    let mesh = bumpy_sphere(4);
    let path = folder.write("mesh.ply", ply(&mesh, &little()));
    let expected = cut(&path, &DAffine3::IDENTITY, None, &PARAMS).unwrap();
    let mut astray = mesh.clone();
    astray.0.push(Vec3::new(-3e30, 1e20, 7.0));
    let path = folder.write("astray.ply", ply(&astray, &little()));
    let detail = cut(&path, &DAffine3::IDENTITY, None, &PARAMS).unwrap();
    assert_eq!(detail.cell(), expected.cell());
    assert_eq!(detail.world_bounds(), expected.world_bounds());
    assert_eq!(detail.vertices(), expected.vertices() + 1);
    assert_eq!(detail.chunk_count(), expected.chunk_count());
    for chunk in 0..detail.chunk_count() {
        assert!(detail.ids(chunk).unwrap() == expected.ids(chunk).unwrap(), "chunk {chunk}");
    }
    assert!(triangles(&detail) == triangles(&expected), "triangles differ");
}

/// What a cut leaves out is an error of the test, not of the library.
fn refused(outcome: Result<Detail>) -> (String, String) {
    match outcome {
        Err(Error::Input { place, problem, .. }) => (place, problem),
        other => panic!("expected an error of the input, got {other:?}"),
    }
}

/// The mesh, for tests that only need one.
fn small() -> Mesh {
    bumpy_sphere(2)
}
