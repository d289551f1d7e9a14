//! Which channels of a pose are controlled, and how they stand in samples.

use stillpoint_operator::Choice;
use stillpoint_samples::{Standing, TargetElement, TargetStatus, TrackElement};

/// A channel of a pose. Angles follow `R = Rz(yaw) Ry(roll) Rx(pitch)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Choice)]
pub enum Channel {
    /// Position along x.
    X,
    /// Position along y.
    Y,
    /// Position along z.
    Z,
    /// Turn about x.
    Pitch,
    /// Turn about y.
    Roll,
    /// Turn about z.
    Yaw,
}

/// All channels, in the order in which samples have them.
pub const ALL: [Channel; 6] =
    [Channel::X, Channel::Y, Channel::Z, Channel::Pitch, Channel::Roll, Channel::Yaw];

impl Channel {
    /// Its place among the six.
    #[must_use]
    pub const fn place(self) -> usize {
        self as usize
    }

    /// Its name in configs and metrics.
    #[must_use]
    pub const fn name(self) -> &'static str {
        ["x", "y", "z", "pitch", "roll", "yaw"][self as usize]
    }

    /// The channel of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        ALL.into_iter().find(|c| c.name() == name)
    }

    /// Its SI unit.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        if (self as usize) < 3 { "m" } else { "rad" }
    }
}

/// Distinct channels, at least one, in the order in which a config names them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channels(Vec<Channel>);

/// Why channels cannot be controlled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ChannelsError {
    /// None.
    #[error("name at least one channel")]
    None,
    /// One twice.
    #[error("{0} is named twice")]
    Twice(&'static str),
}

impl Channels {
    /// These channels.
    ///
    /// # Errors
    /// None at all, or one twice.
    pub fn new(channels: &[Channel]) -> Result<Self, ChannelsError> {
        if channels.is_empty() {
            return Err(ChannelsError::None);
        }
        match channels.iter().enumerate().find(|(i, c)| channels[..*i].contains(c)) {
            Some((_, twice)) => Err(ChannelsError::Twice(twice.name())),
            None => Ok(Self(channels.to_vec())),
        }
    }

    /// Number of them.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The channels.
    pub fn iter(&self) -> impl Iterator<Item = Channel> + '_ {
        self.0.iter().copied()
    }

    /// A bit per channel, as samples have it.
    #[must_use]
    pub fn bits(&self) -> u32 {
        self.0.iter().fold(0, |bits, c| bits | 1 << c.place())
    }

    /// Reads the channels of a track, m or rad; `None` where it lacks one of them.
    #[must_use]
    pub fn of_track(&self, track: &TrackElement) -> Option<[f64; 6]> {
        if track.standing() == Standing::None || track.channels & self.bits() != self.bits() {
            return None;
        }
        let mut all = [f64::NAN; 6];
        all[..3].copy_from_slice(&track.position);
        if self.0.iter().any(|c| c.place() >= 3)
            && let Some(angles) = stillpoint_pose::angles(track.orientation)
        {
            all[3..].copy_from_slice(&angles);
        }
        Some(self.pick(&all))
    }

    /// Reads the channels of a target, m or rad; `None` where there is none, or it lacks one of them.
    #[must_use]
    pub fn of_target(&self, target: &TargetElement) -> Option<[f64; 6]> {
        if target.status() == TargetStatus::None || target.channels & self.bits() != self.bits() {
            return None;
        }
        let [x, y, z] = target.position;
        let [pitch, roll, yaw] = target.angles;
        Some(self.pick(&[x, y, z, pitch, roll, yaw]))
    }

    /// Numbers in the order of the channels, in the order of all six; zero for those that are not among them.
    #[must_use]
    pub fn spread(&self, own: &[f64; 6]) -> [f64; 6] {
        let mut all = [0.0; 6];
        for (own, channel) in own.iter().zip(self.iter()) {
            all[channel.place()] = *own;
        }
        all
    }

    /// The entries of six numbers that belong to the channels, in their order; zero beyond.
    fn pick(&self, all: &[f64; 6]) -> [f64; 6] {
        let mut picked = [0.0; 6];
        for (to, channel) in picked.iter_mut().zip(self.iter()) {
            *to = all[channel.place()];
        }
        picked
    }
}

/// The difference of two readings of a channel; of angles the one within half a turn.
#[must_use]
pub fn difference(channel: Channel, to: f64, from: f64) -> f64 {
    let plain = to - from;
    if channel.place() < 3 { plain } else { libm::remainder(plain, std::f64::consts::TAU) }
}
