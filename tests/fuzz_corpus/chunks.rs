//! Archives of chunks: as files, and as blocks alone that are put into a file here, whose checksums hold whatever they say.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};
use glowtree::archive::{Archive, Encoded, Tag, Writer};
use glowtree::detail::{Detail, near};
use glowtree::geometry::octahedral;
use glowtree::rays::{Bvh, BvhView, Ray};
use glowtree::scene::Scene;
use glowtree::scene::assemble::{Contents, Part, Streamed};

use super::{Memory, archive_digests, check_refusal, check_scene, put};

/// What bytes begin with that are blocks alone.
const LOOSE: &[u8] = b"blocks\n";

/// The tags that blocks alone may have, by number; the format has them in this order (docs/format.md).
const TAGS: [&str; 12] = [
    "head", "branches", "packets", "ids", "points", "normals", "colours", "cells", "means", "tints", "faces",
    "box",
];

/// Reads bytes as an archive of chunks, whole and chunk by chunk.
pub fn detail(bytes: &[u8]) {
    let sealed = bytes.strip_prefix(LOOSE).map(sealed);
    let path = put("detail.glow", sealed.as_deref().unwrap_or(bytes));
    match Detail::open(&path, None) {
        Err(error) => check_refusal(&error),
        Ok(detail) => {
            (0..detail.chunk_count()).for_each(|chunk| check_chunk(&detail, chunk));
            assert!(detail.cell() >= 0.0 && detail.placement().origin.is_finite());
            let _ = (detail.triangles(), detail.vertices());
            check_proxy(detail, &path);
        }
    }
    if let Err(error) = Detail::open(&path, Some(archive_digests())) {
        check_refusal(&error);
    }
}

/// Asks for all that a chunk has; what is given must be fit for use.
fn check_chunk(detail: &Detail, chunk: usize) {
    let vertices = match (detail.ids(chunk), detail.points(chunk), detail.normals(chunk)) {
        (Ok(ids), Ok(points), Ok(normals)) => {
            assert!(ids.is_sorted_by(|a, b| a < b), "ids {ids:?}");
            assert!(ids.last().is_none_or(|&last| u64::from(last) < detail.vertices()), "ids {ids:?}");
            assert_eq!((points.len(), normals.len()), (ids.len(), ids.len()));
            normals.iter().for_each(|&code| assert!(!octahedral::decode(code).is_nan(), "{code:x}"));
            Some(ids.len())
        }
        (ids, points, normals) => {
            let errors = [ids.err(), points.err(), normals.err()];
            errors.iter().flatten().for_each(check_refusal);
            None
        }
    };
    match detail.colours(chunk) {
        Err(error) => check_refusal(&error),
        Ok(colours) => {
            assert_eq!(colours.is_some(), detail.has_colours());
            if let (Some(colours), Some(vertices)) = (colours, vertices) {
                assert_eq!(colours.len(), vertices);
                assert!(colours.iter().flatten().all(|value| value.to_f32() >= 0.0), "{colours:?}");
            }
        }
    }
    match (detail.branches(chunk).array(), detail.packets(chunk).array()) {
        (Ok(branches), Ok(packets)) => drop(BvhView::checked(branches, packets).map(rays)),
        (branches, packets) => {
            [branches.err(), packets.err()].iter().flatten().for_each(check_refusal);
        }
    }
}

/// A few rays that a hierarchy must stand.
fn rays(view: BvhView<'_>) {
    for direction in [Vec3::X, -Vec3::Y, Vec3::Z, Vec3::new(0.3, -0.5, 0.8)] {
        let ray = Ray::new(Vec3::splat(0.01), direction);
        if let Some(hit) = view.closest(&ray) {
            let _ = view.normal_at(hit.triangle);
        }
        let _ = view.occluded(&ray);
    }
}

/// Makes the scene in which the proxy stands for the mesh, and looks at it in both resolutions.
fn check_proxy(detail: Detail, path: &Path) {
    let part = match detail.proxy() {
        Ok(part) => part,
        Err(error) => return check_refusal(&error),
    };
    let vertices = part.positions.len();
    assert!(part.positions.iter().all(|at| at.is_finite()));
    assert!(part.triangles.iter().flatten().all(|&corner| (corner as usize) < vertices));
    assert!(part.colours.as_ref().is_none_or(|colours| colours.len() == vertices));
    let bounds = detail.world_bounds();
    assert!(bounds.iter().all(|corner: &DVec3| corner.is_finite()), "{bounds:?}");
    let streamed = Some(Streamed { bounds, ..Streamed::default() });
    let contents = Contents { parts: vec![Part { streamed, ..part }], ..Contents::default() };
    match contents.into_scene(path) {
        Err(error) => check_refusal(&error),
        Ok(scene) => {
            check_scene(&scene);
            look(&scene, detail);
        }
    }
}

fn look(scene: &Scene, detail: Detail) {
    let near = Arc::new(near(scene, &[(0, Arc::new(detail))]));
    near.touch();
    let bvh = Bvh::build_triangles(&scene.vertices, &scene.triangles).with_near(Some(near));
    for direction in [Vec3::X, -Vec3::Y, Vec3::Z, Vec3::new(0.3, -0.5, 0.8)] {
        let ray = Ray::new(Vec3::splat(0.01) - direction, direction);
        let _ = (bvh.closest_fine(&ray), bvh.occluded_fine(&ray), bvh.surface(&ray));
        let _ = (bvh.is_hidden(ray.origin, direction), bvh.beside(ray.origin, direction));
    }
    if let Err(error) = bvh.sound() {
        check_refusal(&error);
    }
}

/// A finished archive of blocks alone: number of the tag, width of a value (2 bytes), values that it covers (4), length of
/// the payload (4), payload.
fn sealed(mut blocks: &[u8]) -> Vec<u8> {
    let memory = Memory::default();
    let path = Path::new("detail.glow");
    let mut writer = Writer::create_in(Arc::new(memory.clone()), path, Tag::new("detail"), archive_digests())
        .expect("memory");
    let mut end = 0;
    while let Some((head, rest)) = blocks.split_at_checked(11) {
        let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let length = (word(7) as usize).min(rest.len());
        let (bytes, rest) = rest.split_at(length);
        // What a writer would not write itself is of no interest here.
        let claimed = u16::from_le_bytes([head[1], head[2]]);
        let fits = claimed > 0 && length.is_multiple_of(usize::from(claimed));
        let width_bytes = if fits { claimed } else { 1 };
        let payload = Encoded { codec: 0, width_bytes, raw_bytes: length as u64, bytes };
        let tag = Tag::new(TAGS[usize::from(head[0]) % TAGS.len()]);
        let range = end..end + u64::from(word(3));
        end = range.end;
        writer.append_bytes(tag, range, payload).expect("memory");
        blocks = rest;
    }
    writer.finish(&[]).expect("memory");
    memory.bytes(path).expect("a file")
}

/// The blocks of an archive alone.
pub fn loose(path: &PathBuf) -> Vec<u8> {
    let archive = Archive::open(path).expect("an archive");
    let mut bytes = LOOSE.to_vec();
    for block in archive.all_blocks() {
        let entry = block.entry();
        let tag = TAGS.iter().position(|name| Tag::new(name) == entry.tag).expect("a known tag");
        let stored = block.stored().expect("a whole block");
        bytes.push(tag as u8);
        bytes.extend(entry.width_bytes.to_le_bytes());
        bytes.extend((entry.count as u32).to_le_bytes());
        bytes.extend((stored.len() as u32).to_le_bytes());
        bytes.extend(stored);
    }
    bytes
}
