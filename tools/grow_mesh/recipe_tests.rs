//! What a user asks of a grown mesh, on meshes written and read again.

use std::collections::HashMap;

use clap::Parser;
use glam::DVec3;

use super::{Base, Recipe};
use crate::base::shapes::ball;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    recipe: Recipe,
}

/// The recipe of an option line.
fn recipe(line: &str) -> Recipe {
    let words = std::iter::once("grow_mesh").chain(line.split_whitespace());
    Line::try_parse_from(words).unwrap_or_else(|error| panic!("{error}")).recipe
}

/// The bytes of the mesh of an option line over a ball of 128 triangles.
fn bytes(line: &str) -> Vec<u8> {
    let (recipe, mut out) = (recipe(line), Vec::new());
    let base = recipe.prepared(ball(2)).expect("a base");
    recipe.grow(&base, "ball", &mut out).expect("a recipe").expect("a file");
    out
}

/// Positions and corners as the library's reader finds them, in the file's order.
fn grown(line: &str) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("grown.ply");
    std::fs::write(&path, bytes(line)).expect("a file");
    let base = Base::load(&path).expect("a mesh");
    (base.vertices, base.triangles)
}

/// How often each edge is run through in each of its two directions.
fn runs(faces: &[[u32; 3]]) -> HashMap<[u32; 2], [u32; 2]> {
    let mut met = HashMap::new();
    for &[a, b, c] in faces {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            met.entry([from.min(to), from.max(to)]).or_insert([0; 2])[usize::from(from > to)] += 1;
        }
    }
    met
}

/// Six times the enclosed volume.
fn volume((vertices, faces): &(Vec<DVec3>, Vec<[u32; 3]>)) -> f64 {
    let corner = |v: u32| vertices[v as usize];
    faces.iter().map(|&[a, b, c]| corner(a).dot(corner(b).cross(corner(c)))).sum()
}

#[test]
fn a_closed_base_gives_a_closed_mesh_of_k_squared_parts() {
    for k in [1, 2, 3, 4, 7, 10] {
        let (vertices, faces) = grown(&format!("-k {k}"));
        assert_eq!(faces.len(), 128 * k * k, "k = {k}");
        // Euler: V − E + F = 2 with 2E = 3F.
        assert_eq!(vertices.len(), faces.len() / 2 + 2, "k = {k}");
        for (edge, turns) in runs(&faces) {
            assert_eq!(turns, [1, 1], "edge {edge:?} of k = {k}");
        }
    }
}

#[test]
fn every_number_is_its_place_and_back() {
    // A mesh whose numbers were mixed up would still be closed, but its triangles would span the ball: edges of a k-th
    // of the base's 0.77 at the longest, half as much again for the noise.
    for k in [2, 3, 5, 8] {
        let (vertices, faces) = grown(&format!("-k {k} --duplicates 0.3"));
        for [a, b] in runs(&faces).into_keys() {
            let length = (vertices[a as usize] - vertices[b as usize]).length();
            assert!(length < 1.2 / f64::from(k), "an edge of {length} from {a} to {b}, k = {k}");
        }
    }
}

#[test]
fn any_number_of_threads_writes_the_same_bytes() {
    // 128 · 72² faces are eleven blocks: two rounds of one thread, one of two.
    let line = "-k 72 --shuffle --holes 0.05 --slivers 0.1 --duplicates 0.1";
    let by = |threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(|| bytes(line))
    };
    assert!(by(1) == by(2));
    assert!(by(1) != bytes(&line.replace("--shuffle", "--seed 2 --shuffle")));
}

#[test]
fn the_bytes_are_those_of_every_platform() {
    // Written down from x86-64; a change of the noise, the numbering or the format changes it and says so in its commit.
    let digest =
        xxhash_rust::xxh3::xxh3_64(&bytes("-k 6 --shuffle --holes 0.05 --slivers 0.1 --duplicates 0.1"));
    assert_eq!(digest, 0xe2df_dbac_aa06_eabd, "{digest:#018x}");
}

#[test]
fn a_shuffle_is_a_permutation_of_the_faces() {
    let (plain, shuffled) = (grown("-k 5"), grown("-k 5 --shuffle"));
    assert_eq!(plain.0, shuffled.0);
    assert!(plain.1 != shuffled.1);
    let sorted = |mut faces: Vec<[u32; 3]>| {
        faces.sort_unstable();
        faces
    };
    assert_eq!(sorted(plain.1), sorted(shuffled.1));
}

#[test]
fn meshes_of_one_seed_sample_one_surface() {
    // Through doubles, as bytes: the reader's frame depends on the vertices' bounds.
    let raw = |k: u32, edges: usize| -> Vec<[u8; 24]> {
        let file = bytes(&format!("-k {k} --double"));
        let start = file.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
        let count = 66 + edges * (k as usize - 1);
        file[start..start + 24 * count]
            .chunks_exact(24)
            .map(|row| row.try_into().expect("24 bytes"))
            .collect()
    };
    // The 66 vertices of the base, and the edges' middles.
    let (two, four) = (raw(2, 192), raw(4, 192));
    assert_eq!(two[..66], four[..66]);
    for edge in 0..192 {
        assert_eq!(two[66 + edge], four[66 + 3 * edge + 1], "edge {edge}");
    }
}

