//! The dose matrix row by row: voxel by voxel, six bytes an entry.
//!
//! A plan needs the rows of some voxels, and of those the ones whose dose costs now: the others are not read.

use thiserror::Error;

use super::columns::{Csc, CscError, CscRef};

/// A sparse matrix by rows. Columns rise within a row; values are gray per unit weight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    columns: usize,
    starts: Vec<u32>,
    column: Vec<u16>,
    value: Vec<f32>,
}

/// A [`Rows`] that is borrowed: from a [`Rows`], or from a mapped file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowsRef<'a> {
    /// Number of columns.
    pub columns: usize,
    /// Where each row starts in `column` and `value`; one more than there are rows.
    pub starts: &'a [u32],
    /// Column of each entry.
    pub column: &'a [u16],
    /// Value of each entry.
    pub value: &'a [f32],
}

/// Why arrays are no matrix.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum RowsError {
    /// More columns or entries than the numbers of this form count.
    #[error(
        "a matrix of {columns} columns and {entries} entries is too large: 65536 and 4294967295 are the most"
    )]
    Large {
        /// Columns.
        columns: usize,
        /// Entries.
        entries: usize,
    },
    /// The row starts do not fit the entries.
    #[error(
        "row starts must rise from 0 to the {entries} entries, and there must be one column for each value"
    )]
    Starts {
        /// Number of entries.
        entries: usize,
    },
    /// A column number is too large or does not rise.
    #[error("a row has columns out of order or beyond the {columns} columns")]
    Column {
        /// Columns of the matrix.
        columns: usize,
    },
    /// A value is not finite.
    #[error("a value is not finite")]
    Value,
}

impl Rows {
    /// The same matrix by rows.
    pub fn from_columns(matrix: CscRef<'_>) -> Result<Self, RowsError> {
        let (columns, entries) = (matrix.columns(), matrix.value.len());
        if columns > 1 << 16 || u32::try_from(entries).is_err() {
            return Err(RowsError::Large { columns, entries });
        }
        let mut starts = vec![0_u32; matrix.rows + 1];
        for row in matrix.row {
            starts[*row as usize + 1] += 1;
        }
        for row in 0..matrix.rows {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let (mut column, mut value) = (vec![0; entries], vec![0.0; entries]);
        for j in 0..columns {
            let (rows, values) = matrix.column(j);
            for (row, v) in rows.iter().zip(values) {
                let at = &mut next[*row as usize];
                (column[*at as usize], value[*at as usize]) = (j as u16, *v);
                *at += 1;
            }
        }
        Ok(Self { columns, starts, column, value })
    }

    /// The matrix of these rows: columns that rise, with their values.
    pub(crate) fn from_rows(
        columns: usize,
        rows: impl Iterator<Item = Vec<(u16, f32)>>,
    ) -> Result<Self, RowsError> {
        let (mut starts, mut column, mut value) = (vec![0], Vec::new(), Vec::new());
        for row in rows {
            for (c, v) in row {
                column.push(c);
                value.push(v);
            }
            let large = |_| RowsError::Large { columns, entries: value.len() };
            starts.push(u32::try_from(value.len()).map_err(large)?);
        }
        let rows = Self { columns, starts, column, value };
        rows.view().check().map(|()| rows)
    }

    /// The same matrix by columns.
    pub(crate) fn to_columns(&self) -> Result<Csc, CscError> {
        let mut starts = vec![0_u64; self.columns + 1];
        for column in &self.column {
            starts[usize::from(*column) + 1] += 1;
        }
        for column in 0..self.columns {
            starts[column + 1] += starts[column];
        }
        let mut next = starts.clone();
        let (mut row, mut value) = (vec![0; self.value.len()], vec![0.0; self.value.len()]);
        let rows = self.view();
        for place in 0..rows.rows() {
            let (columns, values) = rows.row(place);
            for (column, v) in columns.iter().zip(values) {
                let at = &mut next[usize::from(*column)];
                (row[*at as usize], value[*at as usize]) = (place as u32, *v);
                *at += 1;
            }
        }
        Csc::new(rows.rows(), starts, row, value)
    }

    /// The matrix, borrowed.
    pub fn view(&self) -> RowsRef<'_> {
        RowsRef { columns: self.columns, starts: &self.starts, column: &self.column, value: &self.value }
    }
}

/// A matrix that is made row by row.
#[derive(Clone, Debug)]
pub(crate) struct RowsBuilder(Rows);

impl RowsBuilder {
    /// Of so many columns.
    pub fn new(columns: usize) -> Self {
        Self(Rows { columns, ..Rows::default() })
    }

    /// Begins a row, which is behind all others; those between are empty.
    pub fn begin(&mut self, row: usize) -> Result<(), RowsError> {
        let entries = self.0.value.len();
        let start = u32::try_from(entries).map_err(|_| RowsError::Large { columns: self.0.columns, entries });
        self.0.starts.resize(row + 1, start?);
        Ok(())
    }

    /// Adds an entry to the row that was begun last, behind its others.
    #[inline]
    pub fn push(&mut self, column: u16, value: f32) {
        self.0.column.push(column);
        self.0.value.push(value);
    }

    /// The matrix of so many rows.
    pub fn finish(mut self, rows: usize) -> Result<Rows, RowsError> {
        self.begin(rows)?;
        self.0.view().check().map(|()| self.0)
    }
}

