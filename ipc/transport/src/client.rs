//! The receiver's end of a stream: it connects to a server, whenever there is one.

use std::collections::VecDeque;
use std::io::Read;
use std::net::{SocketAddr, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::greeting::greeting;
use crate::{Channel, LinkState, Origin, Receiver, Refusal, TransportError};

/// Samples that wait at this end; one on top costs the oldest.
pub const MOST_WAITING: usize = 3;
/// How often the client looks for its server.
const LOOK: Duration = Duration::from_millis(50);
/// Time without a sample after which the client connects again: the other machine may have gone without closing.
const SILENCE: Duration = Duration::from_secs(2);
/// How long the client waits before it asks a server again that it does not understand.
const REFUSED: Duration = Duration::from_secs(1);
const LONGEST_GREETING: usize = 256;

/// Takes the samples of a server.
pub struct Client {
    shared: Arc<Mutex<Waiting>>,
}

struct Waiting {
    samples: VecDeque<Vec<u8>>,
    /// Buffers to be used again.
    spare: Vec<Vec<u8>>,
    discarded: u64,
    state: LinkState,
}

impl Client {
    /// Begins to look for the server at an address.
    pub fn start(address: SocketAddr, channel: &Channel) -> Result<Self, TransportError> {
        let shared = Arc::new(Mutex::new(Waiting {
            samples: VecDeque::with_capacity(MOST_WAITING),
            spare: Vec::with_capacity(MOST_WAITING),
            discarded: 0,
            state: LinkState::Waiting,
        }));
        let connection = Connection {
            address,
            greeting: greeting(channel),
            longest: channel.longest(),
            shared: shared.clone(),
        };
        // It ends with its process, or when this end is closed.
        std::thread::Builder::new()
            .name("client".into())
            .spawn(move || connection.run())
            .map_err(|e| TransportError::Open { address, reason: e.to_string() })?;
        Ok(Self { shared })
    }
}

fn lock(shared: &Mutex<Waiting>) -> MutexGuard<'_, Waiting> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Receiver for Client {
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError> {
        let mut waiting = lock(&self.shared);
        if waiting.state == LinkState::Closed {
            return Err(TransportError::Closed);
        }
        let Some(sample) = waiting.samples.pop_front() else { return Ok(None) };
        let spare = std::mem::replace(bytes, sample);
        if waiting.spare.len() < MOST_WAITING {
            waiting.spare.push(spare);
        }
        Ok(Some(Origin { sender: None }))
    }

    fn discarded(&mut self) -> u64 {
        std::mem::take(&mut lock(&self.shared).discarded)
    }

    fn keeps_waiting(&self) -> bool {
        true
    }

    fn state(&self) -> LinkState {
        lock(&self.shared).state.clone()
    }

    fn close(&mut self) {
        let mut waiting = lock(&self.shared);
        waiting.state = LinkState::Closed;
        waiting.samples.clear();
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.close();
    }
}

/// The client's thread.
struct Connection {
    address: SocketAddr,
    greeting: String,
    /// Bytes of the longest sample that is taken.
    longest: usize,
    shared: Arc<Mutex<Waiting>>,
}

impl Connection {
    fn run(&self) {
        while self.is_open() {
            let pause = match self.take_all() {
                Ok(()) => {
                    self.set(LinkState::Waiting);
                    LOOK
                }
                Err(refusal) => {
                    self.set(LinkState::Refused(refusal));
                    REFUSED
                }
            };
            std::thread::sleep(pause);
        }
    }

    fn is_open(&self) -> bool {
        lock(&self.shared).state != LinkState::Closed
    }

    /// Changes the state of an end that is not closed.
    fn set(&self, state: LinkState) {
        let mut waiting = lock(&self.shared);
        if waiting.state != LinkState::Closed {
            waiting.state = state;
        }
    }

    /// Takes samples until the connection ends.
    fn take_all(&self) -> Result<(), Refusal> {
        let Ok(mut server) = TcpStream::connect_timeout(&self.address, REFUSED) else { return Ok(()) };
        if server.set_read_timeout(Some(SILENCE)).is_err() {
            return Ok(());
        }
        let Some(found) = read_line(&mut server) else { return Ok(()) };
        let peer = || self.address.to_string();
        if found != self.greeting {
            return Err(Refusal::OtherChannel {
                peer: peer(),
                found: found.trim_end().escape_debug().to_string(),
                expected: self.greeting.trim_end().to_string(),
            });
        }
        self.set(LinkState::Open);
        let mut bytes = Vec::new();
        let mut length = [0; 4];
        while self.is_open() && server.read_exact(&mut length).is_ok() {
            let length = u32::from_le_bytes(length) as usize;
            if length > self.longest {
                return Err(Refusal::TooLong { peer: peer(), bytes: length, longest: self.longest });
            }
            bytes.resize(length, 0);
            if server.read_exact(&mut bytes).is_err() {
                break;
            }
            self.put(&mut bytes);
        }
        Ok(())
    }

    /// Adds a sample, and exchanges its buffer for one that is free.
    fn put(&self, bytes: &mut Vec<u8>) {
        let mut waiting = lock(&self.shared);
        let free = if waiting.samples.len() >= MOST_WAITING {
            waiting.discarded += 1;
            waiting.samples.pop_front()
        } else {
            waiting.spare.pop()
        };
        let sample = std::mem::replace(bytes, free.unwrap_or_default());
        waiting.samples.push_back(sample);
    }
}

/// A line with its end; a line that is too long is cut.
fn read_line(server: &mut TcpStream) -> Option<String> {
    let mut line = Vec::new();
    let mut byte = [0];
    while line.last() != Some(&b'\n') && line.len() < LONGEST_GREETING {
        server.read_exact(&mut byte).ok()?;
        line.push(byte[0]);
    }
    Some(String::from_utf8_lossy(&line).into_owned())
}
