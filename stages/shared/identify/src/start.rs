//! Models to start from, found by least squares.

use nalgebra::{DMatrix, DVector};

use crate::companion::Companion;

/// An ARX model by least squares: y(k) = -a1 y(k-1) - ... - an y(k-n) + b1 u(k-1) + ... + bn u(k-n) + e(k).
/// Gives (a, b); `None` where the record does not determine them.
#[must_use]
pub fn arx(input: &[f64], output: &[f64], order: usize) -> Option<(DVector<f64>, DVector<f64>)> {
    let n = order;
    let mut matrix = DMatrix::<f64>::zeros(2 * n, 2 * n);
    let mut right = DVector::<f64>::zeros(2 * n);
    let mut row = DVector::<f64>::zeros(2 * n);
    for k in n..output.len().min(input.len()) {
        for i in 0..n {
            row[i] = -output[k - 1 - i];
            row[n + i] = input[k - 1 - i];
        }
        matrix.ger(1.0, &row, &row, 1.0);
        right.axpy(output[k], &row, 1.0);
    }
    let theta = solve(&matrix, &right)?;
    Some((theta.rows(0, n).into_owned(), theta.rows(n, n).into_owned()))
}

/// Solves a symmetric system scaled to a unit diagonal; directions without information in the record get zero.
fn solve(matrix: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let scale = DVector::from_fn(right.len(), |i, _| {
        let d = matrix[(i, i)];
        if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 }
    });
    let scaled = DMatrix::from_fn(right.len(), right.len(), |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let svd = scaled.svd(true, true);
    let solved = svd.solve(&right.component_mul(&scale), 1e-13).ok()?;
    let theta = solved.component_mul(&scale);
    theta.iter().all(|t| t.is_finite()).then_some(theta)
}

/// First `count` numbers of the impulse responses of an ARX model to its input and to its noise.
fn impulses(a: &DVector<f64>, b: &DVector<f64>, count: usize) -> (Vec<f64>, Vec<f64>) {
    let (mut h, mut g) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for k in 1..=count {
        let past = |of: &[f64]| (1..=a.len().min(k - 1)).map(|i| a[i - 1] * of[k - 1 - i]).sum::<f64>();
        let (from_input, from_noise) = (past(&h), past(&g));
        h.push(b.get(k - 1).copied().unwrap_or(0.0) - from_input);
        // 1 / A(q) begins with 1 at k = 0.
        g.push(-a.get(k - 1).copied().unwrap_or(0.0) - from_noise);
    }
    (h, g)
}

/// The ARX model of this order itself. In companion form B and K are the first n impulse responses to input and noise.
pub fn short_arx(input: &[f64], output: &[f64], order: usize) -> Option<Companion> {
    let (a, b) = arx(input, output, order)?;
    let (h, g) = impulses(&a, &b, order);
    Some(Companion {
        last: DVector::from_fn(order, |j, _| -a[order - 1 - j]),
        input: DVector::from_vec(h),
        gain: DVector::from_vec(g),
        start: DVector::zeros(order),
    })
}

/// A long ARX model, reduced to this order by Ho and Kalman's realisation: noise that is not of ARX form bends the
/// short model, and much less the long one.
pub fn reduced_arx(input: &[f64], output: &[f64], order: usize) -> Option<Companion> {
    let long = (8 * order).clamp(12, 40).min(output.len() / 8);
    if long < 2 * order {
        return None;
    }
    let (a, b) = arx(input, output, long)?;
    let half = long;
    let (h, g) = impulses(&a, &b, 2 * half);
    // Hankel matrix of the responses to (input, noise): rows of y(k+i), columns of what came j before.
    let hankel = |shift: usize| {
        DMatrix::from_fn(half, 2 * half, |i, j| {
            let k = i + j / 2 + shift;
            let of = if j % 2 == 0 { &h } else { &g };
            of.get(k).copied().unwrap_or(0.0)
        })
    };
    let svd = hankel(0).svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?);
    let mut best: Vec<usize> = (0..svd.singular_values.len()).collect();
    best.sort_by(|i, j| svd.singular_values[*j].total_cmp(&svd.singular_values[*i]));
    best.truncate(order);
    let root = |k: usize| svd.singular_values[best[k]].sqrt();
    if best.len() < order || root(order - 1).is_nan() || root(order - 1) <= 0.0 {
        return None;
    }
    let observe = DMatrix::from_fn(half, order, |i, k| u[(i, best[k])] * root(k));
    let reach = DMatrix::from_fn(order, 2, |k, j| v[(best[k], j)] * root(k));
    let left = DMatrix::from_fn(order, half, |k, i| u[(i, best[k])] / root(k));
    let right = DMatrix::from_fn(2 * half, order, |j, k| v[(best[k], j)] / root(k));
    let a = left * hankel(1) * right;
    to_companion(&a, &reach, &observe.row(0).into_owned())
}

/// x' = T x with T = (C; C A; ...) brings a model into companion form.
fn to_companion(a: &DMatrix<f64>, reach: &DMatrix<f64>, c: &nalgebra::RowDVector<f64>) -> Option<Companion> {
    let n = a.nrows();
    let mut t = DMatrix::zeros(n, n);
    let mut row = c.clone();
    for i in 0..n {
        t.set_row(i, &row);
        row *= a;
    }
    let back = t.clone().try_inverse()?;
    let companion = &t * a * back;
    let reach = &t * reach;
    let model = Companion {
        last: companion.row(n - 1).transpose(),
        input: reach.column(0).into_owned(),
        gain: reach.column(1).into_owned(),
        start: DVector::zeros(n),
    };
    model.parameters().iter().all(|p| p.is_finite()).then_some(model)
}
