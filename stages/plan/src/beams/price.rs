//! The price of a beam: what it promises beside a plan, by one pass over its dose matrix.

use crate::CscRef;
use crate::fluence::{Goals, Plan};

/// Slope and curvature of the objective in the dose of each voxel of the dose grid, side by side: an entry of a dose
/// matrix then reads one place.
pub struct Slopes(Vec<[f32; 2]>);

impl Slopes {
    /// Of a plan.
    pub fn new(goals: &Goals, plan: &Plan, voxels: usize) -> Self {
        let mut slopes = vec![[0.0; 2]; voxels];
        for (row, voxel) in goals.voxels().iter().enumerate() {
            slopes[*voxel as usize] = [plan.pull[row] as f32, plan.curvature[row] as f32];
        }
        Self(slopes)
    }
}

/// `sum_j max(0, -g_j)^2 / (2 h_j)` over the bixels of a beam, with gradient and curvature along each: the decrease
/// that they would bring, each alone. It ranks beams; it is no bound.
pub fn promise(matrix: CscRef<'_>, slopes: &Slopes) -> f64 {
    let mut promise = 0.0;
    for j in 0..matrix.columns() {
        let (rows, values) = matrix.column(j);
        let mut sums = [[0.0_f64; 2]; 2];
        let (row_pairs, row_rest) = rows.as_chunks::<2>();
        let (value_pairs, value_rest) = values.as_chunks::<2>();
        for (rows, values) in row_pairs.iter().zip(value_pairs) {
            for k in 0..2 {
                let [slope, curvature] = slopes.0[rows[k] as usize];
                sums[k][0] += f64::from(slope * values[k]);
                sums[k][1] += f64::from(curvature * values[k] * values[k]);
            }
        }
        for (row, value) in row_rest.iter().zip(value_rest) {
            let [slope, curvature] = slopes.0[*row as usize];
            sums[0][0] += f64::from(slope * value);
            sums[0][1] += f64::from(curvature * value * value);
        }
        let [g, h] = [sums[0][0] + sums[1][0], sums[0][1] + sums[1][1]];
        if g < 0.0 && h > 0.0 {
            promise += g * g / (2.0 * h);
        }
    }
    promise
}
