//! Sessions: recorded to MCAP, read back bit for bit, mended where they were cut.
//!
//! Writing is sans-IO (any `Write`), reading takes files or bytes. A session is a folder of parts, each an MCAP file
//! with the profile `ros2` that standard tools open; a recorder that dies goes on in the next part. What a session
//! could not keep is listed in it, and [`Session::completeness`] says whether all that replay needs is there.
//!
//! - `writer`: one part, to any `Write`
//! - `topic`: what a session says about a topic
//! - `account`: what a session says about itself: losses, clock, end
//! - `form`: how a sample stands in a recording
//! - `folder`: the folder of a session, and its file modes
//! - `session`: a session, opened
//! - `part`, `samples`, `cache`: its parts, its samples in order, the chunks read last
//! - `layout`: whether a recorded type is a kind of this build
//! - `complete`: what is missing
//! - `recover`, `cut`: mends a session whose recorder died, up to where it is consistent
//! - `file`: MCAP as bytes that nobody vouches for
//! - `error`: why a session cannot be read

#![forbid(unsafe_code)]

mod account;
mod cache;
mod complete;
mod cut;
mod error;
mod file;
mod folder;
mod form;
mod layout;
mod part;
mod recover;
mod samples;
mod session;
mod topic;
mod writer;

pub use account::{Closing, ClockSample, LEDGER_ATTACHMENT, Lost};
pub use complete::{Completeness, Gap};
pub use error::SessionError;
pub use file::Source;
pub use folder::{create_part, create_private, create_session, session_parts};
pub use form::StaticTransform;
pub use layout::TopicKind;
pub use recover::{RecoverError, Report, recover, recover_session};
pub use samples::{Recorded, Samples};
pub use session::{Ended, Session, Topic};
pub use topic::{Role, TopicInfo};
pub use writer::{Attachment, CHUNK_SIZE, Compression, Opening, PartWriter, TopicId, WriteError};
