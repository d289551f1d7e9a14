//! What actuation is at, and why.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// State of actuation, what was sent to the valves, and every reason why it was not what a controller asked for.
pub struct Actuation;

/// What actuation is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ActuationState {
    /// Nobody has armed it: the valves are shut.
    Disarmed = 0,
    /// Commands are followed.
    Armed = 1,
    /// Armed, but a condition is missing: the valves are shut.
    Holding = 2,
    /// The bladders vent, on a person's command or because a condition is missing.
    Venting = 3,
    /// A fault: the safe state, until a person resumes or disarms.
    Fault = 4,
}

impl ActuationState {
    /// All with the words that people read.
    pub const ALL: &'static [(&'static str, ActuationState)] = &[
        ("disarmed", ActuationState::Disarmed),
        ("armed", ActuationState::Armed),
        ("holding", ActuationState::Holding),
        ("venting", ActuationState::Venting),
        ("fault", ActuationState::Fault),
    ];

    /// The word that people read.
    pub fn word(self) -> &'static str {
        Self::ALL.iter().find(|(_, s)| *s == self).map_or("", |(word, _)| word)
    }

    /// The state of this number.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.iter().map(|(_, s)| *s).find(|s| *s as u32 == number)
    }
}

/// Reasons of actuation: bits.
pub struct ActuationReason;

impl ActuationReason {
    /// Nobody has armed it.
    pub const NOT_ARMED: u32 = 1;
    /// There is no reference, or there is another one than when it was armed.
    pub const REFERENCE: u32 = 1 << 1;
    /// A frame between camera and pose has no date or residual, too large a residual, or was measured too long ago.
    pub const EXTRINSIC: u32 = 1 << 2;
    /// There is no pose.
    pub const NO_POSE: u32 = 1 << 3;
    /// The newest measurement of the pose is too old, or always the same.
    pub const POSE_STALE: u32 = 1 << 4;
    /// The pose has numbers that are none.
    pub const POSE_NOT_FINITE: u32 = 1 << 5;
    /// No command has come.
    pub const NO_COMMAND: u32 = 1 << 6;
    /// The newest command is too old.
    pub const COMMAND_STALE: u32 = 1 << 7;
    /// A command has duties that are no numbers.
    pub const COMMAND_NOT_FINITE: u32 = 1 << 8;
    /// A command is for another number of valves.
    pub const COMMAND_SHAPE: u32 = 1 << 9;
    /// The controller asks that all valves be shut.
    pub const IDLE: u32 = 1 << 10;
    /// What was missing is there again, but not for long enough.
    pub const SETTLING: u32 = 1 << 11;
    /// A condition was missing for too long.
    pub const TOO_LONG: u32 = 1 << 12;
    /// A pressure is estimated, or measured, above its limit.
    pub const PRESSURE: u32 = 1 << 13;
    /// A person asked to vent.
    pub const ASKED: u32 = 1 << 14;
    /// This stage was not activated for longer than its datagrams live.
    pub const GAP: u32 = 1 << 15;
    /// A duty was asked for that is not from zero to the greatest.
    pub const DUTY_LIMITED: u32 = 1 << 16;
    /// A duty grows no faster than it may.
    pub const SLEW_LIMITED: u32 = 1 << 17;
    /// An inlet is kept from raising an estimated pressure to its limit.
    pub const PRESSURE_LIMITED: u32 = 1 << 18;
    /// No person has confirmed the reference.
    pub const UNCONFIRMED: u32 = 1 << 19;
    /// The head is farther from the reference model than the controller's limit; a fault if it lasts.
    pub const TRACKING_ERROR: u32 = 1 << 20;
    /// The pressure estimate limits an inlet while the head is that far off, for too long: the estimate is wrong.
    pub const PRESSURE_DOUBTED: u32 = 1 << 21;
    /// The far end has acknowledged no order of late: orders or acknowledgements do not arrive.
    pub const NO_ANSWER: u32 = 1 << 22;
    /// In the last second an order was found not to have arrived at the far end.
    pub const ORDERS_LOST: u32 = 1 << 23;
    /// A bladder pushes with less than the least force; a fault if it lasts.
    pub const CONTACT_LOW: u32 = 1 << 24;
    /// The face moves by itself: the valves hold, and do not follow it.
    pub const FACE_MOVES: u32 = 1 << 25;

