//! Filtered tracks.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{Axis, Channel, Codes, Layout, Quaternion, Sample, SampleKind, Shape};

/// Mean and covariance of a filtered pose and its rates, in the port's frame, at the sample's origin.
///
/// A channel is x, y, z or the rotation about x, y, z. A track has those of its filter: one, three or all six. A channel
/// that it does not have is NaN in the mean, with infinite variance.
pub struct Track;

/// The fields of a [`Track`].
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct TrackElement {
    /// Position.
    #[unit("m")]
    #[parts(Axis)]
    pub position: [f64; 3],
    /// Unit quaternion, scalar first, scalar not negative.
    #[parts(Quaternion)]
    pub orientation: [f64; 4],
    /// Velocity.
    #[unit("m/s")]
    #[parts(Axis)]
    pub velocity: [f64; 3],
    /// Angular velocity about the axes of the port's frame.
    #[unit("rad/s")]
    #[parts(Axis)]
    pub angular_velocity: [f64; 3],
    /// Covariance of (the six channels, their six rates), row by row, 12 by 12. Rotations are small ones about the axes
    /// of the port's frame.
    #[unit("m2, rad2, m2/s, rad2/s, m2/s2, rad2/s2")]
    #[rows(12, 12)]
    pub covariance: [f64; 144],
    /// Innovation of the measurement behind this sample; NaN where there was none.
    #[unit("m, rad")]
    #[parts(Channel)]
    pub innovation: [f64; 6],
    /// Gain K with which the measurement was used, row by row, 12 by 6; zero if no measurement was used.
    #[unit("1, 1/s")]
    #[rows(12, 6)]
    pub gain: [f64; 72],
    /// Standard deviation of the acceleration in the filter's process noise, per channel.
    #[unit("m/s2, rad/s2")]
    #[parts(Channel)]
    pub acceleration_sd: [f64; 6],
    /// How long such an acceleration lasts; 0 where from one measurement to the next.
    #[unit("s")]
    pub acceleration_hold: f64,
    /// Normalised innovation squared of the measurement; NaN where there was none.
    pub nis: f64,
    /// Measurements used so far.
    pub accepted: u64,
    /// Measurements refused so far: by the gate, for bad numbers or for their time.
    pub rejected: u64,
    /// Measurements used since the track began; 1 in the sample that begins it.
    pub run: u64,
    /// Measurements before this one, in a row, that had the very same numbers.
    pub repeated: u64,
    /// The channels of the filter, a bit each: 1 for x, 2 for y, 4 for z, 8, 16 and 32 for the rotations about them.
    #[bits(Channel)]
    pub channels: u32,
    /// What the numbers stand on, as a [`Standing`].
    #[codes(Standing)]
    pub standing: u32,
}

/// What the numbers of a track stand on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Codes)]
#[repr(u32)]
pub enum Standing {
    /// There is no estimate: no measurement yet, or none for too long. All numbers of the mean are NaN.
    None = 0,
    /// A measurement of the time of the sample.
    Measured = 1,
    /// Earlier measurements: the state is predicted to a time without a measurement.
    Predicted = 2,
    /// Earlier measurements: the one of the time of the sample was refused.
    Refused = 3,
}

impl TrackElement {
    /// Says that there is no estimate.
    pub const NONE: Self = Self {
        position: [f64::NAN; 3],
        orientation: [f64::NAN; 4],
        velocity: [f64::NAN; 3],
        angular_velocity: [f64::NAN; 3],
        covariance: Self::UNKNOWN,
        innovation: [f64::NAN; 6],
        gain: [0.0; 72],
        acceleration_sd: [0.0; 6],
        acceleration_hold: 0.0,
        nis: f64::NAN,
        accepted: 0,
        rejected: 0,
        run: 0,
        repeated: 0,
        channels: 0,
        standing: Standing::None as u32,
    };

    /// An uninformative covariance: infinite variances.
    const UNKNOWN: [f64; 144] = {
        let (mut covariance, mut i) = ([0.0; 144], 0);
        while i < 12 {
            covariance[13 * i] = f64::INFINITY;
            i += 1;
        }
        covariance
    };

    /// What the numbers stand on. A number that no build of this version wrote counts as none.
    pub fn standing(&self) -> Standing {
        match self.standing {
            1 => Standing::Measured,
            2 => Standing::Predicted,
            3 => Standing::Refused,
            _ => Standing::None,
        }
    }

    /// Variance of the position, per axis.
    pub fn position_variance(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.covariance[13 * i])
    }
}

impl Sample for Track {
    type Body = ();
    type Element = TrackElement;
    const NAME: &'static str = "Track";
    const SHAPE: Shape = Shape::Fixed;
    const ABOUT: &'static str = "Filtered pose, or some channels of one, and its rates, with covariance.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}
