//! Requests, read with suspicion: who knows the token may fetch the page and send edits; nobody else is told anything.
//!
//! Servers of crates read heads of any length before one sees them, and wait as long as a sender likes; here both are bounded.

use std::io::{ErrorKind, Read};

/// Bytes of a head at the most.
const MOST_HEAD: usize = 8 << 10;

/// Headers at the most.
const MOST_HEADERS: usize = 64;

/// Bytes of an edit at the most: ten thousand names of meshes.
pub const MOST_BODY: usize = 1 << 20;

/// What is asked.
#[derive(Debug, PartialEq)]
pub enum Asked {
    /// The page.
    Page,
    /// An edit, as it came.
    Edit(Vec<u8>),
}

/// Why a request is not answered: a status of HTTP and a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refusal(pub u16, pub &'static str);

const FORBIDDEN: Refusal =
    Refusal(403, "the address with the token is needed, as `glowtree view` printed it");

/// What requests must know.
#[derive(Debug, Clone)]
pub struct Gate {
    /// The first part of the path.
    pub token: String,
    /// The port listened at.
    pub port: u16,
}

impl Gate {
    /// Reads one request.
    ///
    /// # Errors
    /// The refusal to answer with.
    pub fn read(&self, stream: &mut impl Read) -> Result<Asked, Refusal> {
        let mut bytes = Vec::new();
        let head = read_head(stream, &mut bytes)?;
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        let mut parsed = httparse::Request::new(&mut headers);
        parsed.parse(&bytes[..head]).map_err(|_| Refusal(400, "no request of HTTP/1"))?;
        let path = self.path(parsed.path.unwrap_or_default())?;
        let headers = Headers(parsed.headers);
        self.check_host(&headers)?;
        match (parsed.method.unwrap_or_default(), path) {
            ("GET", "") => Ok(Asked::Page),
            ("POST", "edit") => {
                self.check_origin(&headers)?;
                let length = headers.length()?;
                let mut body = bytes.split_off(head);
                body.truncate(length);
                read_rest(stream, &mut body, length)?;
                Ok(Asked::Edit(body))
            }
            (_, "") => Err(Refusal(405, "GET is the way to fetch the page")),
            (_, "edit") => Err(Refusal(405, "POST is the way to send an edit")),
            _ => Err(Refusal(404, "there is the page, and `edit`")),
        }
    }

    /// What follows the token.
    fn path<'a>(&self, target: &'a str) -> Result<&'a str, Refusal> {
        let path = target.split_once('?').map_or(target, |(path, _)| path);
        let parts = path.strip_prefix('/').and_then(|path| path.split_once('/'));
        let (token, rest) = parts.ok_or(FORBIDDEN)?;
        // As long for a wrong first letter as for a wrong last one.
        let differs = |(a, b): (u8, u8)| a ^ b;
        let wrong = token.bytes().zip(self.token.bytes()).map(differs).fold(0, |sum, bits| sum | bits);
        if token.len() == self.token.len() && wrong == 0 { Ok(rest) } else { Err(FORBIDDEN) }
    }

    /// A name that someone else made point here is not ours.
    fn check_host(&self, headers: &Headers<'_>) -> Result<(), Refusal> {
        let host = headers.one("host")?.ok_or(FORBIDDEN)?;
        let ours = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port));
        // Port 80 goes without saying.
        let is_bare = self.port == 80 && ["127.0.0.1", "localhost"].contains(&host);
        if is_bare || ours.iter().any(|own| own == host) { Ok(()) } else { Err(FORBIDDEN) }
    }

    /// Other pages may not send edits.
    fn check_origin(&self, headers: &Headers<'_>) -> Result<(), Refusal> {
        let host = headers.one("host")?.unwrap_or_default();
        if headers.one("origin")?.is_some_and(|origin| origin != format!("http://{host}")) {
            return Err(FORBIDDEN);
        }
        let kind = headers.one("content-type")?.unwrap_or_default();
        let kind = kind.split(';').next().unwrap_or_default().trim();
        if kind.eq_ignore_ascii_case("application/json") {
            Ok(())
        } else {
            Err(Refusal(415, "edits are application/json"))
        }
    }
}

