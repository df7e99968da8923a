//! Invariants of the scene: its numbers are finite, and its hierarchy holds every triangle once, inside of all boxes above.

use std::path::Path;

use glam::Vec3;

use super::archives::Opened;
use super::{Damage, Report, each};
use crate::bake::store;
use crate::bake::store::record::SceneRecord;
use crate::detail::Detail;
use crate::error::{Error, Result};
use crate::geometry::triangle;
use crate::light::Rgb;
use crate::rays::{Branch, BvhView, Child, NO_TRIANGLE, Packet};
use crate::scene::{Albedo, Scene};

/// Checks `scene.glow`; the scene, if it can be restored.
pub(super) fn check(file: &Opened, report: &mut Report) -> Option<Scene> {
    let tables = file.array::<u8>(report, "tables");
    let vertices = file.array::<Vec3>(report, "vertices");
    let corners = file.array::<[u32; 3]>(report, "corners");
    let flat = file.array::<Vec3>(report, "attribs");
    if let Some(flat) = flat {
        file.hold(report, "attribs", each(flat, "finite numbers", |v| v.is_finite()));
    }
    let branches = file.array::<Branch>(report, "branches");
    let packets = file.array::<Packet>(report, "packets");
    let scene = restore(tables?, vertices?, corners?, flat?);
    let scene = match scene {
        Ok(scene) => scene,
        Err(problem) => {
            file.hold(report, "tables", Err(problem));
            return None;
        }
    };
    if !file.hold(report, "vertices", finite_corners(&scene)) {
        return None;
    }
    file.hold(report, "tables", meshes(&scene));
    if let (Some(branches), Some(packets)) = (branches, packets) {
        let held = file.hold(report, "packets", triangles(&scene, packets));
        let boxes = hierarchy(branches, packets);
        if held || boxes.is_err() {
            file.hold(report, "branches", boxes);
        }
    }
    Some(scene)
}

/// Triangles and vertices of the scene as its files have it, chunks counted for the proxies that stand for them; None
/// where some cannot be counted. Notes what their checksums do not tell: order, lengths, references, the frame.
pub(super) fn counts(job: &Path, scene: &Scene, report: &mut Report) -> Result<Option<(u64, u64)>> {
    let Ok(files) = store::chunk_files(job) else { return Ok(None) };
    let mut counts = Some((scene.triangles.len() as u64, scene.vertices.len() as u64));
    for (mesh, name) in files {
        let checked = if report.is_whole_file(&name) { chunks(&job.join(&name), scene) } else { Ok(None) };
        let added = match checked {
            Ok(added) => added,
            Err(Error::Damaged { place, problem, .. }) => {
                report.damages.push(Damage::of_file(name, format!("{place}: {problem}")));
                None
            }
            Err(error) => return Err(error),
        };
        let sum = |(triangles, vertices): (u64, u64)| {
            let (more, proxy) = (added?, scene.meshes.get(mesh)?);
            let stood_in = [proxy.triangles.len() as u64, proxy.vertices.len() as u64];
            let left = (triangles.checked_sub(stood_in[0])?, vertices.checked_sub(stood_in[1])?);
            Some((left.0 + more.0, left.1 + more.1))
        };
        counts = counts.and_then(sum);
    }
    Ok(counts)
}

/// Checks one archive of chunks; triangles with an area, and vertices, of the mesh.
fn chunks(path: &Path, scene: &Scene) -> Result<Option<(u64, u64)>> {
    let detail = Detail::open(path, None)?;
    let damaged =
        |place: String, problem: String| Err(Error::Damaged { file: path.to_path_buf(), place, problem });
    if detail.placement() != scene.placement {
        return damaged("head".into(), "expected the frame of the scene, got another".into());
    }
    for chunk in 0..detail.chunk_count() {
        detail.ids(chunk)?;
        detail.points(chunk)?;
        detail.normals(chunk)?;
        detail.colours(chunk)?;
        let view = BvhView::checked(detail.branches(chunk).array()?, detail.packets(chunk).array()?);
        if let Err(problem) = view {
            return damaged(format!("branches of chunk {chunk}"), problem.to_string());
        }
    }
    Ok(Some((detail.triangles(), detail.vertices())))
}

/// The scene of its tables, which are checked before anything is believed.
fn restore(tables: &[u8], vertices: &[Vec3], corners: &[[u32; 3]], flat: &[Vec3]) -> Result<Scene, String> {
    let mut aligned = rkyv::util::AlignedVec::<16>::with_capacity(tables.len());
    aligned.extend_from_slice(tables);
    let record = rkyv::from_bytes::<SceneRecord, rkyv::rancor::BoxedError>(&aligned);
    record.map_err(|e| e.to_string())?.restore(vertices, corners, flat)
}

/// Vertices that no triangle has may be anything: the input's are kept.
fn finite_corners(scene: &Scene) -> Result<(), String> {
    let finite = |corners: &[u32; 3]| {
        corners.iter().all(|&v| scene.vertices.get(v as usize).is_some_and(|v| v.is_finite()))
    };
    each(&scene.triangles, "finite corners", finite)
}

