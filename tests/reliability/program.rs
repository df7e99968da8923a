//! Runs the program itself.

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use super::job::ERROR;

/// What a run of the program said.
#[derive(Debug)]
pub struct Said {
    /// Its exit code; 128 and the signal's number when one ended it.
    pub code: i32,
    /// The last line of its standard output.
    pub last: serde_json::Value,
    /// Its standard error.
    pub complaint: String,
}

impl Said {
    /// A figure of the summary.
    pub fn figure(&self, name: &str) -> Option<u64> {
        self.last[name].as_u64()
    }

    /// Blocks resumed and computed.
    pub fn blocks(&self) -> (u64, u64) {
        let figure = |name| self.figure(name).unwrap_or(u64::MAX);
        (figure("resumed_blocks"), figure("computed_blocks"))
    }

    /// All of it in one line.
    pub fn in_words(&self) -> String {
        let complaint: String = self.complaint.trim().chars().take(300).collect();
        format!("code {}, {}, {:?}", self.code, self.last["message"], complaint)
    }
}

impl From<Output> for Said {
    fn from(output: Output) -> Self {
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let last = text.lines().last().and_then(|line| serde_json::from_str(line).ok()).unwrap_or_default();
        let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
        Self { code: code(&output.status), last, complaint }
    }
}

#[cfg(unix)]
fn code(status: &std::process::ExitStatus) -> i32 {
    use std::os::unix::process::ExitStatusExt;
    status.code().unwrap_or_else(|| 128 + status.signal().unwrap_or(0))
}

#[cfg(not(unix))]
fn code(status: &std::process::ExitStatus) -> i32 {
    status.code().unwrap_or(1)
}

/// A bake of the small scene, ready to run.
pub fn bake(scene: &Path, job: &Path, preview: bool) -> Command {
    bake_at(ERROR, (scene, job), preview)
}

/// A bake at an error target.
pub fn bake_at(error: &str, (scene, job): (&Path, &Path), preview: bool) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_glowtree"));
    command.arg("bake").arg(scene).arg("-o").arg(job).args([
        "--error",
        error,
        "--json",
        "--progress",
        "none",
    ]);
    if !preview {
        command.arg("--no-preview");
    }
    command
}

/// Starts a command with its outputs kept.
pub fn start(command: &mut Command) -> Child {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Runs a command to its end.
pub fn run(command: &mut Command) -> Said {
    start(command).wait_with_output().unwrap().into()
}

/// Sends a signal by its name after a while, and waits for the end.
pub fn run_and_send(command: &mut Command, after: Duration, signal: &str) -> (Said, Duration) {
    let child = start(command);
    std::thread::sleep(after);
    let asked = std::time::Instant::now();
    // A program that ended already is not there to be told.
    let _ = Command::new("kill").args(["-s", signal, &child.id().to_string()]).stderr(Stdio::null()).status();
    let said = child.wait_with_output().unwrap().into();
    (said, asked.elapsed())
}
