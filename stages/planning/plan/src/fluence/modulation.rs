//! How uneven the fluence of a beam may be.
//!
//! Doses alone leave directions of the weights open: a bixel that gives little where it counts may carry any weight. Two
//! convex terms close them, both in squared weights, which are about gray:
//!
//! - neighbours: `weight / n sum (x_i - x_j)^2` over the pairs of bixels of a beam that share an edge;
//! - peaks: `weight / n sum max(0, x_i - times_mean mean)^2`, where `mean` is that of the weights of the same beam.
//!
//! `n` is the number of bixels of all beams. A median in place of the mean would not be convex; the check of a plan compares
//! with the median.

use serde::{Deserialize, Serialize};

use super::goals::GoalsError;
use super::problem::{Side, Term};
use super::shapes::Parts;
use crate::Setups;

/// What uneven fluence costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Modulation {
    /// Weight of the mean square of differences between neighbours.
    pub neighbours: f64,
    /// Weight of the mean square of what is above the bound.
    pub peaks: f64,
    /// The bound, in means of the beam's weights.
    pub times_mean: f64,
}

impl Modulation {
    pub(super) fn check(&self) -> Result<(), GoalsError> {
        let name = || "the modulation of the fluence".to_owned();
        for (what, value) in
            [("the weight of neighbours", self.neighbours), ("the weight of peaks", self.peaks)]
        {
            if !(value.is_finite() && value >= 0.0) {
                return Err(GoalsError::Number {
                    name: name(),
                    what,
                    value,
                    range: "finite and not negative",
                });
            }
        }
        if !(1.0..=1e6).contains(&self.times_mean) {
            let (what, value) = ("the bound of peaks", self.times_mean);
            return Err(GoalsError::Number {
                name: name(),
                what,
                value,
                range: "between 1 and 1000000 means",
            });
        }
        Ok(())
    }

    /// Adds its rows and terms for beams whose bixels have places; others add nothing.
    pub(super) fn add(&self, beams: &[Setups<'_>], parts: &mut Parts<'_>) {
        let placed: usize = beams.iter().map(|beam| beam.bixels_mm().len()).sum();
        if placed == 0 {
            return;
        }
        let share = 1.0 / placed as f64;
        let mut before = 0_u32;
        for beam in beams {
            let bixels_mm = beam.bixels_mm();
            for [i, j] in neighbours(bixels_mm) {
                let row = parts.matrix.rows() as u32;
                parts.matrix.push_row(&[before + i, before + j], &[1.0, -1.0]);
                parts.averages.push(Vec::new());
                for side in [Side::Over, Side::Under] {
                    parts.terms.push(Term { row, side, goal: 0.0, weight: share * self.neighbours });
                }
            }
            // A lone bixel is its own mean.
            if bixels_mm.len() > 1 && self.peaks > 0.0 {
                let columns: Vec<u32> = (before..before + bixels_mm.len() as u32).collect();
                let of_mean = self.times_mean / bixels_mm.len() as f64;
                for i in 0..bixels_mm.len() {
                    let value = |at: usize| if at == i { 1.0 - of_mean } else { -of_mean };
                    let values: Vec<f32> = (0..bixels_mm.len()).map(|at| value(at) as f32).collect();
                    let row = parts.matrix.rows() as u32;
                    parts.matrix.push_row(&columns, &values);
                    parts.averages.push(Vec::new());
                    parts.terms.push(Term { row, side: Side::Over, goal: 0.0, weight: share * self.peaks });
                }
            }
            before += beam.columns() as u32;
        }
    }
}

/// Pairs of bixels that share an edge, by the first and then the second; the width is the least distance between any two
/// along an axis.
fn neighbours(bixels_mm: &[[f64; 2]]) -> Vec<[u32; 2]> {
    let mut width_mm = f64::INFINITY;
    for axis in 0..2 {
        let mut places: Vec<f64> = bixels_mm.iter().map(|place| place[axis]).collect();
        places.sort_by(f64::total_cmp);
        let steps = places.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 1e-6);
        width_mm = steps.fold(width_mm, f64::min);
    }
    let step = |place: &[f64; 2]| place.map(|mm| libm::round(mm / width_mm) as i64);
    let by_place: std::collections::BTreeMap<[i64; 2], u32> = bixels_mm.iter().map(step).zip(0..).collect();
    let mut pairs = Vec::new();
    for (i, place) in bixels_mm.iter().enumerate() {
        let [x, z] = step(place);
        for next in [[x, z + 1], [x + 1, z]] {
            pairs.extend(by_place.get(&next).map(|j| [(i as u32).min(*j), (i as u32).max(*j)]));
        }
    }
    pairs.sort_unstable();
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_share_an_edge_and_every_pair_is_there_once() {
        let places = [[0.0, 0.0], [0.0, 5.0], [5.0, 0.0], [5.0, 5.0], [15.0, 5.0]];
        assert_eq!(neighbours(&places), [[0, 1], [0, 2], [1, 3], [2, 3]]);
        assert_eq!(neighbours(&[[3.0, 4.0]]), Vec::<[u32; 2]>::new());
    }
}
