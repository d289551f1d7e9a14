//! Quantiles, medians of ratios, and their text.

use serde::Serialize;

/// Ages of the samples of one window, ns.
#[derive(Clone, Debug, Default)]
pub struct Ages {
    /// Ages since just before the payload was written.
    pub whole: Vec<u64>,
    /// Ages since just after the payload was written.
    pub handed: Vec<u64>,
}

impl Ages {
    /// Adds ages in pairs, as a sink sends them: `whole`, then `handed`.
    pub fn take(&mut self, pairs: impl IntoIterator<Item = u64>) {
        for (i, age) in pairs.into_iter().enumerate() {
            if i % 2 == 0 { self.whole.push(age) } else { self.handed.push(age) }
        }
    }

    /// Adds the ages of another window.
    pub fn add(&mut self, other: &Self) {
        self.whole.extend(&other.whole);
        self.handed.extend(&other.handed);
    }
}

/// Quantiles of times, us.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantiles {
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
    pub count: usize,
}

impl Quantiles {
    /// Quantiles of times in ns.
    pub fn of(times: &[u64]) -> Self {
        let mut sorted = times.to_vec();
        sorted.sort_unstable();
        let at = |q: f64| {
            let last = sorted.len().saturating_sub(1);
            sorted.get((q * last as f64).round() as usize).map_or(f64::NAN, |ns| *ns as f64 / 1e3)
        };
        Self { p50: at(0.5), p90: at(0.9), p99: at(0.99), count: sorted.len() }
    }
}

/// The median of the finite numbers; NaN if there are none.
pub fn median(numbers: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = numbers.iter().copied().filter(|n| n.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => sorted[n / 2],
        n => f64::midpoint(sorted[n / 2 - 1], sorted[n / 2]),
    }
}

/// Median over the windows of the ratio of their medians.
pub fn ratio(ours: &[Vec<u64>], theirs: &[Vec<u64>]) -> f64 {
    let ratios: Vec<f64> =
        ours.iter().zip(theirs).map(|(a, b)| Quantiles::of(a).p50 / Quantiles::of(b).p50).collect();
    median(&ratios)
}

/// A number of bytes as text.
pub fn bytes(n: usize) -> String {
    match n {
        0..1024 => format!("{n} B"),
        1024..100_000 => format!("{} KiB", n / 1024),
        _ => format!("{:.1} MB", n as f64 / 1e6),
    }
}
