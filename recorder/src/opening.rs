//! What stands at the start of a part, before any sample.

use std::collections::BTreeMap;

use crate::account::ClockSample;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::form::StaticTransform;

/// How chunks are compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    /// No compression.
    None,
    /// Fast.
    #[default]
    Lz4,
    /// Small.
    Zstd,
}

impl fmt::Display for Compression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::None => "none",
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        })
    }
}

/// A file that is kept in the session.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attachment {
    /// Its name in the session.
    pub name: String,
    /// Its media type.
    pub media_type: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// What stands at the start of a part, before any sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Opening {
    /// The pipeline as run, the resolved params, every file that a param names.
    pub attachments: Vec<Attachment>,
    /// Seeds, build and CPU identity and the like: entries by the name of their record.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Frames that do not move, for `/tf_static`.
    pub frames: Vec<StaticTransform>,
    /// The session's time at the start of the part, against realtime.
    pub clock: Option<ClockSample>,
}
