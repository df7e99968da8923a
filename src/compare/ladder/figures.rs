//! The figures of a chart, SVG and PNG, five for each scene.

use std::path::{Path, PathBuf};

use super::{Measurement, Method, table};
use crate::error::Result;
use crate::plot::{Axis, Chart, Series, Style};

/// The exponent of y ~ xᵏ by least squares of the logarithms; None for fewer than two different places.
pub fn slope(points: &[[f64; 2]]) -> Option<f64> {
    let logs: Vec<[f64; 2]> =
        points.iter().filter(|p| p[0] > 0.0 && p[1] > 0.0).map(|p| p.map(f64::ln)).collect();
    let count = logs.len() as f64;
    let mean = |k: usize| logs.iter().map(|p| p[k]).sum::<f64>() / count;
    let (x, y) = (mean(0), mean(1));
    let cross: f64 = logs.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    let square: f64 = logs.iter().map(|p| (p[0] - x).powi(2)).sum();
    (logs.len() > 1 && square > 0.0).then(|| cross / square)
}

/// Writes the figures of every scene.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn write(all: &[Measurement], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut scenes: Vec<&str> = all.iter().map(|m| m.scene.as_str()).collect();
    scenes.dedup();
    for scene in scenes {
        let own: Vec<Measurement> = all.iter().filter(|m| m.scene == scene).cloned().collect();
        let charts = [
            ("error-cpu", error_against_cpu(scene, &own)),
            ("error-links", error_against_links(scene, &own)),
            ("memory", memory(scene, &own)),
            ("residual", residual(scene, &own)),
            ("scaling", scaling(scene, &own)),
        ];
        for (name, chart) in charts {
            files.extend(chart.write(&folder.join(format!("{scene}-{name}")))?);
        }
    }
    Ok(files)
}

/// The points of a ladder whose axes both have a number.
fn along(ladder: &[&Measurement], at: impl Fn(&Measurement) -> Option<[f64; 2]>) -> Vec<[f64; 2]> {
    ladder.iter().filter_map(|m| at(m)).collect()
}

fn error_against_cpu(scene: &str, all: &[Measurement]) -> Chart {
    let axes = (Axis::log("CPU time (s)"), Axis::log("relative RMS error of irradiance"));
    let mut chart = Chart::new(format!("{scene}: error against cost"), axes.0, axes.1);
    for ladder in table::ladders(all) {
        let points = along(&ladder, |m| Some([m.cpu_seconds, m.true_error]));
        let name = ladder[0].key.method.name();
        let name = slope(&points).map_or(name.into(), |k| format!("{name}, error ~ t^{k:.2}"));
        chart.series.push(Series::new(name, Style::LineMarkers, points));
    }
    let points = all.first().map_or(0, |m| m.points);
    let noise = all.first().map_or(0.0, |m| 100.0 * m.noise);
    chart.notes.push(format!(
        "Bakes light the whole scene; path tracing finds {points} points alone. Noise of the reference: {noise:.2} %."
    ));
    chart
}

fn error_against_links(scene: &str, all: &[Measurement]) -> Chart {
    let axes = (Axis::log("links"), Axis::log("relative RMS error of irradiance"));
    let mut chart = Chart::new(format!("{scene}: error against links"), axes.0, axes.1);
    for ladder in bakes(all) {
        let points = along(&ladder, |m| Some([m.links? as f64, m.true_error]));
        chart.series.push(Series::new(ladder[0].key.method.name(), Style::LineMarkers, points));
    }
    chart
}

fn memory(scene: &str, all: &[Measurement]) -> Chart {
    let axes = (Axis::log("sites"), Axis::log("archive (bytes)"));
    let mut chart = Chart::new(format!("{scene}: memory against sites"), axes.0, axes.1);
    for ladder in bakes(all) {
        let points = along(&ladder, |m| Some([m.sites? as f64, m.bytes? as f64]));
        chart.series.push(Series::new(ladder[0].key.method.name(), Style::LineMarkers, points));
    }
    chart
}

/// The residual's way down at each method's tightest target.
fn residual(scene: &str, all: &[Measurement]) -> Chart {
    let axes = (Axis::linear("products with the operator"), Axis::log("relative residual"));
    let mut chart = Chart::new(format!("{scene}: convergence"), axes.0, axes.1);
    for tightest in bakes(all).iter().filter_map(|ladder| ladder.last()) {
        let points = tightest.residuals.iter().enumerate().map(|(k, r)| [(k + 1) as f64, *r]).collect();
        let name = format!("{} at {} %", tightest.key.method.name(), 100.0 * tightest.key.target);
        chart.series.push(Series::new(name, Style::LineMarkers, points));
    }
    chart
}

/// Wall-clock time on one and on two threads, where a target was measured on both.
fn scaling(scene: &str, all: &[Measurement]) -> Chart {
    let axes = (Axis::linear("threads").within(0.5, 2.5), Axis::linear("wall-clock time (s)"));
    let mut chart = Chart::new(format!("{scene}: one thread against two"), axes.0, axes.1);
    let bakes = |threads: usize| {
        all.iter().filter(move |m| m.key.method != Method::Paths && m.key.threads == threads)
    };
    for one in bakes(1) {
        let same = |m: &&Measurement| m.key.method == one.key.method && m.key.target == one.key.target;
        let Some(two) = bakes(2).find(same) else { continue };
        let points = vec![[1.0, one.seconds], [2.0, two.seconds]];
        let (name, target) = (one.key.method.name(), 100.0 * one.key.target);
        let name = format!("{name} at {target} %: {:.2} ×", one.seconds / two.seconds);
        if chart.series.iter().all(|s| s.name != name) {
            chart.series.push(Series::new(name, Style::Bars, points));
        }
    }
    chart
}

/// The ladders of bakes.
fn bakes(all: &[Measurement]) -> Vec<Vec<&Measurement>> {
    let mut ladders = table::ladders(all);
    ladders.retain(|ladder| ladder[0].key.method != Method::Paths);
    ladders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_of_powers_are_their_exponents() {
        let points: Vec<[f64; 2]> = (1..6).map(|k| [f64::from(k), f64::from(k).powf(-0.7) * 3.0]).collect();
        assert!((slope(&points).unwrap() + 0.7).abs() < 1e-12);
        assert_eq!(slope(&[[1.0, 2.0]]), None);
        assert_eq!(slope(&[[1.0, 2.0], [1.0, 3.0], [2.0, 0.0]]), None);
    }
}
