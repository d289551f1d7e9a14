//! A convex quadratic over numbers that are not negative.

/// A symmetric positive definite matrix, by what a solver asks of it.
pub trait Curvature {
    /// `out = H p`.
    fn product(&self, p: &[f64], out: &mut [f64]);
    /// Solves `H_FF p_F = right_F` over the `free` places, in place; the other places become zero. It may be inexact,
    /// as long as `p` lessens the quadratic. `false` where it cannot.
    fn solve_free(&mut self, free: &[usize], right: &mut [f64]) -> bool;
}

/// How far [`minimise`] goes.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Most systems that it solves.
    pub solves: usize,
    /// Ends where the violation of the conditions of the optimum has fallen to this part of that at the start.
    pub reduction: f64,
}

/// What [`minimise`] reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    /// By how much the quadratic is less.
    pub decrease: f64,
    /// Whether the violation fell as far as it should.
    pub solved: bool,
}

/// Parts of a step that are tried along its projection before the step is cut.
const PARTS: [f64; 7] = [1.0, 0.4, 0.16, 0.06, 0.025, 0.01, 0.004];

/// Lessens `g^T (z - x) + (z - x)^T H (z - x) / 2` over `z >= 0`, from `z = x`; `gradient` is `g` at `x`.
///
/// Solves on the face of the places that are positive or pulled inwards, and goes along the projected way there.
/// Where that does not lessen the quadratic, places at their bound that would leave it outwards are taken off the face,
/// then the step is cut at the first bound.
pub fn minimise(
    h: &mut impl Curvature,
    gradient: &[f64],
    x: &[f64],
    effort: Effort,
    z: &mut [f64],
) -> Reached {
    let n = x.len();
    z.copy_from_slice(x);
    let mut point = Point { value: 0.0, residual: gradient.to_vec() };
    let mut other = Point { value: 0.0, residual: vec![0.0; n] };
    let target = effort.reduction * violation(z, gradient);
    let (mut step, mut trial, mut away) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut face: Option<Vec<usize>> = None;
    for _ in 0..effort.solves {
        if violation(z, &point.residual) <= target {
            break;
        }
        let free = face
            .take()
            .unwrap_or_else(|| (0..n).filter(|&j| z[j] > 0.0 || point.residual[j] < 0.0).collect());
        for (step, r) in step.iter_mut().zip(&point.residual) {
            *step = -r;
        }
        if !h.solve_free(&free, &mut step) {
            break;
        }
        let mut found = PARTS.iter().any(|part| {
            for j in 0..n {
                trial[j] = (z[j] + part * step[j]).max(0.0);
            }
            other.evaluate(h, gradient, x, &trial, &mut away);
            other.value < point.value
        });
        if !found {
            let outward = |j: usize| z[j] == 0.0 && step[j] < 0.0;
            if free.iter().any(|&j| outward(j)) {
                face = Some(free.into_iter().filter(|&j| !outward(j)).collect());
                continue;
            }
            let bound = |j: usize| if step[j] < 0.0 { -z[j] / step[j] } else { f64::INFINITY };
            let longest = free.iter().map(|&j| bound(j)).fold(1.0, f64::min);
            for j in 0..n {
                trial[j] = if bound(j) <= longest { 0.0 } else { z[j] + longest * step[j] };
            }
            other.evaluate(h, gradient, x, &trial, &mut away);
            found = other.value < point.value;
        }
        if !found {
            break;
        }
        z.copy_from_slice(&trial);
        std::mem::swap(&mut point, &mut other);
    }
    Reached { decrease: -point.value, solved: violation(z, &point.residual) <= target }
}

/// The quadratic and its gradient at a place.
struct Point {
    value: f64,
    residual: Vec<f64>,
}

impl Point {
    fn evaluate(&mut self, h: &impl Curvature, gradient: &[f64], x: &[f64], at: &[f64], away: &mut [f64]) {
        for ((away, at), x) in away.iter_mut().zip(at).zip(x) {
            *away = at - x;
        }
        h.product(away, &mut self.residual);
        self.value = 0.0;
        for ((residual, gradient), away) in self.residual.iter_mut().zip(gradient).zip(away) {
            *residual += gradient;
            self.value += 0.5 * (gradient + *residual) * *away;
        }
    }
}

/// Largest violation of the conditions of the optimum: the distance to the projected gradient step.
pub fn violation(x: &[f64], gradient: &[f64]) -> f64 {
    x.iter().zip(gradient).map(|(x, g)| if *g > 0.0 { g.min(*x) } else { -g }).fold(0.0, f64::max)
}

/// Eight sums, so that additions overlap, joined in a fixed order.
pub fn sum_of_products(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let ((a_chunks, a_rest), (b_chunks, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a_chunks.iter().zip(b_chunks) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}
