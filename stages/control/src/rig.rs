//! Rigs whose mechanics are known: what their bladders do to the head, and which targets they can hold.

use nalgebra::SVector;
use stillpoint_mechanics::plant::reach::{Limits, Unreachable};
use stillpoint_mechanics::plant::{OneDof, Plant, SixDof, ThreeDof};
use stillpoint_operator::Choice;

use crate::channels::Channel;

/// A rig whose mechanics are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum RigKind {
    /// None is known.
    Unknown,
    /// Height, on one bladder.
    OneBladder,
    /// Height, pitch and roll, on three bladders.
    ThreeBladders,
    /// All six channels, between eight bladders.
    EightBladders,
}

/// Gauge pressure at which the flow into a bladder counts, Pa.
const NOMINAL: f64 = 10e3;
/// Number of points of a way that are checked.
const PARTS: u32 = 8;

/// A rig at rest where control begins.
#[derive(Clone, Debug, PartialEq)]
pub enum Rig {
    /// An unknown rig: no target is refused.
    Unknown,
    /// One bladder.
    One(Box<At<1, 1, 5>>),
    /// Three bladders.
    Three(Box<At<3, 3, 15>>),
    /// Eight bladders.
    Eight(Box<At<6, 8, 36>>),
}

/// A plant, where it rests, and with which pushes.
#[derive(Clone, Debug, PartialEq)]
pub struct At<const D: usize, const B: usize, const N: usize> {
    plant: Plant<D, B, N>,
    air: SVector<f64, B>,
    rest: SVector<f64, D>,
    push: SVector<f64, B>,
    /// Which of the six channels each coordinate is.
    channels: [usize; D],
}

/// What stands in the way of a target, and how far it could be reached: 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{why} (after {percent:.0} % of the way)", percent = part * 100.0)]
pub struct InTheWay {
    /// Why.
    pub why: Unreachable,
    /// How far.
    pub part: f64,
}

impl InTheWay {
    /// The bladder that stands in the way, by its number among the valves' pairs.
    #[must_use]
    pub fn bladder(&self) -> Option<usize> {
        match self.why {
            Unreachable::NotFinite => None,
            Unreachable::Flat { bladder, .. }
            | Unreachable::Apart { bladder, .. }
            | Unreachable::Pulls { bladder, .. }
            | Unreachable::TooHard { bladder, .. } => Some(bladder),
        }
    }
}

impl Rig {
    /// A rig under a head of `mass` kg, with the air that it starts with.
    ///
    /// # Errors
    /// The rig does not bear the head.
    pub fn of(kind: RigKind, mass: f64) -> Result<Self, String> {
        Ok(match kind {
            RigKind::Unknown => Self::Unknown,
            RigKind::OneBladder => {
                let plant = OneDof::rig(mass);
                let air = plant.start_air();
                Self::One(Box::new(At::rest(plant, air, SVector::repeat(0.085), [2])?))
            }
            RigKind::ThreeBladders => {
                let plant = ThreeDof::rig(mass);
                let air = plant.start_air();
                Self::Three(Box::new(At::rest(plant, air, SVector::zeros(), [2, 3, 4])?))
            }
            RigKind::EightBladders => {
                let plant = SixDof::rig(mass);
                let air = plant.start_air();
                Self::Eight(Box::new(At::rest(plant, air, SVector::zeros(), [0, 1, 2, 3, 4, 5])?))
            }
        })
    }

    /// How fast each bladder moves x, y, z, pitch, roll and yaw when its inlet is wide open, m/s and rad/s: how the pose at
    /// rest moves with its air, times the flow into it (SCIENCE E6, E11). `None` where no rig is known.
    ///
    /// # Errors
    /// The rig does not bear the head with a little less air in a bladder.
    pub fn rates(&self) -> Result<Option<Vec<[f64; 6]>>, String> {
        match self {
            Self::Unknown => Ok(None),
            Self::One(at) => at.rates().map(Some),
            Self::Three(at) => at.rates().map(Some),
            Self::Eight(at) => at.rates().map(Some),
        }
    }

    /// Whether its bladders move this channel. An unknown rig moves every channel.
    #[must_use]
    pub fn moves(&self, channel: Channel) -> bool {
        match self {
            Self::Unknown => true,
            Self::One(at) => at.channels.contains(&channel.place()),
            Self::Three(at) => at.channels.contains(&channel.place()),
            Self::Eight(at) => at.channels.contains(&channel.place()),
        }
    }

