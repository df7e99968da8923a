//! All measurements as a table, and what they come to: slopes, and ladders that rise.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{Measurement, Method, figures};
use crate::error::{Error, Result};
use crate::output::file::write_bytes;

/// The table's name in the folder of a chart.
pub const TABLE_FILE: &str = "chart.csv";

/// A fitted exponent: error ~ CPU time to this power.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Slope {
    /// Of which scene.
    pub scene: String,
    /// By what.
    pub method: &'static str,
    /// −1 halves the error at twice the cost; path tracing has −½.
    pub exponent: f64,
}

/// A tighter target with a larger error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rise {
    /// Of which scene.
    pub scene: String,
    /// By what.
    pub method: &'static str,
    /// The looser target and its true error.
    pub from: [f64; 2],
    /// The tighter target and its true error.
    pub to: [f64; 2],
}

/// Those of one scene and method on the most threads, loosest first; every ladder once, in the order of the measurements.
pub fn ladders(all: &[Measurement]) -> Vec<Vec<&Measurement>> {
    let mut ladders: Vec<Vec<&Measurement>> = Vec::new();
    for m in all {
        let same = |l: &&mut Vec<&Measurement>| {
            l[0].scene == m.scene && l[0].key.method == m.key.method && l[0].key.threads == m.key.threads
        };
        match ladders.iter_mut().find(same) {
            Some(ladder) => ladder.push(m),
            None => ladders.push(vec![m]),
        }
    }
    // Measurements of the scaling alone are no ladder: the first of a scene and method is.
    let mut seen: Vec<(String, Method)> = Vec::new();
    ladders.retain(|ladder| {
        let name = (ladder[0].scene.clone(), ladder[0].key.method);
        let fresh = !seen.contains(&name);
        seen.push(name);
        fresh
    });
    for ladder in &mut ladders {
        ladder.sort_by(|a, b| effort(a).total_cmp(&effort(b)));
    }
    ladders
}

/// Tighter is more.
fn effort(m: &Measurement) -> f64 {
    if m.key.method == Method::Paths { m.key.target } else { 1.0 / m.key.target }
}

/// The slopes of all ladders of two steps and more.
pub fn slopes(all: &[Measurement]) -> Vec<Slope> {
    let of = |ladder: Vec<&Measurement>| {
        let points: Vec<[f64; 2]> = ladder.iter().map(|m| [m.cpu_seconds, m.true_error]).collect();
        let exponent = figures::slope(&points)?;
        Some(Slope { scene: ladder[0].scene.clone(), method: ladder[0].key.method.name(), exponent })
    };
    ladders(all).into_iter().filter_map(of).collect()
}

/// All steps that rise.
pub fn risen(all: &[Measurement]) -> Vec<Rise> {
    let rise = |pair: &[&Measurement]| {
        let told = |m: &Measurement| [m.key.target, m.true_error];
        (pair[1].true_error > pair[0].true_error).then(|| Rise {
            scene: pair[0].scene.clone(),
            method: pair[0].key.method.name(),
            from: told(pair[0]),
            to: told(pair[1]),
        })
    };
    ladders(all).iter().flat_map(|ladder| ladder.windows(2).filter_map(rise).collect::<Vec<_>>()).collect()
}

const HEAD: [&str; 16] = [
    "scene",
    "method",
    "target",
    "seed",
    "threads",
    "seconds",
    "cpu_seconds",
    "answer_seconds",
    "points",
    "rays",
    "sites",
    "links",
    "bytes",
    "true_error",
    "reference_noise",
    "estimated_error",
];

/// Writes `chart.csv`, a row for each measurement.
///
/// # Errors
/// [`Error::Io`].
pub fn write(all: &[Measurement], folder: &Path) -> Result<PathBuf> {
    let path = folder.join(TABLE_FILE);
    let failed = |e: csv::Error| Error::io(&path, "writing", e.into());
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(HEAD).map_err(failed)?;
    let count = |n: Option<u64>| n.map_or(String::new(), |n| n.to_string());
    for m in all {
        let row = [
            m.scene.clone(),
            m.key.method.name().into(),
            m.key.target.to_string(),
            m.key.seed.to_string(),
            m.key.threads.to_string(),
            m.seconds.to_string(),
            m.cpu_seconds.to_string(),
            m.answer_seconds.to_string(),
            m.points.to_string(),
            count(m.rays),
            count(m.sites),
            count(m.links),
            count(m.bytes),
            m.true_error.to_string(),
            m.noise.to_string(),
            m.estimated_error.to_string(),
        ];
        writer.write_record(&row).map_err(failed)?;
    }
    let text = writer.into_inner().map_err(|e| Error::io(&path, "writing", e.into_error()))?;
    write_bytes(&path, &text)?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::Basis;
    use crate::compare::ladder::Key;

    fn made(method: Method, target: f64, threads: usize, [cpu_seconds, true_error]: [f64; 2]) -> Measurement {
        let key = Key { program: "1".into(), digest: "d".into(), method, target, seed: 0, threads };
        Measurement {
            seconds: 0.5 * cpu_seconds,
            cpu_seconds,
            true_error,
            ..Measurement::blank(key, "s", 10)
        }
    }

    #[test]
    fn ladders_that_rise_are_named_whatever_their_order() {
        let bake = Method::Bake(Basis::Hierarchical);
        let all = [
            made(bake, 0.01, 2, [8.0, 0.015]),
            made(bake, 0.1, 2, [1.0, 0.08]),
            made(bake, 0.02, 2, [4.0, 0.01]),
            made(bake, 0.02, 1, [4.0, 0.5]),
            made(Method::Paths, 16.0, 2, [1.0, 0.4]),
            made(Method::Paths, 64.0, 2, [4.0, 0.2]),
        ];
        let risen = risen(&all);
        assert_eq!(risen.len(), 1);
        assert_eq!((risen[0].from, risen[0].to), ([0.02, 0.01], [0.01, 0.015]));
        let slopes = slopes(&all);
        assert_eq!(slopes.len(), 2);
        assert!((slopes[1].exponent + 0.5).abs() < 1e-12 && slopes[1].method == "path tracing");
    }
}
