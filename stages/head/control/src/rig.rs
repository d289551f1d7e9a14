//! Rigs whose mechanics are known: what their bladders do to the head, and which targets they can hold.

use std::fmt::Debug;
use std::sync::Arc;

use nalgebra::SVector;
use stillpoint_mechanics::contact::grasp::Touch;
use stillpoint_mechanics::plant::Plant;
use stillpoint_mechanics::plant::equilibrium::EquilibriumError;
use stillpoint_mechanics::plant::layouts::around;
use stillpoint_mechanics::plant::reach::{Limits, Unreachable};
pub use stillpoint_mechanics::plant::rigs::{RIGS, RigSpec};
use stillpoint_mechanics::plant::rigs::{RigPlant, UsePlant};
use stillpoint_operator::params::{Node, ParamField, ParamReader, ParamType, ParamValue, json};

use crate::channels::{ALL, Channel, Channels};
use crate::contacts::{BLADDERS, Friction, Held, held};

/// Names of a rig in parameters: `unknown`, and those of the table of rigs.
const NAMES: [&str; RIGS.len() + 1] = {
    let mut names = ["unknown"; RIGS.len() + 1];
    let mut i = 0;
    while i < RIGS.len() {
        names[i + 1] = RIGS[i].name;
        i += 1;
    }
    names
};

/// Which rig it is, if its mechanics are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RigKind(Option<&'static RigSpec>);

impl RigKind {
    /// None is known.
    pub const UNKNOWN: Self = Self(None);

    /// A rig of the table.
    #[must_use]
    pub const fn known(spec: &'static RigSpec) -> Self {
        Self(Some(spec))
    }

    /// The rig of this name, or `unknown`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        if name == NAMES[0] { Some(Self::UNKNOWN) } else { RigSpec::named(name).map(Self::known) }
    }
}

impl ParamValue for RigKind {
    const TYPE: ParamType = ParamType::Choice(&NAMES);

    fn read(node: &Node, field: &ParamField, reader: &ParamReader<'_>) -> Option<Self> {
        Self::named(reader.choice(node, field, &NAMES)?)
    }

    fn resolved(&self) -> json::Value {
        json::Value::from(self.0.map_or(NAMES[0], |spec| spec.name))
    }
}

/// Gauge pressure at which the flow into a bladder counts, Pa.
const NOMINAL: f64 = 10e3;
/// Number of points of a way that are checked.
const PARTS: u32 = 8;

/// A rig at rest where control begins, or any rig where none is known.
#[derive(Clone, Debug)]
pub struct Rig(Option<Arc<dyn Mechanics>>);

/// What is asked of a rig, whatever its numbers of coordinates and bladders.
trait Mechanics: Debug + Send + Sync {
    fn channels(&self) -> &[usize];
    fn rates(&self) -> Result<Vec<[f64; 6]>, EquilibriumError>;
    fn check(&self, from: &[f64; 6], to: &[f64; 6]) -> Result<(), Obstacle>;
    fn held(&self, moved: &[f64; 6], pressure: &[f64; BLADDERS]) -> (Held, usize);
}

/// A plant, where it rests, and with which pushes.
#[derive(Debug)]
struct At<const D: usize, const B: usize, const N: usize> {
    plant: Plant<D, B, N>,
    air: SVector<f64, B>,
    rest: SVector<f64, D>,
    push: SVector<f64, B>,
    /// Which of the six channels each coordinate is.
    channels: [usize; D],
    /// Of a rig whose contacts' places are known.
    friction: Option<Friction>,
}

/// What stands in the way of a target, and how far it could be reached: 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{why} (after {percent:.0} % of the way)", percent = part * 100.0)]
pub struct Obstacle {
    /// The reason.
    pub why: Unreachable,
    /// How far.
    pub part: f64,
}

impl Obstacle {
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
    pub fn of(kind: RigKind, mass: f64) -> Result<Self, EquilibriumError> {
        kind.0.map(|spec| spec.with(mass, Rest)).transpose().map(Self)
    }

    /// How fast each bladder moves x, y, z, pitch, roll and yaw when its inlet is wide open, m/s and rad/s: how the pose at
    /// rest moves with its air, times the flow into it (SCIENCE E6, E11). `None` where no rig is known.
    ///
    /// # Errors
    /// The rig does not bear the head with a little less air in a bladder.
    pub fn rates(&self) -> Result<Option<Vec<[f64; 6]>>, EquilibriumError> {
        self.0.as_ref().map(|at| at.rates()).transpose()
    }

    /// Whether its bladders move this channel. An unknown rig moves every channel.
    #[must_use]
    pub fn moves(&self, channel: Channel) -> bool {
        self.0.as_ref().is_none_or(|at| at.channels().contains(&channel.place()))
    }

    /// The channels that its bladders move; `None` where no rig is known.
    #[must_use]
    pub fn channels(&self) -> Option<Channels> {
        let places = self.0.as_ref()?.channels();
        let moved: Vec<Channel> = ALL.into_iter().filter(|c| places.contains(&c.place())).collect();
        Channels::new(&moved).ok()
    }

