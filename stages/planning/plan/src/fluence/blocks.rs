//! The diagonal blocks of the Gram matrix: what conjugate gradients are preconditioned with.

use std::num::NonZeroUsize;

use faer::Mat;

use super::cholesky;
use super::problem::Problem;

/// Columns of a block. Bixels of a beam stand together, so a block is about a beam: it holds how neighbours overlap.
const WIDTH: usize = 400;
/// Fall of a diagonal, over its peak, beyond which the rest of it counts as rounding.
const FALL: f64 = 1e-6;

/// Lower triangles of the diagonal blocks of `S A^T C A S`, kept up to date as the curvatures `C` of the rows change.
#[derive(Debug)]
pub struct Blocks {
    blocks: Vec<Mat<f64>>,
    scale: Vec<f64>,
    /// Curvature with which each row stands in them.
    standing: Vec<f64>,
    /// Largest diagonal since the last rebuild.
    peak: Vec<f64>,
}

impl Blocks {
    /// No row stands in them yet.
    pub fn new(rows: usize, scale: Vec<f64>) -> Self {
        let n = scale.len();
        let size = |b: usize| WIDTH.min(n - b * WIDTH);
        let blocks = (0..n.div_ceil(WIDTH)).map(|b| Mat::zeros(size(b), size(b))).collect();
        Self { blocks, scale, standing: vec![0.0; rows], peak: vec![0.0; n] }
    }

    /// Brings them to these curvatures of the rows.
    pub fn update(&mut self, problem: &Problem, curvature: &[f64]) {
        self.change(problem, curvature);
        if (0..self.scale.len()).any(|j| self.diagonal(j) < FALL * self.peak[j]) {
            self.blocks.iter_mut().for_each(|block| block.fill(0.0));
            self.standing.fill(0.0);
            self.peak.fill(0.0);
            self.change(problem, curvature);
        }
    }

    /// Place on the diagonal.
    pub fn diagonal(&self, j: usize) -> f64 {
        self.blocks[j / WIDTH][(j % WIDTH, j % WIDTH)]
    }

    fn change(&mut self, problem: &Problem, curvature: &[f64]) {
        for (row, curvature) in curvature.iter().enumerate() {
            let change = curvature - self.standing[row];
            if change != 0.0 {
                self.standing[row] = *curvature;
                self.add(problem, row, change);
            }
        }
        for j in 0..self.peak.len() {
            self.peak[j] = self.peak[j].max(self.diagonal(j));
        }
    }

    /// Adds `change * a a^T` for the row `a`.
    fn add(&mut self, problem: &Problem, row: usize, change: f64) {
        let (mut columns, mut values) = problem.matrix().row(row);
        let mut scaled = [0.0; WIDTH];
        while let Some(first) = columns.first() {
            let b = *first as usize / WIDTH;
            let end = columns.partition_point(|c| (*c as usize) < (b + 1) * WIDTH);
            let (mine, rest) = columns.split_at(end);
            let (mine_values, rest_values) = values.split_at(end);
            for ((scaled, c), v) in scaled.iter_mut().zip(mine).zip(mine_values) {
                *scaled = self.scale[*c as usize] * f64::from(*v);
            }
            for (k, j) in mine.iter().enumerate() {
                let column = self.blocks[b].col_as_slice_mut(*j as usize - b * WIDTH);
                let by = change * scaled[k];
                for (i, value) in mine[k..].iter().zip(&scaled[k..end]) {
                    column[*i as usize - b * WIDTH] += by * value;
                }
            }
            (columns, values) = (rest, rest_values);
        }
    }

    /// Factors of the blocks on the face of the `free` places, with `damping` added to the diagonal.
    pub fn factor(&self, free: &[usize], damping: impl Fn(usize) -> f64) -> Option<Factors> {
        let mut factors = Vec::new();
        let mut free = free;
        while let Some(first) = free.first() {
            let b = first / WIDTH;
            let (mine, rest) = free.split_at(free.partition_point(|j| *j < (b + 1) * WIDTH));
            let mut matrix = Mat::zeros(mine.len(), mine.len());
            for (k, j) in mine.iter().enumerate() {
                let (from, to) = (self.blocks[b].col_as_slice(j - b * WIDTH), matrix.col_as_slice_mut(k));
                for (to, i) in to[k..].iter_mut().zip(&mine[k..]) {
                    *to = from[i - b * WIDTH];
                }
                to[k] += damping(*j);
            }
            cholesky::factor(matrix.as_mut(), NonZeroUsize::MIN)?;
            factors.push((mine.to_vec(), matrix));
            free = rest;
        }
        Some(Factors { factors })
    }
}

/// Factors of blocks on a face.
#[derive(Debug)]
pub struct Factors {
    /// Places of the face, with the factor of their block.
    factors: Vec<(Vec<usize>, Mat<f64>)>,
}

impl Factors {
    /// Solves for the places of the face; the others become zero.
    pub fn solve(&self, right: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (places, factor) in &self.factors {
            let mut packed: Vec<f64> = places.iter().map(|j| right[*j]).collect();
            cholesky::solve(factor.as_ref(), &mut packed);
            for (j, value) in places.iter().zip(packed) {
                out[*j] = value;
            }
        }
    }
}
