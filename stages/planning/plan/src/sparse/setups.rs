//! A beam's matrices for several set-ups of the patient.

use super::rows::RowsRef;

/// Matrices of one beam on one grid, one for each set-up, one above the other: row `s n + v` is voxel `v` of the grid's `n`
/// in set-up `s`. They stay where they lie.
#[derive(Clone, Debug, Default)]
pub struct Setups<'a> {
    matrices: Vec<RowsRef<'a>>,
    /// Centres of the bixels on the isocentre plane, mm; none where columns are no bixels, or their places are not known.
    bixels_mm: &'a [[f64; 2]],
}

impl<'a> From<RowsRef<'a>> for Setups<'a> {
    fn from(only: RowsRef<'a>) -> Self {
        Self { matrices: vec![only], bixels_mm: &[] }
    }
}

impl<'a> Setups<'a> {
    /// Of these matrices; `None` where their rows or columns are not as many.
    pub fn new(matrices: Vec<RowsRef<'a>>) -> Option<Self> {
        let alike =
            |pair: &[RowsRef<'_>]| pair[0].rows() == pair[1].rows() && pair[0].columns == pair[1].columns;
        matrices.windows(2).all(alike).then_some(Self { matrices, bixels_mm: &[] })
    }

    /// The same with the centres of its bixels, mm, one for each column; places that are not as many are left out.
    #[must_use]
    pub fn placed(self, bixels_mm: &'a [[f64; 2]]) -> Self {
        let bixels_mm = if bixels_mm.len() == self.columns() { bixels_mm } else { &[] };
        Self { bixels_mm, ..self }
    }

    /// Centres of the bixels, mm, or none.
    pub fn bixels_mm(&self) -> &'a [[f64; 2]] {
        self.bixels_mm
    }

    /// Number of rows, over all set-ups.
    pub fn rows(&self) -> usize {
        self.matrices.iter().map(RowsRef::rows).sum()
    }

    /// Number of columns: bixels of the beam.
    pub fn columns(&self) -> usize {
        self.matrices.first().map_or(0, |first| first.columns)
    }

    /// The matrix of the first set-up: the planned one.
    pub fn planned(&self) -> Option<RowsRef<'a>> {
        self.matrices.first().copied()
    }

    /// Columns and values of a row.
    #[inline]
    pub fn row(&self, row: usize) -> (&'a [u16], &'a [f32]) {
        if self.matrices.len() == 1 {
            return self.matrices[0].row(row);
        }
        let each = self.matrices[0].rows();
        self.matrices[row / each].row(row % each)
    }
}

/// Matrices of several beams side by side, by rows, for other programs: compressed sparse rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ByRows {
    /// Where each row starts in the others; one more at the end.
    pub starts: Vec<i64>,
    /// The column of each entry: bixels of the first beam, then those of the next.
    pub columns: Vec<i32>,
    /// The entries, gray over all fractions for a weight of 1.
    pub values: Vec<f32>,
}

impl ByRows {
    /// The matrices side by side. They have as many rows.
    pub fn of(matrices: &[Setups<'_>]) -> Self {
        let mut all = Self { starts: vec![0], ..Self::default() };
        for row in 0..matrices.first().map_or(0, Setups::rows) {
            let mut before = 0;
            for matrix in matrices {
                let (columns, values) = matrix.row(row);
                all.columns.extend(columns.iter().map(|column| before + i32::from(*column)));
                all.values.extend_from_slice(values);
                before += matrix.columns() as i32;
            }
            all.starts.push(all.columns.len() as i64);
        }
        all
    }
}
