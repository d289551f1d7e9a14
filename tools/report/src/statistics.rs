//! Statistics of numbers.

use serde::Serialize;

/// A summary of numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    pub count: usize,
    pub p50: Option<f64>,
    /// 90 % quantile.
    pub p90: Option<f64>,
    /// 99 % quantile.
    pub p99: Option<f64>,
    pub max: Option<f64>,
}

impl Spread {
    /// The summary of the finite numbers among these.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        Self {
            count: sorted.len(),
            p50: quantile(&sorted, 0.5),
            p90: quantile(&sorted, 0.9),
            p99: quantile(&sorted, 0.99),
            max: sorted.last().copied(),
        }
    }
}

/// The `q` quantile of sorted numbers: the smallest number that a fraction `q` of them does not exceed.
pub fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.clamp(1, sorted.len().max(1)) - 1).copied()
}

pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Mean square of the distances from the mean.
pub fn variance(values: &[f64]) -> Option<f64> {
    let mean = mean(values)?;
    Some(values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / values.len() as f64)
}

/// Counts of numbers in bins of one width.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Histogram {
    /// Where the first bin begins.
    pub low: f64,
    /// Width of a bin.
    pub width: f64,
    pub counts: Vec<u64>,
    /// Numbers below the first bin and above the last.
    pub outside: u64,
}

impl Histogram {
    /// Of numbers within `low..high`.
    pub fn of(values: impl IntoIterator<Item = f64>, low: f64, high: f64, bins: usize) -> Self {
        let width = (high - low) / bins.max(1) as f64;
        let mut found = Self { low, width, counts: vec![0; bins.max(1)], outside: 0 };
        for value in values {
            let place = (value - low) / width;
            // The upper end belongs to the last bin.
            let place = if value == high { found.counts.len() as f64 - 0.5 } else { place };
            match found.counts.get_mut(place as usize) {
                Some(count) if place >= 0.0 => *count += 1,
                _ => found.outside += 1,
            }
        }
        found
    }

    /// Its outline as (value, share of all numbers), to be drawn in steps.
    pub fn outline(&self) -> Vec<(f64, f64)> {
        let all = (self.counts.iter().sum::<u64>() + self.outside).max(1) as f64;
        let edge = |i: usize| self.low + self.width * i as f64;
        let bins = self.counts.iter().enumerate().map(|(i, n)| (edge(i), *n as f64 / all));
        std::iter::once((self.low, 0.0)).chain(bins).chain([(edge(self.counts.len()), 0.0)]).collect()
    }
}

/// At most about `most` points of a line: the minimum and the maximum of each stretch, so that no peak is lost.
pub fn for_a_line(points: &[(f64, f64)], most: usize) -> Vec<(f64, f64)> {
    if points.len() <= most.max(4) {
        return points.to_vec();
    }
    let stretch = points.len().div_ceil(most.max(4) / 2);
    let mut drawn = Vec::new();
    for part in points.chunks(stretch) {
        let finite = || part.iter().filter(|p| p.1.is_finite());
        let low = finite().min_by(|a, b| a.1.total_cmp(&b.1));
        let high = finite().max_by(|a, b| a.1.total_cmp(&b.1));
        let mut both: Vec<_> = low.into_iter().chain(high).copied().collect();
        both.sort_by(|a, b| a.0.total_cmp(&b.0));
        both.dedup();
        drawn.extend(both);
        // A break of the line stays a break.
        drawn.extend(part.iter().find(|p| !p.1.is_finite()).map(|p| (p.0, f64::NAN)));
    }
    drawn
}

/// At most `most` points of a cloud of dots, evenly spaced.
pub fn for_dots(points: &[(f64, f64)], most: usize) -> Vec<(f64, f64)> {
    let stride = points.len().div_ceil(most.max(1)).max(1);
    points.iter().filter(|p| p.1.is_finite()).step_by(stride).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_numbers_of_the_row() {
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!(quantile(&hundred, 0.5), Some(50.0));
        assert_eq!(quantile(&hundred, 0.99), Some(99.0));
        assert_eq!((quantile(&hundred, 0.0), quantile(&hundred, 1.0)), (Some(1.0), Some(100.0)));
        assert_eq!(quantile(&[], 0.5), None);
        let spread = Spread::of([3.0, f64::NAN, 1.0, 2.0]);
        assert_eq!((spread.count, spread.p50, spread.max), (3, Some(2.0), Some(3.0)));
    }

    #[test]
    fn variance_is_about_the_mean() {
        assert_eq!(variance(&[1.0, 3.0]), Some(1.0));
        assert_eq!((mean(&[]), variance(&[])), (None, None));
    }

    #[test]
    fn every_number_is_in_a_bin_or_outside() {
        let found = Histogram::of([-1.0, 0.0, 0.5, 1.0, 1.5, 2.0, 2.1, f64::NAN], 0.0, 2.0, 2);
        // What is no number lies nowhere.
        assert_eq!((found.counts.clone(), found.outside), (vec![2, 3], 3));
        let outline = found.outline();
        assert_eq!((outline.first(), outline.last()), (Some(&(0.0, 0.0)), Some(&(2.0, 0.0))));
    }

    #[test]
    fn a_thinned_line_keeps_its_peaks_and_its_breaks() {
        let mut points: Vec<(f64, f64)> = (0..10_000).map(|i| (f64::from(i), 0.0)).collect();
        points[4321].1 = 9.0;
        points[777].1 = -9.0;
        points[5555].1 = f64::NAN;
        let drawn = for_a_line(&points, 200);
        assert!(drawn.len() <= 310, "{}", drawn.len());
        assert!(drawn.contains(&(4321.0, 9.0)) && drawn.contains(&(777.0, -9.0)));
        assert_eq!(drawn.iter().filter(|p| p.1.is_nan()).count(), 1);
        assert!(drawn.windows(2).all(|w| w[0].0 <= w[1].0 || w[1].1.is_nan()));
        assert_eq!(for_dots(&points, 100).len(), 100);
    }
}
