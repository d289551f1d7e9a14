//! What given doses cost, without a problem to solve.

use super::goals::{Goals, GoalsError};
use super::objective::{DvhPoint, Objective};
use super::problem::Side;

impl Goals {
    /// The objective of doses that are there: one for each row of a dose matrix, Gy.
    ///
    /// # Errors
    /// The doses are of another grid.
    pub fn cost(&self, dose: &[f64]) -> Result<f64, GoalsError> {
        if dose.len() != self.rows() {
            return Err(GoalsError::Grid { found: dose.len(), expected: self.rows() });
        }
        let mut cost = 0.0;
        for structure in self.wanted() {
            let volume = |at: usize| structure.volumes.get(at).copied().unwrap_or(1.0);
            let points: Vec<(f64, f64)> =
                structure.voxels.iter().enumerate().map(|(at, v)| (dose[*v as usize], volume(at))).collect();
            for objective in &structure.objectives {
                cost += objective.cost(&points, &structure.to_target_mm);
            }
        }
        Ok(cost)
    }
}

impl Objective {
    /// Its cost at points with a dose (Gy) and a volume each, and distances to the targets (mm) where it asks for them.
    fn cost(&self, points: &[(f64, f64)], to_target_mm: &[f64]) -> f64 {
        let whole: f64 = points.iter().map(|(_, volume)| volume).sum();
        let mean = || points.iter().map(|(d, volume)| volume * d).sum::<f64>() / whole;
        let squares = |off: &dyn Fn(f64) -> f64| -> f64 {
            points.iter().map(|(d, volume)| volume * off(*d) * off(*d)).sum()
        };
        match *self {
            Self::Overdose { dose, weight } => weight / whole * squares(&|d| (d - dose).max(0.0)),
            Self::Underdose { dose, weight } => weight / whole * squares(&|d| (dose - d).max(0.0)),
            Self::FallOff { near, far, over_mm, weight } => {
                let (mut within, mut sum) = (0.0, 0.0);
                for ((d, volume), r) in points.iter().zip(to_target_mm) {
                    let off = (d - near - (far - near) * (r / over_mm).min(1.0)).max(0.0);
                    sum += volume * off * off;
                    within += if *r <= over_mm { *volume } else { 0.0 };
                }
                weight * sum / if within > 0.0 { within } else { whole }
            }
            Self::MeanDose { dose, weight } => {
                let off = (mean() - dose).max(0.0);
                weight * off * off
            }
            Self::Homogeneity { weight } => {
                let mean = mean();
                weight / whole * squares(&|d| d - mean)
            }
            Self::DvhAtMost { dose, volume, weight } => {
                of_dvh(points, Side::Over, volume * whole, dose, weight / whole)
            }
            Self::DvhAtLeast { dose, volume, weight } => {
                of_dvh(points, Side::Under, volume * whole, dose, weight / whole)
            }
        }
    }
}

fn of_dvh(points: &[(f64, f64)], side: Side, volume: f64, dose: f64, weight: f64) -> f64 {
    let rows = points.iter().enumerate().map(|(at, (_, volume))| (at as u32, *volume)).collect();
    let doses: Vec<f64> = points.iter().map(|(d, _)| *d).collect();
    let point = DvhPoint { rows, volume, side, dose, weight };
    let costing = point.costing(&doses);
    let off = |d: f64| if side == Side::Over { (d - dose).max(0.0) } else { (dose - d).max(0.0) };
    weight * costing.iter().map(|(at, volume)| volume * off(doses[*at as usize]).powi(2)).sum::<f64>()
}
