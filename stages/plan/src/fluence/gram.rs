//! The Gram matrix of the rows whose terms are active, kept up to date as they change.

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, Par};

use super::problem::Problem;

/// Rows that enter the product together.
const PANEL: usize = 128;
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
}

impl Gram {
    /// No row stands in it yet.
    pub fn new(rows: usize, scale: Vec<f64>) -> Self {
        let n = scale.len();
        Self { matrix: Mat::zeros(n, n), scale, standing: vec![0.0; rows], peak: vec![0.0; n] }
    }

    /// Updates it to the curvatures at these doses: only rows that changed are added or removed, unless so much has
    /// been removed that the rest would be rounding.
    pub fn update(&mut self, problem: &Problem, dose: &[f64]) {
        self.change(problem, dose);
        let fell = self.diagonal().zip(&self.peak).any(|(now, peak)| now < FALL * peak);
        if fell {
            self.matrix.fill(0.0);
            self.standing.fill(0.0);
            self.peak.fill(0.0);
            self.change(problem, dose);
        }
    }

    /// Diagonal of `G`, not negative.
    pub fn diagonal(&self) -> impl Iterator<Item = f64> {
        (0..self.scale.len()).map(|j| self.matrix[(j, j)].max(0.0))
    }

    fn change(&mut self, problem: &Problem, dose: &[f64]) {
        let (mut enter, mut leave) = (Vec::new(), Vec::new());
        for (row, standing) in self.standing.iter_mut().enumerate() {
            let curvature = problem.curvature(row, dose[row]);
            let change = curvature - *standing;
            if change > 0.0 {
                enter.push((row, change));
            } else if change < 0.0 {
                leave.push((row, -change));
            }
            *standing = curvature;
        }
        for panel in enter.chunks(PANEL) {
            self.add(problem, panel, 1.0);
        }
        for j in 0..self.peak.len() {
            self.peak[j] = self.peak[j].max(self.matrix[(j, j)]);
        }
        for panel in leave.chunks(PANEL) {
            self.add(problem, panel, -1.0);
        }
    }

    /// Adds `sign * change * a a^T` for each row.
    ///
    /// Rows that follow each other are voxels side by side: the few columns that any of them has are packed together,
    /// and the product is of those alone.
    fn add(&mut self, problem: &Problem, rows: &[(usize, f64)], sign: f64) {
        let mut touched = vec![false; self.scale.len()];
        for (row, _) in rows {
            problem.matrix().row(*row).0.iter().for_each(|c| touched[*c as usize] = true);
        }
        let columns: Vec<usize> = (0..touched.len()).filter(|j| touched[*j]).collect();
        let mut place = vec![0; touched.len()];
        columns.iter().enumerate().for_each(|(k, j)| place[*j] = k);
        let mut panel = Mat::<f64>::zeros(columns.len(), rows.len());
        for (k, (row, change)) in rows.iter().enumerate() {
            let (column, root) = (panel.col_as_slice_mut(k), change.sqrt());
            let (columns, values) = problem.matrix().row(*row);
            for (c, v) in columns.iter().zip(values) {
                column[place[*c as usize]] = root * self.scale[*c as usize] * f64::from(*v);
            }
        }
        let mut packed = Mat::<f64>::zeros(columns.len(), columns.len());
        triangular::matmul(
            packed.as_mut(),
            BlockStructure::TriangularLower,
            Accum::Replace,
            panel.as_ref(),
            BlockStructure::Rectangular,
            panel.transpose(),
            BlockStructure::Rectangular,
            sign,
            Par::Seq,
        );
        for (k, j) in columns.iter().enumerate() {
            let (from, to) = (&packed.col_as_slice(k)[k..], self.matrix.col_as_slice_mut(*j));
            for (from, i) in from.iter().zip(&columns[k..]) {
                to[*i] += from;
            }
        }
    }
}
