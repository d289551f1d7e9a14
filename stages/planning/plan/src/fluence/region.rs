//! A cost of all rows of a region together: of a power mean of their doses, with its slope and curvature.

use super::problem::Side;

/// `weight max(0, +-(mean - goal))^2` of the power mean of the rows. Convex where the mean is convex and costs above its
/// goal (`a >= 1`), or concave and costs below it (`a <= 1`).
#[derive(Clone, Debug, PartialEq)]
pub struct RegionTerm {
    /// Rows with their shares, which sum to 1.
    pub rows: Vec<(u32, f64)>,
    /// The mean.
    pub mean: PowerMean,
    /// Side that costs.
    pub side: Side,
    /// Gray.
    pub goal: f64,
    /// Weight.
    pub weight: f64,
}

/// `(sum s (d + raise)^a)^(1/a) - raise`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerMean {
    /// Exponent, not 0.
    pub a: f64,
    /// Gray.
    pub raise: f64,
}

/// Part of the mean that a dose has at least where curvatures are taken: below `a = 2` that of a dose of zero is not finite.
const LEAST: f64 = 1e-3;

/// A cost around some doses: `diagonal + bend g g^T` is its curvature.
#[derive(Clone, Debug, PartialEq)]
pub struct Around {
    /// Slope in the mean.
    pub slope: f64,
    /// Slope of the mean in the dose of each row, in their order: `g`.
    pub mean_slopes: Vec<f64>,
    /// Curvature in each row's own dose, but for the part of `bend`; not negative.
    pub diagonal: Vec<f64>,
    /// Curvature in the mean. It is negative far from the goal, where `diagonal` outweighs it.
    pub bend: f64,
}

impl PowerMean {
    /// The mean with what was added to it, and each dose over that. Doses below zero count as zero.
    fn parts(self, rows: &[(u32, f64)], dose: &[f64]) -> (f64, Vec<f64>) {
        let raised: Vec<f64> =
            rows.iter().map(|(row, _)| dose[*row as usize].max(0.0) + self.raise).collect();
        // The dose that rules the sum is 1 in it.
        let ends = raised.iter().fold([f64::INFINITY, 0.0], |[low, high], d| [d.min(low), d.max(high)]);
        let ruling = if self.a > 0.0 { ends[1] } else { ends[0] };
        // Without rows, or without any dose.
        if ruling <= 0.0 || !ruling.is_finite() {
            return (0.0, vec![0.0; rows.len()]);
        }
        let power = |(d, (_, share)): (&f64, &(u32, f64))| share * libm::pow(d / ruling, self.a);
        let sum: f64 = raised.iter().zip(rows).map(power).sum();
        let mean = ruling * libm::pow(sum, 1.0 / self.a);
        (mean, raised.iter().map(|d| d / mean).collect())
    }

    /// The mean of these doses.
    pub fn of(self, rows: &[(u32, f64)], dose: &[f64]) -> f64 {
        self.parts(rows, dose).0 - self.raise
    }
}

impl RegionTerm {
    /// How far a mean is on the side that costs, Gy; not positive where it is not.
    fn excess(&self, mean: f64) -> f64 {
        match self.side {
            Side::Over => mean - self.goal,
            Side::Under => self.goal - mean,
        }
    }

    /// The cost of these doses.
    pub fn cost(&self, dose: &[f64]) -> f64 {
        let excess = self.excess(self.mean.of(&self.rows, dose)).max(0.0);
        self.weight * excess * excess
    }

    /// The cost around these doses; nothing where it does not cost.
    pub fn around(&self, dose: &[f64]) -> Option<Around> {
        let (raised, ratios) = self.mean.parts(&self.rows, dose);
        let excess = self.excess(raised - self.mean.raise);
        if excess <= 0.0 || raised <= 0.0 {
            return None;
        }
        let a = self.mean.a;
        let of = |power: f64, least: f64| {
            let one = |((_, share), ratio): (&(u32, f64), &f64)| share * libm::pow(ratio.max(least), power);
            self.rows.iter().zip(&ratios).map(one).collect::<Vec<f64>>()
        };
        let steep = 2.0 * self.weight * excess;
        // The curvature of the mean is (a - 1) / mean (diag(s ratio^(a - 2)) - g g^T).
        let own = steep * (a - 1.0).abs() / raised;
        let mut diagonal = of(a - 2.0, LEAST);
        diagonal.iter_mut().for_each(|curvature| *curvature *= own);
        let slope = if self.side == Side::Over { steep } else { -steep };
        Some(Around { slope, mean_slopes: of(a - 1.0, 0.0), diagonal, bend: 2.0 * self.weight - own })
    }

    /// First and second derivative along a line at these doses.
    pub fn along(&self, dose: &[f64], change: &[f64]) -> (f64, f64) {
        let Some(Around { slope, mean_slopes, diagonal, bend }) = self.around(dose) else {
            return (0.0, 0.0);
        };
        let (mut by, mut curvature) = (0.0, 0.0);
        for (((row, _), g), own) in self.rows.iter().zip(mean_slopes).zip(diagonal) {
            let change = change[*row as usize];
            by += g * change;
            curvature += own * change * change;
        }
        (slope * by, curvature + bend * by * by)
    }

    /// The same for every `step`-th of the first `of` rows, where it has any of them.
    pub fn thinned(&self, of: usize, step: usize) -> Self {
        let retained = |row: u32| (row as usize) < of && (row as usize).is_multiple_of(step);
        let rows: Vec<(u32, f64)> = self.rows.iter().filter(|(row, _)| retained(*row)).copied().collect();
        let whole: f64 = rows.iter().map(|(_, share)| share).sum();
        let rows = rows.into_iter().map(|(row, share)| (row / step as u32, share / whole)).collect();
        Self { rows, ..self.clone() }
    }

    /// The largest dose of a row with this share where the cost is at most `cost`; infinite where none follows.
    pub fn largest_dose(&self, share: f64, cost: f64) -> f64 {
        match self.side {
            Side::Over => (self.goal + (cost / self.weight).sqrt()) * libm::pow(share, -1.0 / self.mean.a),
            Side::Under => f64::INFINITY,
        }
    }
}
