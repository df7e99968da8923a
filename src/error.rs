//! The library's one error type, split by who can act on it.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// A result whose error is [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What a file system takes for the smallest thing: said to be missing where nothing better is known.
const LEAST_BYTES: u64 = 4096;

/// What went wrong, where, and what to do about it. Each variant has one exit code (see [`Error::exit_code`]).
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An input file is malformed or holds values that light transport has no meaning for.
    #[error("{}: {place}: {problem}; {remedy}", one_line(&file.to_string_lossy(), 4096))]
    Input {
        /// The offending file.
        file: PathBuf,
        /// Line, byte, element or key within the file.
        place: String,
        /// What is wrong there, with expected and found values.
        problem: String,
        /// What the user can do.
        remedy: String,
    },
    /// The command line asks for something that has no meaning.
    #[error("{0}")]
    Usage(String),
    /// Reading or writing failed; the work done so far is kept.
    #[error("{}: {action}: {source}", file.display())]
    Io {
        /// The file concerned.
        file: PathBuf,
        /// What was being done ("reading the header").
        action: String,
        /// The operating system's answer.
        source: std::io::Error,
    },
    /// The disk is full; the job resumes once there is room.
    #[error("{}: disk full: {needed_bytes} more bytes are needed; free them and run the same command again", file.display())]
    DiskFull {
        /// The file that could not be written.
        file: PathBuf,
        /// How many bytes were still to be written.
        needed_bytes: u64,
    },
    /// A stage would need more memory than the budget allows.
    #[error(
        "{stage} needs about {needed_bytes} bytes, over --max-memory {budget_bytes}; raise the budget or the error target"
    )]
    Memory {
        /// The stage that would exceed the budget.
        stage: String,
        /// Estimated need.
        needed_bytes: u64,
        /// The budget.
        budget_bytes: u64,
    },
    /// The system gave no more memory.
    #[error("{action}: the system has no memory left for this; end other programs or raise its limits")]
    OutOfMemory {
        /// What was being done.
        action: String,
    },
    /// The job directory holds a job made from other inputs or options.
    #[error("{}: the job was made with other inputs or options: {difference}; choose another -o, or --restart", job.display())]
    JobDiffers {
        /// The job directory.
        job: PathBuf,
        /// What differs: option or file, there and now.
        difference: String,
    },
    /// No job at this path.
    #[error("{}: no such job; make one with `glowtree bake SCENE -o {}`", job.display(), job.display())]
    NoJob {
        /// The path given.
        job: PathBuf,
    },
    /// Another process works on the job.
    #[error("{}: locked by {holder}; wait for it or stop it", job.display())]
    JobLocked {
        /// The job directory.
        job: PathBuf,
        /// Process and host of the holder.
        holder: String,
    },
    /// A checksum or invariant of an archive fails.
    #[error("{}: {place}: {problem}; {}", file.display(), mending(file))]
    Damaged {
        /// The archive file.
        file: PathBuf,
        /// Which block.
        place: String,
        /// Expected and found.
        problem: String,
    },
    /// Verifying a job found damage, or a repair could not make it whole.
    #[error("{}: {problem}", job.display())]
    DamagedJob {
        /// The job directory.
        job: PathBuf,
        /// How much is damaged, and what to do.
        problem: String,
    },
    /// The iteration stopped at its limit before the residual reached the tolerance.
    #[error(
        "did not converge: residual {residual:.3e} after {iterations} iterations; raise --max-bounces or lower the albedos"
    )]
    NotConverged {
        /// Iterations done.
        iterations: usize,
        /// Relative residual reached.
        residual: f64,
    },
    /// Rows of the stability table exceed their limits.
    #[error("the stability table does not hold: rows {rows}; please report it with the table")]
    Unstable {
        /// Their numbers, with commas.
        rows: String,
    },
    /// A signal asked the program to stop; the job is resumable.
    #[error("interrupted by {signal}; run the same command again", signal = if *terminated { "SIGTERM" } else { "SIGINT" })]
    Interrupted {
        /// SIGTERM rather than SIGINT.
        terminated: bool,
    },
}

/// What to do about a damaged file: those of a job can be made anew.
fn mending(file: &Path) -> String {
    let is_archive = file.extension().is_some_and(|ending| ending == "glow");
    let is_note = ["options.json", "inputs.json", "summary.json"].iter().any(|name| file.ends_with(name));
    match file.parent().filter(|job| (is_archive || is_note) && !job.as_os_str().is_empty()) {
        Some(job) => format!("`glowtree verify {} --repair` makes it anew", job.display()),
        None => "bake again with --restart".to_owned(),
    }
}

