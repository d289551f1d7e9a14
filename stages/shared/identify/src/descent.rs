//! Levenberg and Marquardt's descent of the prediction loss.

use nalgebra::{DMatrix, DVector};

use crate::companion::Companion;

const STEPS: usize = 200;
/// A step that takes off less than this part of the loss is the last.
const ENOUGH: f64 = 1e-12;

/// A model at the foot of the descent.
#[derive(Clone, Debug)]
pub struct Foot {
    pub model: Companion,
    pub loss: f64,
    /// sum psi psi^T there.
    pub curvature: DMatrix<f64>,
    pub steps: usize,
}

/// Descends from `start`; `None` where its predictor is unstable and cannot be made stable.
pub fn descend(start: &Companion, input: &[f64], output: &[f64]) -> Option<Foot> {
    let mut model = stable(start)?;
    let mut normal = model.normal(input, output);
    if !normal.loss.is_finite() {
        return None;
    }
    let mut damping = 1e-3;
    let mut steps = 0;
    while steps < STEPS {
        steps += 1;
        let Some(step) = damped(&normal.matrix, &normal.gradient, damping) else {
            damping *= 10.0;
            continue;
        };
        let next = Companion::from_parameters(&(model.parameters() - step));
        let loss =
            if is_stable(&next.predictor()) { next.predict(input, output).loss } else { f64::INFINITY };
        if loss < normal.loss {
            let taken_off = 1.0 - loss / normal.loss;
            model = next;
            normal = model.normal(input, output);
            damping = (damping * 0.1).max(1e-12);
            if taken_off < ENOUGH {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    Some(Foot { model, loss: normal.loss, curvature: normal.matrix, steps })
}

/// (H + damping diag H)^-1 g, in coordinates of unit diagonal.
fn damped(h: &DMatrix<f64>, g: &DVector<f64>, damping: f64) -> Option<DVector<f64>> {
    let scale = diagonal_scale(h);
    let n = g.len();
    let scaled =
        DMatrix::from_fn(n, n, |i, j| h[(i, j)] * scale[i] * scale[j] + if i == j { damping } else { 0.0 });
    let step = scaled.cholesky()?.solve(&g.component_mul(&scale)).component_mul(&scale);
    step.iter().all(|s| s.is_finite()).then_some(step)
}

/// The factors that make the diagonal of a matrix one; one where the diagonal is zero.
pub fn diagonal_scale(h: &DMatrix<f64>) -> DVector<f64> {
    DVector::from_fn(h.nrows(), |i, _| {
        let d = h[(i, i)];
        if d > 0.0 && d.is_finite() { 1.0 / d.sqrt() } else { 1.0 }
    })
}

/// Whether all eigenvalues are inside the unit circle.
pub fn is_stable(matrix: &DMatrix<f64>) -> bool {
    matrix.iter().all(|v| v.is_finite()) && matrix.complex_eigenvalues().iter().all(|z| z.norm() < 1.0)
}

/// The model with a stable predictor: eigenvalues outside the unit circle are mirrored into it.
fn stable(model: &Companion) -> Option<Companion> {
    let predictor = model.predictor();
    if !predictor.iter().all(|v| v.is_finite()) {
        return None;
    }
    if is_stable(&predictor) {
        return Some(model.clone());
    }
    // Of a predictor only its characteristic polynomial matters; K follows from it through the impulse response of the
    // noise model det(z - A + K C) / det(z - A).
    let n = model.order();
    let roots: Vec<_> = predictor
        .complex_eigenvalues()
        .iter()
        .map(|z| {
            let inside = if z.norm() >= 1.0 { z.conj().inv() } else { *z };
            inside * 0.98
        })
        .collect();
    let mut polynomial = vec![nalgebra::Complex::new(1.0, 0.0)];
    for root in roots {
        polynomial.push(nalgebra::Complex::new(0.0, 0.0));
        for i in (1..polynomial.len()).rev() {
            let before = polynomial[i - 1];
            polynomial[i] -= root * before;
        }
    }
    // H(z) = sum g_i z^-i with C(q) = A(q) H(q), both in falling powers.
    let a = |i: usize| if i == 0 { 1.0 } else { -model.last[n - i] };
    let mut response = vec![1.0];
    for i in 1..=n {
        let past: f64 = (1..=i).map(|j| a(j) * response[i - j]).sum();
        response.push(polynomial[i].re - past);
    }
    let gain = DVector::from_fn(n, |i, _| response[i + 1]);
    let model = Companion { gain, ..model.clone() };
    is_stable(&model.predictor()).then_some(model)
}
