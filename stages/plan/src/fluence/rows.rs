//! The dose-influence matrix by rows: what products with it read.

use crate::CscRef;

/// Marks a row of a block that is left out.
pub const LEFT_OUT: u32 = u32::MAX;

/// A sparse matrix by rows. Columns rise within a row; values are `f32`, sums are `f64`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Csr {
    columns: usize,
    starts: Vec<usize>,
    column: Vec<u32>,
    value: Vec<f32>,
}

impl Csr {
    /// The same matrix by rows.
    pub fn from_columns(matrix: CscRef<'_>) -> Self {
        let rows: Vec<u32> = (0..matrix.rows as u32).collect();
        Self::from_blocks(&[matrix], &rows, matrix.rows)
    }

    /// Blocks side by side. `row_of` says for each row of the blocks which of the `rows` it becomes, or [`LEFT_OUT`].
    pub fn from_blocks(blocks: &[CscRef<'_>], row_of: &[u32], rows: usize) -> Self {
        let mut starts = vec![0; rows + 1];
        for row in blocks.iter().flat_map(|block| block.row) {
            let row = row_of[*row as usize];
            if row != LEFT_OUT {
                starts[row as usize + 1] += 1;
            }
        }
        for row in 0..rows {
            starts[row + 1] += starts[row];
        }
        let entries = starts[rows];
        let (mut column, mut value) = (vec![0; entries], vec![0.0; entries]);
        let mut next = starts.clone();
        let mut columns = 0;
        for block in blocks {
            for j in 0..block.columns() {
                let (block_rows, values) = block.column(j);
                for (row, v) in block_rows.iter().zip(values) {
                    let row = row_of[*row as usize];
                    if row != LEFT_OUT {
                        let at = &mut next[row as usize];
                        (column[*at], value[*at]) = (columns as u32, *v);
                        *at += 1;
                    }
                }
                columns += 1;
            }
        }
        Self { columns, starts, column, value }
    }

    /// Appends empty columns.
    pub fn widen(&mut self, columns: usize) {
        self.columns += columns;
    }

    /// Appends a row: columns that rise, with their values.
    pub fn push_row(&mut self, columns: &[u32], values: &[f32]) {
        self.column.extend_from_slice(columns);
        self.value.extend_from_slice(values);
        self.starts.push(self.column.len());
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.value.len()
    }

    /// Columns and values of a row.
    #[inline]
    pub fn row(&self, row: usize) -> (&[u32], &[f32]) {
        let range = self.starts[row]..self.starts[row + 1];
        (&self.column[range.clone()], &self.value[range])
    }

    /// `out = A x`.
    pub fn forward(&self, x: &[f64], out: &mut [f64]) {
        for (row, out) in out.iter_mut().enumerate() {
            let (columns, values) = self.row(row);
            *out = dot(columns, values, x);
        }
    }

    /// `out += weight * a (a^T x)` for the row `a`.
    #[inline]
    pub fn add_outer(&self, row: usize, weight: f64, x: &[f64], out: &mut [f64]) {
        let (columns, values) = self.row(row);
        add_scaled(columns, values, weight * dot(columns, values, x), out);
    }

    /// `out = A^T y`; rows where `y` is zero are not read.
    pub fn adjoint(&self, y: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (row, y) in y.iter().enumerate() {
            if *y != 0.0 {
                let (columns, values) = self.row(row);
                add_scaled(columns, values, *y, out);
            }
        }
    }
}

/// Inner product of a sparse row with `x`: four sums, so that additions overlap, joined in a fixed order.
#[inline]
fn dot(columns: &[u32], values: &[f32], x: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (column_fours, column_rest) = columns.as_chunks::<4>();
    let (value_fours, value_rest) = values.as_chunks::<4>();
    for (c, v) in column_fours.iter().zip(value_fours) {
        for k in 0..4 {
            sums[k] += f64::from(v[k]) * x[c[k] as usize];
        }
    }
    for (k, (c, v)) in column_rest.iter().zip(value_rest).enumerate() {
        sums[k] += f64::from(*v) * x[*c as usize];
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// `out += scale * row`.
#[inline]
fn add_scaled(columns: &[u32], values: &[f32], scale: f64, out: &mut [f64]) {
    for (c, v) in columns.iter().zip(values) {
        out[*c as usize] += scale * f64::from(*v);
    }
}
