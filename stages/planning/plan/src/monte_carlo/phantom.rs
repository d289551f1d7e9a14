//! Phantoms and fields of the comparison.

use std::fmt;

use serde::Serialize;

/// Width of a voxel, mm.
pub const VOXEL_MM: f64 = 2.5;
/// Voxels along the beam.
pub(super) const DEPTHS: usize = 120;

/// A block of water with something in it. Depths count from the skin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phantom {
    /// Water alone.
    Water,
    /// Lung of density 0.25 from 3 to 13 cm.
    Lung,
    /// Bone of density 1.6 from 5 to 7 cm.
    Bone,
    /// A cube of air of 2 cm, from 2 to 4 cm.
    Air,
    /// Lung of density 0.25 from 3 to 23 cm, with a cube of water of 2 cm from 9 to 11 cm.
    Tumour,
}

impl Phantom {
    /// All phantoms.
    pub const ALL: [Self; 5] = [Self::Water, Self::Lung, Self::Bone, Self::Air, Self::Tumour];

    /// The name on a command line.
    pub fn key(self) -> &'static str {
        match self {
            Self::Tumour => "tumour",
            other => other.word(),
        }
    }

    /// The name as it is written.
    pub fn word(self) -> &'static str {
        match self {
            Self::Water => "water",
            Self::Lung => "lung",
            Self::Bone => "bone",
            Self::Air => "air",
            Self::Tumour => "tumour in lung",
        }
    }

    /// Density relative to water at a depth and a distance from the axis, mm.
    pub(super) fn density(self, depth_mm: f64, [x, z]: [f64; 2]) -> f64 {
        let is_in = |low: f64, high: f64| (low..high).contains(&depth_mm);
        let is_central = x.abs() < 10.0 && z.abs() < 10.0;
        match self {
            Self::Lung if is_in(30.0, 130.0) => 0.25,
            Self::Bone if is_in(50.0, 70.0) => 1.6,
            Self::Air if is_in(20.0, 40.0) && is_central => 0.0012,
            Self::Tumour if is_in(90.0, 110.0) && is_central => 1.0,
            Self::Tumour if is_in(30.0, 230.0) => 0.25,
            _ => 1.0,
        }
    }

    /// Whether the reference is too noisy at a depth: in air.
    pub(super) fn is_noisy(self, depth_mm: f64) -> bool {
        self == Self::Air && (20.0..40.0).contains(&depth_mm)
    }
}

/// A phantom and a square field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Setting {
    /// The phantom.
    pub phantom: Phantom,
    /// Side of the field on the isocentre plane, cm.
    pub field_cm: u32,
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {} cm", self.phantom.word(), self.field_cm)
    }
}

const fn of(phantom: Phantom, field_cm: u32) -> Setting {
    Setting { phantom, field_cm }
}

/// Every setting that has a reference.
pub const SETTINGS: [Setting; 14] = [
    of(Phantom::Water, 1),
    of(Phantom::Water, 2),
    of(Phantom::Water, 5),
    of(Phantom::Lung, 1),
    of(Phantom::Lung, 2),
    of(Phantom::Lung, 5),
    of(Phantom::Bone, 2),
    of(Phantom::Bone, 5),
    of(Phantom::Air, 1),
    of(Phantom::Air, 2),
    of(Phantom::Air, 5),
    of(Phantom::Tumour, 1),
    of(Phantom::Tumour, 2),
    of(Phantom::Tumour, 5),
];
