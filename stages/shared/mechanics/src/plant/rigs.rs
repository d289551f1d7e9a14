//! The rigs that the project knows: one entry of [`RIGS`] and one arm of [`RigSpec::with`] each.
//!
//! The simulated rigs, the laws that are told of a rig, the check of targets and the map of reachable poses all read
//! this table.

use nalgebra::SVector;

use super::body::Plant;
use super::layouts::{OneDof, START_GAP, SixDof, ThreeDof};

/// Places in x, y, z, pitch, roll, yaw.
const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];
const HEIGHT_PITCH_ROLL: [usize; 3] = [2, 3, 4];
const HEIGHT: [usize; 1] = [2];

/// A rig: its names, and which coordinates of the head it moves.
#[derive(Debug, PartialEq, Eq)]
pub struct RigSpec {
    /// Its name in parameters, such as `three_bladders`.
    pub name: &'static str,
    /// The kind of the operator that simulates it, such as `rig.three_bladders`.
    pub kind: &'static str,
    /// One sentence about it.
    pub about: &'static str,
    /// Which of x, y, z, pitch, roll, yaw (0 to 5) its coordinates are.
    pub channels: &'static [usize],
    layout: Layout,
}

#[derive(Debug, PartialEq, Eq)]
enum Layout {
    Height,
    HeightPitchRoll,
    AllSix,
}

pub const RIGS: [RigSpec; 3] = [
    RigSpec {
        name: "one_bladder",
        kind: "rig.one_bladder",
        about: "Simulates a head on one bladder, which moves in height, seen by a depth camera.",
        channels: &HEIGHT,
        layout: Layout::Height,
    },
    RigSpec {
        name: "three_bladders",
        kind: "rig.three_bladders",
        about: "Simulates a head on three bladders, which moves in height, pitch and roll, seen by a depth camera.",
        channels: &HEIGHT_PITCH_ROLL,
        layout: Layout::HeightPitchRoll,
    },
    RigSpec {
        name: "eight_bladders",
        kind: "rig.eight_bladders",
        about: "Simulates a head between eight bladders, which moves in all six directions, seen by a depth camera.",
        channels: &ALL,
        layout: Layout::AllSix,
    },
];

/// A rig's plant with what it starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct RigPlant<const D: usize, const B: usize, const N: usize> {
    pub plant: Plant<D, B, N>,
    /// Air in each bladder, kg.
    pub air: SVector<f64, B>,
    /// Near the coordinates at rest, m and rad.
    pub guess: SVector<f64, D>,
    /// Which of x, y, z, pitch, roll, yaw each coordinate is.
    pub channels: [usize; D],
}

/// What somebody makes of a rig's plant, whatever its numbers of coordinates and bladders.
pub trait UsePlant {
    type Made;
    fn with<const D: usize, const B: usize, const N: usize>(self, rig: RigPlant<D, B, N>) -> Self::Made;
}

impl RigSpec {
    /// The rig of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        const { &RIGS }.iter().find(|rig| rig.name == name)
    }

    /// The rig that this kind of operator simulates.
    #[must_use]
    pub fn of_kind(kind: &str) -> Option<&'static Self> {
        const { &RIGS }.iter().find(|rig| rig.kind == kind)
    }

    /// Number of its bladders.
    #[must_use]
    pub const fn bladders(&self) -> usize {
        match self.layout {
            Layout::Height => 1,
            Layout::HeightPitchRoll => 3,
            Layout::AllSix => 8,
        }
    }

    /// Lets `user` make something of the plant under a head of `mass` kg.
    pub fn with<U: UsePlant>(&self, mass: f64, user: U) -> U::Made {
        match self.layout {
            Layout::Height => {
                let plant = OneDof::rig(mass);
                let (air, guess) = (plant.start_air(), SVector::repeat(START_GAP));
                user.with(RigPlant { plant, air, guess, channels: HEIGHT })
            }
            Layout::HeightPitchRoll => {
                let plant = ThreeDof::rig(mass);
                let (air, guess) = (plant.start_air(), SVector::zeros());
                user.with(RigPlant { plant, air, guess, channels: HEIGHT_PITCH_ROLL })
            }
            Layout::AllSix => {
                let plant = SixDof::rig(mass);
                let (air, guess) = (plant.start_air(), SVector::zeros());
                user.with(RigPlant { plant, air, guess, channels: ALL })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Coordinates;

    impl UsePlant for Coordinates {
        type Made = Vec<usize>;
        fn with<const D: usize, const B: usize, const N: usize>(self, rig: RigPlant<D, B, N>) -> Vec<usize> {
            assert!(rig.plant.equilibrium(&rig.air, rig.guess).is_ok(), "the head rests");
            rig.channels.to_vec()
        }
    }

    #[test]
    fn every_entry_has_names_of_its_own_and_the_coordinates_of_its_plant() {
        for rig in &RIGS {
            assert_eq!(rig.with(5.0, Coordinates), rig.channels, "{}", rig.name);
            assert_eq!(rig.kind, format!("rig.{}", rig.name));
            assert_eq!(RigSpec::named(rig.name), Some(rig));
        }
        assert_eq!(RigSpec::named("four_bladders"), None);
    }
}
