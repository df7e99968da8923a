//! SIGINT and SIGTERM: the first asks to stop, the second stops. SIGBUS: a mapped file was cut short while it was read.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::json::{self, Line};
use crate::archive;
use crate::bake::Signal;
use crate::error::Error;

/// What the signal handlers leave behind.
#[derive(Debug, Clone)]
pub struct Signals {
    came: Arc<AtomicUsize>,
}

/// Makes a bus error say what it is and leave with the exit code of damage.
pub fn leave_when_cut(json: bool) {
    #[cfg(unix)]
    {
        use std::os::fd::AsFd;
        let problem =
            "was cut short while it was read; `glowtree verify JOB --repair` makes it anew".to_owned();
        let error = Error::DamagedJob { job: "a file of the job".into(), problem };
        let (code, message) = (error.exit_code(), error.to_string());
        let copy = |fd: std::os::fd::BorrowedFd<'_>| fd.try_clone_to_owned().map(std::fs::File::from);
        let line = json.then(|| json::text(&Line::Error { code, message: &message }).into_bytes());
        let out = line.and_then(|line| Some((copy(std::io::stdout().as_fd()).ok()?, line)));
        let say =
            copy(std::io::stderr().as_fd()).ok().map(|err| (err, format!("error: {message}\n").into_bytes()));
        archive::leave_when_cut(out.into_iter().chain(say).collect(), i32::from(code));
    }
}

impl Signals {
    /// Installs the handlers. A system that refuses them keeps its defaults: the signal ends the program.
    pub fn install() -> Self {
        let came = Arc::new(AtomicUsize::new(0));
        let armed = Arc::new(AtomicBool::new(false));
        for (signal, code) in [(SIGINT, 130), (SIGTERM, 143)] {
            // Actions run in this order: the second signal finds the flag set and leaves; files are write-once, so
            // leaving at any moment is safe.
            let _ = flag::register_conditional_shutdown(signal, code, Arc::clone(&armed));
            let _ = flag::register(signal, Arc::clone(&armed));
            let _ = flag::register_usize(signal, Arc::clone(&came), signal as usize);
        }
        Self { came }
    }

    /// The signal that came, if any.
    pub fn came(&self) -> Option<Signal> {
        match self.came.load(Ordering::Relaxed) {
            0 => None,
            signal if signal == SIGTERM as usize => Some(Signal::Terminate),
            _ => Some(Signal::Interrupt),
        }
    }
}
