//! Messages over the pipes of a child process, which carries them on: so the asking process needs no network library.
//!
//! A frame is the length of what follows (u32, little endian), the length of a name (u8), the name, and the message. To
//! the child the name says to whom it goes (none: to all), from the child who sent it.

use std::io::{self, Read, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use crate::{Arrival, Courier, CourierError, To};

/// The longest frame, bytes.
pub const LONGEST: usize = 8 << 20;
/// Messages that wait to be taken.
const MOST_WAITING: usize = 1024;

/// Writes a frame.
///
/// # Errors
/// The pipe is closed, or the name or the message is too long.
pub fn write_frame(out: &mut impl Write, name: &str, message: &[u8]) -> io::Result<()> {
    let long = || io::Error::new(io::ErrorKind::InvalidInput, "a frame is too long");
    let name_length = u8::try_from(name.len()).map_err(|_| long())?;
    let length = 1 + name.len() + message.len();
    if length > LONGEST {
        return Err(long());
    }
    out.write_all(&(length as u32).to_le_bytes())?;
    out.write_all(&[name_length])?;
    out.write_all(name.as_bytes())?;
    out.write_all(message)?;
    out.flush()
}

/// Reads a frame; none at the end.
///
/// # Errors
/// The pipe fails, or what comes is no frame.
pub fn read_frame(from: &mut impl Read) -> io::Result<Option<(String, Vec<u8>)>> {
    let wrong = |what| io::Error::new(io::ErrorKind::InvalidData, what);
    let mut head = [0; 4];
    match from.read_exact(&mut head) {
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        other => other?,
    }
    let length = u32::from_le_bytes(head) as usize;
    if !(1..=LONGEST).contains(&length) {
        return Err(wrong("a frame has a wrong length"));
    }
    let mut name_length = [0];
    from.read_exact(&mut name_length)?;
    let name_length = usize::from(name_length[0]);
    if 1 + name_length > length {
        return Err(wrong("the name of a frame is longer than the frame"));
    }
    let mut bytes = Vec::new();
    // Memory grows with what arrives.
    from.take((length - 1) as u64).read_to_end(&mut bytes)?;
    if bytes.len() != length - 1 {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    let message = bytes.split_off(name_length);
    Ok(Some((String::from_utf8(bytes).map_err(|_| wrong("the name of a frame is not text"))?, message)))
}

/// A child process that carries messages. It ends with this object.
pub struct ChildCourier {
    child: Child,
    arrivals: Receiver<io::Result<Arrival>>,
    begun: Instant,
}

impl ChildCourier {
    /// Starts the child. Its standard error is that of this process.
    ///
    /// # Errors
    /// The program cannot be started.
    pub fn start(mut command: Command) -> io::Result<Self> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let mut from = child.stdout.take().ok_or(io::ErrorKind::BrokenPipe)?;
        let (sender, arrivals) = sync_channel(MOST_WAITING);
        std::thread::Builder::new().name("courier".to_owned()).spawn(move || {
            loop {
                let (arrival, is_last) = match read_frame(&mut from) {
                    Ok(Some((from, bytes))) => (Ok(Arrival { from, bytes }), false),
                    Ok(None) => return,
                    Err(e) => (Err(e), true),
                };
                if sender.send(arrival).is_err() || is_last {
                    return;
                }
            }
        })?;
        Ok(Self { child, arrivals, begun: Instant::now() })
    }
}

impl Courier for ChildCourier {
    fn now(&self) -> u64 {
        self.begun.elapsed().as_nanos() as u64
    }

    fn send(&mut self, to: &To, bytes: Vec<u8>) {
        let name = match to {
            To::All => "",
            To::One(name) => name,
        };
        if let Some(pipe) = self.child.stdin.as_mut() {
            // A child that has ended is told by `receive`.
            let _ = write_frame(pipe, name, &bytes);
        }
    }

    fn receive(&mut self, until: u64) -> Result<Option<Arrival>, CourierError> {
        let wait = Duration::from_nanos(until.saturating_sub(self.now()));
        match self.arrivals.recv_timeout(wait) {
            Ok(Ok(arrival)) => Ok(Some(arrival)),
            Ok(Err(e)) => Err(CourierError::NotAMessage(e)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(CourierError::Ended),
        }
    }
}

impl Drop for ChildCourier {
    fn drop(&mut self) {
        // The end of its input ends the child.
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}