/// The headers of a request.
struct Headers<'a>(&'a [httparse::Header<'a>]);

impl<'a> Headers<'a> {
    /// The value of a header that may come once.
    fn one(&self, name: &str) -> Result<Option<&'a str>, Refusal> {
        let mut own = self.0.iter().filter(|header| header.name.eq_ignore_ascii_case(name));
        let value = own.next().map(|header| std::str::from_utf8(header.value)).transpose();
        match (value, own.next()) {
            (Ok(value), None) => Ok(value.map(str::trim)),
            _ => Err(Refusal(400, "a header that cannot be understood")),
        }
    }

    /// How long the body is.
    fn length(&self) -> Result<usize, Refusal> {
        if self.one("transfer-encoding")?.is_some() {
            return Err(Refusal(501, "bodies come in one piece"));
        }
        let text = self.one("content-length")?.ok_or(Refusal(411, "how long is the edit?"))?;
        // Digits alone: `+5` is a number to Rust and none to HTTP.
        let is_number = !text.is_empty() && text.bytes().all(|digit| digit.is_ascii_digit());
        if !is_number {
            return Err(Refusal(400, "a length that is no number"));
        }
        match text.parse() {
            Ok(length) if length <= MOST_BODY => Ok(length),
            _ => Err(Refusal(413, "an edit too large")),
        }
    }
}

/// Reads until a head is whole, or cannot become one; where it ends.
fn read_head(stream: &mut impl Read, bytes: &mut Vec<u8>) -> Result<usize, Refusal> {
    loop {
        let piece = &mut [0; 2048];
        let count = read_some(stream, piece)?;
        bytes.extend(&piece[..count]);
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        match httparse::Request::new(&mut headers).parse(bytes) {
            Ok(httparse::Status::Complete(end)) if end <= MOST_HEAD => return Ok(end),
            Ok(httparse::Status::Partial) if bytes.len() <= MOST_HEAD => {}
            Ok(_) => return Err(Refusal(431, "a head too large")),
            Err(httparse::Error::TooManyHeaders) => return Err(Refusal(431, "too many headers")),
            Err(_) => return Err(Refusal(400, "no request of HTTP/1")),
        }
    }
}

fn read_rest(stream: &mut impl Read, body: &mut Vec<u8>, length: usize) -> Result<(), Refusal> {
    while body.len() < length {
        let piece = &mut [0; 4096];
        let most = (length - body.len()).min(piece.len());
        let count = read_some(stream, &mut piece[..most])?;
        body.extend(&piece[..count]);
    }
    Ok(())
}

