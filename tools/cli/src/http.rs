//! The few words of HTTP that `run --metrics` and `view` speak.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// How long a client may take to ask, and to take a piece of an answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// Bytes of a request that are read at most.
const LONGEST: usize = 8192;

/// A request of a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// `GET` and the like.
    pub method: String,
    /// The path, without what stands behind `?`.
    pub path: String,
    /// The host that the client asks for, without its port.
    pub host: String,
}

impl Request {
    /// Reads a request up to its empty line.
    pub fn read(client: &mut TcpStream) -> std::io::Result<Self> {
        client.set_read_timeout(Some(PATIENCE))?;
        client.set_write_timeout(Some(PATIENCE))?;
        let mut bytes = Vec::new();
        let mut piece = [0; 512];
        while bytes.len() < LONGEST && !bytes.windows(4).any(|w| w == b"\r\n\r\n") {
            match client.read(&mut piece)? {
                0 => break,
                count => bytes.extend_from_slice(&piece[..count]),
            }
        }
        Ok(Self::of(&String::from_utf8_lossy(&bytes)))
    }

    fn of(text: &str) -> Self {
        let mut words = text.lines().next().unwrap_or_default().split_whitespace();
        let method = words.next().unwrap_or_default().to_owned();
        let path = words.next().unwrap_or_default().split('?').next().unwrap_or_default().to_owned();
        let named = |line: &str| {
            let (name, value) = line.split_once(':')?;
            name.eq_ignore_ascii_case("host").then(|| value.trim().to_owned())
        };
        let host = text.lines().skip(1).find_map(named).unwrap_or_default();
        let host = match host.rsplit_once(':') {
            Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name.to_owned(),
            _ => host,
        };
        Self { method, path, host }
    }

    /// Whether the client asks for this machine by a name that only this machine has: a page of another site cannot.
    pub fn is_local(&self) -> bool {
        matches!(self.host.as_str(), "localhost" | "127.0.0.1" | "[::1]")
    }
}

/// Answers with a whole body.
pub fn respond(client: &mut TcpStream, status: &str, kind: &str, body: &[u8]) -> std::io::Result<()> {
    head(client, status, kind, &format!("Content-Length: {}\r\n", body.len()))?;
    client.write_all(body)
}

/// Begins an answer; `more` are further lines of its head.
pub fn head(client: &mut TcpStream, status: &str, kind: &str, more: &str) -> std::io::Result<()> {
    write!(
        client,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\n{more}Connection: close\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\n\r\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_has_its_method_path_and_host_without_port_and_query() {
        let request = Request::of("GET /graph.svg?7 HTTP/1.1\r\nAccept: *\r\nHOST: 127.0.0.1:8017\r\n\r\n");
        let (method, path, host) = ("GET".to_owned(), "/graph.svg".to_owned(), "127.0.0.1".to_owned());
        assert_eq!(request, Request { method, path, host });
        assert!(request.is_local());
        for (host, is_local) in
            [("[::1]:80", true), ("localhost", true), ("127.0.0.1.example.org:80", false), ("", false)]
        {
            let request = Request::of(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n"));
            assert_eq!(request.is_local(), is_local, "{host}");
        }
        assert_eq!(Request::of("").method, "");
    }
}
