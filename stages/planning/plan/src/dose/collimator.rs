//! The multileaf collimator of a machine file.

use serde::{Deserialize, Serialize};

use super::machine::{MachineError, in_range, rising, size};

/// A multileaf collimator. Its leaves travel along the beam's x; pairs lie side by side along the beam's z, which is y of
/// IEC 61217 with the collimator at 0 degrees. Every length is on the isocentre plane. Opposed leaves of neighbouring
/// pairs may pass each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Collimator {
    /// Edges of the leaf pairs, rising, mm: one more than there are pairs.
    pub leaf_edges_mm: Vec<f64>,
    /// Farthest that the tip of a leaf is withdrawn from the axis, mm.
    pub reach_mm: f64,
    /// Farthest that the tip of a leaf goes over the axis, mm.
    pub over_travel_mm: f64,
    /// Fluence behind a leaf, relative to that of the open field.
    pub transmission: f64,
    /// Monitor units that give the open field a fluence of weight 1.
    pub mu_per_weight: f64,
    /// Fewest monitor units of a segment in one fraction.
    pub least_mu: f64,
    /// How far the jaws may go over the axis along x and z, mm, where they follow each segment. Without it they stand still
    /// around all segments of a beam.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jaws_over_axis_mm: Option<[f64; 2]>,
}

impl Collimator {
    /// A generic one: 80 pairs of 5 mm, a transmission of 1.5 %, jaws that follow each segment, and 1 cGy per monitor unit at
    /// the isocentre, 100 mm deep in water, in a field of 100 mm.
    pub fn generic() -> Self {
        Self {
            leaf_edges_mm: (-40..=40).map(|edge| 5.0 * f64::from(edge)).collect(),
            reach_mm: 200.0,
            over_travel_mm: 150.0,
            transmission: 0.015,
            mu_per_weight: 100.0,
            least_mu: 2.0,
            jaws_over_axis_mm: Some([20.0, 100.0]),
        }
    }

    /// Number of leaf pairs.
    pub fn pairs(&self) -> usize {
        self.leaf_edges_mm.len() - 1
    }

    /// Lower and upper edge of a pair, mm.
    pub fn pair_mm(&self, pair: usize) -> [f64; 2] {
        [self.leaf_edges_mm[pair], self.leaf_edges_mm[pair + 1]]
    }

    /// The jaws of a segment whose open part has these edges, in a beam whose segments all lie within these others.
    pub fn jaws_mm(&self, open_mm: [[f64; 2]; 2], beam_mm: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
        let Some(over) = self.jaws_over_axis_mm else { return beam_mm };
        [0, 1].map(|axis| [open_mm[axis][0].min(over[axis]), open_mm[axis][1].max(-over[axis])])
    }

    pub(super) fn check(&self) -> Result<(), MachineError> {
        rising("collimator.leaf_edges_mm", &self.leaf_edges_mm)?;
        size("collimator.leaf_edges_mm", self.leaf_edges_mm.len(), 2..=1001)?;
        in_range("collimator.reach_mm", self.reach_mm, 1.0..=500.0, "from 1 to 500 mm")?;
        let over = 0.0..=self.reach_mm;
        in_range("collimator.over_travel_mm", self.over_travel_mm, over, "from 0 to `reach_mm`")?;
        in_range("collimator.transmission", self.transmission, 0.0..=0.5, "from 0 to 0.5")?;
        in_range("collimator.mu_per_weight", self.mu_per_weight, 1e-3..=1e6, "from 0.001 to 1000000")?;
        for over in self.jaws_over_axis_mm.iter().flatten() {
            in_range("collimator.jaws_over_axis_mm", *over, 0.0..=500.0, "from 0 to 500 mm")?;
        }
        in_range("collimator.least_mu", self.least_mu, 0.0..=100.0, "from 0 to 100 monitor units")
    }
}
