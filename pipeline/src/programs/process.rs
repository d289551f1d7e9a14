//! A program of operators as it was when the run began, and processes of it.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use rustix::fs::{MemfdFlags, memfd_create};
use serde_json::{Value, json};
use stillpoint_operator::files::Files;
use stillpoint_operator::program::SERVE;
use stillpoint_operator::program::wire::{Message, receive, send};

/// Time in which a program has to describe its kinds.
const GREETING: Duration = Duration::from_secs(10);
/// How long the end of a process is waited for whose connection is closed, and how often it is looked for.
const ENDING: Duration = Duration::from_millis(500);
const ENDING_LOOKS: u32 = 100;
/// How often a program is started that another process is still writing.
const TRIES: u32 = 200;

/// A program: its bytes as they were read, so that a file that is built anew meanwhile changes nothing.
pub struct Program {
    /// Its path in the pipeline.
    pub path: String,
    /// The bytes, in memory, for reading.
    code: File,
}

impl Program {
    /// The program of these bytes.
    pub fn of(path: &str, bytes: &[u8]) -> io::Result<Self> {
        let mut written = File::from(memfd_create("stillpoint-program", MemfdFlags::CLOEXEC)?);
        written.write_all(bytes)?;
        // What is open for writing cannot be executed.
        let code = File::open(in_proc(&written))?;
        Ok(Self { path: path.to_owned(), code })
    }

    /// Starts a process of it. Gives the description of its kinds, too.
    pub fn start(&self) -> io::Result<(Process, Value)> {
        let (ours, theirs) = UnixStream::pair()?;
        let theirs = OwnedFd::from(theirs);
        let mut tries = 0;
        let child = loop {
            let mut command = Command::new(in_proc(&self.code));
            // Signals of a terminal are for the run, which ends its operators in order.
            command.arg(SERVE).stdin(Stdio::from(theirs.try_clone()?)).process_group(0);
            // What it prints is not an output of the command.
            command.stdout(Stdio::from(io::stderr().as_fd().try_clone_to_owned()?));
            match command.spawn() {
                // A process that another thread started a moment ago still has the writing end.
                Err(e) if e.kind() == ErrorKind::ExecutableFileBusy && tries < TRIES => {
                    tries += 1;
                    std::thread::sleep(Duration::from_millis(1));
                }
                other => break other?,
            }
        };
        let mut process = Process { child, socket: ours };
        drop(theirs);
        process.answers_within(GREETING)?;
        let greeting = process.receive()?;
        process.socket.set_read_timeout(None)?;
        Ok((process, greeting.head))
    }
}

/// The path of an open file.
fn in_proc(file: &File) -> String {
    format!("/proc/{}/fd/{}", std::process::id(), file.as_raw_fd())
}

/// How a process of a program ended.
#[derive(Clone, Debug, thiserror::Error)]
#[error("the program ended ({how})")]
pub struct Ended {
    how: String,
    /// A signal ended it: from outside, or for what no code may do.
    pub by_signal: bool,
}

/// A process of a program. It ends with this value, or with the process that holds it.
pub struct Process {
    child: Child,
    socket: UnixStream,
}

impl Process {
    /// From now on, an answer that takes longer is an error. A step has no such bound: the deadline of the operator is its own.
    pub fn answers_within(&self, time: Duration) -> io::Result<()> {
        self.socket.set_read_timeout(Some(time))
    }

    /// The next message. An error says how the process ended, or that it does not answer.
    fn receive(&mut self) -> io::Result<Message> {
        match receive(&mut self.socket) {
            Ok(Some(message)) => Ok(message),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                let time = self.socket.read_timeout().ok().flatten().unwrap_or_default();
                let reason = format!("the program does not answer within {} s", time.as_secs());
                Err(io::Error::new(ErrorKind::TimedOut, reason))
            }
            Err(e) if e.kind() == ErrorKind::InvalidData => Err(io::Error::new(
                ErrorKind::InvalidData,
                format!("the program sends no messages of operators: {e}"),
            )),
            _ => Err(self.gone()),
        }
    }

    /// How the process ended, if it does so soon: its connection closes a moment before.
    fn ended_by_itself(&mut self) -> Option<ExitStatus> {
        for _ in 0..ENDING_LOOKS {
            if let Ok(Some(status)) = self.child.try_wait() {
                return Some(status);
            }
            std::thread::sleep(ENDING / ENDING_LOOKS);
        }
        None
    }

    /// Asks for an answer, and answers from `files` what the program asks on the way.
    pub fn ask(&mut self, head: &Value, strings: &[&[u8]], files: &dyn Files) -> io::Result<Message> {
        send(&mut self.socket, head, strings).map_err(|_| self.gone())?;
        loop {
            let message = self.receive()?;
            let Some(what) = message.head["ask"].as_str() else { return Ok(message) };
            let name = message.head["name"].as_str().unwrap_or_default();
            let (answer, bytes) = match what {
                "read" => match files.read(name) {
                    Ok(bytes) => (json!({}), Some(bytes)),
                    Err(e) => (json!({ "error": e.to_string() }), None),
                },
                "list" => match files.list(name) {
                    Ok(list) => (json!({ "list": list }), None),
                    Err(e) => (json!({ "error": e.to_string() }), None),
                },
                _ => (json!({ "mode": files.shared_mode(name) }), None),
            };
            let strings: Vec<&[u8]> = bytes.iter().map(Vec::as_slice).collect();
            send(&mut self.socket, &answer, &strings).map_err(|_| self.gone())?;
        }
    }

    /// The error that the process is gone, with what it left. A process that has closed its connection and goes on is ended:
    /// that was its own doing, and not a signal from outside.
    fn gone(&mut self) -> io::Error {
        let (how, by_signal) = match self.ended_by_itself() {
            Some(status) => (status.to_string(), status.signal().is_some()),
            None => ("it closed its connection".to_owned(), false),
        };
        let _ = self.child.kill();
        let _ = self.child.wait();
        io::Error::new(ErrorKind::BrokenPipe, Ended { how, by_signal })
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A process that does nothing on its socket, and the other end of the socket.
    fn silent() -> (Process, UnixStream) {
        let (ours, theirs) = UnixStream::pair().unwrap();
        (Process { child: Command::new("sleep").arg("60").spawn().unwrap(), socket: ours }, theirs)
    }

    #[test]
    fn a_program_that_does_not_answer_sends_other_things_or_ends_is_named_as_such() {
        let (mut process, _theirs) = silent();
        process.answers_within(Duration::from_millis(20)).unwrap();
        let error = process.receive().unwrap_err().to_string();
        assert!(error.contains("does not answer within"), "{error}");
        let (mut process, mut theirs) = silent();
        theirs.write_all(b"Hello, world: this is no message.\n").unwrap();
        let error = process.receive().unwrap_err().to_string();
        assert!(error.contains("sends no messages of operators"), "{error}");
        let (mut process, theirs) = silent();
        drop(theirs);
        let error = process.receive().unwrap_err().to_string();
        assert!(error.contains("the program ended (it closed its connection)"), "{error}");
        let (mut process, theirs) = silent();
        process.child.kill().unwrap();
        drop(theirs);
        let error = process.receive().unwrap_err();
        let ended = error.get_ref().and_then(|inner| inner.downcast_ref::<Ended>()).unwrap();
        assert!(ended.by_signal && error.to_string().contains("signal: 9"), "{error}");
    }
}
