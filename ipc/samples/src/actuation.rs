//! What actuation is at, and why.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::names::bits;
use crate::{Codes, Layout, Sample, SampleKind, Shape, ValveOrder};

/// State of actuation, what was sent to the valves, and every reason why it was not what a controller asked for.
pub struct Actuation;

/// What actuation is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
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

bits! {
    /// Reasons of actuation: bits.
    ActuationReason {
        /// Nobody has armed it.
        NOT_ARMED = 1, "not armed";
        /// There is no reference, or there is another one than when it was armed.
        REFERENCE = 1 << 1, "reference";
        /// A frame between camera and pose has no date or residual, too large a residual, or was measured too long ago.
        EXTRINSIC = 1 << 2, "extrinsic";
        /// There is no pose.
        NO_POSE = 1 << 3, "no pose";
        /// The newest measurement of the pose is too old, or always the same.
        POSE_STALE = 1 << 4, "pose stale";
        /// The pose has numbers that are none.
        POSE_NOT_FINITE = 1 << 5, "pose not finite";
        /// No command has come.
        NO_COMMAND = 1 << 6, "no command";
        /// The newest command is too old.
        COMMAND_STALE = 1 << 7, "command stale";
        /// A command has duties that are no numbers.
        COMMAND_NOT_FINITE = 1 << 8, "command not finite";
        /// A command is for another number of valves.
        COMMAND_SHAPE = 1 << 9, "command shape";
        /// The controller asks that all valves be shut.
        IDLE = 1 << 10, "idle";
        /// What was missing is there again, but not for long enough.
        SETTLING = 1 << 11, "settling";
        /// A condition was missing for too long.
        TOO_LONG = 1 << 12, "too long";
        /// A pressure is estimated, or measured, above its limit.
        PRESSURE = 1 << 13, "pressure";
        /// A person asked to vent.
        ASKED = 1 << 14, "asked";
        /// This stage was not activated for longer than its datagrams live.
        GAP = 1 << 15, "gap";
        /// A duty was asked for that is not from zero to the greatest.
        DUTY_LIMITED = 1 << 16, "duty limited";
        /// A duty grows no faster than it may.
        SLEW_LIMITED = 1 << 17, "slew limited";
        /// An inlet is kept from raising an estimated pressure to its limit.
        PRESSURE_LIMITED = 1 << 18, "pressure limited";
        /// No person has confirmed the reference.
        UNCONFIRMED = 1 << 19, "unconfirmed";
        /// The head is farther from the reference model than the controller's limit; a fault if it lasts.
        TRACKING_ERROR = 1 << 20, "tracking error";
        /// The pressure estimate limits an inlet while the head is that far off, for too long: the estimate is wrong.
        PRESSURE_DOUBTED = 1 << 21, "pressure doubted";
        /// The far end has acknowledged no order of late: orders or acknowledgements do not arrive.
        NO_ANSWER = 1 << 22, "no answer";
        /// In the last second an order was found not to have arrived at the far end.
        ORDERS_LOST = 1 << 23, "orders lost";
        /// A bladder pushes with less than the least force; a fault if it lasts.
        CONTACT_LOW = 1 << 24, "contact low";
        /// The face moves by itself: the valves hold, and do not follow it.
        FACE_MOVES = 1 << 25, "face moves";
        /// Orders to a bladder go one way while the head rests: a stuck valve or a leak; a fault where pressures are estimates.
        NO_EFFECT = 1 << 26, "orders without effect";
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
    #[codes(ActuationState)]
    pub state: u32,
    /// What the valves are told: 0 to shut, 1 to vent, 2 to follow `duty`.
    #[codes(ValveOrder)]
    pub order: u32,
    /// Why, and what else is out of order: bits of [`ActuationReason`].
    #[bits(ActuationReason)]
    pub reasons: u32,
    /// What made the last fault: bits of [`ActuationReason`].
    #[bits(ActuationReason)]
    pub fault: u32,
    /// What was missing when arming or resuming was last refused: bits of [`ActuationReason`].
    #[bits(ActuationReason)]
    pub lacking: u32,
    /// Bit i is set where valve i is not at what the command asks.
    #[each("valve")]
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
