//! Filtered tracks.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Layout, Sample, SampleKind, Shape};

/// Mean and covariance of a filtered position and its velocity, in the port's frame.
pub struct Track;

/// The fields of a [`Track`].
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct TrackElement {
    /// Position.
    #[unit("m")]
    pub position: [f64; 3],
    /// Velocity.
    #[unit("m/s")]
    pub velocity: [f64; 3],
    /// Covariance of (position, velocity), row by row, 6 by 6.
    #[unit("m2, m2/s, m2/s2")]
    pub covariance: [f64; 36],
    /// Innovation of the last measurement; NaN where there was none.
    #[unit("m")]
    pub innovation: [f64; 3],
    /// Normalised innovation squared of the last measurement; NaN where there was none.
    pub nis: f64,
    /// Measurements used so far.
    pub accepted: u64,
    /// Measurements refused so far, by the gate or for bad numbers.
    pub rejected: u64,
}

impl Sample for Track {
    type Body = ();
    type Element = TrackElement;
    const NAME: &'static str = "Track";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "Filtered position and velocity with covariance.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
