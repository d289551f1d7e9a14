//! The message by which a host is alive, with the counts of its ends.

use serde::{Deserialize, Serialize};

use crate::HostIdentity;

/// Version of the beats and attachments.
pub const PROTOCOL: u32 = 1;
/// The longest beat that is read, bytes.
pub const LONGEST: usize = 256 * 1024;
/// The most ends of one host, in each direction.
pub const MOST_ENDS: usize = 512;
/// The most peers of one host.
pub const MOST_PEERS: usize = 32;
/// The longest name in a beat, bytes.
pub const LONGEST_TEXT: usize = 512;
/// The longest name of a host, bytes.
pub const LONGEST_NAME: usize = 64;

/// A beat.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Beat {
    /// Version of the protocol.
    pub protocol: u32,
    /// Name of the host.
    pub host: String,
    /// Number of the host's life: a later one is higher.
    pub incarnation: u64,
    /// Number of the beat, from 1.
    pub number: u64,
    /// What the host runs.
    pub identity: HostIdentity,
    /// When the beat was sent, ns of the host's clock.
    pub at: u64,
    /// The peers that the host hears.
    #[serde(rename = "heard")]
    pub seen: Vec<Seen>,
    /// Its sending ends.
    pub sends: Vec<Sends>,
    /// Its taking ends.
    pub takes: Vec<Takes>,
}

/// A peer that a host hears.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seen {
    /// Name of the peer.
    pub host: String,
    /// Its incarnation.
    pub incarnation: u64,
    /// Number of its newest beat.
    pub number: u64,
    /// When that was sent, ns of the peer's clock.
    pub at: u64,
    /// How long it had been there when this beat was sent, ns.
    pub held: u64,
    /// Why nothing is exchanged with it; empty if samples flow.
    pub refused: Vec<String>,
}

/// A sending end.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sends {
    /// The edge.
    pub edge: String,
    /// Type, layout and frame.
    pub channel: String,
    /// Number of the end.
    pub end: u64,
    /// Samples handed to the network.
    pub put: u64,
}

/// A taking end.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Takes {
    /// The edge.
    pub edge: String,
    /// Type, layout and frame.
    pub channel: String,
    /// The sending end from which it takes; 0: none yet.
    pub from: u64,
    /// Samples of that end that arrived.
    pub received: u64,
    /// Samples of that end that arrived and were not valid.
    pub refused: u64,
}

/// Why a message is no beat.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BeatError {
    /// It is too long.
    #[error("a beat of {0} bytes is longer than {LONGEST}")]
    TooLong(usize),
    /// It is not written as one.
    #[error("it is not a beat: {0}")]
    Malformed(String),
    /// Another version of the protocol.
    #[error(
        "it speaks version {0} of the protocol, and this program version {PROTOCOL}: use the same build on all hosts"
    )]
    Protocol(u32),
    /// It was sent under the name of another host.
    #[error("it says that it comes from the host `{0}`, and was sent under another name")]
    Key(String),
    /// A part of it is beyond the bounds.
    #[error("{0} of it is empty or too long")]
    Bounds(&'static str),
}

impl Beat {
    /// The bytes on the wire.
    pub fn to_bytes(&self) -> Vec<u8> {
        // A tree of texts and numbers can always be written.
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// Reads a beat from bytes that anybody may have sent.
    ///
    /// # Errors
    /// The bytes are no beat of this version, or beyond its bounds.
    pub fn read(bytes: &[u8]) -> Result<Self, BeatError> {
        #[derive(Deserialize)]
        struct Version {
            protocol: u32,
        }
        if bytes.len() > LONGEST {
            return Err(BeatError::TooLong(bytes.len()));
        }
        let malformed = |e: serde_json::Error| BeatError::Malformed(e.to_string());
        // Another version may have other fields: it is told by its number.
        let Version { protocol } = serde_json::from_slice(bytes).map_err(malformed)?;
        if protocol != PROTOCOL {
            return Err(BeatError::Protocol(protocol));
        }
        let beat: Self = serde_json::from_slice(bytes).map_err(malformed)?;
        beat.check_bounds()?;
        Ok(beat)
    }

    fn check_bounds(&self) -> Result<(), BeatError> {
        let name = |text: &str| (1..=LONGEST_NAME).contains(&text.len());
        let text = |text: &str| (1..=LONGEST_TEXT).contains(&text.len());
        let seen = |h: &Seen| {
            name(&h.host) && h.refused.len() <= 8 && h.refused.iter().all(|r| r.len() <= 4 * LONGEST_TEXT)
        };
        let bounds = [
            ("the name of the host", name(&self.host)),
            ("the number", self.number > 0),
            ("the identity", self.identity.texts().iter().all(|t| t.len() <= LONGEST_TEXT)),
            ("the list of peers", self.seen.len() <= MOST_PEERS && self.seen.iter().all(seen)),
            (
                "the list of sending ends",
                self.sends.len() <= MOST_ENDS && self.sends.iter().all(|s| text(&s.edge) && text(&s.channel)),
            ),
            (
                "the list of taking ends",
                self.takes.len() <= MOST_ENDS && self.takes.iter().all(|t| text(&t.edge) && text(&t.channel)),
            ),
        ];
        bounds.iter().find(|(_, holds)| !holds).map_or(Ok(()), |(what, _)| Err(BeatError::Bounds(what)))
    }
}
