//! The program: parses, runs one verb, prints its report, leaves with its exit code. No mathematics.

pub mod arguments;
pub mod console;
mod destination;
pub mod values;
mod verbs;

use std::ffi::OsString;
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use clap::{ColorChoice, CommandFactory, FromArgMatches};

use crate::error::{Error, Result};
use arguments::{Arguments, Manners, Verb};
use console::Console;

/// Exit code of an error that has no better one; a panic, for instance.
const OTHER_ERROR: u8 = 1;

/// Runs the program on the process's arguments.
pub fn main() -> ExitCode {
    console::signals::leave_orderly_without_memory();
    let words: Vec<OsString> = std::env::args_os().collect();
    let arguments = match parse(&words) {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    let console = Console::open(&arguments.manners);
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        use_threads(&arguments.manners)?;
        run(&arguments.verb, &console)
    }));
    console.close();
    ExitCode::from(match outcome {
        Ok(Ok(())) => 0,
        Ok(Err(error)) if is_closed_pipe(&error) => 0,
        Ok(Err(error)) => {
            console.fail(error.exit_code(), &error.to_string());
            error.exit_code()
        }
        // The panic's own message is on standard error already.
        Err(_) => {
            console.fail(OTHER_ERROR, "internal error: this is a bug in glowtree, please report it");
            OTHER_ERROR
        }
    })
}

/// The arguments, or the exit code after help, version or a usage error was printed.
fn parse(words: &[OsString]) -> std::result::Result<Arguments, ExitCode> {
    let colour = match words.iter().position(|word| word == "--color").and_then(|at| words.get(at + 1)) {
        Some(choice) if choice == "never" => ColorChoice::Never,
        Some(choice) if choice == "always" => ColorChoice::Always,
        _ if words.iter().any(|word| word == "--color=never") => ColorChoice::Never,
        _ if words.iter().any(|word| word == "--color=always") => ColorChoice::Always,
        _ => ColorChoice::Auto,
    };
    let matches = Arguments::command().color(colour).try_get_matches_from(words);
    matches.and_then(|matches| Arguments::from_arg_matches(&matches)).map_err(|refusal| {
        // A closed pipe behind --help is no error.
        let _ = refusal.print();
        let code = refusal.exit_code();
        if code != 0 && words.iter().any(|word| word == "--json") {
            let message = refusal.render().to_string();
            let first = message.lines().next().unwrap_or_default().trim_start_matches("error: ");
            console::print_error_line(code as u8, first);
        }
        ExitCode::from(code as u8)
    })
}

/// Starts the one pool of threads that every stage shares. Left to itself it would start at its first use, and panic if
/// the system gives no memory for stacks.
fn use_threads(manners: &Manners) -> Result<()> {
    // Zero is as many as there are processors.
    let threads = manners.threads.unwrap_or(0) as usize;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    pool.map_err(|e| Error::OutOfMemory { action: format!("starting threads: {e}") })
}

fn run(verb: &Verb, console: &Console) -> Result<()> {
    match verb {
        Verb::Bake(request) => verbs::bake::run(request, console),
        Verb::Probe(request) => verbs::points::probe::run(request, console),
        Verb::Reference(request) => verbs::points::reference::run(request, console),
        Verb::Export(request) => verbs::export::run(request, console),
        Verb::Render(request) => verbs::render::run(request, console),
        Verb::Relight(request) => verbs::relight::run(request, console),
        Verb::View(request) => verbs::view::run(request, console),
        Verb::Inspect(request) => verbs::inspect::run(request, console),
        Verb::Verify(request) => verbs::verify::run(request, console),
        Verb::Chart(request) => verbs::chart::run(request, console),
        Verb::Completions(request) => verbs::packaging::completions(request, console),
        Verb::Man => verbs::packaging::manual(console),
    }
}

/// Whether the reader of standard output went away, as `head` does when it has enough.
fn is_closed_pipe(error: &Error) -> bool {
    matches!(error, Error::Io { file, source, .. }
        if source.kind() == ErrorKind::BrokenPipe && file.as_os_str() == console::STANDARD_OUTPUT)
}
