//! What a pose estimate says about itself.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Axis, Codes, Layout, Sample, SampleKind, Shape, YesNo};

/// How a pose was found, how well the surface fits, and which of the six directions the surface constrains.
pub struct PoseReport;

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum PoseStatus {
    /// There is no reference yet, so no pose.
    NoReference = 0,
    /// The frame became the reference, or a part of it; its pose is sent.
    Captured = 1,
    /// The pose was found from the last one.
    Tracked = 2,
    /// The pose was found by the search that follows a loss.
    Found = 3,
    /// The frame does not fit the reference: no pose.
    Lost = 4,
    /// The frame has too few points: no pose.
    TooFewPoints = 5,
    /// The frame was to become the reference and is not fit for it; the next one is tried. No pose.
    CaptureRefused = 6,
    /// The frame shows no face: no pose.
    NoFace = 7,
    /// The frame fits the reference, and checks of its identity fail: no pose.
    Doubted = 8,
    /// No frame became the reference within the time for which a command holds: it has to be asked for again.
    CaptureLapsed = 9,
    /// The pose is that of the skull, and the face moves by itself: a smile, a word, a swallow. The pose is sent.
    FaceMoves = 10,
    /// The face moves by itself, and so much that the pose of the skull is unsure: no pose.
    FaceUnsure = 11,
    /// The head was not cut out of the frame, or little of it: the pose is that of the points where the head was expected.
    /// The pose is sent, and the beam stays off.
    Followed = 12,
}

/// The parts of the confidence that a frame shows what was captured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum IdentityPart {
    /// What is seen is as large as the reference.
    Size = 0,
    /// Enough of what is seen lies on the reference.
    Overlap = 1,
    /// What is seen lies as near to the reference as at the capture.
    Residual = 2,
    /// The head is near the place where it was captured.
    Region = 3,
    /// Two independent parts of the surface agree on the motion.
    Agreement = 4,
}

/// Whether the parts of a reference were seen to move together since the capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum Proof {
    /// Not yet.
    Waiting = 0,
    /// They were.
    Proven = 1,
    /// They were not within the time limit: another capture is needed.
    Failed = 2,
}

/// Why the parts of a reference are not known to move together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum Unproven {
    /// They are, or no frame was judged yet.
    None = 0,
    /// The head has moved too little, or was seen too coarsely, for enough pieces to be decided.
    TooLittleMotion = 1,
    /// A piece of the reference moves against the rest of it: a hand, a blanket, a shoulder.
    PieceApart = 2,
    /// Neighbouring patches do not move alike: a mask that is at rest lies over the head.
    Mixed = 3,
    /// The face moves by itself, and such frames prove nothing.
    FaceMoves = 4,
    /// The frames are doubted: they may not show what was captured.
    Doubted = 5,
    /// The frame is of other cameras than those with which the head was proven.
    OtherCameras = 6,
}

/// The fields of a [`PoseReport`]. What is not known is NaN.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct PoseReportElement {
    /// Mean square of how far the surface moves along its normals per unit of movement in a direction, largest first.
    pub sensitivity: [f64; 6],
    /// Standard deviation of the movement in each direction; infinite where it is refused.
    #[unit("m")]
    pub direction_sd: [f64; 6],
    /// The directions, one a row: translation, then rotation times `length`, in the port's frame, about `centre`.
    #[rows(6, 6)]
    pub directions: [f64; 36],
    /// Point about which rotations of the head are stated here: the point nearest to all of the surface's normals.
    #[unit("m")]
    #[parts(Axis)]
    pub centre: [f64; 3],
    /// Distance from the centre that makes a rotation a movement.
    #[unit("m")]
    pub length: f64,
    /// Root mean square of the distances to the reference along its normals, of the points that count.
    #[unit("m")]
    pub residual_rms: f64,
    /// Robust standard deviation of the same distances, of all points that have a partner.
    #[unit("m")]
    pub residual_sd: f64,
    /// Part of the points used that lie on the reference, or of the reference that they lie on: the smaller, from 0 to 1.
    pub overlap: f64,
    /// Difference of the two largest eigenvalues of (4.21) for the three points.
    #[unit("m2")]
    pub three_points_gap: f64,
    /// How sure it is that the frame shows what was captured, from 0 to 1: the least of `certainty`.
    pub confidence: f64,
    /// The parts of the confidence, each from 0 to 1, in the order of [`IdentityPart`].
    #[parts(IdentityPart)]
    pub certainty: [f64; 5],
    /// Size of what is seen over the size of the reference.
    pub scale: f64,
    /// Root mean square, along the normals, of how far two parts of the surface move against each other.
    #[unit("m")]
    pub apart: f64,
    /// Share of the reference that was seen to move with the rest of it since the capture, over the share that is a proof.
    pub moved: f64,
    /// A [`PoseStatus`] as its number.
    #[codes(PoseStatus)]
    pub status: u32,
    /// Bit i is set where direction i is refused: the surface does not constrain it.
    #[each("direction")]
    pub refused: u32,
    /// Iterations.
    pub iterations: u32,
    /// Points used in the last of them.
    pub points: u32,
    /// Points of the frame that were left out because a coordinate is not finite.
    pub not_finite: u32,
    /// Number of the reference, from 1; 0 where there is none.
    pub reference: u32,
    /// 1 where a person has confirmed the reference or nobody has to, else 0.
    #[codes(YesNo)]
    pub confirmed: u32,
    /// A [`Proof`] as its number.
    #[codes(Proof)]
    pub proof: u32,
    /// Why it is not proven, an [`Unproven`] as its number: of the newest frame that was judged, or what failed the proof.
    #[codes(Unproven)]
    pub unproven: u32,
    /// 1 where the parts of a face were found on the reference, else 0: then all of it is taken for rigid, and a smile lets go
    /// of the head.
    #[codes(YesNo)]
    pub face: u32,
}

impl Sample for PoseReport {
    type Body = ();
    type Element = PoseReportElement;
    const NAME: &'static str = "PoseReport";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "How a pose was found, its fit, and which directions the surface constrains.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
