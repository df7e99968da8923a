//! SIGINT and SIGTERM: the first asks to stop, the second stops. SIGBUS: a mapped file was cut short while it was read.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGBUS, SIGINT, SIGTERM};
use signal_hook::flag;

use crate::bake::Signal;

/// What the signal handlers leave behind.
#[derive(Debug, Clone)]
pub struct Signals {
    came: Arc<AtomicUsize>,
    cut: Arc<AtomicBool>,
    alone: Arc<AtomicBool>,
}

/// Exit code of a reader whose file was cut short under it.
const DAMAGED: i32 = 9;

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
        // The thread that met the gap meets it again whenever the handler returns, and computes nothing meanwhile: whoever
        // watches prints why and leaves. If nobody does, the handler leaves.
        let (cut, alone) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let _ = flag::register_conditional_shutdown(SIGBUS, DAMAGED, Arc::clone(&alone));
        let _ = flag::register(SIGBUS, Arc::clone(&cut));
        Self { came, cut, alone }
    }

    /// Whether a file was cut short while it was read: the thread that read it does not go on.
    pub fn cut(&self) -> bool {
        self.cut.load(Ordering::Relaxed)
    }

    /// Nobody asks [`Signals::cut`] any more: the next time, the program just leaves with its exit code.
    pub fn leave_alone(&self) {
        self.alone.store(true, Ordering::Relaxed);
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
