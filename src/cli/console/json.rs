//! JSON lines, as `docs/schema.json` has them.

use serde::Serialize;

/// One line of JSON output. NaN and infinity become null.
#[derive(Debug, Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Line<'a> {
    /// Where a running stage is.
    Status(&'a Status),
    /// What is reused and what is made anew.
    Note {
        /// What.
        message: &'a str,
    },
    /// Something the user should know and that stops nothing.
    Warning {
        /// What.
        message: &'a str,
    },
    /// The last line of a verb that failed.
    Error {
        /// The exit code.
        code: u8,
        /// What, where, and what to do.
        message: &'a str,
    },
}

/// Where a stage is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Status {
    /// "started", "running" or "finished".
    pub event: &'static str,
    /// The stage's noun.
    pub stage: String,
    /// What `done` and `total` count.
    pub unit: String,
    /// Units done.
    pub done: u64,
    /// Units in all, if known.
    pub total: Option<u64>,
    /// Wall-clock time of the stage so far.
    pub seconds: f64,
    /// Estimated time to the end of the stage, once there is something to judge by.
    pub eta_seconds: Option<f64>,
    /// Anonymous resident memory now: what `--max-memory` counts.
    pub anonymous_bytes: u64,
    /// Resident memory now, files' pages included.
    pub resident_bytes: u64,
    /// Bytes of the job's files, once known.
    pub disk_bytes: u64,
}

/// The last line of a verb that is done.
#[derive(Debug, Serialize)]
struct Summary<'a, S: Serialize> {
    r#type: &'static str,
    verb: &'a str,
    #[serde(flatten)]
    figures: S,
}

/// The line as text, its end included.
pub fn text(line: &Line<'_>) -> String {
    serialised(line)
}

/// The summary line of a verb, its end included.
pub fn summary(verb: &str, figures: impl Serialize) -> String {
    serialised(&Summary { r#type: "summary", verb, figures })
}

/// Any line as text, its end included.
pub fn serialised(line: &impl Serialize) -> String {
    // Plain structs of numbers and strings: serialising them cannot fail.
    let text = serde_json::to_string(line);
    text.map_or_else(
        |e| format!("{{\"type\":\"error\",\"code\":1,\"message\":\"{e}\"}}\n"),
        |text| text + "\n",
    )
}
