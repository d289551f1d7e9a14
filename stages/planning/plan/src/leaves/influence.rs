//! The dose of segments from that of bixels.

use crate::{Rows, RowsError, Setups};

/// What passes each segment, bixel by bixel.
pub struct Passed {
    pub segments: usize,
    /// Bixel by bixel, one for each segment.
    pub parts: Vec<f32>,
}

/// The dose of the segments, per unit of their weights: of the dose matrices of bixels, in all set-ups, these rows; the
/// others have none.
pub fn of_segments(bixels: &Setups<'_>, rows: &[u32], passed: &Passed) -> Result<Rows, RowsError> {
    let count = passed.segments;
    let mut sums = vec![0.0_f64; count];
    let mut requested = rows.iter().copied().peekable();
    let entries = (0..bixels.rows()).map(|row| {
        if requested.next_if_eq(&(row as u32)).is_none() {
            return Vec::new();
        }
        sums.fill(0.0);
        let (columns, values) = bixels.row(row);
        for (column, value) in columns.iter().zip(values) {
            let at = usize::from(*column) * count;
            for (sum, part) in sums.iter_mut().zip(&passed.parts[at..at + count]) {
                *sum += f64::from(*value) * f64::from(*part);
            }
        }
        let lit = sums.iter().enumerate().filter(|(_, sum)| **sum > 0.0);
        lit.map(|(segment, sum)| (segment as u16, *sum as f32)).collect()
    });
    Rows::from_rows(count, entries)
}
