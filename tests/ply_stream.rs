//! PLY files read row by row give what the reader of whole meshes gives.
#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod scene_shared;

use std::path::Path;

use glam::{DVec3, Vec3};
use glowtree::scene::assemble::Part;
use glowtree::scene::ply::{self, stream::BLOCK, stream::Stream};
use glowtree::{Error, Result};
use scene_shared::{Folder, SQUARE_PLY, shared};

/// All that a stream gives, as the other reader has it.
fn streamed(path: &Path, scratch: &Path) -> Result<(Part, Vec<String>)> {
    let stream = Stream::open(path, scratch)?;
    let mut part = Part::default();
    let notes = stream.faces(|triangles| {
        assert!(triangles.len() <= BLOCK);
        part.triangles.extend_from_slice(triangles);
        Ok(())
    })?;
    stream.check(0..stream.vertex_count() as u32)?;
    assert_eq!(notes.triangles, part.triangles.len() as u64);
    let vertices = || 0..stream.vertex_count() as u32;
    part.positions = vertices().map(|vertex| stream.position(vertex)).collect();
    part.normals = vertices().map(|vertex| stream.normal(vertex)).collect();
    part.colours = vertices().map(|vertex| stream.colour(vertex)).collect();
    let warnings =
        stream.warnings().iter().chain(&notes.warnings(&stream)).map(|w| w.message.clone()).collect();
    Ok((part, warnings))
}

/// Holds a stream to the reader; gives the mesh if it is one.
fn compare(path: &Path) -> Option<Part> {
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let scratch = tempfile::tempdir().unwrap();
    let outcome = streamed(path, scratch.path());
    match (ply::read(path), outcome) {
        (Ok(mut contents), Ok((part, mut warnings))) => {
            let expected = contents.parts.remove(0);
            assert!(part.positions == expected.positions, "{name}: positions");
            assert!(part.triangles == expected.triangles, "{name}: triangles");
            let bits = |normals: Option<Vec<Vec3>>| {
                normals.map(|list| list.iter().map(|n| n.to_array().map(f32::to_bits)).collect::<Vec<_>>())
            };
            assert!(bits(part.normals.clone()) == bits(expected.normals), "{name}: normals");
            let of_faces = warnings.iter().position(|message| message.contains("per face"));
            if let Some(at) = of_faces {
                warnings.remove(at);
                contents.warnings.retain(|warning| !warning.message.contains("per face"));
            } else {
                assert!(part.colours == expected.colours, "{name}: colours");
            }
            let mut messages: Vec<String> = contents.warnings.iter().map(|w| w.message.clone()).collect();
            // Lines after the last table are only looked at when that table holds the faces.
            messages.retain(|message| !message.contains("lines follow"));
            warnings.retain(|message| !message.contains("lines follow"));
            messages.sort();
            warnings.sort();
            assert_eq!(messages, warnings, "{name}");
            Some(part)
        }
        (Err(expected), Err(found)) => {
            let said = |error: &Error| match error {
                Error::Input { problem, .. } => problem.clone(),
                other => other.to_string(),
            };
            assert_eq!(said(&expected), said(&found), "{name}");
            None
        }
        (expected, found) => {
            let (expected, found) = (expected.map(|_| "a mesh"), found.map(|_| "a mesh"));
            panic!("{name}: the reader says {expected:?}, the stream {found:?}")
        }
    }
}

#[test]
fn odd_and_broken_files_are_read_alike() {
    let mut meshes = 0;
    for folder in ["data/bad-input/ply", "data/meshes"] {
        let Some(folder) = shared(folder) else { return };
        let mut files: Vec<_> =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.retain(|file| file.extension().is_some_and(|extension| extension == "ply"));
        files.sort();
        meshes += files.iter().filter_map(|file| compare(file)).count();
    }
    assert!(meshes > 20, "{meshes} meshes");
}

const TABLES: &str = "element vertex 6\nproperty double z\nproperty list uchar short note\nproperty float y\nproperty float x\n\
property float red\nproperty float green\nproperty float blue\nproperty float nx\nproperty float ny\nproperty float nz\n";

