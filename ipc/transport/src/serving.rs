//! The sender's end of a stream: a server for the samples of one output.

use std::io::{ErrorKind, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use stillpoint_samples::{Pieces, SampleKind};

use crate::greeting::greeting;
use crate::{Channel, LinkState, Sender, TransportError};

/// How long a client may take for a sample.
const PATIENCE: Duration = Duration::from_millis(200);
/// How often the server looks for new clients.
const LOOK: Duration = Duration::from_millis(50);
/// The most clients of one server.
pub const MOST_CLIENTS: usize = 8;

/// Serves the samples of an output.
pub struct Server {
    shared: Arc<Shared>,
    kind: &'static SampleKind,
}

struct Shared {
    slot: Mutex<Slot>,
    filled: Condvar,
}

#[derive(Default)]
struct Slot {
    /// The sample that is sent next: its length and its bytes.
    next: Option<Vec<u8>>,
    spare: Vec<u8>,
    has_clients: bool,
    is_closed: bool,
}

impl Server {
    /// Begins to serve at an address.
    pub fn start(address: SocketAddr, channel: &Channel) -> Result<Self, TransportError> {
        let refused = |e: std::io::Error| TransportError::Serve { address, reason: e.to_string() };
        let listener = TcpListener::bind(address).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        let shared = Arc::new(Shared { slot: Mutex::default(), filled: Condvar::new() });
        let (served, greeting) = (shared.clone(), greeting(channel));
        let server = move || served.serve(&listener, &greeting);
        std::thread::Builder::new().name("server".into()).spawn(server).map_err(refused)?;
        Ok(Self { shared, kind: channel.kind })
    }
}

impl Sender for Server {
    fn send(&mut self, sample: Pieces<'_>) -> Result<(), TransportError> {
        let sample = sample.check(self.kind).map_err(TransportError::Sample)?;
        let mut slot = self.shared.slot();
        if slot.is_closed {
            return Err(TransportError::Closed);
        }
        if !slot.has_clients {
            return Ok(());
        }
        let bytes = sample.meta.len() + sample.payload.len();
        let length = u32::try_from(bytes)
            .map_err(|_| TransportError::TooLong { bytes, longest: u32::MAX as usize })?;
        let mut bytes = slot.next.take().unwrap_or_else(|| std::mem::take(&mut slot.spare));
        bytes.clear();
        bytes.extend_from_slice(&length.to_le_bytes());
        bytes.extend_from_slice(sample.meta);
        bytes.extend_from_slice(sample.payload);
        slot.next = Some(bytes);
        self.shared.filled.notify_one();
        Ok(())
    }

    fn state(&self) -> LinkState {
        let slot = self.shared.slot();
        match (slot.is_closed, slot.has_clients) {
            (true, _) => LinkState::Closed,
            (false, true) => LinkState::Open,
            (false, false) => LinkState::Waiting,
        }
    }

    fn close(&mut self) {
        self.shared.slot().is_closed = true;
        self.shared.filled.notify_one();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.close();
    }
}

impl Shared {
    fn slot(&self) -> MutexGuard<'_, Slot> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn serve(&self, listener: &TcpListener, greeting: &str) {
        let mut clients: Vec<TcpStream> = Vec::new();
        loop {
            while let Ok((client, _)) = listener.accept() {
                if clients.len() < MOST_CLIENTS && greet(&client, greeting).is_ok() {
                    clients.push(client);
                }
            }
            let mut slot = self.slot();
            slot.has_clients = !clients.is_empty();
            if slot.next.is_none() && !slot.is_closed {
                let waited = self.filled.wait_timeout(slot, LOOK);
                slot = waited.unwrap_or_else(PoisonError::into_inner).0;
            }
            if slot.is_closed {
                return;
            }
            let Some(bytes) = slot.next.take() else { continue };
            drop(slot);
            clients.retain(|client| write_within(client, &bytes).is_ok());
            self.slot().spare = bytes;
        }
    }
}

fn greet(client: &TcpStream, greeting: &str) -> std::io::Result<()> {
    client.set_nonblocking(false)?;
    client.set_nodelay(true)?;
    client.set_write_timeout(Some(PATIENCE))?;
    write_within(client, greeting.as_bytes())
}

/// Writes all of it, or fails after a time.
fn write_within(mut client: &TcpStream, mut bytes: &[u8]) -> std::io::Result<()> {
    let begun = Instant::now();
    while !bytes.is_empty() {
        match client.write(bytes) {
            Ok(written) => bytes = &bytes[written..],
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
        if begun.elapsed() > PATIENCE && !bytes.is_empty() {
            return Err(ErrorKind::TimedOut.into());
        }
    }
    Ok(())
}
