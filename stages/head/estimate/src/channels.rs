//! The channels of a pose that a filter estimates, and their layout in samples.

use nalgebra::{Isometry3, SMatrix, SVector};
use stillpoint_operator::Choice;
use stillpoint_samples::{PoseElement, Standing, TrackElement};

use crate::cross::Update;
use crate::manifold::Manifold;
use crate::measurement::Measurement;
use crate::process::{Hold, ProcessNoise};
use crate::state::State;

/// The part of a pose that is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Follow {
    /// The position along x alone.
    X,
    /// The position along y alone.
    Y,
    /// The position along z alone.
    Z,
    /// The position.
    Position,
    /// Position and orientation.
    Pose,
}

/// The channels of a filter, as places among the six of a pose: x, y, z and the rotations about them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channels<const N: usize> {
    places: [usize; N],
}

/// A mean that can be written into samples.
pub trait InSamples<const N: usize>: Manifold<N> + Send + 'static {
    /// The mean of a pose; `None` where it has none.
    fn read(position: [f64; 3], orientation: [f64; 4], channels: &Channels<N>) -> Option<Self>;
    /// Writes the mean into a track.
    fn write(&self, channels: &Channels<N>, track: &mut TrackElement);
}

impl Channels<1> {
    /// One coordinate of the position: 0 for x, 1 for y, 2 for z.
    pub fn axis(axis: usize) -> Self {
        Self { places: [axis.min(2)] }
    }
}

impl Channels<3> {
    /// The position.
    pub const POSITION: Self = Self { places: [0, 1, 2] };
}

impl Channels<6> {
    /// Position and orientation.
    pub const POSE: Self = Self { places: [0, 1, 2, 3, 4, 5] };
}

impl<const N: usize> Channels<N> {
    /// A bit per channel, as tracks have it.
    pub fn bits(&self) -> u32 {
        self.places.iter().fold(0, |bits, place| bits | 1 << place)
    }

    /// One number for lengths and one for angles, as one per channel.
    pub fn each(&self, length: f64, angle: f64) -> SVector<f64, N> {
        SVector::from_fn(|i, _| if self.places[i] < 3 { length } else { angle })
    }

    /// The measurement in a pose. A pose without a usable mean gives a measurement that every filter refuses.
    pub fn measurement<X: InSamples<N>>(&self, pose: &PoseElement) -> Measurement<N, X> {
        let place = |i: usize, j: usize| pose.covariance[6 * self.places[i] + self.places[j]];
        match X::read(pose.position, pose.orientation, self) {
            Some(position) => Measurement { position, covariance: SMatrix::from_fn(place) },
            None => Measurement { position: X::origin(), covariance: SMatrix::repeat(f64::NAN) },
        }
    }

    /// A track with the numbers of a state, without the account of the measurement behind it.
    pub fn track<X: InSamples<N>>(&self, state: &State<N, X>, process: &ProcessNoise<N>) -> TrackElement {
        let mut track = TrackElement { channels: self.bits(), ..TrackElement::NONE };
        state.position.write(self, &mut track);
        for (i, row) in self.places.into_iter().enumerate() {
            match row {
                0..3 => track.velocity[row] = state.velocity[i],
                _ => track.angular_velocity[row - 3] = state.velocity[i],
            }
            track.acceleration_sd[row] = process.acceleration_sd[i];
            for (j, column) in self.places.into_iter().enumerate() {
                track.covariance[12 * row + column] = state.pp[(i, j)];
                track.covariance[12 * row + 6 + column] = state.pv[(i, j)];
                track.covariance[12 * (6 + row) + column] = state.pv[(j, i)];
                track.covariance[12 * (6 + row) + 6 + column] = state.vv[(i, j)];
            }
        }
        track.acceleration_hold = match process.hold {
            Hold::Step => 0.0,
            Hold::Seconds(seconds) => seconds,
        };
        track
    }

    /// Writes the effect of a measurement: its innovation and the gain, N rows for the position and N for the velocity.
    pub fn write_innovation(
        &self,
        residual: &SVector<f64, N>,
        gain: Option<[&SMatrix<f64, N, N>; 2]>,
        track: &mut TrackElement,
    ) {
        for (i, row) in self.places.into_iter().enumerate() {
            track.innovation[row] = residual[i];
            for (j, column) in self.places.into_iter().enumerate() {
                for (half, gain) in gain.into_iter().flatten().enumerate() {
                    track.gain[6 * (6 * half + row) + column] = gain[(i, j)];
                }
            }
        }
    }
}

/// What a track says of the filter behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalTrack<const N: usize, X> {
    /// The state at the sample's origin; `None` where the filter has no estimate.
    pub state: Option<State<N, X>>,
    /// The process noise of the filter.
    pub process: ProcessNoise<N>,
    /// How the filter used the measurement behind the sample; `None` if it used none.
    pub update: Option<Update<N>>,
}

impl<const N: usize> Channels<N> {
    /// Reads a track of these channels; `None` if it has other channels, or numbers that no filter sends.
    pub fn read<X: InSamples<N>>(&self, track: &TrackElement) -> Option<LocalTrack<N, X>> {
        if track.channels != self.bits() {
            return None;
        }
        let gain = |half: usize| {
            SMatrix::from_fn(|i, j| track.gain[6 * (6 * half + self.places[i]) + self.places[j]])
        };
        let covariance = |rows: usize, columns: usize| {
            let place = |i: usize, j: usize| 12 * (6 * rows + self.places[i]) + 6 * columns + self.places[j];
            SMatrix::<f64, N, N>::from_fn(|i, j| track.covariance[place(i, j)])
        };
        let velocity = SVector::from_fn(|i, _| match self.places[i] {
            row @ 0..3 => track.velocity[row],
            row => track.angular_velocity[row.min(5) - 3],
        });
        let process = ProcessNoise {
            acceleration_sd: SVector::from_fn(|i, _| track.acceleration_sd[self.places[i]]),
            hold: match track.acceleration_hold {
                0.0 => Hold::Step,
                seconds => Hold::Seconds(seconds),
            },
        };
        let standing = track.standing();
        let state = match standing {
            Standing::None => None,
            _ => Some(State {
                position: X::read(track.position, track.orientation, self)?,
                velocity,
                pp: covariance(0, 0),
                pv: covariance(0, 1),
                vv: covariance(1, 1),
            })
            .filter(|state: &State<N, X>| state.is_finite()),
        };
        let update = match (standing, track.run) {
            (Standing::Measured, 1) => Some(Update::Start),
            (Standing::Measured, _) => Some(Update::Gain([gain(0), gain(1)])),
            _ => None,
        };
        Some(LocalTrack { state, process, update })
    }
}

impl<const N: usize> InSamples<N> for SVector<f64, N> {
    fn read(position: [f64; 3], _: [f64; 4], channels: &Channels<N>) -> Option<Self> {
        Some(Self::from_fn(|i, _| position[channels.places[i].min(2)]))
    }

    fn write(&self, channels: &Channels<N>, track: &mut TrackElement) {
        for (i, place) in channels.places.into_iter().enumerate() {
            track.position[place.min(2)] = self[i];
        }
    }
}

impl InSamples<6> for Isometry3<f64> {
    fn read(position: [f64; 3], orientation: [f64; 4], _: &Channels<6>) -> Option<Self> {
        stillpoint_pose::checked_isometry(position, orientation)
    }

    fn write(&self, _: &Channels<6>, track: &mut TrackElement) {
        track.position = self.translation.vector.into();
        track.orientation = stillpoint_pose::orientation(&self.rotation);
    }
}