    /// All with the words that people read.
    pub const ALL: &'static [(&'static str, u32)] = &[
        ("not armed", Self::NOT_ARMED),
        ("reference", Self::REFERENCE),
        ("extrinsic", Self::EXTRINSIC),
        ("no pose", Self::NO_POSE),
        ("pose stale", Self::POSE_STALE),
        ("pose not finite", Self::POSE_NOT_FINITE),
        ("no command", Self::NO_COMMAND),
        ("command stale", Self::COMMAND_STALE),
        ("command not finite", Self::COMMAND_NOT_FINITE),
        ("command shape", Self::COMMAND_SHAPE),
        ("idle", Self::IDLE),
        ("settling", Self::SETTLING),
        ("too long", Self::TOO_LONG),
        ("pressure", Self::PRESSURE),
        ("asked", Self::ASKED),
        ("gap", Self::GAP),
        ("duty limited", Self::DUTY_LIMITED),
        ("slew limited", Self::SLEW_LIMITED),
        ("pressure limited", Self::PRESSURE_LIMITED),
        ("unconfirmed", Self::UNCONFIRMED),
        ("tracking error", Self::TRACKING_ERROR),
        ("pressure doubted", Self::PRESSURE_DOUBTED),
        ("no answer", Self::NO_ANSWER),
        ("orders lost", Self::ORDERS_LOST),
        ("contact low", Self::CONTACT_LOW),
        ("face moves", Self::FACE_MOVES),
    ];

    /// The words of the bits that are set, in their order.
    pub fn words(bits: u32) -> impl Iterator<Item = &'static str> {
        Self::ALL.iter().filter(move |(_, bit)| bits & bit != 0).map(|(word, _)| *word)
    }
}

/// The fields of an [`Actuation`].
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct ActuationElement {
    /// Duties as sent: parts of full opening, inlet and outlet of the first bladder, of the second, and so on.
    pub duty: [f64; 16],
    /// Estimated pressure in each bladder over that of the room.
    #[unit("Pa")]
    pub pressure: [f64; 8],
    /// Start of the session of its datagrams.
    #[unit("ns")]
    pub session_started: u64,
    /// Nonce of that session.
    pub session_nonce: u64,
    /// Number of the datagram that goes with this sample.
    pub datagram: u64,
    /// How long the state has held.
    #[unit("ns")]
    pub since: u64,
    /// Commands to arm or to resume that were refused so far.
    pub refused: u64,
    /// Faults so far.
    pub faults: u64,
    /// An [`ActuationState`] as its number.
    pub state: u32,
    /// What the valves are told: 0 to shut, 1 to vent, 2 to follow `duty`.
    pub order: u32,
    /// Why, and what else is out of order: bits of [`ActuationReason`].
    pub reasons: u32,
    /// What made the last fault: bits of [`ActuationReason`].
    pub fault: u32,
    /// What was missing when arming or resuming was last refused: bits of [`ActuationReason`].
    pub lacking: u32,
    /// Bit i is set where valve i is not at what the command asks.
    pub limited: u32,
    /// How many of `duty` count.
    pub valves: u32,
    /// The reference with which it was armed; 0 if none is required.
    pub reference: u32,
}

impl ActuationElement {
    /// What actuation is at. A number that no build of this version wrote counts as a fault.
    pub fn state(&self) -> ActuationState {
        ActuationState::from_number(self.state).unwrap_or(ActuationState::Fault)
    }
}

impl Sample for Actuation {
    type Body = ();
    type Element = ActuationElement;
    const NAME: &'static str = "Actuation";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "State of actuation, what was sent to the valves, and why.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
