//! Progress as bars, as plain lines, or as JSON lines.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::json::{self, Line, Status};
use super::{print, say_line};
use crate::bake::StageTime;
use crate::cli::arguments::Progress;
use crate::cli::values::{show_bytes, show_count, show_seconds};

/// Between two plain lines of one stage.
const PLAIN_INTERVAL: Duration = Duration::from_secs(30);

/// Between two JSON lines of one stage.
const JSON_INTERVAL: Duration = Duration::from_secs(1);

/// A way to show progress.
pub enum Show {
    /// One bar on standard error, and a line above it for each finished stage.
    Bar(ProgressBar),
    /// Lines on standard error.
    Plain,
    /// JSON lines.
    Json {
        /// On standard output rather than standard error.
        on_stdout: bool,
    },
    /// Nothing.
    Nothing,
}

impl Show {
    /// The way chosen; `Auto` must be resolved before.
    pub fn new(progress: Progress, json: bool) -> Self {
        match progress {
            Progress::Bar => Self::Bar(bar()),
            Progress::Plain => Self::Plain,
            Progress::Json => Self::Json { on_stdout: json },
            Progress::Auto | Progress::None => Self::Nothing,
        }
    }

    /// Whether something is to be shown that long after the last time.
    pub fn is_due(&self, since: Duration) -> bool {
        match self {
            Self::Bar(_) => true,
            Self::Plain => since >= PLAIN_INTERVAL,
            Self::Json { .. } => since >= JSON_INTERVAL,
            Self::Nothing => false,
        }
    }

    /// A stage begins.
    pub fn started(&self, status: &Status) {
        match self {
            Self::Bar(bar) => {
                bar.reset();
                bar.set_length(status.total.unwrap_or(0));
                bar.set_prefix(status.stage.clone());
                draw(bar, status);
            }
            Self::Plain => {
                let total = status.total.map(|total| format!(": {} {}", show_count(total), status.unit));
                say_line(&format!("{}{}", status.stage, total.unwrap_or_default()));
            }
            Self::Json { .. } => self.json(status),
            Self::Nothing => {}
        }
    }

    /// A stage goes on.
    pub fn running(&self, status: &Status) {
        match self {
            Self::Bar(bar) => draw(bar, status),
            Self::Plain => say_line(&format!("{}: {}", status.stage, describe(status))),
            Self::Json { .. } => self.json(status),
            Self::Nothing => {}
        }
    }

    /// A stage is done.
    pub fn finished(&self, status: &Status, time: &StageTime, verbose: bool) {
        let line = || {
            let cpu = show_seconds(time.cpu_seconds);
            format!("{} done in {} ({cpu} of CPU)", status.stage, show_seconds(time.seconds))
        };
        match self {
            Self::Bar(bar) => bar.suspend(|| say_line(&line())),
            Self::Plain if verbose => say_line(&line()),
            Self::Json { .. } => self.json(status),
            Self::Plain | Self::Nothing => {}
        }
    }

    /// Runs `say` with bars out of the way.
    pub fn above(&self, say: &dyn Fn()) {
        match self {
            Self::Bar(bar) => bar.suspend(say),
            _ => say(),
        }
    }

    /// Removes bars.
    pub fn clear(&self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }

    fn json(&self, status: &Status) {
        let line = json::text(&Line::Status(status));
        if matches!(self, Self::Json { on_stdout: true }) {
            // A closed pipe does not stop a bake of hours.
            let _ = print(line.as_bytes());
        } else {
            say_line(line.trim_end());
        }
    }
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
    // A template that does not parse leaves indicatif's own.
    if let Ok(style) = ProgressStyle::with_template("{prefix:>9} [{bar:30}] {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

fn draw(bar: &ProgressBar, status: &Status) {
    bar.set_position(status.done.min(status.total.unwrap_or(0)));
    bar.set_message(describe(status));
}

/// "1 200/3 400 receivers, 35%, ETA 12 s, memory 1.2 GiB, disk 300 MiB"
fn describe(status: &Status) -> String {
    let count = match status.total {
        Some(total) if total > 0 => {
            let percent = (100.0 * status.done as f64 / total as f64).min(100.0);
            format!("{}/{} {}, {percent:.0}%", show_count(status.done), show_count(total), status.unit)
        }
        _ => format!("{} {}", show_count(status.done), status.unit),
    };
    let eta = status.eta_seconds.map_or("unknown".to_owned(), show_seconds);
    let memory = show_bytes(status.anonymous_bytes);
    let disk = if status.disk_bytes > 0 {
        format!(", disk {}", show_bytes(status.disk_bytes))
    } else {
        String::new()
    };
    format!("{count}, ETA {eta}, memory {memory}{disk}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_lines_say_how_far_and_how_long() {
        let status = Status {
            event: "running",
            stage: "links".into(),
            unit: "receivers".into(),
            done: 1200,
            total: Some(4800),
            seconds: 10.0,
            eta_seconds: Some(30.0),
            anonymous_bytes: 3 << 29,
            resident_bytes: 4 << 29,
            disk_bytes: 0,
        };
        assert_eq!(describe(&status), "1 200/4 800 receivers, 25%, ETA 30 s, memory 1.5 GiB");
        let unknown = Status { total: None, eta_seconds: None, disk_bytes: 2048, ..status };
        assert_eq!(describe(&unknown), "1 200 receivers, ETA unknown, memory 1.5 GiB, disk 2.0 KiB");
    }
}