fn read_some(stream: &mut impl Read, piece: &mut [u8]) -> Result<usize, Refusal> {
    loop {
        match stream.read(piece) {
            Ok(0) => return Err(Refusal(400, "the request ends early")),
            Ok(count) => return Ok(count),
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return Err(Refusal(408, "the request takes too long"));
            }
            Err(_) => return Err(Refusal(400, "the request cannot be read")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;

    fn gate() -> Gate {
        Gate { token: "0123456789abcdef".into(), port: 4000 }
    }

    fn read(request: &str) -> Result<Asked, u16> {
        gate().read(&mut request.as_bytes()).map_err(|refusal| refusal.0)
    }

    #[test]
    fn only_the_page_and_edits_pass() {
        let host = "Host: 127.0.0.1:4000\r\n";
        let json = "Content-Type: application/json\r\n";
        let post = format!("POST /0123456789abcdef/edit HTTP/1.1\r\n{host}{json}");
        let get = "GET /0123456789abcdef/ HTTP/1.1\r\n";
        assert_eq!(read(&format!("{get}{host}\r\n")), Ok(Asked::Page));
        assert_eq!(read(&format!("{get}Host: localhost:4000\r\n\r\n")), Ok(Asked::Page));
        assert_eq!(read(&format!("{post}Content-Length: 2\r\n\r\n{{}}more")), Ok(Asked::Edit(b"{}".into())));
        let origin = "Origin: http://127.0.0.1:4000\r\n";
        assert_eq!(read(&format!("{post}{origin}Content-Length: 0\r\n\r\n")), Ok(Asked::Edit(vec![])));
        for (request, status) in [
            (format!("GET / HTTP/1.1\r\n{host}\r\n"), 403),
            (format!("GET /0123456789abcdeF/ HTTP/1.1\r\n{host}\r\n"), 403),
            (format!("GET /0123456789abcde/ HTTP/1.1\r\n{host}\r\n"), 403),
            (format!("GET /0123456789abcdef0/ HTTP/1.1\r\n{host}\r\n"), 403),
            (format!("GET /0123456789abcdef HTTP/1.1\r\n{host}\r\n"), 403),
            (format!("GET //0123456789abcdef/ HTTP/1.1\r\n{host}\r\n"), 403),
            (format!("{get}\r\n"), 403),
            (format!("{get}Host: evil.example:4000\r\n\r\n"), 403),
            (format!("{get}Host: 127.0.0.1:4001\r\n\r\n"), 403),
            (format!("{get}Host: 127.0.0.1\r\n\r\n"), 403),
            (format!("{get}{host}{host}\r\n"), 400),
            (format!("PUT /0123456789abcdef/ HTTP/1.1\r\n{host}\r\n"), 405),
            (format!("GET /0123456789abcdef/edit HTTP/1.1\r\n{host}\r\n"), 405),
            (format!("GET /0123456789abcdef/other HTTP/1.1\r\n{host}\r\n"), 404),
            (format!("{post}\r\n"), 411),
            (format!("{post}Content-Length: 1048577\r\n\r\n"), 413),
            (format!("{post}Content-Length: 99999999999999999999999\r\n\r\n"), 413),
            (format!("{post}Content-Length: +2\r\n\r\n{{}}"), 400),
            (format!("{post}Content-Length: 2\r\nContent-Length: 2\r\n\r\n{{}}"), 400),
            (format!("{post}Content-Length: 3\r\n\r\n{{}}"), 400),
            (format!("{post}Transfer-Encoding: chunked\r\n\r\n2\r\n{{}}\r\n0\r\n\r\n"), 501),
            (format!("{post}Origin: http://evil.example\r\nContent-Length: 2\r\n\r\n{{}}"), 403),
            (format!("POST /0123456789abcdef/edit HTTP/1.1\r\n{host}Content-Length: 2\r\n\r\n{{}}"), 415),
            (format!("{get}{host}X: {}\r\n\r\n", "x".repeat(MOST_HEAD)), 431),
            (format!("{get}{host}{}\r\n", "X: y\r\n".repeat(100)), 431),
            ("GET".into(), 400),
            (String::new(), 400),
            ("\r\n\r\n".into(), 400),
            ("\u{16}\u{3}\u{1}\u{2}\r\n\r\n".into(), 400),
            ("GET / HTTP/3.7\r\n\r\n".into(), 400),
        ] {
            assert_eq!(read(&request), Err(status), "{request}");
        }
    }

    #[test]
    fn garbage_is_refused_without_panic() {
        let good = b"POST /0123456789abcdef/edit HTTP/1.1\r\nHost: 127.0.0.1:4000\r\n\
            Content-Type: application/json\r\nContent-Length: 2\r\n\r\n{}";
        for seed in 0..20_000 {
            let mut bytes = good.to_vec();
            for k in 0..1 + seed % 7 {
                let place = hash::mix2(seed, k) as usize % bytes.len();
                bytes[place] = (hash::mix2(seed, 100 + k) >> 32) as u8;
            }
            bytes.truncate(1 + hash::mix2(seed, 200) as usize % (2 * good.len()));
            // What passes is an edit of at most two bytes' difference from the one sent.
            if let Ok(asked) = gate().read(&mut &bytes[..]) {
                assert!(matches!(&asked, Asked::Edit(body) if body.len() <= 99), "seed {seed}: {asked:?}");
            }
        }
    }
}
