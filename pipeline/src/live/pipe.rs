//! The pipes between supervisor and child processes: one JSON message per line. The reader keeps the rest of a line and
//! reads it before a wait, so that two lines that arrive together are both read.

use std::fs::File;
use std::io::Write;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::OnceLock;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::control::FromWorker;
use crate::stdout::StdoutRedirect;

/// The reading end of a pipe of JSON lines.
pub struct PipeReader {
    fd: OwnedFd,
    rest: Vec<u8>,
    ended: bool,
}

/// The result of reading a line.
pub enum PipeRead<T> {
    /// A message.
    Message(T),
    /// No message yet.
    Nothing,
    /// The other end is gone.
    Ended,
}

/// Why the pipe between a process and its supervisor cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PipeError {
    /// A line is no message of this build.
    #[error("a line of the control pipe cannot be read: {0}")]
    Message(serde_json::Error),
    /// A line goes on for too long.
    #[error("a line of the control pipe is longer than {LONGEST} bytes")]
    TooLong,
    /// The system refuses to wait or to read.
    #[error("the control pipe cannot be read: {0}")]
    Read(rustix::io::Errno),
    /// Standard input cannot be had.
    #[error("standard input cannot be had: {0}")]
    Input(std::io::Error),
    /// Standard output is closed.
    #[error("standard output is closed, so there is no line to the supervisor")]
    NoOutput,
    /// Standard output was taken before.
    #[error("the line to the supervisor is taken already")]
    Taken,
    /// Standard output was not taken.
    #[error("there is no line to a supervisor")]
    NotTaken,
    /// A message could not be written.
    #[error("the supervisor cannot be reached: {0}")]
    SendMessage(std::io::Error),
}

/// The longest line that is taken.
const LONGEST: usize = 64 << 20;

impl PipeReader {
    /// Reads lines from `fd`.
    pub fn new(fd: OwnedFd) -> Self {
        Self { fd, rest: Vec::new(), ended: false }
    }

    /// The descriptor, to wait on.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }

    /// The next line, without waiting.
    pub fn next<T: DeserializeOwned>(&mut self) -> Result<PipeRead<T>, PipeError> {
        loop {
            if let Some(end) = self.rest.iter().position(|b| *b == b'\n') {
                let line: Vec<u8> = self.rest.drain(..=end).collect();
                return serde_json::from_slice(&line).map(PipeRead::Message).map_err(PipeError::Message);
            }
            if self.ended {
                return Ok(PipeRead::Ended);
            }
            let mut poll_fd = [PollFd::new(&self.fd, PollFlags::IN)];
            match poll(&mut poll_fd, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })) {
                Ok(0) => return Ok(PipeRead::Nothing),
                Ok(_) => {}
                // Not known whether there is anything: to read now could be to wait for ever.
                Err(rustix::io::Errno::INTR) => continue,
                Err(e) => return Err(PipeError::Read(e)),
            }
            let mut buffer = [0u8; 8192];
            match rustix::io::read(&self.fd, &mut buffer) {
                Ok(0) => self.ended = true,
                Ok(n) => self.rest.extend_from_slice(&buffer[..n]),
                Err(rustix::io::Errno::INTR | rustix::io::Errno::AGAIN) => {}
                Err(e) => return Err(PipeError::Read(e)),
            }
            if self.rest.len() > LONGEST {
                return Err(PipeError::TooLong);
            }
        }
    }
}

/// The line to the supervisor: the standard output with which this process began.
static CONTROL: OnceLock<File> = OnceLock::new();

/// Takes standard output as the line to the supervisor. From here on, standard output goes to standard error.
pub fn take_control() -> Result<(), PipeError> {
    let line = StdoutRedirect::to_stderr().into_original().ok_or(PipeError::NoOutput)?;
    CONTROL.set(line).map_err(|_| PipeError::Taken)
}

/// Sends a message to the supervisor. It takes no lock, which a thread that hangs could hold.
pub fn send_message(message: &FromWorker) -> Result<(), PipeError> {
    let mut line = CONTROL.get().ok_or(PipeError::NotTaken)?;
    say(&mut line, message).map_err(PipeError::SendMessage)
}

/// Writes a message as one line.
pub fn say<T: Serialize>(to: &mut impl Write, message: &T) -> std::io::Result<()> {
    let mut line = serde_json::to_vec(message)?;
    line.push(b'\n');
    to.write_all(&line)?;
    to.flush()
}

/// Standard input as lines.
pub fn orders() -> Result<PipeReader, PipeError> {
    let stdin: OwnedFd = std::io::stdin().as_fd().try_clone_to_owned().map_err(PipeError::Input)?;
    Ok(PipeReader::new(stdin))
}

/// The next order, waiting for it. `None`: the supervisor is gone.
pub fn wait_for<T: serde::de::DeserializeOwned>(orders: &mut PipeReader) -> Result<Option<T>, PipeError> {
    loop {
        match orders.next()? {
            PipeRead::Message(message) => return Ok(Some(message)),
            PipeRead::Ended => return Ok(None),
            PipeRead::Nothing => {
                let mut fd = [PollFd::from_borrowed_fd(orders.fd(), PollFlags::IN)];
                match poll(&mut fd, None) {
                    Ok(_) | Err(rustix::io::Errno::INTR) => {}
                    Err(e) => return Err(PipeError::Read(e)),
                }
            }
        }
    }
}
