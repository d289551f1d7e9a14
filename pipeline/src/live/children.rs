//! The child processes of a supervisor: their start, the messages in both directions, and their end.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child as Process, ChildStdin, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::Serialize;

use super::bridge::BridgeReport;
use super::control::{Connect, FromWorker};
use super::log::LogLine;
use super::pipe::{PipeRead, PipeReader, say};
use crate::limits::StartError;

/// How long a child that is no longer wanted may take to end in order.
const LAST_PATIENCE: Duration = Duration::from_secs(5);

/// How a child process is started.
#[derive(Clone, Debug)]
pub struct Launch {
    /// The program.
    pub program: PathBuf,
    /// Its arguments in front of all others.
    pub lead: Vec<OsString>,
    /// Variables of its environment, in addition to those of this process.
    pub environment: Vec<(String, String)>,
    /// Its argument that makes it a worker.
    pub worker: &'static str,
    /// Its argument that makes it a recorder.
    pub recorder: &'static str,
}

/// Why a child process cannot be started, or does not answer.
#[derive(Debug, thiserror::Error)]
pub enum ChildError {
    /// The program cannot be started.
    #[error("process {process} cannot be started from {}: {reason}", program.display())]
    Start {
        /// Name of the process.
        process: String,
        /// The program.
        program: PathBuf,
        /// What the system says.
        reason: StartError,
    },
    /// It has ended.
    #[error("process {0} has ended")]
    Ended(String),
    /// It did not answer in time.
    #[error("process {process} did not answer within {patience_ms} ms")]
    Silent {
        /// Name of the process.
        process: String,
        /// How long the answer was waited for, ms.
        patience_ms: u128,
    },
}

/// A child process.
pub struct Child {
    /// Name in messages.
    pub name: String,
    /// The reason that it gave for its end.
    pub fatal_reason: Option<String>,
    /// Its ports are made.
    pub made: bool,
    /// Number of the last order to connect that it was given.
    pub ordered: u64,
    /// Number of the last order to connect that it has done.
    pub connected: u64,
    /// Its inputs are drained and its end is marked.
    pub stopped: bool,
    /// The newest counts, of a bridge.
    pub bridged: Option<BridgeReport>,
    /// What happened on the network, of a bridge.
    pub news: Vec<String>,
    /// Lines for the log.
    pub logged: Vec<LogLine>,
    /// Operators that panicked and wait for an order, with the text of the panic.
    pub panicked: Vec<(String, String)>,
    /// Since when it has not answered an order: to make its ports, or to connect.
    unanswered_since: Option<Instant>,
    /// When it was last ordered to connect, or was started.
    asked: Instant,
    process: Process,
    stdin: Option<ChildStdin>,
    lines: PipeReader,
    received: VecDeque<FromWorker>,
    ended: bool,
}

/// A failure that a child reported.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportedFault {
    /// Name of the operator, or of the process.
    pub operator: String,
    /// Incarnation, where it is known.
    pub incarnation: u32,
    /// The reason that it gave.
    pub reason: String,
    /// Whether its process ended by it.
    pub fatal: bool,
}

impl Child {
    /// Starts a child and greets it.
    pub fn start<T: Serialize>(
        launch: &Launch,
        role: &str,
        name: &str,
        hello: &T,
    ) -> Result<Self, ChildError> {
        let refused = |reason: std::io::Error| ChildError::Start {
            process: name.to_string(),
            program: launch.program.clone(),
            reason: StartError(reason),
        };
        let mut process = Command::new(&launch.program)
            .args(&launch.lead)
            .envs(launch.environment.iter().map(|(name, value)| (name, value)))
            .arg(role)
            // For those who look at a list of processes.
            .arg(name)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            // Ctrl-C is for the supervisor alone, also while a child has not yet said that it ignores it.
            .process_group(0)
            .spawn()
            .map_err(refused)?;
        let stdout = process.stdout.take().ok_or_else(|| refused(std::io::ErrorKind::BrokenPipe.into()))?;
        let stdin = process.stdin.take();
        let begun = Instant::now();
        let mut child = Self {
            name: name.to_string(),
            fatal_reason: None,
            made: false,
            ordered: 0,
            connected: 0,
            stopped: false,
            bridged: None,
            news: Vec::new(),
            logged: Vec::new(),
            panicked: Vec::new(),
            unanswered_since: Some(begun),
            asked: begun,
            process,
            stdin,
            lines: PipeReader::new(OwnedFd::from(stdout)),
            received: VecDeque::new(),
            ended: false,
        };
        child.send_message(hello);
        Ok(child)
    }

    /// Process number.
    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Whether its end of the pipe is closed: it is gone, or about to be.
    pub fn is_gone(&self) -> bool {
        self.ended
    }

    /// Sends it a message. A child that is gone does not get it; the pipe shows its end.
    pub fn send_message<T: Serialize>(&mut self, message: &T) {
        if let Some(stdin) = &mut self.stdin
            && say(stdin, message).is_err()
        {
            self.stdin = None;
        }
    }

    /// Orders it to connect to all publishers that are there. `order` makes its message of the number.
    pub fn order_connect<T: Serialize>(&mut self, number: u64, order: fn(Connect) -> T) {
        self.send_message(&order(Connect { number }));
        let now = Instant::now();
        (self.ordered, self.asked) = (number, now);
        self.unanswered_since.get_or_insert(now);
    }

    /// Whether its ports are made, it has answered every order, and it was given none for so long.
    pub fn is_idle_for(&self, since: Duration) -> bool {
        self.made && self.unanswered_since.is_none() && self.asked.elapsed() >= since
    }

