//! The Gram matrix of the rows whose terms are active, kept up to date as they change.

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::reborrow::ReborrowMut;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::problem::Problem;
use crate::threads::with_each;

/// Rows that enter the product together. Where a product is large, more rows share its way to memory.
const PANEL: usize = 128;
const LARGE_PANEL: usize = 512;
/// Columns from which a product is large.
const LARGE: usize = 2048;
/// Fall of a diagonal, over its peak, beyond which the rest of it counts as rounding.
const FALL: f64 = 1e-6;

/// `G = S A^T C A S` with the curvatures `C` of the rows and a scale `S` of the columns. The lower triangle is kept.
#[derive(Debug)]
pub struct Gram {
    /// Lower triangle of `G`.
    pub matrix: Mat<f64>,
    scale: Vec<f64>,
    /// Curvature with which each row stands in `G`.
    standing: Vec<f64>,
    /// Largest diagonal since the last rebuild.
    peak: Vec<f64>,
    /// What regions bend by their means, as it stands in `G`: directions are scaled.
    bends: Vec<(f64, Vec<f64>)>,
    /// Room for a panel of rows, and for its product.
    panel: Vec<f64>,
    packed: Vec<f64>,
}

impl Gram {
    /// No row stands in it yet.
    pub fn new(rows: usize, scale: Vec<f64>) -> Self {
        let n = scale.len();
        let (bends, panel, packed) = Default::default();
        let (matrix, standing, peak) = (Mat::zeros(n, n), vec![0.0; rows], vec![0.0; n]);
        Self { matrix, scale, standing, peak, bends, panel, packed }
    }

    /// Updates it to the curvatures at these doses: only rows that changed are added or removed, unless so much has
    /// been removed that the rest would be rounding.
    pub fn update(&mut self, problem: &Problem, dose: &[f64]) {
        for (bend, direction) in std::mem::take(&mut self.bends) {
            add_outer(&mut self.matrix, -bend, &direction);
        }
        self.change(problem, dose);
        let fell = self.diagonal().zip(&self.peak).any(|(now, peak)| now < FALL * peak);
        if fell {
            self.matrix.fill(0.0);
            self.standing.fill(0.0);
            self.peak.fill(0.0);
            self.change(problem, dose);
        }
        self.bends = problem.bends(dose);
        for (bend, direction) in &mut self.bends {
            direction.iter_mut().zip(&self.scale).for_each(|(u, scale)| *u *= scale);
            add_outer(&mut self.matrix, *bend, direction);
        }
        if !self.bends.is_empty() {
            (0..self.peak.len()).for_each(|j| self.peak[j] = self.peak[j].max(self.matrix[(j, j)]));
        }
    }

    /// Diagonal of `G`, not negative.
    pub fn diagonal(&self) -> impl Iterator<Item = f64> {
        (0..self.scale.len()).map(|j| self.matrix[(j, j)].max(0.0))
    }

    fn change(&mut self, problem: &Problem, dose: &[f64]) {
        let (mut enter, mut leave) = (Vec::new(), Vec::new());
        let curvatures = problem.curvatures(dose);
        for (row, (standing, curvature)) in self.standing.iter_mut().zip(curvatures).enumerate() {
            let change = curvature - *standing;
            if change > 0.0 {
                enter.push((row, change));
            } else if change < 0.0 {
                leave.push((row, -change));
            }
            *standing = curvature;
        }
        let together = if self.scale.len() < LARGE { PANEL } else { LARGE_PANEL };
        for panel in enter.chunks(together) {
            self.add(problem, panel, 1.0);
        }
        for j in 0..self.peak.len() {
            self.peak[j] = self.peak[j].max(self.matrix[(j, j)]);
        }
        for panel in leave.chunks(together) {
            self.add(problem, panel, -1.0);
        }
    }

