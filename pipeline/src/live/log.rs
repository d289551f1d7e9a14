//! The log of a run: what its processes say, by operator and level, a line of JSON each.
//!
//! Operators use the macros of `tracing`; a worker hands the events to its supervisor, which writes them with what happened
//! to processes and operators. Nothing that an operator sends may depend on its log.

use std::cell::Cell;
use std::fmt::{Debug, Write as _};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

use super::control::FromWorker;
use super::pipe::send_message;
use crate::clock::SessionClock;

/// Name of the file, in the folder of a run and in that of a session.
pub const FILE: &str = "log.jsonl";
/// Lines that a process may say in a second: a log must not delay a step.
const MOST_LINES: u32 = 100;
/// Longest message; the rest is cut.
const LONGEST: usize = 2_000;

/// How grave a line is, the gravest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Something failed.
    Error,
    /// Something is not as it should be.
    Warn,
    /// Something happened.
    Info,
}

impl Level {
    /// The level as a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warn => "warn",
            Self::Info => "info",
        }
    }
}

/// A line of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogLine {
    /// Session time, ns since the epoch.
    pub time: u64,
    /// Its level.
    pub level: Level,
    /// The operator or process that it is about.
    pub operator: String,
    /// What is said.
    pub message: String,
}

/// The files that a supervisor writes: of the run, and of its session.
#[derive(Default)]
pub struct Log {
    files: Vec<File>,
}

impl Log {
    /// Begins the log of a run. A file that cannot be written is left out: a run does not end for its log.
    pub fn begin(run: &Path, session: Option<&Path>) -> Self {
        let open = |folder: &Path| {
            OpenOptions::new().append(true).create(true).mode(0o600).open(folder.join(FILE)).ok()
        };
        Self { files: [Some(run), session].into_iter().flatten().filter_map(open).collect() }
    }

    /// Writes a line.
    pub fn write(&mut self, line: &LogLine) {
        let Ok(mut text) = serde_json::to_vec(line) else { return };
        text.push(b'\n');
        // A full disk costs the line, not the run.
        self.files.iter_mut().for_each(|file| drop(file.write_all(&text)));
    }
}

/// The lines of a log, oldest first. A line that is cut off is left out.
pub fn read(folder: &Path) -> std::io::Result<Vec<LogLine>> {
    let text = std::fs::read_to_string(folder.join(FILE))?;
    Ok(text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect())
}

thread_local! {
    /// Number of the operator whose code runs on this thread.
    static OPERATOR: Cell<usize> = const { Cell::new(usize::MAX) };
}

/// Says whose code runs on this thread from now on.
pub fn enter(operator: usize) {
    OPERATOR.set(operator);
}

/// Hands the events of a worker to its supervisor.
pub struct Forward {
    clock: SessionClock,
    /// Names by number.
    operators: Vec<String>,
    process: String,
    budget: Mutex<Budget>,
}

/// How much was said in the present second.
struct Budget {
    begun: Instant,
    lines: u32,
    dropped: u32,
}

/// Whether a line may be said, and how many were not said before it.
fn spend(budget: &mut Budget, now: Instant) -> Option<u32> {
    if now.duration_since(budget.begun) >= Duration::from_secs(1) {
        (budget.begun, budget.lines) = (now, 0);
    }
    if budget.lines >= MOST_LINES {
        budget.dropped += 1;
        return None;
    }
    budget.lines += 1;
    Some(std::mem::take(&mut budget.dropped))
}

impl Forward {
    /// Takes the events of this process from now on.
    pub fn start(process: &str, operators: Vec<String>, clock: SessionClock) {
        let budget = Mutex::new(Budget { begun: Instant::now(), lines: 0, dropped: 0 });
        let forward = Self { clock, operators, process: process.to_owned(), budget };
        // A program of its own that has a subscriber keeps it.
        let _ = tracing::subscriber::set_global_default(forward);
    }
}

/// The text of an event: its message, then its fields.
#[derive(Default)]
struct Text(String);

impl Visit for Text {
    fn record_str(&mut self, field: &Field, value: &str) {
        self.record_debug(field, &format_args!("{value}"));
    }

    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let gap = if self.0.is_empty() { "" } else { " " };
        let _ = match field.name() {
            "message" => write!(self.0, "{gap}{value:?}"),
            name => write!(self.0, "{gap}{name}={value:?}"),
        };
    }
}

impl Subscriber for Forward {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        // Libraries log, too; what is asked of them is their warnings.
        let is_own = metadata.target().starts_with("stillpoint");
        metadata.is_event()
            && *metadata.level() <= if is_own { tracing::Level::INFO } else { tracing::Level::WARN }
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let Ok(mut budget) = self.budget.lock() else { return };
        let Some(dropped) = spend(&mut budget, Instant::now()) else { return };
        let mut text = Text::default();
        event.record(&mut text);
        if dropped > 0 {
            let _ = write!(text.0, " ({dropped} lines before it were left out)");
        }
        if let Some((end, _)) = text.0.char_indices().nth(LONGEST) {
            text.0.truncate(end);
        }
        let level = match *event.metadata().level() {
            tracing::Level::ERROR => Level::Error,
            tracing::Level::WARN => Level::Warn,
            _ => Level::Info,
        };
        let operator = self.operators.get(OPERATOR.get()).unwrap_or(&self.process).clone();
        let line = LogLine { time: self.clock.now(), level, operator, message: text.0 };
        let _ = send_message(&FromWorker::Logged(line));
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_says_too_much_is_cut_and_says_how_much_was_left_out() {
        let begun = Instant::now();
        let mut budget = Budget { begun, lines: 0, dropped: 0 };
        let message = (0..1000).filter(|_| spend(&mut budget, begun).is_some()).count();
        assert_eq!(message, MOST_LINES as usize);
        let later = begun + Duration::from_secs(1);
        assert_eq!(spend(&mut budget, later), Some(1000 - MOST_LINES));
        assert_eq!(spend(&mut budget, later), Some(0));
    }

    #[test]
    fn a_log_is_read_up_to_a_line_that_is_cut_off() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::begin(folder.path(), None);
        let line =
            LogLine { time: 7, level: Level::Warn, operator: "face".into(), message: "a \"b\"\nc".into() };
        log.write(&line);
        log.write(&line);
        log.files[0].write_all(b"{\"time\":8,\"lev").unwrap();
        assert_eq!(read(folder.path()).unwrap(), [line.clone(), line]);
    }
}
