//! The server of the page: each client has a thread of its own, so one that stalls holds nobody up.

use std::io::Write;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use serde_json::json;
use stillpoint_http::{Request, head, respond};
use stillpoint_pipeline::limits::start_thread;

use super::commands::{CommandError, Commands};
use super::picture::Given;
use super::served::Served;
use crate::exit::Failure;

/// What a browser loads: path, type, text.
const FILES: [(&str, &str, &str); 8] = [
    ("/", "text/html; charset=utf-8", include_str!("page/page.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("page/page.css")),
    ("/page.js", SCRIPT, include_str!("page/page.js")),
    ("/tables.js", SCRIPT, include_str!("page/tables.js")),
    ("/charts.js", SCRIPT, include_str!("page/charts.js")),
    ("/head.js", SCRIPT, include_str!("page/head.js")),
    ("/pieces.js", SCRIPT, include_str!("page/pieces.js")),
    ("/commands.js", SCRIPT, include_str!("page/commands.js")),
];
const SCRIPT: &str = "text/javascript; charset=utf-8";
/// Only what this program serves is loaded by the page.
const POLICY: &str = "Content-Security-Policy: default-src 'self'\r\n";
/// Clients at once; more are refused.
const MOST_CLIENTS: usize = 32;
/// How long a client waits for an image before it asks again.
const IMAGE: Duration = Duration::from_secs(1);
/// How long a stream is silent at most.
const SILENCE: Duration = Duration::from_secs(5);

/// Starts the server on this machine alone. Gives its address.
///
/// # Errors
/// The port is taken, or no thread can be started.
pub fn serve(port: u16, served: &Arc<Served>, commands: Option<Commands>) -> Result<SocketAddr, Failure> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let wrong =
        |e: std::io::Error| Failure::failed(format!("{address}: {e}; choose another port with --port"));
    let listener = TcpListener::bind(address).map_err(wrong)?;
    let bound = listener.local_addr().map_err(wrong)?;
    let site = Arc::new(Site { served: served.clone(), commands, clients: AtomicUsize::new(0) });
    let failed = |e| Failure::failed(format!("the thread that serves the page cannot be started: {e}"));
    start_thread(move || {
        for client in listener.incoming().flatten() {
            let site = site.clone();
            // A client that gets no thread is left without an answer.
            let _ = start_thread(move || site.attend(client));
        }
    })
    .map_err(failed)?;
    Ok(bound)
}

struct Site {
    served: Arc<Served>,
    commands: Option<Commands>,
    clients: AtomicUsize,
}

impl Site {
    fn attend(&self, mut client: TcpStream) {
        let is_free = self.clients.fetch_add(1, Ordering::Relaxed) < MOST_CLIENTS;
        // A client that is gone gets nothing.
        let _ = match is_free {
            true => self.answer(&mut client),
            false => refuse(&mut client, "503 Service Unavailable", "too many clients"),
        };
        self.clients.fetch_sub(1, Ordering::Relaxed);
    }

    fn answer(&self, client: &mut TcpStream) -> std::io::Result<()> {
        let request = Request::read(client)?;
        if !request.is_local() {
            return refuse(client, "403 Forbidden", "ask for localhost");
        }
        match (request.method.as_str(), request.path.as_str()) {
            ("GET", path) => {
                if let Some((_, kind, text)) = FILES.iter().find(|(known, ..)| *known == path) {
                    let more = format!("{POLICY}Content-Length: {}\r\n", text.len());
                    head(client, "200 OK", kind, &more)?;
                    return client.write_all(text.as_bytes());
                }
                self.get(client, &request)
            }
            ("POST", "/command") => self.command(client, &request),
            _ => refuse(client, "405 Method Not Allowed", "the page is read-only"),
        }
    }

    fn get(&self, client: &mut TcpStream, request: &Request) -> std::io::Result<()> {
        let at = request.number("at");
        let past = self.served.past.as_ref().zip(at);
        let json = |client: &mut TcpStream, text: &str| {
            respond(client, "200 OK", "application/json", text.as_bytes())
        };
        match request.path.as_str() {
            "/about.json" => {
                let mut about = self.served.about.clone();
                about["commands"] = json!(self.commands.is_some());
                json(client, &about.to_string())
            }
            "/state.json" => {
                let state = past.and_then(|(past, t)| past.state(t));
                let state = state.map_or_else(|| self.served.now().state.clone(), Into::into);
                json(client, &state)
            }
            "/rows.json" => {
                let (rows, _) = self.served.now().rows_from(0);
                json(client, &serde_json::to_string(&rows)?)
            }
            "/graph.svg" => {
                let graph = past.map(|(past, t)| past.graph(t).into());
                let graph = graph.unwrap_or_else(|| self.served.now().graph.clone());
                respond(client, "200 OK", "image/svg+xml", graph.as_bytes())
            }
            "/image" => self.image(client, request),
            "/events" => self.stream(client),
            _ => refuse(client, "404 Not Found", "there is no such page"),
        }
    }

    /// The image at a time of a session, or the newest one of a run.
    fn image(&self, client: &mut TcpStream, request: &Request) -> std::io::Result<()> {
        let Some(camera) = &self.served.camera else {
            return refuse(client, "404 Not Found", "the pipeline has no image of a face");
        };
        let after = request.number("after").map_or(0, |number| number.max(0.0) as u64);
        let found = match &self.served.past {
            Some(past) => {
                let found = past.picture(request.number("at").unwrap_or(0.0));
                found.map(|(picture, is_final)| (Arc::new(picture), Given { number: 0, is_final }))
            }
            None => {
                let found = self.served.picture_after(after, IMAGE);
                found.map(|(number, picture)| (picture, Given { number, is_final: false }))
            }
        };
        let Some((picture, given)) = found else { return head(client, "204 No Content", "text/plain", "") };
        match picture.bytes(camera, given, self.served.base) {
            Ok(bytes) => respond(client, "200 OK", "application/octet-stream", &bytes),
            Err(error) => refuse(client, "500 Internal Server Error", &error.to_string()),
        }
    }

    /// Sends each new state as an event, and rows as others: the newest alone to a client that is slow.
    fn stream(&self, client: &mut TcpStream) -> std::io::Result<()> {
        head(client, "200 OK", "text/event-stream", "")?;
        let (mut number, mut row) = (0, 0);
        loop {
            let (state, rows, is_over) = {
                let now = self.served.wait(number, row, SILENCE);
                let state = (now.number != number).then(|| now.state.clone());
                let (rows, next) = now.rows_from(row);
                (number, row) = (now.number, next);
                (state, rows, now.is_over)
            };
            if let Some(state) = &state {
                write!(client, "data: {state}\n\n")?;
            }
            if !rows.is_empty() {
                write!(client, "event: rows\ndata: {}\n\n", serde_json::to_string(&rows)?)?;
            }
            if is_over {
                return write!(client, "event: end\ndata: the run has ended\n\n");
            }
            if state.is_none() && rows.is_empty() {
                // A client that is gone is noticed.
                write!(client, ": \n\n")?;
            }
        }
    }

    fn command(&self, client: &mut TcpStream, request: &Request) -> std::io::Result<()> {
        let own = |origin: &String| {
            let host = origin.strip_prefix("http://").unwrap_or_default();
            Request { host: host.rsplit_once(':').map_or(host, |(h, _)| h).to_owned(), ..Request::default() }
                .is_local()
        };
        let Some(commands) = self.commands.as_ref() else {
            return refuse(
                client,
                "405 Method Not Allowed",
                "the page is read-only: start it with `stillpoint view --commands`",
            );
        };
        if request.origin.as_ref().is_some_and(|origin| !own(origin)) {
            return refuse(client, "403 Forbidden", "commands come from the page alone");
        }
        match commands.send(&request.token, &request.body) {
            Ok(outcome) => respond(client, "200 OK", "application/json", outcome.to_string().as_bytes()),
            Err(error @ CommandError::Token) => refuse(client, "403 Forbidden", &error.to_string()),
            Err(error) => refuse(client, "400 Bad Request", &error.to_string()),
        }
    }
}

fn refuse(client: &mut TcpStream, status: &str, why: &str) -> std::io::Result<()> {
    respond(client, status, "text/plain; charset=utf-8", format!("{why}\n").as_bytes())
}
