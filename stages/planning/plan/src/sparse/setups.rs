//! A beam's matrices for several set-ups of the patient.

use super::rows::RowsRef;

/// Matrices of one beam on one grid, one for each set-up, one above the other: row `s n + v` is voxel `v` of the grid's `n`
/// in set-up `s`. They stay where they lie.
#[derive(Clone, Debug, Default)]
pub struct Setups<'a>(Vec<RowsRef<'a>>);

impl<'a> From<RowsRef<'a>> for Setups<'a> {
    fn from(only: RowsRef<'a>) -> Self {
        Self(vec![only])
    }
}

impl<'a> Setups<'a> {
    /// Of these matrices; `None` where their rows or columns are not as many.
    pub fn new(matrices: Vec<RowsRef<'a>>) -> Option<Self> {
        let alike =
            |pair: &[RowsRef<'_>]| pair[0].rows() == pair[1].rows() && pair[0].columns == pair[1].columns;
        matrices.windows(2).all(alike).then_some(Self(matrices))
    }

    /// Number of rows, over all set-ups.
    pub fn rows(&self) -> usize {
        self.0.iter().map(RowsRef::rows).sum()
    }

    /// Number of columns: bixels of the beam.
    pub fn columns(&self) -> usize {
        self.0.first().map_or(0, |first| first.columns)
    }

    /// The matrix of the first set-up: the planned one.
    pub fn planned(&self) -> Option<RowsRef<'a>> {
        self.0.first().copied()
    }

    /// Columns and values of a row.
    #[inline]
    pub fn row(&self, row: usize) -> (&'a [u16], &'a [f32]) {
        if self.0.len() == 1 {
            return self.0[0].row(row);
        }
        let each = self.0[0].rows();
        self.0[row / each].row(row % each)
    }
}