/// Characters to which each fact of an [`Error::Input`] is cut: files may hold names without end.
const FACT_LENGTH: usize = 300;

/// A text, perhaps from a file, as part of one line: control characters are escaped, what is longer than `length` loses
/// its middle.
pub(crate) fn one_line(text: &str, length: usize) -> String {
    let mut line = String::with_capacity(text.len().min(length));
    for letter in shortened(text, length).chars() {
        if letter.is_control() { line.extend(letter.escape_default()) } else { line.push(letter) }
    }
    // Escapes are longer than what they stand for.
    shortened(&line, length).into_owned()
}

/// Both ends of a long text; a path ends in its name, a message begins with its subject.
fn shortened(text: &str, length: usize) -> Cow<'_, str> {
    let at = |number: usize| text.char_indices().nth(number).map(|(at, _)| at);
    if at(length).is_none() {
        return Cow::Borrowed(text);
    }
    let half = length / 2;
    let head = &text[..at(half).unwrap_or(0)];
    let tail = text.char_indices().rev().nth(half).map_or("", |(at, letter)| &text[at + letter.len_utf8()..]);
    Cow::Owned(format!("{head}[...]{tail}"))
}

impl Error {
    /// The program's exit code for this error; fixed for ever.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Unstable { .. } => 1,
            Self::Usage(_) => 2,
            Self::JobDiffers { .. } => 3,
            Self::Input { .. } => 4,
            Self::Memory { .. } | Self::OutOfMemory { .. } => 6,
            Self::DiskFull { .. } => 7,
            Self::Io { .. } => 8,
            Self::Damaged { .. } | Self::DamagedJob { .. } => 9,
            Self::NoJob { .. } => 10,
            Self::JobLocked { .. } => 11,
            Self::NotConverged { .. } => 12,
            Self::Interrupted { terminated: false } => 130,
            Self::Interrupted { terminated: true } => 143,
        }
    }

    /// An [`Error::Input`] from its four facts.
    pub fn input(
        file: impl Into<PathBuf>,
        place: impl Into<String>,
        problem: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let fact = |text: String| one_line(&text, FACT_LENGTH);
        let (place, problem, remedy) = (fact(place.into()), fact(problem.into()), fact(remedy.into()));
        Self::Input { file: file.into(), place, problem, remedy }
    }

    /// An [`Error::Io`], or [`Error::DiskFull`] or [`Error::OutOfMemory`] when that is what the system said.
    pub fn io(file: impl Into<PathBuf>, action: impl Into<String>, source: std::io::Error) -> Self {
        use std::io::ErrorKind::{OutOfMemory, QuotaExceeded, StorageFull};
        let (file, action) = (file.into(), action.into());
        match source.kind() {
            StorageFull | QuotaExceeded => Self::DiskFull { file, needed_bytes: LEAST_BYTES },
            OutOfMemory => Self::OutOfMemory { action: format!("{}: {action}", file.display()) },
            _ => Self::Io { file, action, source },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;

    #[test]
    fn what_the_system_lacks_has_its_own_codes_and_never_lacks_nothing() {
        for (kind, code) in [
            (ErrorKind::StorageFull, 7),
            (ErrorKind::QuotaExceeded, 7),
            (ErrorKind::OutOfMemory, 6),
            (ErrorKind::PermissionDenied, 8),
        ] {
            let error = Error::io("job", "writing", kind.into());
            assert_eq!(error.exit_code(), code, "{kind}");
            assert!(!error.to_string().contains(" 0 more bytes"), "{error}");
        }
    }

    #[test]
    fn facts_are_single_short_lines() {
        assert_eq!(one_line("a\nb\u{1b}[2Jü", 100), "a\\nb\\u{1b}[2Jü");
        assert_eq!(one_line("0123456789", 10), "0123456789");
        assert_eq!(one_line("0123456789ü", 4), "01[...]9ü");
        // Escaped, each of these takes five characters.
        assert_eq!(one_line(&"\0".repeat(100), 10), "\\u{0}[...]\\u{0}");
        let error = Error::input("a\rb.ply", "x".repeat(1000), "", "");
        assert!(error.to_string().starts_with("a\\rb.ply: xxx") && error.to_string().len() < 330, "{error}");
    }
}