#[test]
fn the_noise_moves_the_surface_by_its_amplitude() {
    let (smooth, rough) = (grown("-k 8 --amplitude 0"), grown("-k 8 --amplitude 0.05"));
    let moved = smooth.0.iter().zip(&rough.0).map(|(a, b)| (a - b).length_squared()).sum::<f64>()
        / smooth.0.len() as f64;
    let asked = 0.05 * ball(2).mean_edge;
    // Some (4π / mean edge² / 6.4²) ≈ 1 independent cell of the first octave lies on the ball, which has three quarters
    // of the variance: a factor of two both ways.
    assert!((0.5..2.0).contains(&(moved.sqrt() / asked)), "{} for {asked}", moved.sqrt());
    assert!(volume(&smooth) > 0.0 && volume(&rough) > 0.0);
}

#[test]
fn holes_leave_borders_and_their_share() {
    let (_, faces) = grown("-k 3 --holes 0.2");
    let kept = faces.len() as f64 / (128.0 * 9.0);
    // Whole fans of at most six of 128 triangles.
    assert!((0.75..=0.8).contains(&kept), "{kept}");
    let borders = runs(&faces).into_values().filter(|turns| turns.iter().sum::<u32>() == 1).count();
    assert!(borders >= 3 * 4, "{borders} border edges");
}

#[test]
fn slivers_have_their_share_and_the_surface_stays_closed() {
    let (vertices, faces) = grown("-k 9 --slivers 0.1 --amplitude 0");
    let sliver = |face: &&[u32; 3]| {
        let [a, b, c] = face.map(|v| vertices[v as usize]);
        let longest = [b - a, c - b, a - c].map(DVec3::length_squared).into_iter().fold(0.0, f64::max);
        longest > 100.0 * 0.5 * (b - a).cross(c - a).length()
    };
    let share = faces.iter().filter(sliver).count() as f64 / faces.len() as f64;
    // Squeezed triangles hold 0.35 slivers: 36.8 of 128 are drawn, binomial deviation 5.1; three of them.
    assert!((share - 0.1).abs() < 0.1 * 3.0 * 5.1 / 36.8, "{share}");
    assert!(runs(&faces).into_values().all(|turns| turns == [1, 1]));
    let (plain, squeezed) = (volume(&grown("-k 9 --amplitude 0")), volume(&(vertices, faces)));
    // Other samples of one surface: the volumes differ by the sagitta of a ninth of an edge, (0.77/9)²/8 = 1e-3, thrice.
    assert!((squeezed / plain - 1.0).abs() < 3.0e-3, "{squeezed} {plain}");
    assert!(recipe("-k 2 --slivers 0.1").counts(&ball(1)).is_err());
}

#[test]
fn torn_triangles_have_vertices_of_their_own_at_the_same_places() {
    let (vertices, faces) = grown("-k 4 --duplicates 0.2");
    let whole = grown("-k 4");
    let copies = vertices.len() - whole.0.len();
    // 25.6 of 128 triangles, binomial deviation 4.5; three of them. 3k vertices each.
    assert_eq!(copies % 12, 0);
    assert!((12..=39).contains(&(copies / 12)), "{copies} copies");
    assert!(runs(&faces).into_values().any(|turns| turns.iter().sum::<u32>() == 1), "nothing is torn");
    let bits = |v: u32, of: &[DVec3]| of[v as usize].to_array().map(f64::to_bits);
    // Welded by place it is the whole mesh again.
    for (face, same) in faces.iter().zip(&whole.1) {
        assert_eq!(face.map(|v| bits(v, &vertices)), same.map(|v| bits(v, &whole.0)));
    }
}

#[test]
fn every_encoding_reads_back_alike() {
    let little = grown("-k 3");
    assert!(grown("-k 3 --big-endian") == little);
    for line in ["-k 3 --ascii", "-k 3 --double", "-k 3 --double --ascii", "-k 3 --double --big-endian"] {
        let (vertices, faces) = grown(line);
        assert_eq!(faces, little.1, "{line}");
        // Floats of the size of 1 and the reader's own rounding.
        assert!(vertices.iter().zip(&little.0).all(|(a, b)| (*a - *b).length() < 1.0e-6), "{line}");
    }
}

#[test]
fn an_offset_moves_doubles_exactly_enough() {
    let (near, far) = (grown("-k 3 --double"), grown("-k 3 --double --offset 500000.25,-5400000.5,130"));
    let offset = DVec3::new(500_000.25, -5_400_000.5, 130.0);
    // The reader keeps f32 about the middle of the mesh: 1e-7 of its size.
    assert!(near.0.iter().zip(&far.0).all(|(a, b)| (*b - offset - *a).length() < 1.0e-6));
}

#[test]
fn what_has_no_meaning_is_refused() {
    for line in [
        "-k 0",
        "-k 5000",
        "-k 2 --holes 1.5",
        "-k 2 --ascii --big-endian",
        "-k 2 --offset 1,2",
        "--octaves 3",
    ] {
        let words = std::iter::once("grow_mesh").chain(line.split_whitespace());
        assert!(Line::try_parse_from(words).is_err(), "{line}");
    }
    assert!(recipe("-k 2 --amplitude NaN").prepared(ball(0)).is_err());
    assert!(recipe("-k 2 --wavelength 0").prepared(ball(0)).is_err());
    // 2048 triangles of 4096² / 2 vertices are more than a PLY numbers.
    assert!(recipe("-k 4096").counts(&ball(4)).is_err());
}