    /// How long it has not answered an order.
    pub fn silence(&self) -> Duration {
        self.unanswered_since.map_or(Duration::ZERO, |since| since.elapsed())
    }

    /// Kills it, as it does not answer. Its reason says so.
    pub fn kill_unresponsive(&mut self, waited: Duration) {
        self.fatal_reason =
            Some(format!("it did not answer for {:.1} s, and was killed", waited.as_secs_f64()));
        self.unanswered_since = None;
        self.kill();
    }

    /// Reads its messages. Failures go into `reported`.
    pub fn listen(&mut self, reported: &mut Vec<ReportedFault>) {
        while !self.ended {
            match self.lines.next::<FromWorker>() {
                Ok(PipeRead::Message(FromWorker::Fault { operator, incarnation, reason, fatal })) => {
                    let operator = if operator.is_empty() { self.name.clone() } else { operator };
                    if fatal {
                        self.fatal_reason = Some(reason.clone());
                    }
                    reported.push(ReportedFault { operator, incarnation, reason, fatal });
                }
                Ok(PipeRead::Message(FromWorker::Panicked { operator, incarnation, reason })) => {
                    self.panicked.push((operator.clone(), reason.clone()));
                    reported.push(ReportedFault { operator, incarnation, reason, fatal: false });
                }
                Ok(PipeRead::Message(FromWorker::Made)) => {
                    self.made = true;
                    self.unanswered_since = None;
                }
                Ok(PipeRead::Message(FromWorker::Connected { number })) => {
                    self.connected = number;
                    // It answers, so the time for the next answer begins anew.
                    self.unanswered_since = (number < self.ordered).then(Instant::now);
                }
                Ok(PipeRead::Message(FromWorker::Stopped)) => self.stopped = true,
                Ok(PipeRead::Message(FromWorker::Bridged(report))) => self.bridged = Some(report),
                Ok(PipeRead::Message(FromWorker::Reported(news))) => self.news.push(news),
                Ok(PipeRead::Message(FromWorker::Logged(line))) => self.logged.push(line),
                Ok(PipeRead::Message(message)) => self.received.push_back(message),
                Ok(PipeRead::Nothing) => return,
                Ok(PipeRead::Ended) => self.ended = true,
                Err(error) => {
                    let reason = error.to_string();
                    reported.push(ReportedFault {
                        operator: self.name.clone(),
                        incarnation: 0,
                        reason,
                        fatal: true,
                    });
                    self.kill();
                    self.ended = true;
                }
            }
        }
    }

    /// Whether a message was heard and not taken.
    pub fn has_answered(&self) -> bool {
        !self.received.is_empty()
    }

    /// The oldest message that was heard and not taken.
    pub fn next(&mut self) -> Option<FromWorker> {
        self.received.pop_front()
    }

    /// Waits until `done` holds; whether it does. A child that is gone is not waited for.
    pub fn wait(
        &mut self,
        patience: Duration,
        reported: &mut Vec<ReportedFault>,
        done: impl Fn(&Self) -> bool,
    ) -> bool {
        let end = Instant::now() + patience;
        loop {
            self.listen(reported);
            let left = end.saturating_duration_since(Instant::now());
            if done(self) || self.ended || left.is_zero() {
                return done(self);
            }
            wait_any(&[&*self], left);
        }
    }

    /// Waits for the answer to an order. `Err`: the child is gone, or did not answer in time.
    pub fn answer(
        &mut self,
        patience: Duration,
        reported: &mut Vec<ReportedFault>,
    ) -> Result<FromWorker, ChildError> {
        let end = Instant::now() + patience;
        loop {
            self.listen(reported);
            if let Some(message) = self.next() {
                return Ok(message);
            }
            if self.ended {
                return Err(ChildError::Ended(self.name.clone()));
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(ChildError::Silent {
                    process: self.name.clone(),
                    patience_ms: patience.as_millis(),
                });
            }
            wait_any(&[&*self], left);
        }
    }

    /// Ends it at once.
    pub fn kill(&mut self) {
        let _ = self.process.kill();
    }

    /// Closes its orders and waits for its end; kills it when that takes too long.
    pub fn reap(mut self, patience: Duration) -> Option<ExitStatus> {
        self.end(patience)
    }

    fn end(&mut self, patience: Duration) -> Option<ExitStatus> {
        self.stdin = None;
        let end = Instant::now() + patience;
        loop {
            match self.process.try_wait() {
                Ok(Some(status)) => return Some(status),
                Ok(None) if Instant::now() < end => {
                    let mut reported = Vec::new();
                    self.listen(&mut reported);
                    if self.ended {
                        // The pipe closes a moment before the process is gone.
                        return self.process.wait().ok();
                    }
                    wait_any(&[&*self], Duration::from_millis(20));
                }
                _ => {
                    self.kill();
                    return self.process.wait().ok();
                }
            }
        }
    }
}

impl Drop for Child {
    /// A run that cannot begin or go on leaves no child behind: each ends when its orders do, and nothing that it still
    /// makes is swept too early.
    fn drop(&mut self) {
        self.end(LAST_PATIENCE);
    }
}

/// Waits until a child has sent a message, or for so long.
pub fn wait_any(children: &[&Child], patience: Duration) {
    let mut fds: Vec<_> = children
        .iter()
        .filter(|c| !c.ended)
        .map(|c| PollFd::from_borrowed_fd(c.lines.fd(), PollFlags::IN))
        .collect();
    let wait = Timespec {
        tv_sec: i64::try_from(patience.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: i64::from(patience.subsec_nanos()),
    };
    // An interruption only makes the wait shorter.
    let _ = poll(&mut fds, Some(&wait));
}
