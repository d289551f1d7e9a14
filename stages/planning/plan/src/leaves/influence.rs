//! The dose of segments from that of bixels.

use std::sync::Arc;

use crate::{Rows, RowsError, Setups};

/// Dose of one segment by row, per unit of its weight.
pub type SegmentDose = Arc<[f32]>;

/// What passes each segment, bixel by bixel.
pub struct Passed {
    pub segments: usize,
    /// Bixel by bixel, one for each segment.
    pub parts: Vec<f32>,
}

/// The dose of each segment to these rows of the dose matrices of bixels, in all set-ups.
pub fn of_segments(bixels: &Setups<'_>, rows: &[u32], passed: &Passed) -> Vec<SegmentDose> {
    let count = passed.segments;
    let mut doses = vec![Vec::with_capacity(rows.len()); count];
    let mut sums = vec![0.0_f64; count];
    for row in rows {
        sums.fill(0.0);
        let (columns, values) = bixels.row(*row as usize);
        for (column, value) in columns.iter().zip(values) {
            let at = usize::from(*column) * count;
            for (sum, part) in sums.iter_mut().zip(&passed.parts[at..at + count]) {
                *sum += f64::from(*value) * f64::from(*part);
            }
        }
        doses.iter_mut().zip(&sums).for_each(|(dose, sum)| dose.push(*sum as f32));
    }
    doses.into_iter().map(Arc::from).collect()
}

/// These doses as a matrix with a column for each segment. It has `count` rows; those that are not in `rows` have no dose.
pub fn side_by_side(doses: &[SegmentDose], rows: &[u32], count: usize) -> Result<Rows, RowsError> {
    let mut requested = rows.iter().copied().enumerate().peekable();
    let entries =
        (0..count).map(|row| match requested.next_if(|(_, requested)| *requested as usize == row) {
            Some((at, _)) => {
                let of = doses.iter().enumerate().map(|(segment, dose)| (segment as u16, dose[at]));
                of.filter(|(_, gray)| *gray > 0.0).collect()
            }
            None => Vec::new(),
        });
    Rows::from_rows(doses.len(), entries)
}
