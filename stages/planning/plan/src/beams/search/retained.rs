//! The beams that stay, and what a beam beside them is expected to cost.

use super::super::prior::standardised;
use super::super::ring::Ring;
use super::formulas::softmax;

/// The cost that a beam takes off grows with this power of its price.
const POWER: f64 = 0.5;
/// How far an error of the expectation reaches to neighbouring angles, degrees.
const REACH_DEG: f64 = 10.0;
/// Scores are sharpened by this much before they become probabilities.
const SHARPNESS: f64 = 1.5;

/// The beams that stay of a set, with every beam that may join them.
#[derive(Clone, Debug)]
pub struct Retained {
    /// Beams that may join, rising.
    pub candidates: Vec<u16>,
    /// Probability of each, by prices and prior.
    pub probability: Vec<f64>,
    /// Cost of the beams that stay, and the price of each candidate beside them; none where they were not solved.
    pub priced: Option<(f64, Vec<f64>)>,
}

impl Retained {
    /// From prices and scores with their weights. Without either all candidates are alike.
    pub fn new(
        candidates: Vec<u16>,
        priced: Option<(f64, Vec<f64>)>,
        price_weight: f64,
        scores: Option<(f64, Vec<f64>)>,
    ) -> Self {
        let mut sum = vec![0.0; candidates.len()];
        let mut add = |weight: f64, values: &[f64]| {
            let scaled = standardised(values);
            sum.iter_mut().zip(scaled).for_each(|(sum, value)| *sum += SHARPNESS * weight * value);
        };
        if let Some((_, prices)) = &priced {
            let roots: Vec<f64> = prices.iter().map(|price| price.sqrt()).collect();
            add(price_weight, &roots);
        }
        if let Some((weight, scores)) = &scores {
            add(*weight, scores);
        }
        Self { candidates, probability: softmax(&sum), priced }
    }

    /// The cost of the set with each candidate, expected from the sets with the same beams that were solved (places of
    /// their candidates, and costs). None without prices or without such a set.
    ///
    /// A beam of price `p` takes `k p^0.5` off; `k` is the geometric mean over the solved sets, and errors of the
    /// expectation are carried to neighbouring angles.
    pub fn expected(&self, ring: Ring, solved: &[(usize, f64)]) -> Option<Vec<f64>> {
        let (cost, prices) = self.priced.as_ref()?;
        let factor = |(at, known): &(usize, f64)| {
            let (gain, power) = (cost - known, libm::pow(prices[*at], POWER));
            (gain > 0.0 && power > 0.0).then(|| libm::log(gain / power))
        };
        let factors: Vec<f64> = solved.iter().filter_map(factor).collect();
        if factors.is_empty() || !cost.is_finite() {
            return None;
        }
        let k = libm::exp(factors.iter().sum::<f64>() / factors.len() as f64);
        let plain: Vec<f64> = prices.iter().map(|price| cost - k * libm::pow(*price, POWER)).collect();
        let corrected = |at: usize| {
            let (mut sum, mut weights) = (0.0, 0.0);
            for (other, known) in solved {
                let steps = ring.steps_between(self.candidates[at], self.candidates[*other]);
                let far = f64::from(steps) * ring.step_deg() / REACH_DEG;
                let weight = libm::exp(-0.5 * far * far);
                sum += weight * (known - plain[*other]);
                weights += weight;
            }
            plain[at] + sum / weights.max(1.0)
        };
        Some((0..plain.len()).map(corrected).collect())
    }
}
