//! The curvature of the objective around a point, damped: as a dense matrix, or by products with the dose matrix.

use std::num::NonZeroUsize;

use faer::reborrow::ReborrowMut;
use faer::{Mat, MatMut};

use super::blocks::Blocks;
use super::bounded::{Curvature, sum_of_products};
use super::cholesky;
use super::problem::Problem;

/// `G` with a damping added to its diagonal. Systems are solved by Cholesky's factor.
pub struct Dense<'a> {
    /// Lower triangle of `G`.
    pub gram: &'a Mat<f64>,
    /// Added to the diagonal.
    pub damping: Vec<f64>,
    /// Room for a factor.
    pub room: &'a mut Vec<f64>,
    /// Most threads of a factor.
    pub threads: NonZeroUsize,
}

impl Curvature for Dense<'_> {
    fn product(&self, p: &[f64], out: &mut [f64]) {
        for ((out, damping), p) in out.iter_mut().zip(&self.damping).zip(p) {
            *out = damping * p;
        }
        for (j, pj) in p.iter().enumerate() {
            let column = &self.gram.col_as_slice(j)[j..];
            let (below, p_below) = (&column[1..], &p[j + 1..]);
            out[j] += column[0] * pj + sum_of_products(below, p_below);
            if *pj != 0.0 {
                for (out, h) in out[j + 1..].iter_mut().zip(below) {
                    *out += h * pj;
                }
            }
        }
    }

    fn solve_free(&mut self, free: &[usize], right: &mut [f64]) -> bool {
        let m = free.len();
        self.room.resize(self.room.len().max(m * m), 0.0);
        let mut matrix = MatMut::from_column_major_slice_mut(&mut self.room[..m * m], m, m);
        for (b, &j) in free.iter().enumerate() {
            let from = self.gram.col_as_slice(j);
            let Some(to) = matrix.rb_mut().col_mut(b).try_as_col_major_mut() else { return false };
            let to = &mut to.as_slice_mut()[b..];
            for (to, &i) in to.iter_mut().zip(&free[b..]) {
                *to = from[i];
            }
            to[0] += self.damping[j];
        }
        if cholesky::factor(matrix.rb_mut(), self.threads).is_none() {
            return false;
        }
        let mut packed: Vec<f64> = free.iter().map(|&j| right[j]).collect();
        cholesky::solve(matrix.as_ref(), &mut packed);
        right.fill(0.0);
        for (&j, p) in free.iter().zip(packed) {
            right[j] = p;
        }
        true
    }
}

/// `S (A^T C A + B) S` with a damping, where `B` is what regions bend by their means, never formed: for more columns than a dense matrix should have. Systems are solved by
/// conjugate gradients, cut short; whatever they reach lessens the quadratic.
pub struct ByProducts<'a> {
    /// Its matrix is `A`.
    pub problem: &'a Problem,
    /// Curvature of each row at the point.
    pub curvature: &'a [f64],
    /// What regions bend by their means: a curvature and a direction over the columns each.
    pub bends: &'a [(f64, Vec<f64>)],
    /// Scale of each column.
    pub scale: &'a [f64],
    /// Its diagonal blocks.
    pub blocks: &'a Blocks,
    /// Added to the diagonal.
    pub damping: Vec<f64>,
}

/// Most iterations of conjugate gradients for one system, and the part of the right side to which they bring it.
const GRADIENTS: (usize, f64) = (150, 1e-2);

impl Curvature for ByProducts<'_> {
    fn product(&self, p: &[f64], out: &mut [f64]) {
        let matrix = self.problem.matrix();
        let scaled: Vec<f64> = p.iter().zip(self.scale).map(|(p, s)| p * s).collect();
        out.fill(0.0);
        for (row, curvature) in self.curvature.iter().enumerate().filter(|(_, c)| **c > 0.0) {
            matrix.add_outer(row, *curvature, &scaled, out);
        }
        for (bend, direction) in self.bends {
            let by = bend * sum_of_products(direction, &scaled);
            out.iter_mut().zip(direction).for_each(|(out, u)| *out += by * u);
        }
        for (j, out) in out.iter_mut().enumerate() {
            *out = *out * self.scale[j] + self.damping[j] * p[j];
        }
    }

    fn solve_free(&mut self, free: &[usize], right: &mut [f64]) -> bool {
        let n = right.len();
        let Some(factors) = self.blocks.factor(free, |j| self.damping[j]) else { return false };
        let mut inside = vec![0.0; n];
        free.iter().for_each(|&j| inside[j] = 1.0);
        let mut residual: Vec<f64> = right.iter().zip(&inside).map(|(r, inside)| r * inside).collect();
        let (mut solution, mut image, mut direction) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        factors.solve(&residual, &mut direction);
        let mut ahead = direction.clone();
        let mut square = sum_of_products(&residual, &ahead);
        let target = GRADIENTS.1 * GRADIENTS.1 * square;
        for _ in 0..GRADIENTS.0 {
            if square <= target {
                break;
            }
            self.product(&direction, &mut image);
            let bend = sum_of_products(&direction, &image);
            if bend <= 0.0 {
                break;
            }
            let t = square / bend;
            for j in 0..n {
                solution[j] += t * direction[j];
                residual[j] -= t * image[j] * inside[j];
            }
            factors.solve(&residual, &mut ahead);
            let next = sum_of_products(&residual, &ahead);
            for (direction, ahead) in direction.iter_mut().zip(&ahead) {
                *direction = ahead + next / square * *direction;
            }
            square = next;
        }
        right.copy_from_slice(&solution);
        true
    }
}
