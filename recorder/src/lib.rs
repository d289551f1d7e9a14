//! Recorder.
#![forbid(unsafe_code)]
mod account;
mod file;
mod form;
mod topic;
mod writer;
pub use account::{Closing, ClockSample, LEDGER_ATTACHMENT, Lost};
pub use file::Source;
pub use form::StaticTransform;
pub use topic::{Role, TopicInfo};
pub use writer::{Attachment, CHUNK_SIZE, Compression, Opening, PartWriter, TopicId, WriteError};
