//! The messages between supervisor and child processes, one JSON line each.

use serde::{Deserialize, Serialize};
use stillpoint_recorder::Compression;
use stillpoint_samples::{Cause, JournalRef};
use zerocopy::{FromBytes, IntoBytes};

use super::bridge::BridgeReport;
use super::log::LogLine;
use crate::clock::SessionClock;
use crate::placement::Begin;
use crate::record::Record;
use crate::run_source::RunSource;
use crate::settings::TakenChange;

/// The first message to a child: all that it needs to make the same graph.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Hello {
    /// Name of the process.
    pub process: String,
    /// The source of the graph.
    pub source: RunSource,
    /// Root folder of the domain.
    pub root: std::path::PathBuf,
    /// Prefix of the domain.
    pub prefix: String,
    /// The session's clock.
    pub clock: SessionClock,
    /// First incarnation of each operator of the process, in the order of the process.
    pub incarnations: Vec<u32>,
    /// The changes of parameters that each of them begins with, the oldest first.
    pub changes: Vec<Vec<TakenChange>>,
    /// Whether activations are decided by the supervisor.
    pub directed: bool,
}

/// To any child: connect to all publishers that are there, and say so.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Connect {
    /// Number of the order, to be given back: an answer may come late.
    pub number: u64,
}

/// From the supervisor to a worker.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum ToWorker {
    /// Connect.
    Connect(Connect),
    /// Begin. Timers count from `epoch`, session time in ns.
    Go {
        /// Zero of the timers.
        epoch: u64,
    },
    /// Begin a new incarnation of an operator that panicked.
    Renew {
        /// Number of the operator.
        operator: usize,
        /// When, session time in ns.
        at: u64,
    },
    /// Begin a new incarnation of an operator on request.
    Restart {
        /// Number of the operator.
        operator: usize,
    },
    /// Stop timers and sources, drain the inputs, mark the end, and say so.
    Stop,
    /// End the process.
    Exit,
    /// Directed: begin an incarnation.
    Start {
        /// Number of the operator.
        operator: usize,
        /// Its number and its time.
        begin: Begin,
    },
    /// Directed: take the samples that wait on an input.
    Take {
        /// Number of the operator.
        operator: usize,
        /// Number of the input.
        port: usize,
    },
    /// Directed: do an activation.
    Activate {
        /// Number of the operator.
        operator: usize,
        /// What to do.
        record: WireRecord,
    },
    /// Directed: what was sent is taken; send what is left of the activation's outputs.
    More {
        /// Number of the operator.
        operator: usize,
    },
    /// Directed: end an incarnation in order.
    End {
        /// Number of the operator.
        operator: usize,
        /// Session time, ns.
        time: u64,
        /// Account of its inputs.
        inputs: Vec<WireRef>,
    },
}

/// From a worker to the supervisor.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum FromWorker {
    /// All ports are made.
    Made,
    /// All publishers that were there are connected.
    Connected {
        /// Number of the order.
        number: u64,
    },
    /// An operator failed. A fatal failure ends the process.
    Fault {
        /// Name of the operator.
        operator: String,
        /// Its incarnation.
        incarnation: u32,
        /// Message of the operator.
        reason: String,
        /// Whether the process ends by it.
        fatal: bool,
    },
    /// An operator panicked. It waits to be told when it begins again.
    Panicked {
        /// Name of the operator.
        operator: String,
        /// Its incarnation.
        incarnation: u32,
        /// Message of the operator.
        reason: String,
    },
    /// Inputs are drained and ends are marked.
    Stopped,
    /// Of the bridge: its counts.
    Bridged(BridgeReport),
    /// Of the bridge: what happened on the network, where it is no fault.
    Reported(String),
    /// A line of the log.
    Logged(LogLine),
    /// The recorder's account of what it kept.
    Recorded(RecorderReport),
    /// Directed: the entry was published.
    Entry,
    /// Directed: taken.
    Taken,
    /// Directed: the entry was published, and of the outputs as many as the buffers hold.
    Committed {
        /// Output of each sample that was sent, in the order of sending.
        sent: Vec<usize>,
        /// Samples that wait until those were taken.
        left: usize,
        /// What a failed activation said.
        fault: Option<String>,
    },
    /// Directed: it could not be done.
    Refused(String),
}

/// The recorder's account.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecorderReport {
    /// Samples written, journals included.
    pub samples: u64,
    /// Bytes of samples written.
    pub bytes: u64,
    /// CPU time of the recorder's process from when its topics and its part were open, ns.
    pub cpu_ns: u64,
    /// Samples that it could not keep, by topic.
    pub lost: std::collections::BTreeMap<String, u64>,
    /// The file.
    pub part: std::path::PathBuf,
}

/// From the supervisor to the recorder.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum ToRecorder {
    /// Connect.
    Connect(Connect),
    /// Take what waits, and end the session with this ledger (JSON).
    Finish {
        /// The ledger.
        ledger: String,
        /// Reasons why the session is not complete, as far as the supervisor knows.
        gaps: Vec<String>,
        /// How often a recorder of this run died.
        recorder_deaths: u32,
        /// Why the run did not end as it should, if it did not.
        ended_early: Option<String>,
    },
}

/// The first message to the recorder.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HelloRecorder {
    /// As to a worker.
    pub hello: Hello,
    /// Folder of the session.
    pub session: std::path::PathBuf,
    /// How the chunks are compressed.
    pub compression: Compression,
    /// Facts about build and machine, for the session's metadata.
    pub identity: std::collections::BTreeMap<String, String>,
}

/// A reference as numbers.
pub type WireRef = Vec<u8>;

/// A record as JSON carries it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WireRecord {
    time: u64,
    nominal: u64,
    tick: u64,
    cause: u32,
    port: usize,
    inputs: Vec<WireRef>,
}

/// References as bytes.
pub fn wire_refs(refs: &[JournalRef]) -> Vec<WireRef> {
    refs.iter().map(|r| r.as_bytes().to_vec()).collect()
}

/// References out of bytes.
pub fn refs_of_wire(wire: &[WireRef]) -> Option<Vec<JournalRef>> {
    wire.iter().map(|bytes| JournalRef::read_from_bytes(bytes).ok()).collect()
}

impl From<&Record> for WireRecord {
    fn from(r: &Record) -> Self {
        Self {
            time: r.time,
            nominal: r.nominal,
            tick: r.tick,
            cause: r.cause as u32,
            port: r.port,
            inputs: wire_refs(&r.inputs),
        }
    }
}

impl WireRecord {
    /// The record; `None` where it makes no sense.
    pub fn record(&self) -> Option<Record> {
        Some(Record {
            time: self.time,
            nominal: self.nominal,
            tick: self.tick,
            cause: Cause::from_number(self.cause)?,
            port: self.port,
            inputs: refs_of_wire(&self.inputs)?,
        })
    }
}