impl<'a> RowsRef<'a> {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Columns and values of a row.
    #[inline]
    pub fn row(&self, row: usize) -> (&'a [u16], &'a [f32]) {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        (&self.column[range.clone()], &self.value[range])
    }

    /// Whether the arrays are a matrix; call it once on arrays that come from outside.
    ///
    /// It checks whole arrays, not rows: columns may decrease only from the end of one row to the start of the next, so
    /// the number of all decreases must equal the number of decreases at these places.
    pub fn check(&self) -> Result<(), RowsError> {
        let entries = self.value.len();
        let rising = self.starts.windows(2).all(|pair| pair[0] <= pair[1]);
        let ends = [self.starts.first(), self.starts.last()].map(|s| s.map(|s| *s as usize));
        if self.column.len() != entries || ends != [Some(0), Some(entries)] || !rising {
            return Err(RowsError::Starts { entries });
        }
        let falls = |k: usize| self.column[k] >= self.column[k + 1];
        let all: usize = self.column.windows(2).map(|pair| usize::from(pair[0] >= pair[1])).sum();
        let mut between = 0;
        let mut last = 0;
        for start in self.starts.iter().map(|s| *s as usize) {
            if start > last && start < entries {
                between += usize::from(falls(start - 1));
            }
            last = start.max(last);
        }
        let largest = self.column.iter().fold(0, |a, b| a.max(*b));
        if all != between || (entries > 0 && usize::from(largest) >= self.columns) {
            return Err(RowsError::Column { columns: self.columns });
        }
        const EXPONENT: u32 = 0x7f80_0000;
        let endless = self.value.iter().fold(false, |any, v| any | (v.to_bits() & EXPONENT == EXPONENT));
        if endless { Err(RowsError::Value) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rows_hold_what_the_columns_hold() {
        let csc = Csc::new(4, vec![0, 2, 2, 5], vec![1, 3, 0, 1, 2], vec![1.0, 0.5, 0.25, 2.0, 3.0]).unwrap();
        let rows = Rows::from_columns(csc.view()).unwrap();
        let view = rows.view();
        assert_eq!((view.rows(), view.columns, view.check()), (4, 3, Ok(())));
        assert_eq!(view.row(0), (&[2_u16][..], &[0.25_f32][..]));
        assert_eq!(view.row(1), (&[0, 2][..], &[1.0, 2.0][..]));
        assert_eq!(view.row(3), (&[0][..], &[0.5][..]));
        assert_eq!(rows.to_columns().unwrap(), csc);

        let mut built = RowsBuilder::new(3);
        for (row, entries) in
            [(0, &[(2, 0.25)][..]), (1, &[(0, 1.0), (2, 2.0)]), (2, &[(2, 3.0)]), (3, &[(0, 0.5)])]
        {
            built.begin(row).unwrap();
            entries.iter().for_each(|(column, value)| built.push(*column, *value));
        }
        assert_eq!(built.finish(4).unwrap(), rows);
    }

    #[test]
    fn rows_that_are_not_begun_are_empty() {
        let mut built = RowsBuilder::new(2);
        built.begin(2).unwrap();
        built.push(1, 4.0);
        let rows = built.finish(5).unwrap();
        assert_eq!(rows.view().starts, [0, 0, 0, 1, 1, 1]);
        assert_eq!(rows.view().row(2), (&[1_u16][..], &[4.0_f32][..]));
    }

    #[test]
    fn arrays_that_are_no_matrix_are_refused() {
        let check = |columns, starts: &[u32], column: &[u16], value: &[f32]| {
            RowsRef { columns, starts, column, value }.check()
        };
        assert_eq!(check(3, &[0, 2, 3], &[0, 2, 1], &[1.0, 2.0, 3.0]), Ok(()));
        assert_eq!(check(0, &[0, 0], &[], &[]), Ok(()));
        assert_eq!(check(3, &[0, 3, 2], &[0, 2], &[1.0, 2.0]), Err(RowsError::Starts { entries: 2 }));
        assert_eq!(check(3, &[], &[], &[]), Err(RowsError::Starts { entries: 0 }));
        assert_eq!(check(3, &[0, 2], &[2, 1], &[1.0, 2.0]), Err(RowsError::Column { columns: 3 }));
        assert_eq!(check(3, &[0, 2], &[1, 1], &[1.0, 2.0]), Err(RowsError::Column { columns: 3 }));
        assert_eq!(check(3, &[0, 1], &[3], &[1.0]), Err(RowsError::Column { columns: 3 }));
        assert_eq!(check(3, &[0, 1], &[0], &[f32::INFINITY]), Err(RowsError::Value));
    }

    proptest! {
        #[test]
        fn the_check_finds_what_a_look_at_every_row_finds(
            sizes in prop::collection::vec(0_usize..4, 0..6), column in prop::collection::vec(0_u16..5, 20),
        ) {
            let starts: Vec<u32> =
                std::iter::once(0).chain(sizes.iter().scan(0, |sum, n| { *sum += *n as u32; Some(*sum) })).collect();
            let entries = sizes.iter().sum::<usize>();
            let (column, value) = (&column[..entries], vec![1.0; entries]);
            let matrix = RowsRef { columns: 4, starts: &starts, column, value: &value };
            let good = (0..sizes.len()).all(|r| {
                let (columns, _) = matrix.row(r);
                columns.windows(2).all(|pair| pair[0] < pair[1]) && columns.iter().all(|c| *c < 4)
            });
            prop_assert_eq!(matrix.check().is_ok(), good);
        }
    }
}
