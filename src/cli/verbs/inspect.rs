//! `glowtree inspect JOB`

use std::fmt::Write;

use crate::bake::Summary;
use crate::cli::arguments::Inspect;
use crate::cli::console::Console;
use crate::cli::values::{show_bytes, show_count, show_seconds};
use crate::error::Result;

/// Prints what the job's summary holds.
pub fn run(request: &Inspect, console: &Console) -> Result<()> {
    let summary = Summary::read(&request.job)?;
    console.result(&table(&summary))?;
    console.summary("inspect", &summary)
}

fn table(summary: &Summary) -> String {
    let converged = if summary.converged { "converged" } else { "not converged" };
    let rows = [
        ("triangles", show_count(summary.triangles)),
        ("vertices", show_count(summary.vertices)),
        ("sites", show_count(summary.sites)),
        ("levels", summary.levels.to_string()),
        ("links", show_count(summary.links)),
        ("rays", show_count(summary.rays)),
        ("on disk", show_bytes(summary.archive_bytes)),
        ("bytes per link", format!("{:.2}", summary.bytes_per_link)),
        ("estimated error", format!("{:.2}%", 100.0 * summary.estimated_error)),
        (
            "solver",
            format!("{} iterations, residual {:.1e}, {converged}", summary.iterations, summary.residual),
        ),
        ("peak memory", show_bytes(summary.usage.peak_anonymous_bytes)),
        ("time", show_seconds(summary.usage.seconds)),
        ("CPU time", show_seconds(summary.usage.cpu_seconds)),
    ];
    let mut text = String::new();
    for (name, value) in rows {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{name:<16} {value}");
    }
    for stage in &summary.stages {
        let (wall, cpu) = (show_seconds(stage.seconds), show_seconds(stage.cpu_seconds));
        let _ = writeln!(text, "  {:<14} {wall}, {cpu} of CPU", stage.name);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::StageTime;

    #[test]
    fn the_table_has_counts_and_stages() {
        let stage = StageTime { name: "links".into(), seconds: 61.0, cpu_seconds: 0.5 };
        let summary = Summary { sites: 12_345, stages: vec![stage], ..Summary::default() };
        let text = table(&summary);
        assert!(text.contains("sites            12 345\n"), "{text}");
        assert!(text.contains("  links          1 min 01 s, 0.50 s of CPU\n"), "{text}");
    }
}
