//! SIGINT and SIGTERM: the first asks to stop, the second stops.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::bake::Signal;

/// What the signal handlers leave behind.
#[derive(Debug, Clone)]
pub struct Signals {
    came: Arc<AtomicUsize>,
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
