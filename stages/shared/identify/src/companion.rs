//! The innovation form (4.10) in companion form: x(k+1) = A x + B u + K e, y = C x + e.
//!
//! A shifts and has `last` as its last row, and C = [1 0 ...], the form that (4.11) is printed in. So A has n free
//! numbers, B and K have n each, and no model is there twice.

use nalgebra::{DMatrix, DVector};

/// A model in companion form, with the state that it starts in.
#[derive(Clone, Debug, PartialEq)]
pub struct Companion {
    /// The last row of A.
    pub last: DVector<f64>,
    pub input: DVector<f64>,
    /// K.
    pub gain: DVector<f64>,
    /// The state before the first sample.
    pub start: DVector<f64>,
}

/// What a model predicts of a record, one sample ahead.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// e(k) = y(k) - C x(k).
    pub errors: Vec<f64>,
    /// V = 1/2 sum e^2.
    pub loss: f64,
}

/// The normal equations of a prediction: with psi = d e / d theta, sum psi psi^T and sum psi e.
#[derive(Clone, Debug, PartialEq)]
pub struct Normal {
    pub matrix: DMatrix<f64>,
    /// sum psi e, the gradient of the loss.
    pub gradient: DVector<f64>,
    pub loss: f64,
}

impl Companion {
    /// The number of states.
    #[must_use]
    pub fn order(&self) -> usize {
        self.last.len()
    }

    #[must_use]
    pub fn a(&self) -> DMatrix<f64> {
        let n = self.order();
        DMatrix::from_fn(n, n, |i, j| match i + 1 == n {
            true => self.last[j],
            false => f64::from(u8::from(j == i + 1)),
        })
    }

    /// A - K C, which drives the predictor.
    #[must_use]
    pub fn predictor(&self) -> DMatrix<f64> {
        let mut a = self.a();
        for i in 0..self.order() {
            a[(i, 0)] -= self.gain[i];
        }
        a
    }

    /// theta: the last row of A, B, K and the start, one behind the other.
    #[must_use]
    pub fn parameters(&self) -> DVector<f64> {
        let parts = [&self.last, &self.input, &self.gain, &self.start];
        DVector::from_iterator(4 * self.order(), parts.into_iter().flat_map(|p| p.iter().copied()))
    }

    /// The model of these parameters.
    #[must_use]
    pub fn from_parameters(theta: &DVector<f64>) -> Self {
        let n = theta.len() / 4;
        let part = |k: usize| theta.rows(k * n, n).into_owned();
        Self { last: part(0), input: part(1), gain: part(2), start: part(3) }
    }

    fn step(&self, x: &mut DVector<f64>, u: f64, e: f64) {
        let n = self.order();
        let bottom = self.last.dot(x);
        for i in 0..n {
            let shifted = if i + 1 < n { x[i + 1] } else { bottom };
            x[i] = shifted + self.input[i] * u + self.gain[i] * e;
        }
    }

    /// Predicts a record one sample ahead; the errors are what the record says beyond that.
    #[must_use]
    pub fn predict(&self, input: &[f64], output: &[f64]) -> Prediction {
        let mut x = self.start.clone();
        let mut errors = Vec::with_capacity(output.len());
        let mut loss = 0.0;
        for (u, y) in input.iter().zip(output) {
            let e = y - x[0];
            loss += 0.5 * e * e;
            errors.push(e);
            self.step(&mut x, *u, e);
        }
        Prediction { errors, loss }
    }

    /// The output that the input alone makes, from the start on.
    #[must_use]
    pub fn simulate(&self, input: &[f64]) -> Vec<f64> {
        let mut x = self.start.clone();
        let mut output = Vec::with_capacity(input.len());
        for u in input {
            output.push(x[0]);
            self.step(&mut x, *u, 0.0);
        }
        output
    }

    /// The normal equations of the prediction errors, by the sensitivity of the state: each column of X = dx / dtheta
    /// obeys the predictor, driven by what its parameter multiplies.
    #[must_use]
    pub fn normal(&self, input: &[f64], output: &[f64]) -> Normal {
        let n = self.order();
        let predictor = self.predictor();
        let mut x = self.start.clone();
        let mut sensitivity = DMatrix::zeros(n, 4 * n);
        for i in 0..n {
            sensitivity[(i, 3 * n + i)] = 1.0;
        }
        let mut next = sensitivity.clone();
        let mut normal =
            Normal { matrix: DMatrix::zeros(4 * n, 4 * n), gradient: DVector::zeros(4 * n), loss: 0.0 };
        for (u, y) in input.iter().zip(output) {
            let e = y - x[0];
            normal.loss += 0.5 * e * e;
            // psi = d e / d theta = -C X.
            let psi = sensitivity.row(0).transpose();
            normal.matrix.ger(1.0, &psi, &psi, 1.0);
            normal.gradient.axpy(-e, &psi, 1.0);
            next.gemm(1.0, &predictor, &sensitivity, 0.0);
            for j in 0..n {
                next[(n - 1, j)] += x[j];
                next[(j, n + j)] += u;
                next[(j, 2 * n + j)] += e;
            }
            std::mem::swap(&mut sensitivity, &mut next);
            self.step(&mut x, *u, e);
        }
        normal
    }
}
