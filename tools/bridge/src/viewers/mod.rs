//! The server of viewers such as Foxglove and Lichtblick: it shows what `stillpoint view` hands over, and hands back what
//! viewers ask for.
//!
//! - `channels`: what is shown as messages of Foxglove
//! - `clock`: the time of a session that viewers play, pause and seek
//! - `listener`: what viewers ask for

mod channels;
mod clock;
mod listener;

use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use foxglove::websocket::Capability;
use foxglove::{Context, WebSocketServerHandle};
use stillpoint_viewer::{Asked, PipeError, Shown, read};

use crate::error::BridgeError;
use channels::Channels;
use clock::Clock;
use listener::Listener;

/// The only address: what is shown is about a patient.
const HOST: &str = "127.0.0.1";
/// Messages that wait for a viewer; of one that is slow, the oldest are lost.
const BACKLOG: usize = 256;
/// Interval of the clock of a session.
const TICK: Duration = Duration::from_millis(30);

/// Serves what comes from `shown` until it ends, and writes to `asks` what viewers ask for.
///
/// # Errors
/// The port is taken, or the other program breaks off within a message.
pub fn serve(shown: &mut impl Read, asks: Box<dyn Write + Send>) -> Result<(), BridgeError> {
    let Some((Shown::Begin { name, port, range }, _)) = read(shown)? else {
        return Err(BridgeError::NoBegin);
    };
    let context = Context::new();
    let channels = Channels::open(&context)?;
    let listener = Arc::new(Listener::new(asks, range.map(Clock::new)));
    let mut server = context
        .websocket_server()
        .name(format!("stillpoint: {name}"))
        .bind(HOST, port)
        .message_backlog_size(BACKLOG)
        .listener(listener.clone());
    if let Some((first, last)) = range {
        server = server.capabilities([Capability::Time]).playback_time_range(first, last);
    }
    let refused = |e| BridgeError::Viewers { address: format!("{HOST}:{port}"), reason: e };
    let server = Arc::new(server.start_blocking().map_err(refused)?);
    listener.ask(&Asked::Listening(server.port()));
    let is_over = Arc::new(AtomicBool::new(false));
    let ticking = listener.has_clock().then(|| tick(server.clone(), listener.clone(), is_over.clone()));
    let ended = show(shown, &channels, &listener, &server);
    is_over.store(true, Ordering::Relaxed);
    if let Some(ticking) = ticking {
        let _ = ticking.join();
    }
    Ok(ended?)
}

/// Shows all that comes.
fn show(
    shown: &mut impl Read,
    channels: &Channels,
    listener: &Listener,
    server: &WebSocketServerHandle,
) -> Result<(), PipeError> {
    while let Some((shown, bytes)) = read(shown)? {
        match shown {
            Shown::Played => {
                if let Some(now) = listener.played() {
                    server.broadcast_time(now);
                }
            }
            shown => channels.show(shown, bytes),
        }
    }
    Ok(())
}

/// Lets the clock of a session go on, and tells viewers of its state where it changes by itself.
fn tick(
    server: Arc<WebSocketServerHandle>,
    listener: Arc<Listener>,
    is_over: Arc<AtomicBool>,
) -> std::thread::JoinHandle<()> {
    std::thread::spawn(move || {
        let mut last = Instant::now();
        while !is_over.load(Ordering::Relaxed) {
            std::thread::sleep(TICK);
            if let Some(state) = listener.tick(last.elapsed()) {
                server.broadcast_playback_state(state);
            }
            last = Instant::now();
        }
    })
}
