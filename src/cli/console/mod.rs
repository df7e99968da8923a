//! What the program says and where: results on standard output, everything else on standard error, JSON lines on demand.

pub mod json;
pub mod show;
pub mod signals;

use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle, park_timeout};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::arguments::{Colour, Manners, Progress};
use crate::bake::{Monitor, Signal, StageTime, usage};
use crate::error::{Error, Result};
use json::{Line, Status};
use show::Show;
use signals::Signals;

/// The file name that errors of standard output carry.
pub const STANDARD_OUTPUT: &str = "standard output";

/// How often progress is looked at: bars move smoothly, and a stop is acknowledged at once for a person.
const TICK: Duration = Duration::from_millis(100);

/// The program's mouth: prints results, warnings, errors, and progress from a thread of its own.
pub struct Console {
    shared: Arc<Shared>,
    ticker: Mutex<Option<JoinHandle<()>>>,
}

/// What the ticker and the workers share.
struct Shared {
    json: bool,
    quiet: bool,
    verbose: u8,
    colour: bool,
    show: Show,
    signals: Signals,
    done: AtomicU64,
    disk: AtomicU64,
    stage: Mutex<Option<Running>>,
    closed: AtomicBool,
}

/// The stage under way.
struct Running {
    name: String,
    unit: String,
    total: Option<u64>,
    started: Instant,
    last_line: Instant,
}

impl Console {
    /// Installs the signal handlers and starts the ticker.
    pub fn open(manners: &Manners) -> Self {
        let terminal = io::stderr().is_terminal();
        signals::leave_when_cut(manners.json);
        let progress = match manners.progress {
            Progress::Auto if manners.quiet => Progress::None,
            Progress::Auto if manners.json => Progress::Json,
            Progress::Auto if terminal => Progress::Bar,
            Progress::Auto => Progress::Plain,
            chosen => chosen,
        };
        let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        let shared = Arc::new(Shared {
            json: manners.json,
            quiet: manners.quiet,
            verbose: manners.verbose,
            colour: match manners.color {
                Colour::Auto => terminal && !no_colour,
                Colour::Always => true,
                Colour::Never => false,
            },
            show: Show::new(progress, manners.json),
            signals: Signals::install(),
            done: AtomicU64::new(0),
            disk: AtomicU64::new(0),
            stage: Mutex::new(None),
            closed: AtomicBool::new(false),
        });
        let watched = Arc::clone(&shared);
        // Without memory for a thread there is no progress to see.
        let ticker = Builder::new().spawn(move || watched.tick());
        Self { shared, ticker: Mutex::new(ticker.ok()) }
    }

    /// Stops the ticker and removes bars; messages still go through.
    pub fn close(&self) {
        self.shared.closed.store(true, Ordering::Relaxed);
        if let Some(ticker) = lock(&self.ticker).take() {
            ticker.thread().unpark();
            // A ticker that panicked has said so; there is nothing to add.
            let _ = ticker.join();
        }
        *lock(&self.shared.stage) = None;
        self.shared.show.clear();
    }

    /// Whether standard output carries JSON lines.
    pub fn json(&self) -> bool {
        self.shared.json
    }

    /// Prints the result of a verb for people; silent under `--json` and `-q`.
    ///
    /// # Errors
    /// [`Error::Io`] on [`STANDARD_OUTPUT`] when it is closed or full.
    pub fn result(&self, text: &str) -> Result<()> {
        if self.shared.json || self.shared.quiet { Ok(()) } else { print(text.as_bytes()) }
    }

    /// Prints the last JSON line of a verb; silent without `--json`.
    ///
    /// # Errors
    /// As [`Console::result`].
    pub fn summary(&self, verb: &str, figures: impl Serialize) -> Result<()> {
        if !self.shared.json {
            return Ok(());
        }
        print(json::summary(verb, figures).as_bytes())
    }

    /// Prints why the program leaves with `code`.
    pub fn fail(&self, code: u8, message: &str) {
        if self.shared.json {
            print_error_line(code, message);
        }
        self.shared.say("error", "31", message);
    }

    /// Leaves at once when a signal came: for work that keeps nothing and cannot be told to stop.
    pub fn leave_if_interrupted(&self) {
        if let Err(error) = self.check() {
            self.close();
            self.fail(error.exit_code(), &error.to_string());
            std::process::exit(i32::from(error.exit_code()));
        }
    }

