//! Why a message is not kept as a sample.

use crate::form::Fault;
use crate::journal::JournalFault;

/// Why a message has no place in a session.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum MessageFault {
    #[error(transparent)]
    Form(#[from] Fault),
    #[error("sample {sequence} of `{topic}`, incarnation {incarnation}, is there twice")]
    Twice { sequence: u64, topic: String, incarnation: u32 },
    #[error("sample {sequence} of `{topic}`, incarnation {incarnation}: {what}")]
    Sample { sequence: u64, topic: String, incarnation: u32, what: SampleFault },
}

/// Why a message is not the sample that its channel promises.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum SampleFault {
    #[error(transparent)]
    Form(#[from] Fault),
    #[error(transparent)]
    Journal(#[from] JournalFault),
}
