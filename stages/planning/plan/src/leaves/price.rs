//! The segment that a plan gains most by: the pricing problem of Romeijn, Ahuja, Dempsey and Kumar (SIAM J. Optim. 15
//! (2005) 838). Where leaf pairs do not depend on each other, each opens the columns of the least sum of slopes.

use super::engel::Shape;
use super::map::{LeafMap, overlap};
use crate::Setups;
use crate::dose::Collimator;
use crate::fluence::{Goals, Plan};

/// Slope of the objective in the weight of each bixel.
pub fn slopes(goals: &Goals, plan: &Plan, bixels: &Setups<'_>) -> Vec<f64> {
    let mut slopes = vec![0.0; bixels.columns()];
    for (row, pull) in goals.voxels().iter().zip(&plan.pull).filter(|(_, pull)| **pull != 0.0) {
        let (columns, values) = bixels.row(*row as usize);
        columns.iter().zip(values).for_each(|(c, v)| slopes[usize::from(*c)] += pull * f64::from(*v));
    }
    slopes
}

/// The shape whose open part has the least slope, and that slope; nothing where no opening lessens the objective.
pub fn steepest(
    collimator: &Collimator,
    map: &LeafMap,
    bixels_mm: &[[f64; 2]],
    slopes: &[f64],
) -> Option<(f64, Shape)> {
    // Where there is no bixel there is no dose to judge a fluence by: no opening goes over such a place.
    let mut on_map = vec![f64::INFINITY; map.fluence.len()];
    let half = 0.5 * map.width_mm;
    for ([x, z], slope) in bixels_mm.iter().zip(slopes) {
        let column = libm::round(x / map.width_mm) as i64 - map.first_column;
        let Some(column) = usize::try_from(column).ok().filter(|c| *c < map.columns) else { continue };
        for pair in 0..map.pairs() {
            let part =
                overlap(collimator.pair_mm(map.first_pair + pair), [z - half, z + half]) / map.width_mm;
            let sum = &mut on_map[pair * map.columns + column];
            if part > 0.0 {
                *sum = part * slope + if sum.is_finite() { *sum } else { 0.0 };
            }
        }
    }
    let rows: Vec<(f64, [usize; 2])> = on_map.chunks(map.columns).map(least_sum).collect();
    let slope: f64 = rows.iter().map(|(sum, _)| sum).sum();
    (slope < 0.0).then(|| (slope, rows.into_iter().map(|(_, open)| open).collect()))
}

/// The consecutive columns of the least sum; none where every sum is above zero.
fn least_sum(row: &[f64]) -> (f64, [usize; 2]) {
    let (mut best, mut open) = (0.0, [0, 0]);
    let (mut sum, mut from) = (0.0, 0);
    for (column, slope) in row.iter().enumerate() {
        if sum > 0.0 {
            (sum, from) = (0.0, column);
        }
        sum += slope;
        if sum < best {
            (best, open) = (sum, [from, column + 1]);
        }
    }
    (best, open)
}
