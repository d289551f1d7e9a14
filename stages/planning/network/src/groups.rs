//! Groups of features, which a network can be trained without: to find out what each is worth.

use serde::{Deserialize, Serialize};

use crate::eye::PAIR;
use crate::model::place;

/// A feature that is left out is divided by this, so that nothing is left of it. The file of weights holds it as a scale.
const NOTHING: f32 = 1e30;

/// Features that belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Group {
    /// Ways through tissue, bone and metal to the target, and the aperture.
    Ways,
    /// How well bixels fit the silhouette of the target, and what of organs they hit beside it.
    Fit,
    /// What of each organ the open field hits.
    InField,
    /// What of each organ lies before and behind the target, and where its middle is.
    BeforeBehind,
    /// Tolerance and weight of each organ.
    Objectives,
    /// How much two fields overlap in organs, in the outline and in the target.
    Overlap,
    /// The angle between two beams.
    Apart,
}

impl Group {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Ways,
        Self::Fit,
        Self::InField,
        Self::BeforeBehind,
        Self::Objectives,
        Self::Overlap,
        Self::Apart,
    ];

    /// Its name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ways => "ways",
            Self::Fit => "fit",
            Self::InField => "in-field",
            Self::BeforeBehind => "before-behind",
            Self::Objectives => "objectives",
            Self::Overlap => "overlap",
            Self::Apart => "apart",
        }
    }

    /// Its features: the tensor of their scales, and their places in it.
    fn scales(self) -> Vec<(usize, std::ops::Range<usize>)> {
        use place::{PAIR_SCALE, STRUCTURE_SCALE, TARGET_SCALE};
        match self {
            Self::Ways => vec![(TARGET_SCALE, 0..10)],
            Self::Fit => vec![(TARGET_SCALE, 10..15), (STRUCTURE_SCALE, 14..16)],
            Self::InField => vec![(STRUCTURE_SCALE, 0..4)],
            Self::BeforeBehind => vec![(STRUCTURE_SCALE, 4..10)],
            Self::Objectives => vec![(STRUCTURE_SCALE, 10..12)],
            Self::Overlap => vec![(PAIR_SCALE, 0..5)],
            Self::Apart => vec![(PAIR_SCALE, 5..PAIR)],
        }
    }
}

/// Leaves groups out of a network whose tensors begin with these means and scales.
pub fn leave_out(groups: &[Group], fixed: &mut [Vec<f32>]) {
    for (tensor, places) in groups.iter().flat_map(|group| group.scales()) {
        fixed[tensor][places].fill(NOTHING);
    }
}

/// The groups that a network with these numbers was made without.
pub fn left_out(numbers: &[Vec<f32>]) -> Vec<Group> {
    let is_out = |(tensor, places): (usize, std::ops::Range<usize>)| {
        numbers[tensor][places].iter().all(|scale| *scale == NOTHING)
    };
    Group::ALL.into_iter().filter(|group| group.scales().into_iter().all(is_out)).collect()
}
