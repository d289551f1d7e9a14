//! Why a live run cannot begin or go on: in a process of operators, in the recorder, and in the supervisor.

use stillpoint_recorder::WriteError;
use stillpoint_shm::ShmError;

use super::affinity::AffinityError;
use super::barrier::BarrierError;
use super::bridge::BridgeMissing;
use super::children::ChildError;
use super::journal::PublishError;
use super::pipe::PipeError;
use super::reservation::ReserveError;
use super::run_folder::RunFolderError;
use super::wire::LinkError;
use crate::config::Faults;
use crate::files::FileError;
use crate::limits::StartError;
use crate::operator::SetupError;
use crate::placement::PlacementError;
use crate::session::OpeningError;
use crate::session_recorder::SessionError;

/// Why a process of operators ends.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The pipe to the supervisor.
    #[error(transparent)]
    Pipe(#[from] PipeError),
    /// Shared memory.
    #[error(transparent)]
    Shm(#[from] ShmError),
    /// A journal entry could not be published.
    #[error(transparent)]
    Publish(#[from] PublishError),
    /// An end of a link.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The folder of the run.
    #[error(transparent)]
    Folder(#[from] RunFolderError),
    /// An activation that a schedule decided.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// A thread cannot be started.
    #[error("a thread cannot be started: {0}")]
    Thread(#[from] StartError),
    /// The process cannot run where the config says.
    #[error(transparent)]
    Affinity(#[from] AffinityError),
    /// The pipeline does not check here as it did for the supervisor.
    #[error("the pipeline cannot be checked again: {0}")]
    Graph(Box<Faults>),
    /// The pipeline has no such process.
    #[error("the pipeline has no process {0}")]
    NoProcess(String),
    /// The floating-point state is not the one that every recorded result assumes.
    #[error("this thread does not round to nearest, or flushes subnormal numbers to zero")]
    FloatState,
    /// The network between hosts.
    #[error("{0}")]
    Network(String),
    /// An operator cannot be made.
    #[error("{operator}: {reason}")]
    Setup {
        /// Name of the operator.
        operator: String,
        /// Message of the operator.
        reason: SetupError,
    },
    /// An operator that panicked cannot be made again.
    #[error("{operator} cannot be made again: {reason}")]
    SetupOnRestart {
        /// Name of the operator.
        operator: String,
        /// Message of the operator.
        reason: SetupError,
    },
    /// An order that this kind of worker does not take.
    #[error("this worker is not directed, but received {0}")]
    NotDirected(String),
    /// An order that a directed worker does not take.
    #[error("a directed worker cannot do {0}")]
    Directed(String),
    /// An order names an operator of another process.
    #[error("operator {0} is not in this process")]
    NotHere(usize),
    /// An order names an input that is not connected.
    #[error("input {0} is not connected")]
    NotConnected(usize),
    /// The record of an activation cannot be read.
    #[error("the record of an activation has an unknown cause or a reference of the wrong size")]
    Record,
    /// The account of an operator's inputs cannot be read.
    #[error("the account of an operator's inputs has a reference of the wrong size")]
    Account,
    /// The memory of an output is used up in lock-step.
    #[error("the memory of an output is used up in lock-step")]
    OutputFull,
}

/// Why the recorder's process ends.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// What a process of operators may end by, too.
    #[error(transparent)]
    Process(#[from] WorkerError),
    /// The part of the session cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The session cannot be begun, written or ended.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The start of the session cannot be made.
    #[error(transparent)]
    Opening(#[from] OpeningError),
    /// A sample cannot be written as a message.
    #[error("topic {topic}: {reason}")]
    Sample {
        /// Name of the topic.
        topic: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The thread that writes ended without a reason.
    #[error("the thread that writes the recording ended")]
    WriterEnded,
    /// The thread that writes panicked.
    #[error("the thread that writes the recording panicked")]
    WriterPanicked,
    /// What was missed between two parts cannot be listed.
    #[error("what was missed between two parts is not listed: {0}")]
    Missed(String),
}

/// What every process may end by, as the recorder's reason.
macro_rules! through_worker {
    ($($error:ty),*) => {$(
        impl From<$error> for RecorderError {
            fn from(error: $error) -> Self {
                Self::Process(error.into())
            }
        }
    )*};
}
through_worker!(PipeError, ShmError, RunFolderError, StartError);

/// Why a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The folder of the run.
    #[error(transparent)]
    Folder(#[from] RunFolderError),
    /// Room in shared memory.
    #[error(transparent)]
    Reserve(#[from] ReserveError),
    /// Shared memory.
    #[error(transparent)]
    Shm(#[from] ShmError),
    /// The program of the bridge.
    #[error(transparent)]
    Bridge(#[from] BridgeMissing),
    /// A process cannot be started.
    #[error(transparent)]
    Child(#[from] ChildError),
    /// The processes did not get ready.
    #[error(transparent)]
    Barrier(#[from] BarrierError),
    /// The files that parameters name cannot be kept for the run.
    #[error(transparent)]
    Files(#[from] FileError),
    /// An operator has no journal topic.
    #[error("operator {0} has no journal topic")]
    NoJournal(String),
    /// A topic was not created.
    #[error("the topic {0} was not created")]
    NoTopic(String),
}
