//! What a running job tells its watcher, and how the watcher asks it to stop.

use super::summary::StageTime;
use super::usage::Stopwatch;
use crate::error::{Error, Result};

/// A signal that asked the program to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// SIGINT: Ctrl-C.
    Interrupt,
    /// SIGTERM.
    Terminate,
}

/// Watches a job: the program's bars, its plain lines, its JSON lines, or nobody ([`Silent`]).
///
/// Stages run one at a time; [`advance`](Monitor::advance) may be called from any thread and is cheap enough for
/// every hundred microseconds of work.
pub trait Monitor: Sync {
    /// A stage begins. `total` counts its `unit`s ("triangles", "receivers", "bytes") when known.
    fn start(&self, _stage: &str, _unit: &str, _total: Option<u64>) {}

    /// That many more units are done.
    fn advance(&self, _amount: u64) {}

    /// The stage that ran is done.
    fn finish(&self, _stage: &StageTime) {}

    /// Bytes that the job's files take now.
    fn disk(&self, _bytes: u64) {}

    /// Something that the user should know, that stops nothing and is no reason to worry: what is reused, what redone.
    fn note(&self, _message: &str) {}

    /// Something the user should know and that stops nothing.
    fn warn(&self, _message: &str) {}

    /// The signal that asked to stop, if one came.
    fn interrupted(&self) -> Option<Signal> {
        None
    }

    /// Errors with [`Error::Interrupted`] once a signal came: call it between blocks of work, at least every second.
    fn check(&self) -> Result<()> {
        match self.interrupted() {
            None => Ok(()),
            Some(signal) => Err(Error::Interrupted { terminated: signal == Signal::Terminate }),
        }
    }
}

/// Nobody watches and nothing interrupts.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Monitor for Silent {}

/// A stage under way: announces itself, times itself and says so when done.
pub struct Stage<'m> {
    monitor: &'m dyn Monitor,
    name: &'m str,
    watch: Stopwatch,
}

impl<'m> Stage<'m> {
    /// Announces the stage and starts its clock.
    pub fn start(monitor: &'m dyn Monitor, name: &'m str, unit: &str, total: Option<u64>) -> Self {
        monitor.start(name, unit, total);
        Self { monitor, name, watch: Stopwatch::start() }
    }

    /// Counts finished units, then errors with [`Error::Interrupted`] if a signal came.
    pub fn advance(&self, amount: u64) -> Result<()> {
        self.monitor.advance(amount);
        self.monitor.check()
    }

    /// Stops the clock, tells the monitor and returns the entry for [`Summary::stages`](super::summary::Summary::stages).
    pub fn finish(self) -> StageTime {
        let time = StageTime {
            name: self.name.to_owned(),
            seconds: self.watch.seconds(),
            cpu_seconds: self.watch.cpu_seconds(),
        };
        self.monitor.finish(&time);
        time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Stopped;
    impl Monitor for Stopped {
        fn interrupted(&self) -> Option<Signal> {
            Some(Signal::Terminate)
        }
    }

    #[test]
    fn a_signal_stops_the_stage_with_its_exit_code() {
        let stage = Stage::start(&Stopped, "links", "receivers", Some(10));
        assert_eq!(stage.advance(1).unwrap_err().exit_code(), 143);
        assert!(Stage::start(&Silent, "links", "receivers", None).advance(1).is_ok());
    }
}
