//! Samples of any size from one program to another: a server beside an output, a client beside a far end.
//!
//! Who connects reads a line that names type, layout and frame, and then samples, each behind its length. The output is
//! never kept waiting: its newest sample takes the place of one that has not been sent yet, and a client that does not
//! take a sample within [`PATIENCE`] is cut off, and may connect again. What is missing shows in the samples' numbers.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use stillpoint_samples::{Pieces, SampleKind};

use crate::outside::Arrivals;
use crate::stream::MOST_WAITING;

/// How long a client may take for a sample.
const PATIENCE: Duration = Duration::from_millis(200);
/// How often a server looks for new clients, and a client for its server.
const LOOK: Duration = Duration::from_millis(50);
/// After so long without a sample a client connects anew: the other machine may be gone without a word.
const SILENCE: Duration = Duration::from_secs(2);
/// How long a client waits that does not understand its server.
const REFUSED: Duration = Duration::from_secs(1);
const MOST_CLIENTS: usize = 8;
const LONGEST_GREETING: usize = 256;

/// What a server says first: who expects something else takes nothing of it.
pub fn greeting(kind: &SampleKind, frame: Option<&str>) -> String {
    format!("stillpoint stream 1 {} {}\n", kind.type_name(), frame.unwrap_or("-"))
}

/// Serves the samples of an output.
pub struct Server(Arc<Shared>);

struct Shared {
    slot: Mutex<Slot>,
    filled: Condvar,
}

#[derive(Default)]
struct Slot {
    /// The sample that is to be sent next: its length and its bytes.
    next: Option<Vec<u8>>,
    spare: Vec<u8>,
    has_clients: bool,
    is_over: bool,
}

impl Server {
    /// Begins to serve at an address.
    pub fn start(address: SocketAddr, greeting: String) -> std::io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let shared = Arc::new(Shared { slot: Mutex::default(), filled: Condvar::new() });
        let served = shared.clone();
        std::thread::Builder::new()
            .name("server".into())
            .spawn(move || served.serve(&listener, &greeting))?;
        Ok(Self(shared))
    }

    /// Has a sample sent to whoever is there; it takes the place of one that still waits.
    pub fn put(&self, sample: Pieces<'_>) {
        let mut slot = self.0.slot.lock().unwrap_or_else(PoisonError::into_inner);
        if !slot.has_clients {
            return;
        }
        let mut bytes = slot.next.take().unwrap_or_else(|| std::mem::take(&mut slot.spare));
        bytes.clear();
        let length = (sample.meta.len() + sample.payload.len()) as u32;
        bytes.extend_from_slice(&length.to_le_bytes());
        bytes.extend_from_slice(sample.meta);
        bytes.extend_from_slice(sample.payload);
        slot.next = Some(bytes);
        self.0.filled.notify_one();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.0.slot.lock().unwrap_or_else(PoisonError::into_inner).is_over = true;
        self.0.filled.notify_one();
    }
}

