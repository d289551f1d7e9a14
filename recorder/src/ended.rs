//! How the recording of a session came to its end.

use std::fmt;
use std::path::PathBuf;

use crate::account::END_RECORD;
use crate::part::SessionPart;
use crate::session::Session;

/// How the recording of a session came to its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The recorder ended it, and so did the run.
    InOrder,
    /// The recorder ended it, but the run did not end as it should.
    Early {
        /// The reason.
        reason: String,
    },
    /// Not yet: a recorder writes it.
    BeingRecorded {
        /// The part that it writes.
        part: PathBuf,
    },
    /// The recorder died: the last part is readable up to a byte.
    Cut {
        /// The last part.
        part: PathBuf,
        /// Where its last whole record ends, bytes.
        whole: u64,
        /// Bytes in the file.
        size: u64,
    },
    /// The recorder died, and the last part was repaired.
    Mended {
        /// The last part.
        part: PathBuf,
    },
    /// Another program recorded it: the end is unknown.
    Foreign,
}

impl fmt::Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::InOrder => f.write_str("in order"),
            Self::Early { reason } => write!(f, "early: {reason}"),
            Self::BeingRecorded { part } => write!(f, "not yet: {} is being recorded", part.display()),
            Self::Cut { part, whole, size } => {
                write!(f, "cut: {} is readable up to byte {whole} of {size}", part.display())
            }
            Self::Mended { part } => write!(f, "cut, and {} is mended", part.display()),
            Self::Foreign => f.write_str("unknown: this is not a session of stillpoint"),
        }
    }
}

impl Session {
    /// How the recording ended.
    pub fn ended(&self) -> Ended {
        let Some(last) = self.parts.last().filter(|_| self.parts.iter().any(SessionPart::is_ours)) else {
            return Ended::Foreign;
        };
        let part = last.path.clone();
        if last.ended_in_order() {
            return self.early().map_or(Ended::InOrder, |reason| Ended::Early { reason });
        }
        match self.parts.iter().find(|p| p.is_being_written) {
            Some(p) => Ended::BeingRecorded { part: p.path.clone() },
            None if last.needs_mending() => Ended::Cut { part, whole: last.scan.whole, size: last.size },
            None => Ended::Mended { part },
        }
    }

    /// Whether [`crate::recover_session`] would repair a part of it.
    pub fn needs_mending(&self) -> bool {
        !self.parts.iter().any(|p| p.is_being_written) && self.parts.iter().any(SessionPart::needs_mending)
    }

    /// Why the run ended before its time, as the last part says it.
    fn early(&self) -> Option<String> {
        let (_, end) = self.parts.last()?.scan.metadata.iter().rfind(|(name, _)| name == END_RECORD)?;
        (end.get("fact.in_order")? == "false").then(|| {
            let reason = end.get("fact.ended_early").map(String::as_str);
            reason.unwrap_or("the run did not end in order").to_owned()
        })
    }
}
