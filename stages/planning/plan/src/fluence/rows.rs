//! The dose matrix of a plan, all beams side by side, by rows: what products with it read.

use std::num::NonZeroUsize;
use std::ops::Range;

use crate::threads::with_each;
use crate::{Csc, CscRef, Setups};

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
        let mut starts = vec![0; matrix.rows + 1];
        for row in matrix.row {
            starts[*row as usize + 1] += 1;
        }
        for row in 0..matrix.rows {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let entries = matrix.value.len();
        let (mut column, mut value) = (vec![0; entries], vec![0.0; entries]);
        for j in 0..matrix.columns() {
            let (rows, values) = matrix.column(j);
            for (row, v) in rows.iter().zip(values) {
                let at = &mut next[*row as usize];
                (column[*at], value[*at]) = (j as u32, *v);
                *at += 1;
            }
        }
        Self { columns: matrix.columns(), starts, column, value }
    }

    /// The matrices of several beams side by side, and of them these rows.
    pub fn of_beams(beams: &[Setups<'_>], rows: &[u32]) -> Self {
        let mut starts = Vec::with_capacity(rows.len() + 1);
        starts.push(0);
        let entries: usize = beams
            .iter()
            .map(|beam| rows.iter().map(|row| beam.row(*row as usize).0.len()).sum::<usize>())
            .sum();
        let (mut column, mut value) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
        for row in rows {
            let mut before = 0;
            for beam in beams {
                let (columns, values) = beam.row(*row as usize);
                column.extend(columns.iter().map(|c| before + u32::from(*c)));
                value.extend_from_slice(values);
                before += beam.columns() as u32;
            }
            starts.push(column.len());
        }
        Self { columns: beams.iter().map(Setups::columns).sum(), starts, column, value }
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

    /// The same matrix by columns.
    pub fn to_columns(&self) -> Csc {
        let mut starts = vec![0_u64; self.columns + 1];
        for column in &self.column {
            starts[*column as usize + 1] += 1;
        }
        for column in 0..self.columns {
            starts[column + 1] += starts[column];
        }
        let mut next = starts.clone();
        let (mut row, mut value) = (vec![0; self.entries()], vec![0.0; self.entries()]);
        for i in 0..self.rows() {
            let (columns, values) = self.row(i);
            for (column, v) in columns.iter().zip(values) {
                let at = &mut next[*column as usize];
                (row[*at as usize], value[*at as usize]) = (i as u32, *v);
                *at += 1;
            }
        }
        Csc { rows: self.rows(), starts, row, value }
    }

    /// Every `step`-th of the first `of` rows, and all behind them.
    pub fn thinned(&self, of: usize, step: usize) -> Self {
        let mut thin = Self { columns: self.columns, starts: vec![0], ..Self::default() };
        for row in (0..of).step_by(step).chain(of..self.rows()) {
            let (columns, values) = self.row(row);
            thin.push_row(columns, values);
        }
        thin
    }

    /// `out = A x`, the same on any number of threads: each has rows of its own.
    pub fn forward(&self, x: &[f64], out: &mut [f64], threads: NonZeroUsize) {
        let part = self.part(out.len(), threads);
        with_each(out.chunks_mut(part).enumerate().collect(), threads, |(number, out)| {
            for (row, out) in (number * part..).zip(out) {
                let (columns, values) = self.row(row);
                *out = dot(columns, values, x);
            }
        });
    }

    /// `out += weight * a (a^T x)` for the row `a`.
    #[inline]
    pub fn add_outer(&self, row: usize, weight: f64, x: &[f64], out: &mut [f64]) {
        let (columns, values) = self.row(row);
        add_scaled(columns, values, weight * dot(columns, values, x), out);
    }

    /// `out += weight * a` for the row `a`.
    #[inline]
    pub fn add_row(&self, row: usize, weight: f64, out: &mut [f64]) {
        let (columns, values) = self.row(row);
        add_scaled(columns, values, weight, out);
    }

    /// `out = A^T y`, the same on any number of threads: each has columns of its own. Rows where `y` is zero are not read.
    pub fn adjoint(&self, y: &[f64], out: &mut [f64], threads: NonZeroUsize) {
        out.fill(0.0);
        let part = self.part(out.len(), threads);
        with_each(out.chunks_mut(part).enumerate().collect(), threads, |(number, out)| {
            let first = (number * part) as u32;
            let end = first + out.len() as u32;
            for (row, y) in y.iter().enumerate().filter(|(_, y)| **y != 0.0) {
                let (columns, values) = self.row(row);
                let range = if part < self.columns { between(columns, first, end) } else { 0..columns.len() };
                for (c, v) in columns[range.clone()].iter().zip(&values[range]) {
                    out[(c - first) as usize] += y * f64::from(*v);
                }
            }
        });
    }

    /// Rows or columns that a thread takes at once; all of them where a second thread is not worth its start.
    fn part(&self, of: usize, threads: NonZeroUsize) -> usize {
        let parts = if self.entries() < WORTH_A_THREAD { 1 } else { threads.get() };
        of.div_ceil(parts).max(1)
    }
}

/// Entries of a matrix from which a product is shared among threads.
const WORTH_A_THREAD: usize = 10_000_000;

/// Where the columns of a row lie that are at least `first` and less than `end`.
fn between(columns: &[u32], first: u32, end: u32) -> Range<usize> {
    columns.partition_point(|c| *c < first)..columns.partition_point(|c| *c < end)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_the_same_on_any_number_of_threads() {
        let (rows, columns) = (WORTH_A_THREAD / 1500, 2000_u32);
        let mut matrix = Csr { columns: columns as usize, starts: vec![0], ..Csr::default() };
        for row in 0..rows as u32 {
            let present: Vec<u32> = (0..columns).filter(|c| (c * 7 + row) % 9 != 0).collect();
            let values: Vec<f32> = present.iter().map(|c| 1.0 / (1 + (c ^ row) % 97) as f32).collect();
            matrix.push_row(&present, &values);
        }
        assert!(matrix.entries() >= WORTH_A_THREAD);
        let x: Vec<f64> = (0..columns).map(|j| f64::from(j % 13) / 7.0).collect();
        let y: Vec<f64> = (0..rows).map(|i| (i % 5) as f64 / 3.0).collect();
        let products = |threads: usize| {
            let threads = NonZeroUsize::new(threads).unwrap();
            let (mut dose, mut slope) = (vec![0.0; rows], vec![0.0; columns as usize]);
            matrix.forward(&x, &mut dose, threads);
            matrix.adjoint(&y, &mut slope, threads);
            (dose, slope)
        };
        let alone = products(1);
        assert!(alone.1.iter().all(|slope| *slope > 0.0));
        for threads in [2, 3, 7] {
            assert_eq!(products(threads), alone, "{threads} threads");
        }
    }
}
