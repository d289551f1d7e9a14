//! A command that is attached to a run, as a user attaches it: a program of its own that is read to its end.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use clap::ValueEnum;
use rustix::process::{Pid, Signal, kill_process};
use serde::Serialize;

use super::COMMAND;
use stillpoint::Failure;

/// Maximum time until a command has attached.
const PATIENCE: Duration = Duration::from_secs(60);
/// Starts `top` in a terminal of a usual size, because without one it prints once and ends.
const SCREEN: &str = "stty rows 48 cols 160; exec \"$BENCH\" \"$COMMAND\" top \"$RUN\"";

/// A command that attaches to a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Tool {
    /// No command: the difference between two windows without any.
    None,
    /// `stillpoint echo` of the payload.
    Echo,
    /// The screen of `stillpoint top`.
    Top,
    /// `stillpoint view` with a client that follows.
    View,
}

impl Tool {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Echo => "echo",
            Self::Top => "top",
            Self::View => "view",
        }
    }

    /// Attaches the command to the run with this PID, and waits until it prints. `topic` is what `echo` prints.
    pub fn attach(self, run: u32, topic: &str) -> Result<Option<AttachedTool>, Failure> {
        let program = std::env::current_exe().map_err(Failure::failed)?;
        let run = run.to_string();
        let mut command = Command::new(&program);
        match self {
            Self::None => return Ok(None),
            Self::Echo => command.args([COMMAND, "echo", topic, "--run", &run]),
            Self::View => command.args([COMMAND, "view", "--port", "0", &run]),
            Self::Top => {
                command = Command::new("script");
                command.args(["-qfec", SCREEN, "/dev/null"]);
                command.envs([("COMMAND", COMMAND), ("RUN", &run), ("TERM", "xterm"), ("SHELL", "/bin/sh")]);
                command.env("BENCH", &program)
            }
        };
        // `script` passes on its standard input to the screen, and ends with it.
        let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let child = child
            .map_err(|e| Failure::failed(format!("{}: {e}", command.get_program().to_string_lossy())))?;
        let mut attached = AttachedTool { child };
        let (prints, printed) = channel();
        if let Some(out) = attached.child.stdout.take() {
            let is_view = self == Self::View;
            std::thread::spawn(move || if is_view { follow(out, &prints) } else { drain(out, &prints) });
        }
        let first = printed.recv_timeout(PATIENCE);
        first.map_err(|_| Failure::failed(format!("`{}` does not print anything", self.name())))?;
        Ok(Some(attached))
    }
}

/// A command that is attached. It ends when it is dropped.
pub struct AttachedTool {
    child: Child,
}

impl Drop for AttachedTool {
    fn drop(&mut self) {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        let asked = pid.is_some_and(|pid| kill_process(pid, Signal::TERM).is_ok());
        if !asked {
            let _ = self.child.kill();
        }
        let _ = self.child.wait();
    }
}

/// Reads to the end. Notifies of the first bytes.
fn drain(mut from: impl Read, prints: &Sender<()>) {
    let mut piece = vec![0; 1 << 16];
    while from.read(&mut piece).is_ok_and(|count| count > 0) {
        // After the first bytes there is no receiver.
        let _ = prints.send(());
    }
}

/// Reads the address of a page, and then its events to the end.
fn follow(mut from: ChildStdout, prints: &Sender<()>) {
    let mut line = Vec::new();
    let mut byte = [0];
    while from.read(&mut byte).is_ok_and(|count| count > 0) && byte != *b"\n" {
        line.push(byte[0]);
    }
    let line = String::from_utf8_lossy(&line);
    let address = line.split_once("http://").and_then(|(_, rest)| rest.split('/').next());
    let Some(mut client) = address.and_then(|address| TcpStream::connect(address).ok()) else { return };
    if client.write_all(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n").is_ok() {
        drain(client, prints);
    }
    // The program ends when nobody reads what it prints.
    drop(from);
}