    /// How its bladders of these pressures (Pa over that of the room) hold the head, which is this far from rest in x, y,
    /// z, pitch, roll and yaw, m and rad, and how many bladders there are; `None` where no rig is known.
    #[must_use]
    pub fn held(&self, moved: &[f64; 6], pressure: &[f64; BLADDERS]) -> Option<(Held, usize)> {
        self.0.as_ref().map(|at| at.held(moved, pressure))
    }

    /// Whether the rig can hold every pose on the straight way between two, both as distances from where control began
    /// in x, y, z, pitch, roll and yaw, m and rad.
    ///
    /// # Errors
    /// What stands in the way.
    pub fn check(&self, from: &[f64; 6], to: &[f64; 6]) -> Result<(), Obstacle> {
        self.0.as_ref().map_or(Ok(()), |at| at.check(from, to))
    }
}

/// Lets the head rest on a rig's bladders.
struct Rest;

impl UsePlant for Rest {
    type Made = Result<Arc<dyn Mechanics>, EquilibriumError>;

    fn with<const D: usize, const B: usize, const N: usize>(self, rig: RigPlant<D, B, N>) -> Self::Made {
        let RigPlant { plant, air, guess, channels } = rig;
        let rest = plant.equilibrium(&air, guess)?;
        let pressed = plant.bladders(&rest, &air);
        let push = SVector::from_fn(|j, _| pressed[j].force());
        let friction = (D == 6 && B == BLADDERS).then(|| {
            let touches = std::array::from_fn(|j| {
                let (arm, normal) = around(j);
                Touch { arm, normal }
            });
            Friction::new(&touches)
        });
        Ok(Arc::new(At { plant, air, rest, push, channels, friction: friction.flatten() }))
    }
}

impl<const D: usize, const B: usize, const N: usize> Mechanics for At<D, B, N> {
    fn channels(&self) -> &[usize] {
        &self.channels
    }

    fn held(&self, moved: &[f64; 6], pressure: &[f64; BLADDERS]) -> (Held, usize) {
        let position = SVector::<f64, D>::from_fn(|i, _| self.rest[i] + moved[self.channels[i]]);
        (held(&self.plant, self.friction.as_ref(), &position, pressure), B)
    }

    fn rates(&self) -> Result<Vec<[f64; 6]>, EquilibriumError> {
        let slopes = self.plant.pose_by_air(&self.air, self.rest)?;
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

    fn check(&self, from: &[f64; 6], to: &[f64; 6]) -> Result<(), Obstacle> {
        let pose = |moved: &[f64; 6]| SVector::from_fn(|i, _| self.rest[i] + moved[self.channels[i]]);
        let reached = self.plant.reach_along(&pose(from), &pose(to), PARTS, &Limits::RIG, &self.push);
        reached.map_err(|(part, why)| Obstacle { why, part })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Effect;
    use nalgebra::DMatrix;

    fn at_rest(name: &str, mass: f64) -> Rig {
        Rig::of(RigKind::named(name).unwrap(), mass).unwrap()
    }

    const DEGREE: f64 = std::f64::consts::PI / 180.0;

    #[test]
    fn the_sources_step_can_be_held_and_ten_times_of_it_cannot() {
        let rig = at_rest("three_bladders", 5.0);
        let step = [0.0, 0.0, 0.0115, 1.35 * DEGREE, 10.0 * DEGREE, 0.0];
        assert_eq!(rig.check(&[0.0; 6], &step), Ok(()));
        let far = rig.check(&[0.0; 6], &step.map(|v| 10.0 * v)).unwrap_err();
        assert!(far.part > 0.0 && far.bladder().is_some(), "{far}");
        assert!(far.to_string().contains("bladder"), "{far}");
    }

    #[test]
    fn every_rig_holds_its_head_where_it_begins() {
        for spec in &RIGS {
            for mass in [3.0, 5.0, 6.0] {
                let rig = at_rest(spec.name, mass);
                assert_eq!(rig.check(&[0.0; 6], &[0.0; 6]), Ok(()), "{} {mass}", spec.name);
            }
        }
        let unknown = at_rest("unknown", 5.0);
        assert_eq!(unknown.check(&[0.0; 6], &[1.0; 6]), Ok(()));
    }

    #[test]
    fn the_bladders_of_every_rig_move_all_of_its_channels() {
        for RigSpec { name, channels, .. } in &RIGS {
            let rates = at_rest(name, 5.0).rates().unwrap().unwrap();
            let scale = [0.01, 0.01, 0.0115, 0.0236, 0.1745, 0.0873];
            let b = DMatrix::from_fn(channels.len(), rates.len(), |i, j| {
                rates[j][channels[i]] / scale[channels[i]]
            });
            let effect = Effect::new(b).unwrap();
            assert_eq!((effect.channels(), effect.bladders()), (channels.len(), rates.len()));
        }
        assert_eq!(at_rest("unknown", 5.0).rates(), Ok(None));
    }
}
