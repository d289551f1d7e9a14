//! The options of a run, and its report.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;
use stillpoint_recorder::Compression;

use super::children::Launch;
use super::status::OperatorFigures;
use crate::ledger::LedgerLine;
use stillpoint_operator::files::DiskFiles;

/// The pipeline of a run, and how it is run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Text of the pipeline.
    pub source: String,
    /// Name of its file.
    pub file: String,
    /// `--set` overrides.
    pub sets: Vec<String>,
    /// Variables of the environment that stood in paths, with their values in `source` and `sets`.
    pub variables: BTreeMap<String, String>,
    /// The files that it included, with their SHA-256.
    pub included: BTreeMap<String, String>,
    /// Where the files are that its params name.
    pub files: DiskFiles,
    /// Length of the run, ns of session time; `None`: until it is stopped.
    pub duration: Option<u64>,
    /// Folder of the session; `None`: nothing is recorded.
    pub session: Option<PathBuf>,
    /// How the chunks are compressed.
    pub compression: Compression,
    /// How children are started.
    pub launch: Launch,
    /// Facts about build and machine.
    pub identity: BTreeMap<String, String>,
}

/// How a run went.
#[derive(Clone, Debug, Serialize)]
pub struct RunReport {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Session time from go to stop, s.
    pub seconds: f64,
    /// Figures by operator.
    pub operators: Vec<OperatorFigures>,
    /// The ledger.
    pub ledger: Vec<LedgerLine>,
    /// Whether every line of the ledger balances.
    pub balanced: bool,
    /// Journal entries that the supervisor did not see (the recorder may have).
    pub unseen_entries: u64,
    /// Failures, in the order in which they were reported.
    pub faults: Vec<Fault>,
    /// Why the run ended before its time, if it did.
    pub ended_early: Option<String>,
    /// The last part of the session, where its recorder ended it; empty where nothing is recorded, or the recording failed.
    pub recorded: Vec<Recorded>,
    /// The reason for which the last part has no end: `Some` means that the recording failed.
    pub recording_failed: Option<String>,
    /// Runs that had died, and were swept before this one.
    pub swept: Vec<String>,
}

/// A failure during a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Fault {
    /// Operator or process.
    pub operator: String,
    /// The reason that it gave, or how it ended.
    pub reason: String,
    /// Whether its process ended by it.
    pub fatal: bool,
}

/// The contents of a part of a session.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Recorded {
    /// The file.
    pub part: PathBuf,
    /// Samples, journals included.
    pub samples: u64,
    /// Their bytes.
    pub bytes: u64,
    /// CPU time of the recorder's process from when its topics and its part were open, ns; 0 where none of its own wrote
    /// the part.
    pub cpu_ns: u64,
    /// Samples not kept, by topic.
    pub lost: BTreeMap<String, u64>,
}

/// Observes the progress of a run.
pub trait Run {
    /// Progress: seconds since the run began, figures so far.
    fn goes_on(&mut self, seconds: f64, operators: &[OperatorFigures]);
    /// A failure was reported.
    fn failed(&mut self, fault: &Fault);
    /// Something happened that is no failure, such as that another host is here.
    fn noted(&mut self, _what: &str) {}
    /// The processes run: process numbers by name.
    fn started(&mut self, processes: &[(String, u32)]);
}
