//! Why a session cannot be read.

use std::io;
use std::path::PathBuf;

/// An error with what it was caused by: mcap's own words leave out what the operating system answered.
pub(crate) fn with_causes(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(Some(error), |e| e.source());
    causes.map(ToString::to_string).collect::<Vec<_>>().join(": ")
}

/// Why a session cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The operating system refused.
    #[error("{path}: {cause}")]
    Io {
        /// File or folder.
        path: PathBuf,
        /// What the operating system answered.
        cause: io::Error,
    },
    /// A folder without a part.
    #[error("{path}: no part-000.mcap is in this folder, so it is not a session")]
    NoParts {
        /// The folder.
        path: PathBuf,
    },
    /// A folder whose parts are empty.
    #[error(
        "{part} is there and holds nothing: its recorder died before it wrote anything, or the file was emptied"
    )]
    Blank {
        /// The first part.
        part: PathBuf,
    },
    /// Another kind of file.
    #[error(
        "{path}: this is not an MCAP file (its first 8 bytes are not MCAP's): give a session's folder or a part of one"
    )]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// A topic whose samples had another layout when the session was recorded.
    #[error(
        "topic `{topic}` was recorded as {recorded}, this build has {ours}: {difference}; \
         read it with the build that recorded it"
    )]
    Layout {
        /// The topic.
        topic: String,
        /// Type name in the recording.
        recorded: String,
        /// Type name in this build.
        ours: String,
        /// Names of the fields that differ.
        difference: String,
    },
    /// A message that is not the sample that its channel promises.
    #[error(
        "{path}: the message on `{topic}` at byte {within} of the chunk at offset {offset} is damaged: {what}"
    )]
    Message {
        /// The part.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Where the chunk's records start in the file.
        offset: u64,
        /// Where the message starts in the chunk's records.
        within: usize,
        /// Description of the fault.
        what: String,
    },
}
