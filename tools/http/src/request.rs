//! A request of HTTP, and its answer.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// How long a client may take to ask, and to take a piece of an answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// Bytes of a request that are read at most.
const LONGEST: usize = 8192;

/// A request of a client.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// `GET` and the like.
    pub method: String,
    /// The path, without what stands behind `?`.
    pub path: String,
    /// What stands behind `?`.
    pub query: String,
    /// The host that the client asks for, without its port.
    pub host: String,
    /// The page that makes the request, if it is made by a script of a page.
    pub origin: Option<String>,
    /// What the line `X-Token` says.
    pub token: String,
    /// The body.
    pub body: String,
}

impl Request {
    /// Reads a request with its body.
    ///
    /// # Errors
    /// The client is gone, or takes longer than two seconds.
    pub fn read(client: &mut TcpStream) -> std::io::Result<Self> {
        client.set_read_timeout(Some(PATIENCE))?;
        client.set_write_timeout(Some(PATIENCE))?;
        let mut bytes = Vec::new();
        let mut piece = [0; 512];
        let mut expected = None;
        while bytes.len() < expected.unwrap_or(LONGEST) {
            match client.read(&mut piece)? {
                0 => break,
                count => bytes.extend_from_slice(&piece[..count]),
            }
            if let Some(head) = bytes.windows(4).position(|w| w == b"\r\n\r\n") {
                let length = line(&String::from_utf8_lossy(&bytes[..head]), "content-length");
                let length = length.and_then(|text| text.parse().ok()).unwrap_or(0_usize);
                expected = Some(LONGEST.min(head.saturating_add(4).saturating_add(length)));
            }
        }
        Ok(Self::of(&String::from_utf8_lossy(&bytes)))
    }

    fn of(text: &str) -> Self {
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or((text, ""));
        let mut words = head.lines().next().unwrap_or_default().split_whitespace();
        let method = words.next().unwrap_or_default().to_owned();
        let target = words.next().unwrap_or_default();
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let host = line(head, "host").unwrap_or_default();
        let host = match host.rsplit_once(':') {
            Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name.to_owned(),
            _ => host,
        };
        Self {
            method,
            path: path.to_owned(),
            query: query.to_owned(),
            host,
            origin: line(head, "origin"),
            token: line(head, "x-token").unwrap_or_default(),
            body: body.to_owned(),
        }
    }

    /// Whether the client asks for this machine by a name that only this machine has: a page of another site cannot.
    pub fn is_local(&self) -> bool {
        matches!(self.host.as_str(), "localhost" | "127.0.0.1" | "[::1]")
    }

    /// The number that the query gives to a name: `?at=3.5`.
    pub fn number(&self, name: &str) -> Option<f64> {
        let pairs = self.query.split('&').filter_map(|pair| pair.split_once('='));
        pairs.filter(|(known, _)| *known == name).find_map(|(_, value)| value.parse().ok())
    }
}

/// What the line of the head with this name says.
fn line(head: &str, name: &str) -> Option<String> {
    let named = |line: &str| {
        let (of, value) = line.split_once(':')?;
        of.eq_ignore_ascii_case(name).then(|| value.trim().to_owned())
    };
    head.lines().skip(1).find_map(named)
}

/// Answers with a whole body.
///
/// # Errors
/// The client is gone.
pub fn respond(client: &mut TcpStream, status: &str, kind: &str, body: &[u8]) -> std::io::Result<()> {
    head(client, status, kind, &format!("Content-Length: {}\r\n", body.len()))?;
    client.write_all(body)
}

/// Begins an answer; `more` are further lines of its head.
///
/// # Errors
/// The client is gone.
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
    fn a_request_has_its_method_path_query_and_host_without_port() {
        let request = Request::of(
            "GET /frame?at=2.5&after=7 HTTP/1.1\r\nAccept: *\r\nHOST: 127.0.0.1:8017\r\nX-Token: ab\r\n\r\n{}",
        );
        let expected = Request {
            method: "GET".to_owned(),
            path: "/frame".to_owned(),
            query: "at=2.5&after=7".to_owned(),
            host: "127.0.0.1".to_owned(),
            origin: None,
            token: "ab".to_owned(),
            body: "{}".to_owned(),
        };
        assert_eq!(request, expected);
        assert_eq!(["at", "after", "to"].map(|name| request.number(name)), [Some(2.5), Some(7.0), None]);
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