/// Albedos that reflect no more than they get, and corners among the mesh's own vertices.
fn meshes(scene: &Scene) -> Result<(), String> {
    let placement = &scene.placement;
    if !(placement.scale.is_finite() && placement.scale > 0.0 && placement.origin.is_finite()) {
        return Err(format!("expected a finite placement, got {placement:?}"));
    }
    for mesh in &scene.meshes {
        let named = |problem: String| format!("mesh {}: {problem}", mesh.name);
        let all = match &mesh.albedo {
            Albedo::Constant(albedo) => each(&[*albedo], SHARES, is_share),
            Albedo::Vertex(values) => each(values, SHARES, is_share),
            // The factor is applied on reading; both together may not exceed one, each alone does not.
            Albedo::Texture { texture, factor, .. } => {
                each(&texture.pixels, SHARES, |pixel| is_share(&(*pixel * *factor)))
            }
        };
        all.map_err(named)?;
        if !(mesh.radiance.is_finite() && mesh.radiance.min_element() >= 0.0) {
            return Err(named(format!("expected a finite radiance, got {:?}", mesh.radiance)));
        }
        let own = scene.triangles.get(mesh.triangles.start as usize..mesh.triangles.end as usize);
        each(own.unwrap_or_default(), "corners of its own", |corners| {
            corners.iter().all(|v| mesh.vertices.contains(v))
        })
        .map_err(named)?;
    }
    Ok(())
}

/// What albedos are.
pub(super) const SHARES: &str = "shares within [0, 1]";

/// Sums of weights that add up to one round to a little more.
const ROUNDING: f32 = 1e-5;

/// Whether three channels are within [0, 1].
pub(super) fn is_share(albedo: &Rgb) -> bool {
    albedo.is_finite() && albedo.min_element() >= 0.0 && albedo.max_element() <= 1.0 + ROUNDING
}

/// Each triangle with an area is in one lane, with the corners that it has in the scene.
fn triangles(scene: &Scene, packets: &[Packet]) -> Result<(), String> {
    let mut held = vec![0u64; scene.triangles.len().div_ceil(64)];
    for (number, packet) in packets.iter().copied().enumerate() {
        for (lane, &id) in packet.triangle.iter().enumerate().filter(|(_, id)| **id != NO_TRIANGLE) {
            let place = || format!("packet {number}, lane {lane}: ");
            if id as usize >= scene.triangles.len() {
                return Err(
                    place() + &format!("expected triangles below {}, got {id}", scene.triangles.len())
                );
            }
            let (word, bit) = (id as usize / 64, 1u64 << (id % 64));
            if held[word] & bit != 0 {
                return Err(place() + &format!("triangle {id} is held twice"));
            }
            held[word] |= bit;
            if corners(&packet, lane) != scene.corners(id) {
                return Err(place() + &format!("corners of triangle {id} are not the scene's"));
            }
        }
    }
    let is_held = |id: u32| held[id as usize / 64] >> (id % 64) & 1 == 1;
    let lost = (0..scene.triangles.len() as u32).find(|&id| {
        let area = if is_held(id) { 0.0 } else { triangle::area(scene.corners(id)) };
        area.is_finite() && area > 0.0
    });
    lost.map_or(Ok(()), |id| Err(format!("triangle {id} is in no packet")))
}

fn corners(packet: &Packet, lane: usize) -> [Vec3; 3] {
    packet.corners.map(|corner| Vec3::from_array(corner.map(|axis| axis[lane])))
}

/// A box by its lower and upper corner.
type Box3 = [Vec3; 2];

/// Every branch and packet hangs in one place, inside of the box that leads to it; hence of all above.
fn hierarchy(branches: &[Branch], packets: &[Packet]) -> Result<(), String> {
    BvhView::checked(branches, packets).map_err(|problem| problem.to_string())?;
    let mut bounds: Vec<Option<Box3>> = vec![None; branches.len()];
    let mut next_packet = vec![false; packets.len()];
    for (number, branch) in branches.iter().copied().enumerate() {
        let place = |child: usize| format!("branch {number}, child {child}: ");
        for (k, child) in branch.children.iter().enumerate().filter(|(_, child)| !child.is_none()) {
            let own = box_of(&branch, k);
            if !own.iter().all(|corner| corner.is_finite()) {
                return Err(place(k) + "expected a finite box");
            }
            if bounds[number].is_some_and(|above| !is_inside(&own, &above)) {
                return Err(place(k) + "outside of the box above");
            }
            if let Some(below) = child.as_branch() {
                if bounds.get_mut(below).is_none_or(|bounds| bounds.replace(own).is_some()) {
                    return Err(place(k) + &format!("branch {below} is another's child"));
                }
            } else {
                hang(packets, *child, (&own, &mut next_packet)).map_err(|problem| place(k) + &problem)?;
            }
        }
    }
    if let Some(orphan) = bounds.iter().skip(1).position(Option::is_none) {
        return Err(format!("branch {} is nobody's child", orphan + 1));
    }
    match next_packet.iter().position(|hangs| !hangs) {
        Some(orphan) => Err(format!("packet {orphan} is nobody's child")),
        None => Ok(()),
    }
}

/// Notes that packets hang here, inside of a box.
fn hang(packets: &[Packet], child: Child, (own, hangs): (&Box3, &mut [bool])) -> Result<(), String> {
    for packet in child.packet_range() {
        if hangs.get_mut(packet).is_none_or(|hangs| std::mem::replace(hangs, true)) {
            return Err(format!("packet {packet} is another's child"));
        }
        for lane in
            (0..packets[packet].triangle.len()).filter(|&l| packets[packet].triangle[l] != NO_TRIANGLE)
        {
            if corners(&packets[packet], lane).iter().any(|corner| !is_inside(&[*corner; 2], own)) {
                return Err(format!("lane {lane} of packet {packet} is outside of its box"));
            }
        }
    }
    Ok(())
}

fn box_of(branch: &Branch, child: usize) -> Box3 {
    [0, 1].map(|side| Vec3::from_array([0, 1, 2].map(|axis| branch.planes[2 * axis + side][child])))
}

fn is_inside(inner: &Box3, outer: &Box3) -> bool {
    inner[0].cmpge(outer[0]).all() && inner[1].cmple(outer[1]).all()
}
