//! SIGINT and SIGTERM: the first asks to stop, the second stops. SIGBUS: a mapped file was cut short while it was read.
//! SIGABRT: memory ran out.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGABRT, SIGINT, SIGTERM};
use signal_hook::flag;

use super::json::{self, Line};
use crate::archive;
use crate::bake::Signal;
use crate::error::Error;

/// The exit code when memory runs out.
const OUT_OF_MEMORY: i32 = 6;

/// An allocation that fails says so on standard error and then aborts: nothing can be unwound without memory. To whoever
/// runs the program that is a case of too little memory, code 6, and no crash; files are write-once, so leaving at any
/// moment is safe. Aborts with a panic under way (in a destructor, say) are faults of the program and stay what they are.
/// To be called before anything that allocates much.
pub fn leave_orderly_without_memory() {
    let armed = Arc::new(AtomicBool::new(true));
    let disarm = Arc::clone(&armed);
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !is_for_memory(panic) {
            disarm.store(false, Ordering::Relaxed);
        }
        usual(panic);
    }));
    let _ = flag::register_conditional_shutdown(SIGABRT, OUT_OF_MEMORY, armed);
}

/// Whether the system refused memory: the standard library panics, and aborts, when there is none for a new thread's
/// signal stack.
fn is_for_memory(panic: &std::panic::PanicHookInfo<'_>) -> bool {
    const REFUSED: &str = "Cannot allocate memory";
    panic.payload().downcast_ref::<String>().is_some_and(|text| text.contains(REFUSED))
}

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
