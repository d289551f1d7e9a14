//! Samples at any times to a record of one sample time.
//!
//! The output is interpolated between its two neighbours. The input holds its last value, because it is a command. No
//! values are invented in a gap of the output: the record is the longest stretch without a gap.

use serde::Serialize;

/// A gap is this many sample times without a sample of the output.
const GAP: u64 = 5;

/// The times of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Grid {
    /// The first, ns.
    pub start: u64,
    /// From one to the next, ns.
    pub step: u64,
    pub count: usize,
}

/// A record, and the account of its resampling.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Resampled {
    #[serde(skip)]
    pub input: Vec<f64>,
    #[serde(skip)]
    pub output: Vec<f64>,
    pub grid: Grid,
    /// The largest distance of a time of the record from a sample of the output, ns: 0 if nothing was interpolated.
    pub farthest: u64,
    /// Gaps of the output that split the recording.
    pub gaps: usize,
    /// Seconds of the recording that are not in the record.
    pub left_out_s: f64,
}

/// Why there is no record.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResampleError {
    /// Too few samples to have a sample time.
    #[error("the {what} has {found} finite samples: a record needs more")]
    TooFew { what: &'static str, found: usize },
    /// Input and output do not overlap.
    #[error("input and output were not recorded at the same time")]
    Apart,
    /// A sample time of zero.
    #[error("the sample time is 0: give one of at least 1 us")]
    NoTime,
}

/// Brings samples, pairs of time in ns and value in the order of time, to one sample time: `step`, ns, or the median
/// interval of the output.
///
/// # Errors
/// There is nothing to make a record of.
pub fn resample(
    input: &[(u64, f64)],
    output: &[(u64, f64)],
    step: Option<u64>,
) -> Result<Resampled, ResampleError> {
    for (what, found) in [("input", input.len()), ("output", output.len())] {
        if found < 2 {
            return Err(ResampleError::TooFew { what, found });
        }
    }
    let mut intervals: Vec<u64> = output.windows(2).map(|w| w[1].0.saturating_sub(w[0].0)).collect();
    intervals.sort_unstable();
    let step = step.unwrap_or(intervals[intervals.len() / 2]);
    if step < 1000 {
        return Err(ResampleError::NoTime);
    }
    let begins = output.iter().position(|(t, _)| *t >= input[0].0).ok_or(ResampleError::Apart)?;
    // A command holds beyond its last sample, but not for ever.
    let last = input[input.len() - 1].0.saturating_add(GAP * step);
    let ends = output.iter().rposition(|(t, _)| *t <= last).ok_or(ResampleError::Apart)?;
    let whole = output.get(begins..=ends).filter(|o| o.len() > 1).ok_or(ResampleError::Apart)?;
    let breaks = |i: &usize| whole[*i].0.saturating_sub(whole[*i - 1].0) > GAP * step;
    let cuts: Vec<usize> = (1..whole.len()).filter(breaks).collect();
    let ends = cuts.iter().copied().chain([whole.len()]);
    let pieces = [0].into_iter().chain(cuts.iter().copied()).zip(ends).map(|(from, to)| &whole[from..to]);
    let span = |piece: &[(u64, f64)]| piece[piece.len() - 1].0 - piece[0].0;
    // The first of the longest.
    let piece = pieces.reduce(|best, p| if span(p) > span(best) { p } else { best }).unwrap_or(whole);
    let grid = Grid { start: piece[0].0, step, count: (span(piece) / step) as usize + 1 };
    let mut record = Resampled {
        input: Vec::with_capacity(grid.count),
        output: Vec::with_capacity(grid.count),
        grid,
        farthest: 0,
        gaps: cuts.len(),
        left_out_s: (output[output.len() - 1].0 - output[0].0 - span(piece)) as f64 * 1e-9,
    };
    let (mut held, mut next) = (0, 0);
    for k in 0..grid.count {
        let time = grid.start + k as u64 * step;
        while input.get(held + 1).is_some_and(|(t, _)| *t <= time) {
            held += 1;
        }
        while piece.get(next + 1).is_some_and(|(t, _)| *t <= time) {
            next += 1;
        }
        record.input.push(input[held].1);
        let (before, value) = piece[next];
        let (value, distance) = match piece.get(next + 1) {
            Some((after, then)) if time > before => {
                let part = (time - before) as f64 / (after - before) as f64;
                (value + (then - value) * part, (time - before).min(after - time))
            }
            _ => (value, time - before),
        };
        record.output.push(value);
        record.farthest = record.farthest.max(distance);
    }
    Ok(record)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(times: &[u64]) -> Vec<(u64, f64)> {
        times.iter().map(|t| (*t * 1_000_000, *t as f64)).collect()
    }

    #[test]
    fn regular_samples_come_through_unchanged() {
        let times: Vec<u64> = (10..60).collect();
        let record = resample(&ramp(&times), &ramp(&times), None).unwrap();
        assert_eq!((record.grid.count, record.farthest, record.gaps), (50, 0, 0));
        assert_eq!(record.output, (10..60).map(f64::from).collect::<Vec<_>>());
        assert_eq!(record.input, record.output);
    }

    #[test]
    fn output_is_interpolated_and_input_held() {
        let record = resample(&ramp(&[0, 7, 30]), &ramp(&[5, 10, 14, 20, 25, 30]), Some(5_000_000)).unwrap();
        assert_eq!(record.output, [5.0, 10.0, 15.0, 20.0, 25.0, 30.0]);
        assert_eq!(record.input, [0.0, 7.0, 7.0, 7.0, 7.0, 30.0]);
        assert_eq!(record.farthest, 1_000_000);
    }

    #[test]
    fn the_longest_stretch_without_a_gap_is_the_record() {
        let times: Vec<u64> = (0..20).chain(100..150).chain(200..210).collect();
        let record = resample(&ramp(&(0..300).collect::<Vec<_>>()), &ramp(&times), None).unwrap();
        assert_eq!((record.grid.start, record.grid.count, record.gaps), (100_000_000, 50, 2));
        assert!((record.left_out_s - 0.160).abs() < 1e-9);
    }

    #[test]
    fn recordings_of_different_times_make_no_record() {
        let (early, late) = (ramp(&[0, 1, 2, 3]), ramp(&[100, 101, 102]));
        assert_eq!(resample(&early, &late, None), Err(ResampleError::Apart));
        assert_eq!(resample(&late, &early, None), Err(ResampleError::Apart));
        assert_eq!(
            resample(&late, &early[..1], None),
            Err(ResampleError::TooFew { what: "output", found: 1 })
        );
        assert_eq!(resample(&early, &early, Some(0)), Err(ResampleError::NoTime));
    }
}
