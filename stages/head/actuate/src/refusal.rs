//! Why a datagram is refused, and how often it was.

/// Why a datagram is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
#[repr(usize)]
pub enum DatagramRefusal {
    /// Fewer bytes than any datagram has.
    #[error("too short")]
    TooShort,
    /// More bytes than any datagram has.
    #[error("too long")]
    TooLong,
    /// It does not begin as datagrams do.
    #[error("foreign")]
    Foreign,
    /// A version that this build does not know.
    #[error("version")]
    Version,
    /// Another length than its number of duties gives.
    #[error("length")]
    Length,
    /// Its code is not that of its bytes under the key: corrupted, or made by somebody else.
    #[error("forged")]
    Forged,
    /// Fields that do not go together.
    #[error("malformed")]
    Malformed,
    /// A duty that is no number.
    #[error("not finite")]
    NotFinite,
    /// A duty that is not from 0 to 1.
    #[error("out of range")]
    OutOfRange,
    /// A validity of zero, or of more than a second.
    #[error("life")]
    Life,
    /// For the beam where valves receive, or the other way round.
    #[error("for another")]
    Recipient,
    /// Duties of another number of valves than there are.
    #[error("valves")]
    Valves,
    /// Its life was over when it arrived, by the clock that both ends share.
    #[error("late")]
    Late,
    /// It was made after it arrived, by the clock that both ends share.
    #[error("early")]
    Early,
    /// The number of the last accepted one.
    #[error("repeated")]
    Repeated,
    /// A number before that of the last accepted one: reordered, or played back.
    #[error("old")]
    Old,
    /// Of a session that started no later than the last accepted one: an old process, or a recording.
    #[error("old session")]
    OldSession,
    /// Of a new session while a datagram of the present session is valid: a second sender.
    #[error("second sender")]
    SecondSender,
    /// Of a new session that begins with an order to follow.
    #[error("new session in motion")]
    InMotion,
}

impl DatagramRefusal {
    /// All, in the order of their numbers.
    pub const ALL: [Self; 19] = [
        Self::TooShort,
        Self::TooLong,
        Self::Foreign,
        Self::Version,
        Self::Length,
        Self::Forged,
        Self::Malformed,
        Self::NotFinite,
        Self::OutOfRange,
        Self::Life,
        Self::Recipient,
        Self::Valves,
        Self::Late,
        Self::Early,
        Self::Repeated,
        Self::Old,
        Self::OldSession,
        Self::SecondSender,
        Self::InMotion,
    ];

    /// Its name in a word or three, for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TooShort => "too_short",
            Self::TooLong => "too_long",
            Self::Foreign => "foreign",
            Self::Version => "version",
            Self::Length => "length",
            Self::Forged => "forged",
            Self::Malformed => "malformed",
            Self::NotFinite => "not_finite",
            Self::OutOfRange => "out_of_range",
            Self::Life => "life",
            Self::Recipient => "recipient",
            Self::Valves => "valves",
            Self::Late => "late",
            Self::Early => "early",
            Self::Repeated => "repeated",
            Self::Old => "old",
            Self::OldSession => "old_session",
            Self::SecondSender => "second_sender",
            Self::InMotion => "in_motion",
        }
    }
}

/// What became of the datagrams that arrived.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub accepted: u64,
    /// Numbers that were passed over between accepted ones: lost on the way, or refused.
    pub missing: u64,
    /// Accepted ones of the present session.
    pub in_session: u64,
    pub sessions: u64,
    refused: [u64; DatagramRefusal::ALL.len()],
}

impl Counts {
    /// How many were refused for a reason.
    #[must_use]
    pub fn refused(&self, why: DatagramRefusal) -> u64 {
        self.refused[why as usize]
    }

    /// How many were refused for any reason.
    #[must_use]
    pub fn all_refused(&self) -> u64 {
        self.refused.iter().sum()
    }

    /// Counts a refused one.
    pub(crate) fn refuse(&mut self, why: DatagramRefusal) {
        self.refused[why as usize] += 1;
    }
}
