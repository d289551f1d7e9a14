//! Two measurements of `robust` side by side: in how many kinds of disturbances one law is nearer than another.

use std::path::Path;

use serde::Deserialize;

use super::step::WITHIN;
use stillpoint::Failure;

/// Part of the seeds above which a kind counts as gated.
const MOST: f64 = 0.5;

/// What is read of a measurement, as `--json` prints it.
#[derive(Clone, Debug, Deserialize)]
pub struct Row {
    /// Name of the kind.
    pub case: String,
    /// One for each seed, in the order of the seeds.
    pub found: Vec<Seed>,
}

/// What is read of one run.
#[derive(Clone, Debug, Deserialize)]
pub struct Seed {
    /// Name of the verdict.
    pub verdict: String,
    /// Root mean square of truth - target: mm, degrees, degrees.
    pub rms: [f64; 3],
}

/// How a law is beside another one in a kind of disturbance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Its median is smaller.
    Better,
    /// Its median is not smaller.
    Worse,
    /// With both laws the beam is off at the end of most runs: neither holds the head.
    Gated,
}

/// The largest root mean square of a run, in parts of the tolerance of its channel; NaN if one is NaN.
fn size(rms: &[f64; 3]) -> f64 {
    let parts = rms.iter().zip(WITHIN).map(|(rms, within)| rms / within);
    parts.fold(0.0, |a: f64, b| if a.is_nan() || b <= a { a } else { b })
}

/// Median of the sizes of a kind's runs.
fn middle(found: &[Seed]) -> f64 {
    median(found.iter().map(|f| size(&f.rms)))
}

/// The median of the seeds: the mean of the two middle numbers if their count is even; NaN if one is NaN.
pub fn median(of: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = of.collect();
    if all.is_empty() || all.iter().any(|v| v.is_nan()) {
        return f64::NAN;
    }
    all.sort_by(f64::total_cmp);
    let middle = all.len() / 2;
    if all.len() % 2 == 1 { all[middle] } else { 0.5 * (all[middle - 1] + all[middle]) }
}

fn is_gated(found: &[Seed]) -> bool {
    let gated = found.iter().filter(|f| f.verdict == "gated-and-safe").count();
    gated as f64 > MOST * found.len() as f64
}

/// How `this` is beside `other`.
pub fn standing(this: &[Seed], other: &[Seed]) -> Standing {
    if is_gated(this) && is_gated(other) {
        Standing::Gated
    } else if middle(this) < middle(other) {
        Standing::Better
    } else {
        Standing::Worse
    }
}

/// Reads a measurement.
///
/// # Errors
/// A file that cannot be read, or that is none of `robust --json`.
pub fn read(path: &Path) -> Result<Vec<Row>, Failure> {
    let wrong = |why: String| {
        Failure::wrong(format!("--beside {}: {why}; give a file that `robust --json` wrote", path.display()))
    };
    let text = std::fs::read(path).map_err(|e| wrong(e.to_string()))?;
    serde_json::from_slice(&text).map_err(|e| wrong(e.to_string()))
}

/// Prints `this` beside `other`, kind by kind, and the counts.
///
/// # Errors
/// Other kinds, or another number of seeds.
pub fn print(this: &[Row], other: &[Row]) -> Result<(), Failure> {
    let same = this.len() == other.len()
        && this.iter().zip(other).all(|(a, b)| a.case == b.case && a.found.len() == b.found.len());
    if !same {
        return Err(Failure::wrong("--beside: the file has other cases or another number of seeds"));
    }
    outln!("median over the seeds of the largest RMS, in parts of {WITHIN:?} mm and degrees");
    let mut counts = [0; 3];
    for (a, b) in this.iter().zip(other) {
        let standing = standing(&a.found, &b.found);
        counts[standing as usize] += 1;
        let nearer = a.found.iter().zip(&b.found).filter(|(a, b)| size(&a.rms) < size(&b.rms)).count();
        outln!(
            "{:<28} {:>8.3} against {:>8.3}, nearer with {nearer} of {} seeds: {}",
            a.case,
            middle(&a.found),
            middle(&b.found),
            a.found.len(),
            ["better", "worse", "both are gated"][standing as usize]
        );
    }
    let [better, worse, gated] = counts;
    outln!("better in {better} of {} kinds, worse in {worse}, both gated in {gated}", this.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seeds(sizes: &[f64], verdict: &str) -> Vec<Seed> {
        let one = |size: &f64| Seed { verdict: verdict.to_owned(), rms: [0.0, 0.2 * size, 0.1 * size] };
        sizes.iter().map(one).collect()
    }

    #[test]
    fn the_channel_that_is_farthest_off_by_its_tolerance_counts() {
        assert_eq!(size(&[0.25, 0.02, 0.02]), 0.5);
        assert_eq!(size(&[0.25, 0.3, 0.02]), 0.3 / 0.2);
        assert!(size(&[0.25, f64::NAN, 0.02]).is_nan());
        assert!((middle(&seeds(&[3.0, 1.0, 2.0], "tracked")) - 2.0).abs() < 1e-12);
        assert_eq!(median([3.0, 1.0, 2.0].into_iter()), 2.0);
        assert_eq!(median([4.0, 1.0, 2.0, 3.0].into_iter()), 2.5);
        assert!(median([1.0, f64::NAN, 2.0].into_iter()).is_nan() && median([].into_iter()).is_nan());
    }

    #[test]
    fn a_law_is_better_by_its_median_and_a_kind_that_no_law_holds_does_not_count() {
        let (near, far) = (seeds(&[0.1, 0.1, 9.0], "tracked"), seeds(&[0.2, 0.2, 0.2], "tracked"));
        assert_eq!([standing(&near, &far), standing(&far, &near)], [Standing::Better, Standing::Worse]);
        assert_eq!(standing(&near, &near), Standing::Worse, "a tie is not better");
        let gated = seeds(&[100.0; 3], "gated-and-safe");
        assert_eq!(standing(&gated, &gated), Standing::Gated);
        assert_eq!([standing(&near, &gated), standing(&gated, &near)], [Standing::Better, Standing::Worse]);
        let none = seeds(&[f64::NAN; 3], "tracked");
        assert_eq!(standing(&none, &far), Standing::Worse);
    }
}