    /// Whether the rig can hold every pose on the straight way between two, both as distances from where control began
    /// in x, y, z, pitch, roll and yaw, m and rad.
    ///
    /// # Errors
    /// What stands in the way.
    pub fn check(&self, from: &[f64; 6], to: &[f64; 6]) -> Result<(), InTheWay> {
        match self {
            Self::Unknown => Ok(()),
            Self::One(at) => at.check(from, to),
            Self::Three(at) => at.check(from, to),
            Self::Eight(at) => at.check(from, to),
        }
    }
}

impl<const D: usize, const B: usize, const N: usize> At<D, B, N> {
    fn rest(
        plant: Plant<D, B, N>,
        air: SVector<f64, B>,
        guess: SVector<f64, D>,
        channels: [usize; D],
    ) -> Result<Self, String> {
        let rest = plant.equilibrium(&air, guess).map_err(|e| e.to_string())?;
        let pressed = plant.bladders(&rest, &air);
        let push = SVector::from_fn(|j, _| pressed[j].force());
        Ok(Self { plant, air, rest, push, channels })
    }

    fn rates(&self) -> Result<Vec<[f64; 6]>, String> {
        let slopes = self.plant.pose_by_air(&self.air, self.rest).map_err(|e| e.to_string())?;
        let flow = self.plant.inlet_flow(NOMINAL);
        let of_bladder = |j: usize| {
            let mut rates = [0.0; 6];
            for (i, channel) in self.channels.iter().enumerate() {
                rates[*channel] = slopes[(i, j)] * flow;
            }
            rates
        };
        Ok((0..B).map(of_bladder).collect())
    }

    fn check(&self, from: &[f64; 6], to: &[f64; 6]) -> Result<(), InTheWay> {
        let pose = |moved: &[f64; 6]| SVector::from_fn(|i, _| self.rest[i] + moved[self.channels[i]]);
        let way = self.plant.reach_along(&pose(from), &pose(to), PARTS, &Limits::RIG, &self.push);
        way.map_err(|(part, why)| InTheWay { why, part })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Effect;
    use nalgebra::DMatrix;

    const DEGREE: f64 = std::f64::consts::PI / 180.0;

    #[test]
    fn the_sources_step_can_be_held_and_ten_times_of_it_cannot() {
        let rig = Rig::of(RigKind::ThreeBladders, 5.0).unwrap();
        let step = [0.0, 0.0, 0.0115, 1.35 * DEGREE, 10.0 * DEGREE, 0.0];
        assert_eq!(rig.check(&[0.0; 6], &step), Ok(()));
        let far = rig.check(&[0.0; 6], &step.map(|v| 10.0 * v)).unwrap_err();
        assert!(far.part > 0.0 && far.bladder().is_some(), "{far}");
        assert!(far.to_string().contains("bladder"), "{far}");
    }

    #[test]
    fn every_rig_holds_its_head_where_it_begins() {
        for kind in [RigKind::OneBladder, RigKind::ThreeBladders, RigKind::EightBladders] {
            for mass in [3.0, 5.0, 6.0] {
                let rig = Rig::of(kind, mass).unwrap();
                assert_eq!(rig.check(&[0.0; 6], &[0.0; 6]), Ok(()), "{kind:?} {mass}");
            }
        }
        let unknown = Rig::of(RigKind::Unknown, 5.0).unwrap();
        assert_eq!(unknown.check(&[0.0; 6], &[1.0; 6]), Ok(()));
    }

    #[test]
    fn the_bladders_of_every_rig_move_all_of_its_channels() {
        for (kind, channels) in [
            (RigKind::OneBladder, &[2][..]),
            (RigKind::ThreeBladders, &[2, 3, 4]),
            (RigKind::EightBladders, &[0, 1, 2, 3, 4, 5]),
        ] {
            let rates = Rig::of(kind, 5.0).unwrap().rates().unwrap().unwrap();
            let scale = [0.01, 0.01, 0.0115, 0.0236, 0.1745, 0.0873];
            let b = DMatrix::from_fn(channels.len(), rates.len(), |i, j| {
                rates[j][channels[i]] / scale[channels[i]]
            });
            let effect = Effect::new(b).unwrap();
            assert_eq!((effect.channels(), effect.bladders()), (channels.len(), rates.len()));
        }
        assert_eq!(Rig::of(RigKind::Unknown, 5.0).unwrap().rates(), Ok(None));
    }
}
