//! Cholesky's factor of a dense matrix, on the thread that asks for it.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::{Mat, MatMut, Par};

/// `L` of `L L^T`.
#[derive(Debug)]
pub struct Cholesky {
    factor: Mat<f64>,
}

impl Cholesky {
    /// Factors a matrix of which the lower triangle is given; `None` where it is not positive definite.
    pub fn new(mut matrix: Mat<f64>) -> Option<Self> {
        let scratch =
            llt::factor::cholesky_in_place_scratch::<f64>(matrix.nrows(), Par::Seq, Default::default());
        let mut buffer = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut buffer);
        llt::factor::cholesky_in_place(
            matrix.as_mut(),
            Default::default(),
            Par::Seq,
            stack,
            Default::default(),
        )
        .ok()?;
        Some(Self { factor: matrix })
    }

    /// Solves in place.
    pub fn solve(&self, right_side: &mut [f64]) {
        let n = right_side.len();
        let scratch = llt::solve::solve_in_place_scratch::<f64>(n, 1, Par::Seq);
        let mut buffer = MemBuffer::new(scratch);
        llt::solve::solve_in_place(
            self.factor.as_ref(),
            MatMut::from_column_major_slice_mut(right_side, n, 1),
            Par::Seq,
            MemStack::new(&mut buffer),
        );
    }
}