/// A file with lists among the vertices' properties, polygons, strips, and a table in between.
fn odd(faces_first: bool) -> Vec<u8> {
    let faces = "element face 3\nproperty list uchar int vertex_indices\nproperty uchar flag\n";
    let other = "element edge 2\nproperty list uchar int ends\n";
    let strips = "element tristrips 1\nproperty list int int vertex_indices\n";
    let tables = if faces_first { [faces, other, TABLES, strips] } else { [TABLES, other, faces, strips] };
    let mut bytes =
        format!("ply\nformat binary_little_endian 1.0\n{}end_header\n", tables.concat()).into_bytes();
    let mut vertices = Vec::new();
    for (k, (x, y)) in
        [(0f32, 0f32), (1., 0.), (1., 1.), (0., 1.), (0.5, 0.5), (2., 2.)].into_iter().enumerate()
    {
        vertices.extend((0.1 * k as f64).to_le_bytes());
        vertices.push(k as u8);
        (0..k).for_each(|_| vertices.extend(7i16.to_le_bytes()));
        for value in [y, x, 200.0, 100.0, 0.0, 0.0, 0.6, 0.8] {
            vertices.extend(value.to_le_bytes());
        }
    }
    let mut rows = Vec::new();
    for face in [&[0, 1, 2, 4, 3][..], &[0, 1], &[1, 2, 5]] {
        rows.push(face.len() as u8);
        face.iter().for_each(|corner: &i32| rows.extend(corner.to_le_bytes()));
        rows.push(9);
    }
    let mut ends = Vec::new();
    for edge in [[0i32, 1], [1, 2]] {
        ends.push(2);
        edge.iter().for_each(|end| ends.extend(end.to_le_bytes()));
    }
    let mut run = 9i32.to_le_bytes().to_vec();
    [0, 1, 2, 3, -1, 3, 4, 5, 0].iter().for_each(|index: &i32| run.extend(index.to_le_bytes()));
    let order = if faces_first { [&rows, &ends, &vertices] } else { [&vertices, &ends, &rows] };
    order.iter().for_each(|table| bytes.extend(*table));
    bytes.extend(run);
    bytes
}

#[test]
fn tables_may_come_in_any_order_and_form() {
    let folder = Folder::new();
    for faces_first in [false, true] {
        let part = compare(&folder.write("odd.ply", odd(faces_first))).expect("a mesh");
        // A concave polygon of five corners, a triangle, strips of two and two; one face is too short.
        assert_eq!(part.triangles.len(), 3 + 1 + 2 + 2);
        assert_eq!(part.positions[5], DVec3::new(2.0, 2.0, 0.5));
    }
    for text in
        [SQUARE_PLY.to_string(), SQUARE_PLY.replace('\n', "\r"), SQUARE_PLY.replace("4 0 1 2 3", "3 0 1 2 3")]
    {
        compare(&folder.write("text.ply", text)).expect("a mesh");
    }
}

#[test]
fn long_strips_and_many_rows_come_in_blocks() {
    let folder = Folder::new();
    let count = 100_000u32;
    let head = |face: &str| {
        format!(
            "ply\nformat binary_big_endian 1.0\nelement vertex {count}\nproperty short x\nproperty float y\nproperty float z\n{face}end_header\n"
        )
    };
    let mut vertices = Vec::new();
    for k in 0..count {
        vertices.extend(((k % 30_000) as i16).to_be_bytes());
        [(k % 2) as f32, (k / 30_000) as f32]
            .iter()
            .for_each(|value: &f32| vertices.extend(value.to_be_bytes()));
    }
    let mut strip = head("element tristrips 1\nproperty list int int vertex_indices\n").into_bytes();
    strip.extend(&vertices);
    strip.extend(count.to_be_bytes());
    (0..count).for_each(|k| strip.extend(k.to_be_bytes()));
    let part = compare(&folder.write("strip.ply", strip)).expect("a mesh");
    assert_eq!(part.triangles.len(), count as usize - 2);

    // A quadrilateral among the triangles of the second block.
    let rows = count - 4;
    let mut faces =
        head(&format!("element face {rows}\nproperty list uchar uint vertex_indices\n")).into_bytes();
    faces.extend(&vertices);
    for k in 0..rows {
        let corners = if k == 90_000 { vec![k, k + 2, k + 3, k + 1] } else { vec![k, k + 1, k + 2] };
        faces.push(corners.len() as u8);
        corners.iter().for_each(|corner| faces.extend(corner.to_be_bytes()));
    }
    let part = compare(&folder.write("mixed.ply", faces)).expect("a mesh");
    assert_eq!(part.triangles.len(), rows as usize + 1);
}

#[test]
fn a_copy_is_made_once_and_anew_when_the_file_changes() {
    let folder = Folder::new();
    let path = folder.write("mesh.ply", SQUARE_PLY);
    let asked = std::sync::atomic::AtomicU64::new(0);
    let pause = || {
        asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        Ok(())
    };
    let open = || Stream::open_with(&path, folder.path(), &pause).unwrap();
    assert_eq!(open().position(2), DVec3::new(1.0, 1.0, 0.0));
    let once = asked.load(std::sync::atomic::Ordering::Relaxed);
    assert_eq!(open().position(2), DVec3::new(1.0, 1.0, 0.0));
    assert_eq!(asked.load(std::sync::atomic::Ordering::Relaxed), once, "the copy was made again");
    folder.write("mesh.ply", SQUARE_PLY.replace("1 1 0\n", "1 1 0.5\n"));
    assert_eq!(open().position(2), DVec3::new(1.0, 1.0, 0.5), "the copy is stale");
}
