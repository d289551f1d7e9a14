//! The dose matrix column by column: bixel by bixel, as it is computed.

use thiserror::Error;

/// A sparse matrix by columns. Rows rise within a column; values are gray per unit weight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Csc {
    pub(crate) rows: usize,
    pub(crate) starts: Vec<u64>,
    pub(crate) row: Vec<u32>,
    pub(crate) value: Vec<f32>,
}

/// A [`Csc`] that is borrowed: from a [`Csc`], or from a mapped file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CscRef<'a> {
    /// Number of rows.
    pub rows: usize,
    /// Where each column starts in `row` and `value`; one more than there are columns.
    pub starts: &'a [u64],
    /// Row of each entry.
    pub row: &'a [u32],
    /// Value of each entry.
    pub value: &'a [f32],
}

/// Why arrays are no matrix.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum CscError {
    /// The column starts do not fit the entries.
    #[error(
        "column starts must rise from 0 to the {entries} entries, and there must be one row for each value; column {column} breaks that"
    )]
    Starts {
        /// Column where it shows.
        column: usize,
        /// Number of entries.
        entries: usize,
    },
    /// A row number is too large or does not rise.
    #[error("column {column} has row {row} out of order or beyond the {rows} rows")]
    Row {
        /// Column of the entry.
        column: usize,
        /// Its row.
        row: u32,
        /// Rows of the matrix.
        rows: usize,
    },
    /// A value is not finite.
    #[error("column {column} holds a value that is not finite")]
    Value {
        /// Column of the entry.
        column: usize,
    },
}

impl Csc {
    /// The matrix of these arrays, if they are one.
    pub fn new(rows: usize, starts: Vec<u64>, row: Vec<u32>, value: Vec<f32>) -> Result<Self, CscError> {
        CscRef { rows, starts: &starts, row: &row, value: &value }.check()?;
        Ok(Self { rows, starts, row, value })
    }

    /// The matrix, borrowed.
    pub fn view(&self) -> CscRef<'_> {
        CscRef { rows: self.rows, starts: &self.starts, row: &self.row, value: &self.value }
    }
}

impl<'a> CscRef<'a> {
    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Rows and values of a column.
    pub fn column(&self, column: usize) -> (&'a [u32], &'a [f32]) {
        let range = self.starts[column] as usize..self.starts[column + 1] as usize;
        (&self.row[range.clone()], &self.value[range])
    }

    /// Whether the arrays are a matrix; call it once on arrays that come from outside.
    pub fn check(&self) -> Result<(), CscError> {
        let entries = self.value.len();
        let bad = |column| CscError::Starts { column, entries };
        if self.row.len() != entries || self.starts.first() != Some(&0) {
            return Err(bad(0));
        }
        if self.starts.last() != Some(&(entries as u64)) {
            return Err(bad(self.columns()));
        }
        if let Some(column) = self.starts.windows(2).position(|pair| pair[0] > pair[1]) {
            return Err(bad(column));
        }
        for column in 0..self.columns() {
            let (rows, values) = self.column(column);
            let mut next = 0;
            for &row in rows {
                if u64::from(row) < next || row as usize >= self.rows {
                    return Err(CscError::Row { column, row, rows: self.rows });
                }
                next = u64::from(row) + 1;
            }
            if !values.iter().all(|value| value.is_finite()) {
                return Err(CscError::Value { column });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_that_are_no_matrix_are_refused_with_the_column() {
        let make = |starts: &[u64], row: &[u32], value: &[f32]| {
            Csc::new(3, starts.to_vec(), row.to_vec(), value.to_vec())
        };
        assert!(make(&[0, 2, 3], &[0, 2, 1], &[1.0, 2.0, 3.0]).is_ok());
        assert_eq!(make(&[0, 3, 2], &[0, 2], &[1.0, 2.0]), Err(CscError::Starts { column: 1, entries: 2 }));
        assert_eq!(make(&[0, 2], &[2, 1], &[1.0, 2.0]), Err(CscError::Row { column: 0, row: 1, rows: 3 }));
        assert_eq!(make(&[0, 1], &[3], &[1.0]), Err(CscError::Row { column: 0, row: 3, rows: 3 }));
        assert_eq!(make(&[0, 1], &[0], &[f32::NAN]), Err(CscError::Value { column: 0 }));
    }
}
