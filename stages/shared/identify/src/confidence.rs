//! Poles and DC gain of a model, and how well they are known: single entries of B are not, these are.

use nalgebra::{Complex, DMatrix, DVector};
use serde::Serialize;

use crate::companion::Companion;
use crate::descent::is_stable;

/// A number and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    pub value: f64,
    pub sd: f64,
}

/// A pole of the model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pole {
    pub re: Estimate,
    pub im: Estimate,
    /// Distance from 0; 1 and more is unstable.
    pub modulus: Estimate,
}

/// The largest modulus of a pole that is accepted as an integrator's if the record cannot tell it from 1.
pub const INTEGRATOR: f64 = 1.01;

/// What a record says of a pole, at 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stability {
    /// Its modulus is below 1.
    Stable,
    /// Its modulus cannot be told from 1, and is at most [`INTEGRATOR`]: a plant that integrates has such a pole.
    Integrating,
    /// Its modulus is above 1.
    Unstable,
}

impl Pole {
    /// What the record says of it.
    #[must_use]
    pub fn stability(&self) -> Stability {
        let Estimate { value, sd } = self.modulus;
        if value + 1.96 * sd < 1.0 {
            Stability::Stable
        } else if value < 1.0 || (value <= INTEGRATOR && value - 1.96 * sd < 1.0) {
            Stability::Integrating
        } else {
            Stability::Unstable
        }
    }
}

/// The poles, by real and imaginary part, with what the covariance of the parameters says of them: for a root z of the
/// characteristic polynomial p, dz / dr_j = z^j / p'(z), r being the last row of A.
pub fn poles(model: &Companion, covariance: &DMatrix<f64>) -> Vec<Pole> {
    let n = model.order();
    let mut roots: Vec<Complex<f64>> = model.a().complex_eigenvalues().iter().copied().collect();
    roots.sort_by(|a, b| (a.re, a.im).partial_cmp(&(b.re, b.im)).unwrap_or(std::cmp::Ordering::Equal));
    let one = Complex::new(1.0, 0.0);
    roots
        .into_iter()
        .map(|z| {
            let power = |k: usize| (0..k).fold(one, |product, _| product * z);
            let slope = (1..n)
                .fold(power(n - 1) * n as f64, |sum, j| sum - power(j - 1) * (j as f64 * model.last[j]));
            let by: Vec<Complex<f64>> = (0..n).map(|j| power(j) / slope).collect();
            let sd = |part: &dyn Fn(&Complex<f64>) -> f64| {
                let gradient = DVector::from_iterator(n, by.iter().map(part));
                variance(&gradient, covariance).sqrt()
            };
            let modulus = z.norm();
            Pole {
                re: Estimate { value: z.re, sd: sd(&|d| d.re) },
                im: Estimate { value: z.im, sd: sd(&|d| d.im) },
                modulus: Estimate {
                    value: modulus,
                    sd: sd(&|d| if modulus > 0.0 { (z.re * d.re + z.im * d.im) / modulus } else { d.norm() }),
                },
            }
        })
        .collect()
}

/// C (I - A)^-1 B, and its deviation; `None` where the model is not stable: its output then settles nowhere.
pub fn dc_gain(model: &Companion, covariance: &DMatrix<f64>) -> Option<Estimate> {
    let n = model.order();
    if !is_stable(&model.a()) {
        return None;
    }
    let inverse = (DMatrix::identity(n, n) - model.a()).try_inverse()?;
    let state = &inverse * &model.input;
    // d(C M B) = C M (dA M B + dB) with M = (I - A)^-1; dA is in the last row.
    let mut gradient = DVector::zeros(2 * n);
    for j in 0..n {
        gradient[j] = inverse[(0, n - 1)] * state[j];
        gradient[n + j] = inverse[(0, j)];
    }
    Some(Estimate { value: state[0], sd: variance(&gradient, covariance).sqrt() })
}

/// g^T P g for the first numbers of the parameters.
fn variance(gradient: &DVector<f64>, covariance: &DMatrix<f64>) -> f64 {
    let n = gradient.len();
    (gradient.transpose() * covariance.view((0, 0), (n, n)) * gradient)[0].max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dvector;

    #[test]
    fn deviations_of_gain_and_poles_are_those_of_finite_differences() {
        let model = Companion {
            last: dvector![-0.665, 1.65],
            input: dvector![0.02, 0.047],
            gain: dvector![0.4, 0.35],
            start: dvector![0.3, 0.2],
        };
        // Parameters that go together, so that the signs of the gradient count.
        let root =
            DMatrix::from_fn(8, 8, |i, j| 1e-3 * (1.0 + ((3 * i + 5 * j) % 7) as f64 - 0.4 * i as f64));
        let covariance = &root * root.transpose();
        let theta = model.parameters();
        let sd = |of: &dyn Fn(&Companion) -> f64| {
            let gradient = DVector::from_fn(8, |i, _| {
                let at = |d: f64| {
                    let mut moved = theta.clone();
                    moved[i] += d;
                    of(&Companion::from_parameters(&moved))
                };
                (at(1e-6) - at(-1e-6)) / 2e-6
            });
            (gradient.transpose() * &covariance * gradient)[0].sqrt()
        };
        let zero = DMatrix::zeros(8, 8);
        let gain = sd(&|m| dc_gain(m, &zero).map_or(f64::NAN, |g| g.value));
        let found = dc_gain(&model, &covariance).unwrap();
        assert!((found.sd / gain - 1.0).abs() < 1e-6, "{found:?} {gain}");
        for (place, pole) in poles(&model, &covariance).iter().enumerate() {
            let of = sd(&|m| poles(m, &zero)[place].modulus.value);
            assert!((pole.modulus.sd / of - 1.0).abs() < 1e-5, "{pole:?} {of}");
        }
    }
}
