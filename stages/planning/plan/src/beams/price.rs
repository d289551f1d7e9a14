//! The price of a beam: what it promises beside a plan, by one pass over the rows of its dose matrix that cost now.

use crate::Setups;
use crate::fluence::{Goals, Plan};

/// Slope and curvature of the objective in the dose of the voxels where they are not zero.
pub struct Slopes(Vec<Slope>);

struct Slope {
    /// Row of the dose matrices.
    row: usize,
    slope: f64,
    curvature: f64,
}

impl Slopes {
    /// Of a plan.
    pub fn new(goals: &Goals, plan: &Plan) -> Self {
        let both = plan.pull.iter().zip(&plan.curvature);
        let all = goals.voxels().iter().zip(both).map(|(voxel, (slope, curvature))| Slope {
            row: *voxel as usize,
            slope: *slope,
            curvature: *curvature,
        });
        Self(all.filter(|s| s.slope != 0.0 || s.curvature != 0.0).collect())
    }
}

/// `sum_j max(0, -g_j)^2 / (2 h_j)` over the bixels of a beam, with gradient and curvature along each: the decrease
/// that they would bring, each alone. It ranks beams; it is no bound.
pub fn promise(beam: &Setups<'_>, slopes: &Slopes) -> f64 {
    let mut along = vec![[0.0_f64; 2]; beam.columns()];
    for Slope { row, slope, curvature } in &slopes.0 {
        let (columns, values) = beam.row(*row);
        for (c, v) in columns.iter().zip(values) {
            let v = f64::from(*v);
            let [g, h] = &mut along[usize::from(*c)];
            *g += slope * v;
            *h += curvature * v * v;
        }
    }
    along.iter().filter(|[g, h]| *g < 0.0 && *h > 0.0).map(|[g, h]| g * g / (2.0 * h)).sum()
}
