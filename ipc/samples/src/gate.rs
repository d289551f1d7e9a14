//! Whether the beam may be on, and why not.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::names::bits;
use crate::{Angle, Axis, Layout, OnOff, Sample, SampleKind, Shape};

/// The lease of the beam: whether it was renewed, the errors that were judged, and every reason against it.
pub struct Gate;

bits! {
    /// Reasons against the beam: bits.
    GateReason {
        /// There is no pose, or it lacks a channel of the target.
        NO_POSE = 1, "no pose";
        /// The newest measurement of the pose is too old, or always the same.
        POSE_STALE = 1 << 1, "pose stale";
        /// Pose or target have numbers that are none.
        NOT_FINITE = 1 << 2, "not finite";
        /// There is no target.
        NO_TARGET = 1 << 3, "no target";
        /// The newest sample of the target is too old.
        TARGET_STALE = 1 << 4, "target stale";
        /// The target moves.
        TARGET_MOVES = 1 << 5, "target moves";
        /// A coordinate is out of tolerance.
        POSITION = 1 << 6, "position";
        /// An angle is out of tolerance.
        ANGLE = 1 << 7, "angle";
        /// A coordinate or an angle is not known well enough.
        UNCERTAIN = 1 << 8, "uncertain";
        /// A frame between camera and pose has no date or residual, too large a residual, or was measured too long ago.
        EXTRINSIC = 1 << 9, "extrinsic";
        /// Actuation is not armed, holds, vents or is at fault.
        ACTUATION = 1 << 10, "actuation";
        /// Actuation has been silent for too long.
        ACTUATION_SILENT = 1 << 11, "actuation silent";
        /// All is well, but not for long enough.
        DWELLING = 1 << 12, "dwelling";
        /// The tracker's last report has no pose, is too old, or none has come.
        TRACKER = 1 << 13, "tracker";
        /// The tracker's confidence that it follows what was captured is too low.
        IDENTITY = 1 << 14, "identity";
        /// The parts of the reference have not been seen to move together since the capture.
        UNPROVEN = 1 << 15, "unproven";
        /// No person has confirmed the reference.
        UNCONFIRMED = 1 << 16, "unconfirmed";
        /// The standing plan is not known to hold in the requested set-up.
        PLAN = 1 << 17, "plan";
        /// The face moves by itself: the pose of the skull is less sure.
        FACE_MOVES = 1 << 18, "face moves";
        /// In a channel that the target does not hold, the head is too far from where it was when the beam first began.
        DRIFT = 1 << 19, "drift";
        /// The beam that is delivered next is planned at another couch angle than that of the session.
        COUCH = 1 << 20, "couch";
        /// A camera is left out of the merged cloud while the tracker has no pose, doubts it or has no proof.
        CAMERA = 1 << 21, "camera";
    }
}

/// The fields of a [`Gate`]. What is not known, or not held by the target, is NaN.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct GateElement {
    /// Position less target.
    #[unit("m")]
    #[parts(Axis)]
    pub position_error: [f64; 3],
    /// Pitch, roll and yaw minus those of the target.
    #[unit("rad")]
    #[parts(Angle)]
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
    #[codes(OnOff)]
    pub beam: u32,
    /// Why it may not: bits of [`GateReason`].
    #[bits(GateReason)]
    pub reasons: u32,
    /// Why the last lease was not renewed: bits of [`GateReason`].
    #[bits(GateReason)]
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
