//! Files that are no meshes are refused with the row.

use glam::{DAffine3, Vec3};
use glowtree::Error;
use glowtree::scene::ply::stream::Stream;

use super::files::{Form, little, ply};
use super::scene_shared::{Folder, SQUARE_PLY};
use super::{PARAMS, cut, refused, small};

fn refusal(name: &str, bytes: impl AsRef<[u8]>) -> (String, String) {
    let folder = Folder::new();
    let path = folder.write(name, bytes);
    let streamed = refused(cut(&path, &DAffine3::IDENTITY, None, &PARAMS));
    // The reader in memory says the same, except of which byte where it reads in another order.
    match glowtree::scene::ply::read(&path) {
        Err(Error::Input { place, problem, .. }) => assert_eq!((place, problem), streamed, "{name}"),
        other => panic!("{name}: the reader in memory says {:?}", other.map(|_| "nothing")),
    }
    streamed
}

#[test]
fn indices_out_of_range_name_their_row() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let mut mesh = small();
        mesh.1[77][1] = 5000;
        let (place, problem) = refusal("index.ply", ply(&mesh, &Form { format, ..little() }));
        assert!(place.contains("face row 77"), "{format}: {place}");
        assert!(problem.contains("vertex index 5000 is out of range, there are 162 vertices"), "{problem}");
    }
    let (place, problem) = refusal("minus.ply", SQUARE_PLY.replace("4 0 1 2 3", "3 0 1 -2"));
    assert!(place.contains("face row 0") && problem.contains("-2"), "{place}: {problem}");
}

#[test]
fn positions_that_are_nowhere_name_their_row() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let mut mesh = small();
        mesh.0[33].y = f32::NAN;
        let (place, problem) = refusal("nan.ply", ply(&mesh, &Form { format, ..little() }));
        assert!(place.contains("vertex row 33") && problem.contains("not finite"), "{place}: {problem}");
    }
}

#[test]
fn cut_files_name_the_row_that_is_missing() {
    let whole = ply(&small(), &little());
    // Within the last row, within another, and so short that the header's counts tell.
    let lengths =
        [(whole.len() - 5, "face row 319"), (whole.len() / 2, "face row 78"), (700, "element vertex")];
    for (length, what) in lengths {
        let (place, problem) = refusal("short.ply", &whole[..length]);
        assert!(place.contains(what) && problem.contains("truncated"), "{length}: {place}: {problem}");
    }
}

#[test]
fn meshes_without_a_triangle_or_an_extent_are_refused() {
    let (_, problem) = refusal("short.ply", SQUARE_PLY.replace("4 0 1 2 3", "2 0 1"));
    assert!(problem.contains("no triangle"), "{problem}");
    let folder = Folder::new();
    let mut mesh = small();
    mesh.0.fill(Vec3::ONE);
    let path = folder.write("point.ply", ply(&mesh, &little()));
    let (_, problem) = refused(cut(&path, &DAffine3::IDENTITY, None, &PARAMS));
    assert!(problem.contains("one point"), "{problem}");
}

#[test]
fn transforms_into_nowhere_name_the_vertex() {
    let folder = Folder::new();
    let path = folder.write("mesh.ply", ply(&small(), &little()));
    let by = DAffine3::from_scale(glam::DVec3::splat(1e308) * 4.0);
    let (place, problem) = refused(cut(&path, &by, None, &PARAMS));
    assert!(place.contains("vertex row 0") && problem.contains("out of range"), "{place}: {problem}");
}

#[test]
fn a_file_cut_while_it_is_in_use_is_an_error() {
    let folder = Folder::new();
    let path = folder.write("mesh.ply", ply(&small(), &little()));
    let stream = Stream::open(&path, folder.path()).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(1000).unwrap();
    assert!(matches!(stream.check_whole(), Err(Error::Io { .. })));
}
