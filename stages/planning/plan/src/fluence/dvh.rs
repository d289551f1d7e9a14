//! The cost of a DVH point: the voxels between its dose and the dose that its volume gets now (Wu and Mohan 2000).

use super::problem::{Side, Term};

/// Part of a volume that sums of volumes may be off by.
const ROUNDING: f64 = 1e-9;

/// A DVH objective whose voxels are chosen by dose.
#[derive(Clone, Debug)]
pub struct DvhTerm {
    /// Rows of the structure, with their volumes.
    pub rows: Vec<(u32, f64)>,
    /// Volume that is free, for [`Side::Over`] that of the highest doses; or that must not be, for [`Side::Under`].
    pub volume: f64,
    pub side: Side,
    pub dose: f64,
    /// Per volume.
    pub weight: f64,
}

/// The cost at points with a dose and a volume each.
pub fn cost(points: &[(f64, f64)], side: Side, volume: f64, dose: f64, weight: f64) -> f64 {
    let rows = points.iter().enumerate().map(|(at, (_, volume))| (at as u32, *volume)).collect();
    let doses: Vec<f64> = points.iter().map(|(d, _)| *d).collect();
    let point = DvhTerm { rows, volume, side, dose, weight };
    let costing = point.costing(&doses);
    let off = |d: f64| if side == Side::Over { (d - dose).max(0.0) } else { (dose - d).max(0.0) };
    weight * costing.iter().map(|(at, volume)| volume * off(doses[*at as usize]).powi(2)).sum::<f64>()
}

impl DvhTerm {
    /// The rows that cost at these doses, rising, with their volumes: those that would cost least.
    pub fn costing(&self, dose: &[f64]) -> Vec<(u32, f64)> {
        let over = self.side == Side::Over;
        let mut rows = self.rows.clone();
        rows.sort_by(|(a, _), (b, _)| {
            let hottest_first = dose[*b as usize].total_cmp(&dose[*a as usize]);
            hottest_first.then(if over { b.cmp(a) } else { a.cmp(b) })
        });
        // Over: the hottest go free as long as they fit into the volume. Under: the hottest cost until they fill it.
        let limit = self.volume * if over { 1.0 + ROUNDING } else { 1.0 - ROUNDING };
        let mut above = 0.0;
        let hottest = rows.iter().take_while(|(_, volume)| {
            let before = above;
            above += volume;
            if over { above <= limit } else { before < limit }
        });
        let hottest = hottest.count();
        let mut costing = if over { rows.split_off(hottest) } else { rows[..hottest].to_vec() };
        costing.sort_unstable_by_key(|(row, _)| *row);
        costing
    }

    /// Terms of these rows.
    pub fn terms<'a>(&'a self, rows: &'a [(u32, f64)]) -> impl Iterator<Item = Term> + 'a {
        let of = |&(row, volume): &(u32, f64)| {
            let weight = self.weight * volume;
            Term { row, side: self.side, goal: self.dose, weight }
        };
        rows.iter().map(of)
    }
}
