//! Selection, policy and noise of the tree search: (5.5)-(5.8), as SCIENCE G2 and G5 correct them.

use chacha20::ChaCha8Rng;
use rand::RngExt as _;

/// The bound with a prior, `Q + c P sqrt(sum N) / (1 + N)`; `all_visits` is the sum over the children.
pub fn puct(q: f64, prior: f64, visits: u32, all_visits: u32, c: f64) -> f64 {
    q + c * prior * f64::from(all_visits).sqrt() / (1.0 + f64::from(visits))
}

/// Probabilities that grow with the exponential of the scores.
pub fn softmax(scores: &[f64]) -> Vec<f64> {
    let top = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let powers: Vec<f64> = scores.iter().map(|score| libm::exp(score - top)).collect();
    let sum: f64 = powers.iter().sum();
    powers.into_iter().map(|power| power / sum).collect()
}

/// A draw of the symmetric Dirichlet distribution of `count` parts: noise for the priors of a root.
pub fn dirichlet(count: usize, alpha: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let parts: Vec<f64> = (0..count).map(|_| gamma(alpha, rng)).collect();
    let sum: f64 = parts.iter().sum();
    if sum > 0.0 {
        parts.into_iter().map(|part| part / sum).collect()
    } else {
        vec![1.0 / count.max(1) as f64; count]
    }
}

/// A draw of the gamma distribution, by Marsaglia and Tsang (ACM Trans. Math. Softw. 26 (2000) 363).
fn gamma(shape: f64, rng: &mut ChaCha8Rng) -> f64 {
    if shape < 1.0 {
        let power = libm::pow(uniform(rng), 1.0 / shape);
        return gamma(shape + 1.0, rng) * power;
    }
    let d = shape - 1.0 / 3.0;
    let c = 1.0 / (9.0 * d).sqrt();
    loop {
        let (radius, angle) = (uniform(rng), uniform(rng));
        let x = (-2.0 * libm::log(radius)).sqrt() * libm::cos(std::f64::consts::TAU * angle);
        let v = (1.0 + c * x) * (1.0 + c * x) * (1.0 + c * x);
        if v > 0.0 && libm::log(uniform(rng)) < 0.5 * x * x + d - d * v + d * libm::log(v) {
            return d * v;
        }
    }
}

/// Above 0, below 1.
fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    loop {
        let u: f64 = rng.random();
        if u > 0.0 {
            return u;
        }
    }
}
