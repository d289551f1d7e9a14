//! Two methods on the same pelves: their differences, the sign test, and Wilcoxon's signed-rank test.

/// Differences below this, in percent, are ties: that much is rounding of the solver.
const TIE: f64 = 1e-3;

/// Differences of one method to another, pelvis by pelvis.
pub struct Paired {
    better: u32,
    worse: u32,
    mean: f64,
    differences: Vec<f64>,
}

impl Paired {
    /// Of figures of which lower is better, in the same order.
    pub fn new(one: &[f64], other: &[f64]) -> Self {
        let mut differences: Vec<f64> =
            one.iter().zip(other).map(|(a, b)| a - b).filter(|d| !d.is_nan()).collect();
        let count = |sign: fn(&f64) -> bool| differences.iter().filter(|d| sign(d)).count() as u32;
        let (better, worse) = (count(|d| *d < -TIE), count(|d| *d > TIE));
        let mean = differences.iter().sum::<f64>() / differences.len().max(1) as f64;
        differences.retain(|d| d.abs() > TIE);
        Self { better, worse, mean, differences }
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

    /// Two-sided probability of as uneven sums of ranks or more if both were as good: Wilcoxon's signed-rank test, exact,
    /// ties left out, equal amounts with their mean rank.
    pub fn by_ranks(&self) -> f64 {
        let mut amounts: Vec<f64> = self.differences.iter().map(|d| d.abs()).collect();
        amounts.sort_by(f64::total_cmp);
        // Twice the rank, which is whole for mean ranks, too.
        let rank = |d: &f64| {
            let below = amounts.partition_point(|a| *a < d.abs());
            let upto = amounts.partition_point(|a| *a <= d.abs());
            below + upto + 1
        };
        let ranks: Vec<usize> = self.differences.iter().map(rank).collect();
        let whole: usize = ranks.iter().sum();
        let negative: usize =
            ranks.iter().zip(&self.differences).filter(|(_, d)| **d < 0.0).map(|(rank, _)| rank).sum();
        // Probability of each sum if every sign is as likely as the other.
        let mut sums = vec![0.0; whole + 1];
        sums[0] = 1.0;
        for rank in &ranks {
            for sum in (0..=whole).rev() {
                sums[sum] = 0.5 * (sums[sum] + if sum >= *rank { sums[sum - rank] } else { 0.0 });
            }
        }
        let tail: f64 = sums[..=negative.min(whole - negative)].iter().sum();
        (2.0 * tail).min(1.0)
    }

    pub fn reported(&self) -> String {
        format!(
            "{:+.2} ({}:{}, p {:.3}, {:.3})",
            self.mean,
            self.better,
            self.worse,
            self.probability(),
            self.by_ranks()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sign_test_is_that_of_the_binomial_distribution() {
        let probability =
            |better, worse| Paired { better, worse, mean: 0.0, differences: Vec::new() }.probability();
        assert_eq!(probability(0, 0), 1.0);
        assert_eq!(probability(3, 3), 1.0);
        assert_eq!(probability(6, 0), 2.0 / 64.0);
        assert_eq!(probability(1, 7), 2.0 * 9.0 / 256.0);
    }

    #[test]
    fn the_test_by_ranks_is_that_of_wilcoxons_table() {
        let of = |differences: &[f64]| Paired::new(differences, &vec![0.0; differences.len()]).by_ranks();
        assert_eq!(of(&[]), 1.0);
        // All of six on one side; then 1 of the sum of 21 on the other.
        assert_eq!(of(&[-1.0, -2.0, -3.0, -4.0, -5.0, -6.0]), 2.0 / 64.0);
        assert_eq!(of(&[1.0, -2.0, -3.0, -4.0, -5.0, -6.0]), 4.0 / 64.0);
        // Wilcoxon's critical value for ten pairs at 5 %: 8.
        let eight = [1.0, 7.0, -2.0, -3.0, -4.0, -5.0, -6.0, -8.0, -9.0, -10.0];
        assert!((of(&eight) - 0.048_828_125).abs() < 1e-12, "{}", of(&eight));
        // Equal amounts share their rank: as in a sign test.
        assert_eq!(of(&[1.0, 1.0, -1.0, -1.0, -1.0]), 1.0);
    }

    #[test]
    fn ties_count_for_neither() {
        let paired = Paired::new(&[1.0, 2.0, 3.0], &[1.0, 2.5, 2.9]);
        assert_eq!((paired.better, paired.worse), (1, 1));
    }
}
