//! Sessions: recorded to MCAP, read back bit for bit, mended where they were cut.
//!
//! ```
//! use stillpoint_recorder::{Closing, Completeness, Compression, Opening, PartWriter, Role, Session, TopicInfo};
//! use stillpoint_samples::{Pieces, Pose, Sample};
//!
//! let mut part = PartWriter::new(Vec::new(), Compression::Lz4, &Opening::default())?;
//! let topic = part.add_topic(TopicInfo {
//!     name: "head.pose".into(),
//!     operator: "head".into(),
//!     kind: Pose::KIND,
//!     frame: Some("couch".into()),
//!     role: Role::Source,
//! })?;
//! let mut sample = vec![0; 32 + 43 * 8];
//! sample[28] = 1; // one element
//! part.write(topic, Pieces::split(Pose::KIND, &sample)?, 1_795_219_200_000_000_000)?;
//! let bytes = part.finish(&Closing::default())?;
//!
//! let session = Session::from_bytes([bytes.into()])?;
//! assert_eq!(session.completeness(), Completeness::Complete);
//! assert_eq!(&*session.samples().next().unwrap()?.sample, &sample[..]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Writing is sans-IO (any `Write`), reading takes files or bytes. A session is a folder of parts, each an MCAP file
//! with the profile `ros2` that standard tools open; a recorder that dies goes on in the next part. What a session
//! could not keep is listed in it, and [`Session::completeness`] says whether all that replay needs is there.
//!
//! - `writer`, `opening`, `channels`: one part, to any `Write`; what it starts with; the channels of its topics
//! - `encoded`: a sample laid out as its message, by whoever takes it out of shared memory
//! - `topic`: what a session says about a topic
//! - `account`: what a session says about itself: losses, clock, end
//! - `form`: how a sample stands in a recording
//! - `folder`: the folder of a session, and its file modes
//! - `session`, `load`, `fetch`: what an opened session holds; how it is opened; one sample of it
//! - `journal`: whether a journal can be what an operator wrote
//! - `part`, `samples`, `cache`: its parts, its samples in order, the chunks read last
//! - `raw`: its messages as they stand in the file
//! - `rosbag`: `metadata.yaml`, which makes its folder a bag of rosbag2
//! - `layout`, `mapping`: whether a recorded type is a kind of this build; how one of an older layout becomes one
//! - `ended`: how the recording came to its end
//! - `complete`: what is missing
//! - `recover`, `cut`: mends a session whose recorder died, up to where it is consistent
//! - `file`: MCAP as bytes that nobody vouches for
//! - `error`: why a session cannot be read; `fault`: why a message is not a sample

#![forbid(unsafe_code)]
// Outsiders use it.
#![warn(missing_docs)]

mod account;
mod cache;
mod channels;
mod complete;
mod cut;
mod encoded;
mod ended;
mod error;
mod fault;
mod fetch;
mod file;
mod folder;
mod form;
mod journal;
mod layout;
mod load;
mod mapping;
mod opening;
mod part;
mod raw;
mod recover;
mod rosbag;
mod samples;
mod session;
mod topic;
mod writer;

pub use account::{ClockSample, Closing, LEDGER_ATTACHMENT, Lost};
pub use complete::{Completeness, Gap};
pub use encoded::Encoded;
pub use ended::Ended;
pub use error::SessionError;
pub use fetch::Recorded;
pub use file::Source;
pub use folder::{create_part, create_private, create_session, session_parts};
pub use form::{RosMessage, StaticTransform, static_frames};
pub use journal::times;
pub use layout::TopicKind;
pub use mapping::Mapping;
pub use opening::{Attachment, Compression, Opening};
pub use raw::RawMessage;
pub use recover::{RecoverError, Report, recover, recover_session};
pub use rosbag::{METADATA_FILE, metadata_yaml, write_metadata};
pub use samples::Samples;
pub use session::{Session, Topic};
pub use topic::{Role, TopicInfo};
pub use writer::{CHUNK_SIZE, PartWriter, TopicId, WriteError};