    /// Adds `sign * change * a a^T` for each row.
    ///
    /// Rows that follow each other are voxels side by side: the few columns that any of them has are packed together,
    /// and the product is of those alone. Threads share it by its columns.
    fn add(&mut self, problem: &Problem, rows: &[(usize, f64)], sign: f64) {
        let Self { matrix, scale, panel, packed, .. } = self;
        let mut touched = vec![false; scale.len()];
        for (row, _) in rows {
            problem.matrix().row(*row).0.iter().for_each(|c| touched[*c as usize] = true);
        }
        let columns: Vec<usize> = (0..touched.len()).filter(|j| touched[*j]).collect();
        let mut place = vec![0; touched.len()];
        columns.iter().enumerate().for_each(|(k, j)| place[*j] = k);
        let m = columns.len();
        if m == 0 {
            return;
        }
        panel.clear();
        panel.resize(m * rows.len(), 0.0);
        for ((row, change), column) in rows.iter().zip(panel.chunks_exact_mut(m)) {
            let root = change.sqrt();
            let (columns, values) = problem.matrix().row(*row);
            for (c, v) in columns.iter().zip(values) {
                column[place[*c as usize]] = root * scale[*c as usize] * f64::from(*v);
            }
        }
        let panel = MatRef::from_column_major_slice(panel, m, rows.len());
        let mut tiles = Vec::new();
        let (mut left, mut first) = (matrix.as_mut(), 0);
        let most: usize = (0..m).step_by(TILE).map(|at| (m - at) * TILE.min(m - at)).sum();
        packed.resize(most.max(packed.len()), 0.0);
        let mut buffer = &mut packed[..];
        for at in (0..m).step_by(TILE) {
            let end = columns.get(at + TILE).copied().unwrap_or(scale.len());
            let (mine, rest) = left.split_at_col_mut(end - first);
            let (own, others) = buffer.split_at_mut((m - at) * TILE.min(m - at));
            tiles.push(Tile { at, first, matrix: mine, packed: own });
            (left, buffer, first) = (rest, others, end);
        }
        with_each(tiles, problem.threads(), |tile| tile.add(panel, &columns, sign));
    }
}

/// Adds `by u u^T` to the lower triangle.
fn add_outer(matrix: &mut Mat<f64>, by: f64, u: &[f64]) {
    for (j, uj) in u.iter().enumerate().filter(|(_, uj)| **uj != 0.0) {
        let column = &mut matrix.col_as_slice_mut(j)[j..];
        column.iter_mut().zip(&u[j..]).for_each(|(entry, ui)| *entry += by * uj * ui);
    }
}

/// Columns of a tile of a product. It bounds what is added to where, so it decides the last bits of the sums.
const TILE: usize = 512;

/// Some columns of the Gram matrix, to which a panel adds.
struct Tile<'a> {
    /// Its first column among those of the panel, and in the matrix.
    at: usize,
    first: usize,
    matrix: MatMut<'a, f64>,
    /// Room for its product.
    packed: &'a mut [f64],
}

impl Tile<'_> {
    fn add(self, panel: MatRef<'_, f64>, columns: &[usize], sign: f64) {
        let Self { at, first, mut matrix, packed } = self;
        let (below, width) = (columns.len() - at, packed.len() / (columns.len() - at));
        let mut product = MatMut::from_column_major_slice_mut(packed, below, width);
        let own = panel.subrows(at, width);
        let (upper, lower) = product.as_mut().split_at_row_mut(width);
        triangular::matmul(
            upper,
            BlockStructure::TriangularLower,
            Accum::Replace,
            own,
            BlockStructure::Rectangular,
            own.transpose(),
            BlockStructure::Rectangular,
            sign,
            Par::Seq,
        );
        matmul(
            lower,
            Accum::Replace,
            panel.subrows(at + width, below - width),
            own.transpose(),
            sign,
            Par::Seq,
        );
        for (k, j) in columns[at..at + width].iter().enumerate() {
            let (from, to) = (&packed[k * below..][k..below], matrix.rb_mut().col_mut(j - first));
            let Some(to) = to.try_as_col_major_mut() else { continue };
            let to = to.as_slice_mut();
            for (from, i) in from.iter().zip(&columns[at + k..]) {
                to[*i] += from;
            }
        }
    }
}
