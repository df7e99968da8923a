//! The server: loopback alone, one request a connection, a bounded number of connections.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread::{Builder, JoinHandle, sleep};
use std::time::{Duration, Instant};

use super::desk::{Desk, Outcome};
use super::edit::Edit;
use super::request::{Asked, Gate, Refusal};
use crate::bake::Monitor as _;
use crate::cli::console::Console;
use crate::error::{Error, Result};

/// How often the listener looks for connections and signals.
const TICK: Duration = Duration::from_millis(20);

/// A request is whole by then, or refused.
const PATIENCE: Duration = Duration::from_secs(5);

/// A reader that takes nothing for that long is left.
const STALLED: Duration = Duration::from_secs(10);

/// What a sender still has to say is heard for that long, so that it reads the answer.
const LINGER: Duration = Duration::from_millis(500);

/// Connections at a time.
const MOST_OPEN: usize = 32;

/// What answers are made of.
pub struct House {
    /// Who is let in.
    pub gate: Gate,
    /// The page.
    pub page: Vec<u8>,
    /// Where edits go.
    pub desk: Desk,
}

/// Takes a port of loopback; 0 is any that is free.
///
/// # Errors
/// [`Error::Io`] when it is taken.
pub fn listen(port: u16) -> Result<(TcpListener, u16)> {
    let failed = |e| Error::io(format!("127.0.0.1:{port}"), "listening", e);
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let port = listener.local_addr().map_err(failed)?.port();
    Ok((listener, port))
}

/// 128 bits from the system, in hexadecimal digits.
///
/// # Errors
/// [`Error::Io`] when the system has none.
pub fn token() -> Result<String> {
    let mut bytes = [0; 16];
    let failed = |e| Error::io("the system's random numbers", "making a token", io::Error::other(e));
    getrandom::fill(&mut bytes).map_err(failed)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Answers until a signal comes, or who solves is no more.
///
/// # Errors
/// [`Error::Interrupted`].
///
/// # Panics
/// When who solves did.
pub fn run(
    listener: &TcpListener,
    house: &Arc<House>,
    solver: JoinHandle<()>,
    console: &Console,
) -> Result<()> {
    while !solver.is_finished() {
        console.check()?;
        match listener.accept() {
            Ok((stream, from)) if from.ip().is_loopback() => admit(stream, house),
            Ok(_) => {}
            Err(_) => sleep(TICK),
        }
    }
    match solver.join() {
        Ok(()) => Ok(()),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// Answers in a thread of its own.
fn admit(stream: TcpStream, house: &Arc<House>) {
    // One reference is the server's.
    let is_full = Arc::strong_count(house) > MOST_OPEN;
    let house = Arc::clone(house);
    let talk = move || {
        let Ok(mut reader) = Patient::new(&stream) else { return };
        let answer = if is_full {
            Answer::refusal(Refusal(503, "too many connections"))
        } else {
            match house.gate.read(&mut reader) {
                Ok(Asked::Page) => Answer::new(200, "text/html; charset=utf-8", &[]),
                Ok(Asked::Edit(text)) => edited(&house.desk, &text),
                Err(refusal) => Answer::refusal(refusal),
            }
        };
        let body = if answer.is_page() { &house.page } else { &answer.body };
        // Who is gone is not told.
        let _ = answer.write(&stream, body).and_then(|()| part(&stream));
    };
    // Without memory for a thread the connection is closed.
    let _ = Builder::new().name("connection".into()).stack_size(256 << 10).spawn(talk);
}

fn edited(desk: &Desk, text: &[u8]) -> Answer {
    let edit = match Edit::read(text) {
        Ok(edit) => edit,
        Err(problem) => return Answer::text(400, &problem.to_string()),
    };
    match desk.ask(edit).recv() {
        Ok(Outcome::Done(bytes)) => Answer::new(200, "application/octet-stream", &bytes),
        Ok(Outcome::Superseded) => Answer::text(409, "a newer edit came"),
        Ok(Outcome::Refused(problem)) => Answer::text(400, &problem),
        Ok(Outcome::Failed(problem)) => Answer::text(500, &problem),
        Err(_) => Answer::text(500, "nobody solves any more"),
    }
}

/// What is said back.
struct Answer {
    status: u16,
    kind: &'static str,
    body: Vec<u8>,
}

impl Answer {
    fn new(status: u16, kind: &'static str, body: &[u8]) -> Self {
        Self { status, kind, body: body.to_vec() }
    }

    fn text(status: u16, text: &str) -> Self {
        Self::new(status, "text/plain; charset=utf-8", format!("{text}\n").as_bytes())
    }

    fn refusal(Refusal(status, reason): Refusal) -> Self {
        Self::text(status, reason)
    }

    fn is_page(&self) -> bool {
        self.status == 200 && self.kind.starts_with("text/html")
    }

    fn write(&self, mut stream: &TcpStream, body: &[u8]) -> io::Result<()> {
        stream.set_write_timeout(Some(STALLED))?;
        let reason = match self.status {
            200 => "OK",
            403 => "Forbidden",
            409 => "Conflict",
            500.. => "Server Error",
            _ => "Bad Request",
        };
        let allow = if self.status == 405 { "Allow: GET, POST\r\n" } else { "" };
        let head = format!(
            "HTTP/1.1 {} {reason}\r\nContent-Type: {}\r\nContent-Length: {}\r\n{allow}Connection: close\r\n\
             Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\nCross-Origin-Opener-Policy: same-origin\r\n\
             Content-Security-Policy: frame-ancestors 'none'\r\n\r\n",
            self.status,
            self.kind,
            body.len()
        );
        stream.write_all(head.as_bytes())?;
        stream.write_all(body)
    }
}

/// Says that this was all, and hears the sender out for a moment: closing on unread bytes would take the answer back.
fn part(mut stream: &TcpStream) -> io::Result<()> {
    stream.shutdown(Shutdown::Write)?;
    let until = Instant::now() + LINGER;
    let mut piece = [0; 4096];
    while let Some(left) = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
        stream.set_read_timeout(Some(left))?;
        if stream.read(&mut piece)? == 0 {
            break;
        }
    }
    Ok(())
}

/// Reads until its patience ends, however slowly bytes come.
struct Patient<'a> {
    stream: &'a TcpStream,
    until: Instant,
}

impl<'a> Patient<'a> {
    fn new(stream: &'a TcpStream) -> io::Result<Self> {
        // Some systems hand the listener's manner on.
        stream.set_nonblocking(false)?;
        Ok(Self { stream, until: Instant::now() + PATIENCE })
    }
}

impl Read for Patient<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let left = self.until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero());
        self.stream.set_read_timeout(Some(left.ok_or(ErrorKind::TimedOut)?))?;
        let mut stream = self.stream;
        stream.read(into)
    }
}
