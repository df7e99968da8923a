//! Invariants of the sites: where they lie, what they are made of, who is near whom.

use glam::Vec3;

use super::archives::Opened;
use super::scene::{SHARES, is_share};
use super::{Report, ascending, each};
use crate::geometry::triangle;
use crate::scene::Scene;

/// What later files are held against; None where it is damaged.
pub(super) struct Sited<'a> {
    /// How many sites there are.
    pub count: Option<usize>,
    pub positions: Option<&'a [Vec3]>,
    pub albedo: Option<&'a [Vec3]>,
    pub exitance: Option<&'a [Vec3]>,
}

/// A unit vector's square is one within a dozen roundings.
const UNIT: f32 = 2e-6;

/// Barycentric coordinates leave the triangle by some roundings.
const OUTSIDE: f32 = 1e-5;

/// Checks `sites.glow`.
pub(super) fn check<'a>(file: &'a Opened, scene: Option<&Scene>, report: &mut Report) -> Sited<'a> {
    let positions = file.array::<Vec3>(report, "position");
    let Some(n) = positions.map(<[Vec3]>::len) else {
        return Sited { count: None, positions: None, albedo: None, exitance: None };
    };
    file.hold(report, "position", each(positions.unwrap_or_default(), FINITE, |p| p.is_finite()));
    let array = |tag, report: &mut Report| file.sized::<Vec3>(report, tag, n);
    if let Some(normals) = array("normal", report) {
        file.hold(report, "normal", each(normals, "unit vectors", is_unit));
    }
    let albedo = array("albedo", report);
    if let Some(albedo) = albedo {
        file.hold(report, "albedo", each(albedo, SHARES, is_share));
    }
    let exitance = array("exitance", report);
    if let Some(exitance) = exitance {
        file.hold(report, "exitance", each(exitance, LIGHT, is_light));
    }
    places(file, n, scene, report);
    if let (Some(positions), Some(scene)) = (positions, scene) {
        on_triangles(file, positions, scene, report);
    }
    graph(file, n, report);
    Sited { count: Some(n), positions, albedo, exitance }
}

const FINITE: &str = "finite numbers";

/// What light is.
pub(super) const LIGHT: &str = "finite light, not below 0";

/// Whether light is finite and not negative.
pub(super) fn is_light(light: &Vec3) -> bool {
    light.is_finite() && light.min_element() >= 0.0
}

/// Whether a vector is one long.
pub(super) fn is_unit(normal: &Vec3) -> bool {
    (normal.length_squared() - 1.0).abs() <= UNIT
}

fn places(file: &Opened, n: usize, scene: Option<&Scene>, report: &mut Report) {
    for tag in ["area", "spacing"] {
        if let Some(values) = file.sized::<f32>(report, tag, n) {
            file.hold(report, tag, each(values, "finite numbers from 0 on", |v| v.is_finite() && *v >= 0.0));
        }
    }
    file.sized::<u8>(report, "level", n);
    if let (Some(ids), Some(scene)) = (file.sized::<u32>(report, "triangle", n), scene) {
        let wanted = format!("triangles below {}", scene.triangles.len());
        file.hold(report, "triangle", each(ids, &wanted, |&t| (t as usize) < scene.triangles.len()));
    }
    if let Some(places) = file.sized::<[f32; 2]>(report, "barycent", n) {
        let within = |&[u, v]: &[f32; 2]| u.min(v) >= -OUTSIDE && u + v <= 1.0 + OUTSIDE;
        file.hold(report, "barycent", each(places, "places on the triangle", within));
    }
    if let Some(plots) = file.array::<[u32; 7]>(report, "plot") {
        let most = scene.map_or(u32::MAX, |s| s.triangles.len() as u32);
        let whole = |&[first, last, .., back, area, spacing]: &[u32; 7]| {
            let size =
                |bits| Some(f32::from_bits(bits)).filter(|v: &f32| v.is_finite() && *v >= 0.0).is_some();
            first <= last && last <= most && back <= 1 && size(area) && size(spacing)
        };
        file.hold(report, "plot", each(plots, "a piece of the surface", whole));
    }
}

/// How far rounding takes a site off the place that its triangle and coordinates say, local units.
const ASIDE: f32 = 2e-6;

/// Sites are where their triangles and barycentric coordinates say.
fn on_triangles(file: &Opened, positions: &[Vec3], scene: &Scene, report: &mut Report) {
    let ids = file.array::<u32>(report, "triangle");
    let coordinates = file.array::<[f32; 2]>(report, "barycent");
    let (Some(ids), Some(coordinates)) = (ids, coordinates) else { return };
    for (site, ((at, &id), &[u, v])) in positions.iter().zip(ids).zip(coordinates).enumerate() {
        if id as usize >= scene.triangles.len() {
            return;
        }
        let expected = triangle::point(scene.corners(id), u, v);
        if at.distance(expected) > ASIDE {
            let problem = format!("entry {site}: expected {expected} on triangle {id}, got {at}");
            file.hold(report, "position", Err(problem));
            return;
        }
    }
}

/// Neighbours are other sites, and know each other's number.
fn graph(file: &Opened, n: usize, report: &mut Report) {
    let targets = file.array::<u32>(report, "graph_to");
    if let Some(targets) = targets {
        let wanted = format!("sites below {n}");
        file.hold(report, "graph_to", each(targets, &wanted, |&t| (t as usize) < n));
        if let Some(starts) = file.sized::<u32>(report, "graph_at", n + 1) {
            file.hold(report, "graph_at", ascending(starts, targets.len()));
        }
    }
    if let Some(unclean) = file.sized::<u8>(report, "unclean", n) {
        file.hold(report, "unclean", each(unclean, "0 or 1", |&u| u <= 1));
    }
}
