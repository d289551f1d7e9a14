//! Whether the beam may be on, and why not.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// The lease of the beam: whether it was renewed, the errors that were judged, and every reason against it.
pub struct Gate;

/// Reasons against the beam: bits.
pub struct GateReason;

impl GateReason {
    /// There is no pose, or it lacks a channel of the target.
    pub const NO_POSE: u32 = 1;
    /// The newest measurement of the pose is too old, or always the same.
    pub const POSE_STALE: u32 = 1 << 1;
    /// Pose or target have numbers that are none.
    pub const NOT_FINITE: u32 = 1 << 2;
    /// There is no target.
    pub const NO_TARGET: u32 = 1 << 3;
    /// The newest sample of the target is too old.
    pub const TARGET_STALE: u32 = 1 << 4;
    /// The target moves.
    pub const TARGET_MOVES: u32 = 1 << 5;
    /// A coordinate is out of tolerance.
    pub const POSITION: u32 = 1 << 6;
    /// An angle is out of tolerance.
    pub const ANGLE: u32 = 1 << 7;
    /// A coordinate or an angle is not known well enough.
    pub const UNCERTAIN: u32 = 1 << 8;
    /// A frame between camera and pose has no date or residual, too large a residual, or was measured too long ago.
    pub const EXTRINSIC: u32 = 1 << 9;
    /// Actuation is not armed, holds, vents or is at fault.
    pub const ACTUATION: u32 = 1 << 10;
    /// Actuation has been silent for too long.
    pub const ACTUATION_SILENT: u32 = 1 << 11;
    /// All is well, but not for long enough.
    pub const DWELLING: u32 = 1 << 12;

    /// The tracker's last report has no pose, is too old, or none has come.
    pub const TRACKER: u32 = 1 << 13;
    /// The tracker's confidence that it follows what was captured is too low.
    pub const IDENTITY: u32 = 1 << 14;
    /// The parts of the reference have not been seen to move together since the capture.
    pub const UNPROVEN: u32 = 1 << 15;
    /// No person has confirmed the reference.
    pub const UNCONFIRMED: u32 = 1 << 16;
    /// The standing plan is not known to hold in the requested set-up.
    pub const PLAN: u32 = 1 << 17;
    /// The face moves by itself: the pose of the skull is less sure.
    pub const FACE_MOVES: u32 = 1 << 18;

    /// All with the words that people read.
    pub const ALL: &'static [(&'static str, u32)] = &[
        ("no pose", Self::NO_POSE),
        ("pose stale", Self::POSE_STALE),
        ("not finite", Self::NOT_FINITE),
        ("no target", Self::NO_TARGET),
        ("target stale", Self::TARGET_STALE),
        ("target moves", Self::TARGET_MOVES),
        ("position", Self::POSITION),
        ("angle", Self::ANGLE),
        ("uncertain", Self::UNCERTAIN),
        ("extrinsic", Self::EXTRINSIC),
        ("actuation", Self::ACTUATION),
        ("actuation silent", Self::ACTUATION_SILENT),
        ("dwelling", Self::DWELLING),
        ("tracker", Self::TRACKER),
        ("identity", Self::IDENTITY),
        ("unproven", Self::UNPROVEN),
        ("unconfirmed", Self::UNCONFIRMED),
        ("plan", Self::PLAN),
        ("face moves", Self::FACE_MOVES),
    ];

    /// The words of the bits that are set, in their order.
    pub fn words(bits: u32) -> impl Iterator<Item = &'static str> {
        Self::ALL.iter().filter(move |(_, bit)| bits & bit != 0).map(|(word, _)| *word)
    }
}

/// The fields of a [`Gate`]. What is not known, or not held by the target, is NaN.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct GateElement {
    /// Position less target.
    #[unit("m")]
    pub position_error: [f64; 3],
    /// Pitch, roll and yaw minus those of the target.
    #[unit("rad")]
    pub angle_error: [f64; 3],
    /// Largest standard deviation of a coordinate that is held.
    #[unit("m")]
    pub position_sd: f64,
    /// Largest standard deviation of an angle that is held.
    #[unit("rad")]
    pub angle_sd: f64,
    /// When the lease ends; 0 where there is none.
    #[unit("ns")]
    pub lease_ends: u64,
    /// How long all has been well.
    #[unit("ns")]
    pub well_for: u64,
    /// How long the beam was allowed, in all.
    #[unit("ns")]
    pub on_for: u64,
    /// How long it was watched, in all.
    #[unit("ns")]
    pub watched_for: u64,
    /// Leases begun so far.
    pub leases: u64,
    /// Number of the datagram that goes with this sample.
    pub datagram: u64,
    /// 1 where the beam may be on, else 0.
    pub beam: u32,
    /// Why it may not: bits of [`GateReason`].
    pub reasons: u32,
    /// Why the last lease was not renewed: bits of [`GateReason`].
    pub ended_by: u32,
    /// Zero.
    pub reserved: u32,
}

impl Sample for Gate {
    type Body = ();
    type Element = GateElement;
    const NAME: &'static str = "Gate";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "Whether the beam may be on, the errors that were judged, and why not.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
