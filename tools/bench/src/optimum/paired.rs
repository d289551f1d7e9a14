//! Two methods on the same pelves: their differences, and a sign test.

/// Differences of one method to another, pelvis by pelvis.
pub struct Paired {
    better: u32,
    worse: u32,
    mean: f64,
}

impl Paired {
    /// Of figures of which lower is better, in the same order.
    pub fn new(one: &[f64], other: &[f64]) -> Self {
        let differences: Vec<f64> =
            one.iter().zip(other).map(|(a, b)| a - b).filter(|d| !d.is_nan()).collect();
        let count = |sign: fn(&f64) -> bool| differences.iter().filter(|d| sign(d)).count() as u32;
        Self {
            // Equal to rounding of the solver is no difference.
            better: count(|d| *d < -1e-3),
            worse: count(|d| *d > 1e-3),
            mean: differences.iter().sum::<f64>() / differences.len().max(1) as f64,
        }
    }

    /// Two-sided probability of as uneven signs or more if both were as good: the sign test, ties left out.
    pub fn probability(&self) -> f64 {
        let (n, few) = (self.better + self.worse, self.better.min(self.worse));
        let (mut term, mut sum) = (1.0, 0.0);
        for k in 0..=few {
            sum += term;
            term *= f64::from(n - k) / f64::from(k + 1);
        }
        (2.0 * sum / 2.0_f64.powi(n as i32)).min(1.0)
    }

    /// As text.
    pub fn told(&self) -> String {
        format!("{:+.2} ({}:{}, p {:.2})", self.mean, self.better, self.worse, self.probability())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sign_test_is_that_of_the_binomial_distribution() {
        let probability = |better, worse| Paired { better, worse, mean: 0.0 }.probability();
        assert_eq!(probability(0, 0), 1.0);
        assert_eq!(probability(3, 3), 1.0);
        assert_eq!(probability(6, 0), 2.0 / 64.0);
        assert_eq!(probability(1, 7), 2.0 * 9.0 / 256.0);
    }

    #[test]
    fn ties_count_for_neither() {
        let paired = Paired::new(&[1.0, 2.0, 3.0], &[1.0, 2.5, 2.9]);
        assert_eq!((paired.better, paired.worse), (1, 1));
    }
}
