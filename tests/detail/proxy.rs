//! Proxies stand in for what they simplify.

use std::collections::HashMap;

use glam::{DAffine3, DVec3, Vec3};
use glowtree::detail::CutParams;

use super::cut;
use super::files::{Form, little, ply};
use super::scene_shared::Folder;
use super::shapes::icosphere;

#[test]
fn the_proxy_of_a_sphere_is_a_closed_sphere() {
    let folder = Folder::new();
    let mesh = icosphere(7);
    let colours = mesh.0.iter().map(|at| if at.x > 0.0 { [255, 0, 0] } else { [0, 255, 0] }).collect();
    let path = folder.write("sphere.ply", ply(&mesh, &Form { colours: Some(colours), ..little() }));
    let params = CutParams { chunk_triangles: 30_000, proxy_triangles: 10_000 };
    let detail = cut(&path, &DAffine3::IDENTITY, None, &params).unwrap();
    assert!(detail.chunk_count() > 8);
    let proxy = detail.proxy().unwrap();
    let (vertices, triangles) = (proxy.positions.len(), proxy.triangles.len());
    assert!((5_000..20_000).contains(&triangles), "{triangles} triangles for a wish of 10,000");
    // Closed: every edge is run through as often in one direction as in the other.
    let mut runs: HashMap<(u32, u32), i32> = HashMap::new();
    for [a, b, c] in &proxy.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *runs.entry((*from.min(to), *from.max(to))).or_default() += if from < to { 1 } else { -1 };
        }
    }
    let open = runs.values().filter(|&&run| run != 0).count();
    assert_eq!(open, 0, "open edges of {}", runs.len());
    let at = |corner: u32| proxy.positions[corner as usize];
    let area: f64 =
        proxy.triangles.iter().map(|t| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).length() * 0.5).sum();
    let sphere = 4.0 * std::f64::consts::PI;
    let inverted = proxy
        .triangles
        .iter()
        .filter(|t| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).dot(at(t[0])) < 0.0)
        .count();
    println!("{vertices} vertices, {triangles} triangles, area {}, {inverted} inverted", area / sphere);
    assert!((area / sphere - 1.0).abs() < 0.02, "{area} of {sphere}");
    // Means of points on a cap lie below it by at most its height, (√3 cell)² / 8 for a cell's diagonal.
    let cell = f64::from(detail.cell()) * detail.placement().scale;
    let worst = proxy.positions.iter().map(|at| (at.length() - 1.0).abs()).fold(0.0, f64::max);
    assert!(worst < 0.5 * cell && worst < 0.4 * cell * cell, "{worst} for cells of {cell}");
    let colours = proxy.colours.as_ref().unwrap();
    assert_eq!(colours.len(), vertices);
    let off = |(at, colour): (&DVec3, &Vec3)| {
        at.x.abs() > cell && *colour != if at.x > 0.0 { Vec3::X } else { Vec3::Y }
    };
    assert!(!proxy.positions.iter().zip(colours).any(off), "a colour is wrong");
}

#[test]
fn a_coarse_mesh_is_its_own_proxy() {
    let folder = Folder::new();
    let mesh = icosphere(2);
    let path = folder.write("sphere.ply", ply(&mesh, &little()));
    let params = CutParams { chunk_triangles: 100, proxy_triangles: 100_000 };
    let detail = cut(&path, &DAffine3::IDENTITY, None, &params).unwrap();
    let proxy = detail.proxy().unwrap();
    assert_eq!((proxy.positions.len(), proxy.triangles.len()), (mesh.0.len(), mesh.1.len()));
}

#[test]
fn a_thin_sheet_keeps_both_sides() {
    let folder = Folder::new();
    let side = 60u32;
    let at = |k: u32, z: f32| Vec3::new((k % side) as f32, (k / side) as f32, z);
    let mut mesh: super::Mesh = (Vec::new(), Vec::new());
    for (z, turn) in [(0.0, false), (0.01, true)] {
        let first = mesh.0.len() as u32;
        mesh.0.extend((0..side * side).map(|k| at(k, z)));
        for k in (0..side * (side - 1)).filter(|k| k % side < side - 1).map(|k| k + first) {
            for [a, b, c] in [[k, k + 1, k + side], [k + 1, k + side + 1, k + side]] {
                mesh.1.push(if turn { [a, b, c] } else { [a, c, b] });
            }
        }
    }
    let path = folder.write("sheet.ply", ply(&mesh, &little()));
    let params = CutParams { chunk_triangles: 2000, proxy_triangles: 400 };
    let proxy = cut(&path, &DAffine3::IDENTITY, None, &params).unwrap().proxy().unwrap();
    let at = |corner: u32| proxy.positions[corner as usize];
    let areas = proxy.triangles.iter().map(|t| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).z * 0.5);
    let (up, down) = areas.fold((0.0, 0.0), |(up, down), z: f64| (up + z.max(0.0), down - z.min(0.0)));
    // The means of the outer cells lie half a cell within the border: a tenth of the sheet's 59 is lost on each axis.
    let whole = f64::from((side - 1) * (side - 1));
    assert!(up > 0.75 * whole && down > 0.75 * whole && up < 1.01 * whole, "{up} and {down} of {whole}");
}