impl Shared {
    fn serve(&self, listener: &TcpListener, greeting: &str) {
        let mut clients: Vec<TcpStream> = Vec::new();
        loop {
            while let Ok((client, _)) = listener.accept() {
                if clients.len() < MOST_CLIENTS && greet(&client, greeting).is_ok() {
                    clients.push(client);
                }
            }
            let mut slot = self.slot.lock().unwrap_or_else(PoisonError::into_inner);
            slot.has_clients = !clients.is_empty();
            if slot.next.is_none() && !slot.is_over {
                let waited = self.filled.wait_timeout(slot, LOOK);
                slot = waited.unwrap_or_else(PoisonError::into_inner).0;
            }
            if slot.is_over {
                return;
            }
            let Some(bytes) = slot.next.take() else { continue };
            drop(slot);
            clients.retain(|client| write_within(client, &bytes).is_ok());
            self.slot.lock().unwrap_or_else(PoisonError::into_inner).spare = bytes;
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

/// Takes the samples of a server, whenever there is one.
pub struct Client {
    arrivals: Arrivals,
    complaint: Arc<Mutex<Option<String>>>,
}

impl Client {
    /// Begins to look for the server at an address. Samples of more than `longest` bytes are none.
    pub fn start(address: SocketAddr, greeting: String, longest: usize) -> Self {
        let client = Self { arrivals: Arrivals::at_most(MOST_WAITING), complaint: Arc::default() };
        let (arrivals, complaint) = (client.arrivals.clone(), client.complaint.clone());
        // It ends with its process, or when nobody has the arrivals any more.
        std::thread::spawn(move || {
            let mut said = String::new();
            while Arc::strong_count(&complaint) > 1 {
                let Err(Refusal(reason)) = take_all(address, &greeting, longest, &arrivals) else {
                    said.clear();
                    std::thread::sleep(LOOK);
                    continue;
                };
                if reason != said {
                    said.clone_from(&reason);
                    *complaint.lock().unwrap_or_else(PoisonError::into_inner) = Some(reason);
                }
                std::thread::sleep(REFUSED);
            }
        });
        client
    }

    /// The samples that arrived.
    pub fn arrivals(&self) -> Arrivals {
        self.arrivals.clone()
    }

    /// Why nothing is taken from the server, once per reason.
    pub fn complaint(&self) -> Option<String> {
        self.complaint.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Why nothing is taken from a server.
struct Refusal(String);

/// Takes samples until the connection ends.
fn take_all(address: SocketAddr, greeting: &str, longest: usize, arrivals: &Arrivals) -> Result<(), Refusal> {
    let Ok(mut server) = TcpStream::connect_timeout(&address, REFUSED) else { return Ok(()) };
    if server.set_read_timeout(Some(SILENCE)).is_err() {
        return Ok(());
    }
    let Some(said) = read_line(&mut server) else { return Ok(()) };
    if said != greeting {
        return Err(Refusal(format!(
            "who serves at {address} sends `{}`, not `{}`: nothing is taken from there",
            said.trim_end().escape_debug(),
            greeting.trim_end()
        )));
    }
    let mut bytes = Vec::new();
    let mut length = [0; 4];
    while server.read_exact(&mut length).is_ok() {
        let length = u32::from_le_bytes(length) as usize;
        if length > longest {
            return Err(Refusal(format!(
                "who serves at {address} sends a sample of {length} bytes, more than the {longest} of this pipeline"
            )));
        }
        bytes.resize(length, 0);
        if server.read_exact(&mut bytes).is_err() {
            break;
        }
        arrivals.put(&bytes);
    }
    Ok(())
}

/// A line with its end; what goes on for too long is cut.
fn read_line(server: &mut TcpStream) -> Option<String> {
    let mut line = Vec::new();
    let mut byte = [0];
    while line.last() != Some(&b'\n') && line.len() < LONGEST_GREETING {
        server.read_exact(&mut byte).ok()?;
        line.push(byte[0]);
    }
    Some(String::from_utf8_lossy(&line).into_owned())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::net::TcpListener;

    use stillpoint_samples::{DepthImage, HEADER_SIZE, Sample};

    use super::*;

    /// A depth image of so many pixels, all of this value.
    fn image(pixels: u32, value: u16) -> Vec<u8> {
        let mut bytes = vec![0; DepthImage::KIND.meta_size()];
        let end = bytes.len();
        bytes[HEADER_SIZE - 4..HEADER_SIZE].copy_from_slice(&pixels.to_le_bytes());
        bytes[end - 4..].copy_from_slice(&pixels.to_le_bytes());
        (0..pixels).for_each(|_| bytes.extend_from_slice(&value.to_le_bytes()));
        bytes
    }

    fn free() -> SocketAddr {
        TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
    }

    fn wait_for<T>(mut look: impl FnMut() -> Option<T>) -> T {
        let begun = Instant::now();
        loop {
            if let Some(found) = look() {
                return found;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "waited too long");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// What reaches the client when this is offered until something does.
    fn first(server: &Server, bytes: &[u8], client: &Client) -> Vec<u8> {
        wait_for(|| {
            server.put(Pieces::split(DepthImage::KIND, bytes).unwrap());
            client.arrivals().take()
        })
    }

    const ROOM: usize = 2_000_000;

    #[test]
    fn a_large_sample_arrives_whole_and_both_ends_may_come_again() {
        let (address, line) = (free(), greeting(DepthImage::KIND, Some("camera")));
        let client = Client::start(address, line.clone(), ROOM);
        for value in 1..=2 {
            let server = Server::start(address, line.clone()).unwrap();
            let sent = image(640 * 480, value);
            assert_eq!(first(&server, &sent, &client), sent);
            let another = Client::start(address, line.clone(), ROOM);
            assert_eq!(first(&server, &sent, &another), sent);
            drop(server);
            // The port is free once its thread has seen the end.
            wait_for(|| TcpListener::bind(address).ok());
            while client.arrivals().take().is_some() {}
        }
    }

    #[test]
    fn who_expects_another_frame_takes_nothing_and_says_why() {
        let address = free();
        let _server = Server::start(address, greeting(DepthImage::KIND, Some("camera"))).unwrap();
        let client = Client::start(address, greeting(DepthImage::KIND, Some("couch")), ROOM);
        let said = wait_for(|| client.complaint());
        assert!(said.contains("camera") && said.contains("couch"), "{said}");
        assert!(client.arrivals().take().is_none());
    }

    #[test]
    fn a_sample_that_is_too_long_is_refused_before_it_is_read() {
        let (address, line) = (free(), greeting(DepthImage::KIND, None));
        let server = Server::start(address, line.clone()).unwrap();
        let client = Client::start(address, line, 1000);
        let sent = image(1000, 1);
        let said = wait_for(|| {
            server.put(Pieces::split(DepthImage::KIND, &sent).unwrap());
            client.complaint()
        });
        assert!(said.contains("more than the 1000"), "{said}");
    }

    #[test]
    fn a_client_that_takes_nothing_is_cut_off_and_keeps_nobody_waiting() {
        let (address, line) = (free(), greeting(DepthImage::KIND, None));
        let server = Server::start(address, line.clone()).unwrap();
        let mut stopped = TcpStream::connect(address).unwrap();
        let client = Client::start(address, line, ROOM);
        let sent = image(640 * 480, 3);
        // More than the socket of the one that is stopped can hold.
        for _ in 0..40 {
            assert_eq!(first(&server, &sent, &client), sent);
        }
        stopped.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut held = Vec::new();
        // It ends, or it is reset: either way nothing more comes.
        let _ = stopped.read_to_end(&mut held);
        assert_eq!(first(&server, &sent, &client), sent);
    }
}