    /// Prints a remark for those who asked for more (`-v`).
    pub fn remark(&self, message: &str) {
        if self.shared.verbose > 0 {
            self.shared.show.above(&|| say_line(message));
        }
    }
}

impl Drop for Console {
    fn drop(&mut self) {
        self.close();
    }
}

impl Monitor for Console {
    fn start(&self, stage: &str, unit: &str, total: Option<u64>) {
        let now = Instant::now();
        let running = Running { name: stage.into(), unit: unit.into(), total, started: now, last_line: now };
        self.shared.done.store(0, Ordering::Relaxed);
        let status = self.shared.status("started", &running);
        *lock(&self.shared.stage) = Some(running);
        self.shared.show.started(&status);
    }

    fn advance(&self, amount: u64) {
        self.shared.done.fetch_add(amount, Ordering::Relaxed);
    }

    fn finish(&self, stage: &StageTime) {
        let running = lock(&self.shared.stage).take();
        if let Some(running) = running {
            let mut status = self.shared.status("finished", &running);
            status.seconds = stage.seconds;
            status.eta_seconds = Some(0.0);
            self.shared.show.finished(&status, stage, self.shared.verbose > 0);
        }
    }

    fn disk(&self, bytes: u64) {
        self.shared.disk.store(bytes, Ordering::Relaxed);
    }

    fn note(&self, message: &str) {
        if self.shared.json {
            // As for warnings.
            let _ = print(json::text(&Line::Note { message }).as_bytes());
        } else if !self.shared.quiet {
            self.shared.say("note", "36", message);
        }
    }

    fn warn(&self, message: &str) {
        if self.shared.json {
            // Whoever closed the pipe does not want to know.
            let _ = print(json::text(&Line::Warning { message }).as_bytes());
        } else if !self.shared.quiet {
            self.shared.say("warning", "33", message);
        }
    }

    fn interrupted(&self) -> Option<Signal> {
        self.shared.signals.came()
    }
}

impl Shared {
    /// Shows progress until closed.
    fn tick(&self) {
        let mut acknowledged = false;
        while !self.closed.load(Ordering::Relaxed) {
            if !acknowledged && self.signals.came().is_some() {
                acknowledged = true;
                if !self.quiet {
                    self.say("stopping", "33", "finishing the block in flight; once more to leave at once");
                }
            }
            if let Some(running) = lock(&self.stage).as_mut()
                && self.show.is_due(running.last_line.elapsed())
            {
                running.last_line = Instant::now();
                self.show.running(&self.status("running", running));
            }
            park_timeout(TICK);
        }
    }

    fn status(&self, event: &'static str, running: &Running) -> Status {
        let done = self.done.load(Ordering::Relaxed);
        let seconds = running.started.elapsed().as_secs_f64();
        let now = usage::resident();
        let remaining = running.total.filter(|_| done > 0).map(|total| total.saturating_sub(done) as f64);
        Status {
            event,
            stage: running.name.clone(),
            unit: running.unit.clone(),
            done,
            total: running.total,
            seconds,
            eta_seconds: remaining.map(|left| left * seconds / done as f64),
            anonymous_bytes: now.anonymous_bytes,
            resident_bytes: now.bytes,
            disk_bytes: self.disk.load(Ordering::Relaxed),
        }
    }

    /// A message on standard error, its label coloured.
    fn say(&self, label: &str, ansi: &str, message: &str) {
        let line = if self.colour {
            format!("\x1b[1;{ansi}m{label}:\x1b[0m {message}")
        } else {
            format!("{label}: {message}")
        };
        self.show.above(&|| say_line(&line));
    }
}

/// Prints an error line of JSON on standard output.
pub fn print_error_line(code: u8, message: &str) {
    // The exit code says the same to those who closed the pipe.
    let _ = print(json::text(&Line::Error { code, message }).as_bytes());
}

/// Prints a result of its own as a JSON line on standard output.
///
/// # Errors
/// As [`print()`].
pub fn line(value: &impl Serialize) -> Result<()> {
    print(json::serialised(value).as_bytes())
}

/// Writes to standard output at once.
///
/// # Errors
/// [`Error::Io`] on [`STANDARD_OUTPUT`].
pub fn print(bytes: &[u8]) -> Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(bytes).and_then(|()| out.flush()).map_err(|e| Error::io(STANDARD_OUTPUT, "writing", e))
}

/// Writes a line to standard error; where that is closed there is nowhere left to complain.
fn say_line(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// Locks whatever a panicking thread left behind: only progress display is at stake.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
