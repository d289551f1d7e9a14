//! Cholesky's factor of a dense matrix.

use std::num::NonZeroUsize;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, MatMut, MatRef, Par};

use crate::threads::with_each;

/// Size from which a matrix is factored in blocks, which threads share, and the size of the blocks.
const LARGE: usize = 1024;
const BLOCK: usize = 256;

/// Factors a matrix of which the lower triangle is given into `L L^T`, in place; `None` where it is not positive definite.
/// The factor is the same on any number of threads.
pub fn factor(matrix: MatMut<'_, f64>, threads: NonZeroUsize) -> Option<()> {
    if matrix.nrows() < LARGE { factor_at_once(matrix) } else { factor_in_blocks(matrix, threads) }
}

/// Solves `L L^T x = b` in place.
pub fn solve(factor: MatRef<'_, f64>, right_side: &mut [f64]) {
    let n = right_side.len();
    let scratch = llt::solve::solve_in_place_scratch::<f64>(n, 1, Par::Seq);
    let mut buffer = MemBuffer::new(scratch);
    llt::solve::solve_in_place(
        factor,
        MatMut::from_column_major_slice_mut(right_side, n, 1),
        Par::Seq,
        MemStack::new(&mut buffer),
    );
}

fn factor_at_once(matrix: MatMut<'_, f64>) -> Option<()> {
    let scratch = llt::factor::cholesky_in_place_scratch::<f64>(matrix.nrows(), Par::Seq, Default::default());
    let mut buffer = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut buffer);
    llt::factor::cholesky_in_place(matrix, Default::default(), Par::Seq, stack, Default::default()).ok()?;
    Some(())
}

/// Block of columns after block of columns: its diagonal block, the rows below it, and what they take from the rest.
fn factor_in_blocks(matrix: MatMut<'_, f64>, threads: NonZeroUsize) -> Option<()> {
    let mut rest = matrix;
    while rest.nrows() > 0 {
        let width = BLOCK.min(rest.nrows());
        let (own, others) = rest.split_at_col_mut(width);
        let (mut diagonal, mut below) = own.split_at_row_mut(width);
        factor_at_once(diagonal.as_mut())?;
        let diagonal = diagonal.as_ref();
        with_each(rows_in_blocks(below.as_mut()), threads, |rows| {
            solve_lower_triangular_in_place(diagonal, rows.transpose_mut(), Par::Seq);
        });
        let below = below.as_ref();
        let mut remaining = others.split_at_row_mut(width).1;
        with_each(columns_in_blocks(remaining.as_mut()), threads, |(at, columns)| {
            subtract(columns, below, at)
        });
        rest = remaining;
    }
    Some(())
}

fn rows_in_blocks(mut matrix: MatMut<'_, f64>) -> Vec<MatMut<'_, f64>> {
    let mut blocks = Vec::new();
    while matrix.nrows() > 0 {
        let height = BLOCK.min(matrix.nrows());
        let (block, rest) = matrix.split_at_row_mut(height);
        blocks.push(block);
        matrix = rest;
    }
    blocks
}

/// Each block from its own first row on, with the number of that row.
fn columns_in_blocks(mut matrix: MatMut<'_, f64>) -> Vec<(usize, MatMut<'_, f64>)> {
    let (mut blocks, mut at) = (Vec::new(), 0);
    while matrix.ncols() > 0 {
        let width = BLOCK.min(matrix.ncols());
        let (block, rest) = matrix.split_at_col_mut(width);
        blocks.push((at, block.split_at_row_mut(at).1));
        (matrix, at) = (rest, at + width);
    }
    blocks
}

/// Takes `b b^T` from the lower triangle of these columns, which begin at row `at` of `b`.
fn subtract(columns: MatMut<'_, f64>, b: MatRef<'_, f64>, at: usize) {
    let width = columns.ncols();
    let (upper, lower) = columns.split_at_row_mut(width);
    let own = b.subrows(at, width);
    triangular::matmul(
        upper,
        BlockStructure::TriangularLower,
        Accum::Add,
        own,
        BlockStructure::Rectangular,
        own.transpose(),
        BlockStructure::Rectangular,
        -1.0,
        Par::Seq,
    );
    let rest = b.subrows(at + width, b.nrows() - at - width);
    matmul(lower, Accum::Add, rest, own.transpose(), -1.0, Par::Seq);
}
