//! `stillpoint view`

use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_pipeline::config;
use stillpoint_pipeline::limits::start_thread;
use stillpoint_pipeline::live::run_folder::is_going_on;
use stillpoint_report::graph::{Drawing, svg};
use stillpoint_report::pipeline_of;
use stillpoint_report::trace::{Journals, as_run};

use super::hz::watched;
use crate::exit::{Ended, Exit, Failure};
use crate::http::{Request, head, respond};
use crate::journals::LOOK;
use crate::signals::stop_flag;
use crate::subject::{Of, Subject};
use crate::top::{Snapshot, Watch, words};

const PAGE: &str = include_str!("../view/page.html");
const SCRIPT: &str = include_str!("../view/page.js");
/// Only what this program serves is loaded by the page.
const POLICY: &str = "Content-Security-Policy: default-src 'self'; style-src 'self' 'unsafe-inline'\r\n";
/// Interval at which the state is made.
const MADE: Duration = Duration::from_millis(500);
/// Interval at which a stream looks for a new state.
const STREAMED: Duration = Duration::from_millis(50);
/// Streams at once; more clients are refused.
const MOST_STREAMS: usize = 16;

/// Show the state of a run or a session in a browser: a page on this machine alone, read-only.
#[derive(Args)]
pub struct View {
    #[command(flatten)]
    of: Of,
    /// Port on 127.0.0.1; 0 takes any that is free.
    #[arg(long, default_value_t = 8017)]
    port: u16,
    /// The time over which rates, latencies and losses are measured.
    #[arg(long = "for", value_name = "TIME", default_value = "2s")]
    time: String,
}

/// What clients get: the state as JSON with its number, and the graph.
#[derive(Default)]
struct State {
    number: u64,
    json: String,
    graph: String,
    is_over: bool,
}

type Shared = Arc<Mutex<State>>;

impl View {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let window = watched(&self.time)?;
        let subject = self.of.open(registry)?;
        let of = subject.of();
        let shared = Shared::default();
        match subject {
            Subject::Session(path, session) => {
                let (graph, _) = pipeline_of(&session, registry)?;
                let ran = as_run(&graph, &session);
                let drawing = Drawing::of(&Journals::of_session(&session, Some(&ran)), Some(&graph));
                put(&shared, &Snapshot::of_session(of, &path, &session, &graph), &drawing)?;
                self.serve(&shared)?;
                let stop = stop_flag()?;
                while !stop.load(Ordering::Relaxed) {
                    std::thread::sleep(LOOK);
                }
            }
            Subject::Run(attached) => {
                let card = &attached.card;
                let whole = config::check(&card.source, &card.file, &card.sets, registry, &card.files).ok();
                let mut watch = Watch::open(*attached, window)?;
                put(&shared, &watch.snapshot()?, &watch.drawing(whole.as_ref()))?;
                self.serve(&shared)?;
                let stop = stop_flag()?;
                let mut made = Instant::now();
                while !stop.load(Ordering::Relaxed) && is_going_on(&watch.attached.folder()) {
                    watch.look()?;
                    if made.elapsed() >= MADE {
                        made = Instant::now();
                        put(&shared, &watch.snapshot()?, &watch.drawing(whole.as_ref()))?;
                    }
                    std::thread::sleep(LOOK);
                }
                if let Ok(mut state) = shared.lock() {
                    state.is_over = true;
                }
                // The streams report the end.
                std::thread::sleep(2 * STREAMED);
            }
        }
        Ok(Exit::Done)
    }

    fn serve(&self, shared: &Shared) -> Result<(), Failure> {
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, self.port));
        let wrong =
            |e: std::io::Error| Failure::failed(format!("{address}: {e}; choose another port with --port"));
        let listener = TcpListener::bind(address).map_err(wrong)?;
        let bound = listener.local_addr().map_err(wrong)?;
        let (shared, streams) = (shared.clone(), Arc::new(AtomicUsize::new(0)));
        let failed = |e| Failure::failed(format!("the thread that serves the page cannot be started: {e}"));
        start_thread(move || {
            for client in listener.incoming().flatten() {
                let (shared, streams) = (shared.clone(), streams.clone());
                // A client that stalls holds its own thread alone. One that gets none is left without an answer.
                let _ = start_thread(move || drop(answer(client, &shared, &streams)));
            }
        })
        .map_err(failed)?;
        outln!("http://{bound}/ (this machine only, read-only; Ctrl-C ends it)");
        Ok(())
    }
}

fn put(shared: &Shared, snapshot: &Snapshot, drawing: &Drawing) -> Result<(), Failure> {
    let mut value = json!(snapshot);
    value["state"] = json!(words(snapshot));
    let json = serde_json::to_string(&value).map_err(Failure::failed)?;
    let graph = svg(drawing);
    if let Ok(mut state) = shared.lock() {
        *state = State { number: state.number + 1, json, graph, is_over: false };
    }
    Ok(())
}

fn answer(mut client: TcpStream, shared: &Shared, streams: &AtomicUsize) -> std::io::Result<()> {
    let request = Request::read(&mut client)?;
    if !request.is_local() {
        return respond(&mut client, "403 Forbidden", "text/plain", b"ask for localhost\n");
    }
    if request.method != "GET" {
        return respond(&mut client, "405 Method Not Allowed", "text/plain", b"the page is read-only\n");
    }
    let read = |of: fn(&State) -> &String| shared.lock().map(|s| of(&s).clone()).unwrap_or_default();
    match request.path.as_str() {
        "/" => {
            let more = format!("{POLICY}Content-Length: {}\r\n", PAGE.len());
            head(&mut client, "200 OK", "text/html; charset=utf-8", &more)?;
            std::io::Write::write_all(&mut client, PAGE.as_bytes())
        }
        "/page.js" => respond(&mut client, "200 OK", "text/javascript; charset=utf-8", SCRIPT.as_bytes()),
        "/state.json" => respond(&mut client, "200 OK", "application/json", read(|s| &s.json).as_bytes()),
        "/graph.svg" => respond(&mut client, "200 OK", "image/svg+xml", read(|s| &s.graph).as_bytes()),
        "/events" => {
            if streams.fetch_add(1, Ordering::Relaxed) >= MOST_STREAMS {
                streams.fetch_sub(1, Ordering::Relaxed);
                return respond(&mut client, "503 Service Unavailable", "text/plain", b"too many clients\n");
            }
            let done = stream(&mut client, shared);
            streams.fetch_sub(1, Ordering::Relaxed);
            done
        }
        _ => respond(&mut client, "404 Not Found", "text/plain", b"there is no such page\n"),
    }
}

/// Sends each new state as an event, the newest alone to a client that is slow.
fn stream(client: &mut TcpStream, shared: &Shared) -> std::io::Result<()> {
    use std::io::Write;
    head(client, "200 OK", "text/event-stream", "")?;
    let mut sent = 0;
    loop {
        let (number, json, is_over) = match shared.lock() {
            Ok(state) if state.number != sent => (state.number, Some(state.json.clone()), state.is_over),
            Ok(state) => (sent, None, state.is_over),
            Err(_) => return Ok(()),
        };
        if let Some(json) = json {
            write!(client, "data: {json}\n\n")?;
            sent = number;
        }
        if is_over {
            return write!(client, "event: end\ndata: the run has ended\n\n");
        }
        std::thread::sleep(STREAMED);
    }
}
