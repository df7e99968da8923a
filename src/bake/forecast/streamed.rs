//! Meshes that stay in their files: nobody has seen them, so laws of what was measured must do (docs/scaling.md).

use super::{Forecast, StageForecast, counts};
use crate::bake::job::streams;
use crate::bake::options::Options;
use crate::scene::assemble::Contents;

/// What a stage takes: per triangle of the files, per vertex, and however many there are.
struct Law {
    name: &'static str,
    /// CPU seconds, and the share of a wall-clock second that each takes on two cores.
    per_million_triangles: f64,
    per_million_vertices: f64,
    fixed: f64,
    wall: f64,
    disk_bytes: fn(&Size) -> f64,
}

/// How large it all is.
struct Size {
    triangles: f64,
    vertices: f64,
    file_bytes: f64,
    proxy: f64,
}

fn nothing(_: &Size) -> f64 {
    0.0
}

/// At a target of 3 %, two cores; the coarse stages go with the inverse of the target.
const LAWS: [Law; 8] = [
    law("cut", (0.073, 0.0, 0.0), 0.67, nothing),
    law("chunks", (0.81, 0.0, 0.0), 0.63, |size| 72.0 * size.triangles + 20.0 * size.proxy),
    law("rays", (0.0, 0.0, 0.3), 0.7, nothing),
    law("check", (0.006, 0.0, 0.0), 1.0, nothing),
    law("light", (0.0, 0.0, 5.2), 0.55, nothing),
    law("store", (0.0, 0.0, 0.2), 1.0, |size| 100.0 * size.proxy),
    law("mesh", (0.0, 10.6, 2.4), 0.55, |size| size.file_bytes + 35.0 * size.vertices),
    law("preview", (0.0, 0.0, 9.5), 0.52, |_| 4.0e5),
];

const fn law(
    name: &'static str,
    (per_million_triangles, per_million_vertices, fixed): (f64, f64, f64),
    wall: f64,
    disk_bytes: fn(&Size) -> f64,
) -> Law {
    Law { name, per_million_triangles, per_million_vertices, fixed, wall, disk_bytes }
}

/// Anonymous bytes however many triangles there are: the program, and two chunks on their way.
const FIXED_BYTES: f64 = 5.0e7;

/// Anonymous bytes a triangle of the proxy: scene, hierarchy, sites and rows on it.
const PROXY_BYTES: f64 = 300.0;

/// Bytes on disk a vertex until the mesh is written: its answer; and a triangle until chunks are made.
const PASSING_BYTES: [f64; 2] = [16.0, 13.0];

/// Predicts a bake of meshes of which only headers were read.
pub fn forecast(contents: &Contents, options: &Options) -> Forecast {
    let (triangles, vertices) = counts(contents);
    let file_bytes: u64 = contents.parts.iter().filter_map(|p| p.streamed).map(|left| left.file_bytes).sum();
    let count = contents.parts.iter().filter(|part| part.streamed.is_some()).count();
    let proxy = count * streams::cut_params(options.error, options.proxy).proxy_triangles;
    let size = Size {
        triangles: triangles as f64,
        vertices: vertices as f64,
        file_bytes: file_bytes as f64,
        proxy: proxy as f64,
    };
    let threads = rayon::current_num_threads();
    let peak = FIXED_BYTES + PROXY_BYTES * size.proxy + size.vertices / 8.0;
    let stage = |law: &Law| {
        let finer = if law.name == "light" { 0.03 / options.error } else { 1.0 };
        let cpu_seconds = 1e-6 * law.per_million_triangles * size.triangles
            + 1e-6 * law.per_million_vertices * size.vertices
            + law.fixed * finer;
        // Measured on two cores: what is left of a CPU second there is shared by all.
        let wall = if threads == 1 {
            1.0
        } else {
            (law.wall * 2.0 / threads as f64).clamp(1.0 / threads as f64, 1.0)
        };
        StageForecast {
            name: law.name.to_owned(),
            seconds: cpu_seconds * wall,
            cpu_seconds,
            peak_anonymous_bytes: peak as u64,
            disk_bytes: (law.disk_bytes)(&size) as u64,
        }
    };
    let wanted = |law: &&Law| options.preview || !["mesh", "preview"].contains(&law.name);
    let stages = LAWS.iter().filter(wanted).map(stage).collect();
    let passing = PASSING_BYTES[0] * size.vertices * f64::from(u8::from(options.preview));
    let passing = passing.max(PASSING_BYTES[1] * size.triangles - (LAWS[6].disk_bytes)(&size));
    let passing_bytes = passing.max(0.0) as u64;
    Forecast { triangles, vertices, passing_bytes, ..Forecast::of(stages) }
}
