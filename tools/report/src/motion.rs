//! Estimates against the truth: separates the constant offset from the error.
//!
//! An estimate follows another point of the head than the truth: a centroid, a highest point, or the origin of a reference
//! surface. Therefore the mean difference is reported as an offset and removed from the errors. For an estimate with all
//! six channels it is the mean rigid offset, so a rotation of the head is no error of position; for other estimates it is
//! the mean of each channel. When a tracker takes another reference, a new offset begins.

use nalgebra::{Isometry3, SMatrix, Vector6};
use serde::Serialize;
use stillpoint_estimate::Manifold;
use stillpoint_estimate::consistency::nees;
use stillpoint_pose::PoseNumbers;
use stillpoint_samples::Standing;

use super::recording::{Signal, State};
use super::statistics::{Histogram, mean, quantile};
use crate::offset::mean_offset;

/// Names of the channels.
pub const CHANNELS: [&str; 6] = ["x", "y", "z", "pitch", "roll", "yaw"];
/// The truth is not interpolated over a gap of more than this many of its usual intervals.
const LARGEST_GAP: f64 = 3.5;

/// Unit in which a channel is shown, and its number per metre or radian.
pub fn unit(channel: usize) -> (&'static str, f64) {
    if channel < 3 { ("mm", 1e3) } else { ("°", 180.0 / core::f64::consts::PI) }
}

/// The truth at any time between its samples.
pub struct Truth<'a> {
    states: &'a [State],
    /// Longest gap that is interpolated over, ns.
    longest: f64,
    references: &'a [u64],
}

impl<'a> Truth<'a> {
    /// Of states in the order of their times.
    pub fn of(signal: &'a Signal) -> Self {
        let states = signal.states.items();
        let mut gaps: Vec<f64> =
            states.windows(2).map(|w| (w[1].origin - w[0].origin) as f64).filter(|g| *g > 0.0).collect();
        gaps.sort_by(f64::total_cmp);
        let longest = LARGEST_GAP * quantile(&gaps, 0.5).unwrap_or(0.0);
        Self { states, longest, references: &signal.references }
    }

    /// The channels at a time, interpolated between the samples beside it.
    pub fn at(&self, time: u64) -> Option<[f64; 6]> {
        let next = self.states.partition_point(|s| s.origin < time);
        let after = self.states.get(next)?;
        if after.origin == time {
            return Some(after.channels);
        }
        let before = self.states.get(next.checked_sub(1)?)?;
        let gap = (after.origin - before.origin) as f64;
        let part = (time - before.origin) as f64 / gap;
        (gap <= self.longest).then(|| {
            std::array::from_fn(|i| {
                before.channels[i] + part * difference(i, after.channels[i], before.channels[i])
            })
        })
    }
}

/// The difference of two values of a channel; angles are wrapped to half a turn.
fn difference(channel: usize, a: f64, b: f64) -> f64 {
    let d = a - b;
    if channel < 3 || !d.is_finite() {
        return d;
    }
    let turn = 2.0 * core::f64::consts::PI;
    d - turn * (d / turn).round()
}

/// An estimate beside the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Time of acquisition, ns.
    pub origin: u64,
    /// The truth, m and rad.
    pub truth: [f64; 6],
    /// Estimate minus truth, m and rad; NaN where the channel is not known.
    pub error: [f64; 6],
    /// Standard deviations that the estimate claims.
    pub sd: [f64; 6],
    /// Normalised square of the error over the known channels, and their number; none if a rotation is known but not all
    /// six channels.
    pub nees: Option<(f64, usize)>,
}

/// An estimate against the truth.
#[derive(Clone, Debug, Default)]
pub struct Comparison {
    /// The estimates that have a truth; their errors are without the offset.
    pub pairs: Vec<Pair>,
    /// The offset, m and rad; none if the channel is not known. For an estimate with all six channels, the pose of the
    /// truth in the frame that the estimate follows; else the mean of estimate minus truth. If there were several
    /// references, the offset of the last one.
    pub offset: [Option<f64>; 6],
}

/// Compares the states of an estimate with the truth.
pub fn compare(truth: &Truth<'_>, estimate: &[State]) -> Comparison {
    let known = estimate.iter().filter(|s| s.standing != Standing::None);
    let states: Vec<(&State, [f64; 6])> = known.filter_map(|s| Some((s, truth.at(s.origin)?))).collect();
    let whole = |(state, at): &(&State, [f64; 6])| state.channels.iter().chain(at).all(|c| c.is_finite());
    let mut found = Comparison::default();
    let mut rest = &states[..];
    for from in truth.references.iter().copied().chain([u64::MAX]) {
        let (before, after) = rest.split_at(rest.partition_point(|(state, _)| state.origin < from));
        rest = after;
        if before.is_empty() {
            continue;
        }
        let of_one = if before.iter().all(whole) { about_mean_pose(before) } else { about_mean(before) };
        found.pairs.extend(of_one.pairs);
        found.offset = of_one.offset;
    }
    found
}

/// Of states with all six channels.
fn about_mean_pose(states: &[(&State, [f64; 6])]) -> Comparison {
    let poses: Vec<_> = states.iter().map(|(s, at)| (pose(*at), pose(s.channels))).collect();
    let offset = mean_offset(&poses).unwrap_or_default();
    let back = offset.inverse();
    let moved = states.iter().map(|(s, at)| {
        let pair = pair(s, *at, numbers(&(pose(s.channels) * offset)));
        // The estimate claims its covariance of its own place on the head.
        let error = pose(s.channels).minus(&(pose(*at) * back));
        Pair { nees: normalised(&error, s), ..pair }
    });
    Comparison { pairs: moved.collect(), offset: numbers(&offset).map(Some) }
}

fn about_mean(states: &[(&State, [f64; 6])]) -> Comparison {
    let mut pairs: Vec<Pair> = states.iter().map(|(s, at)| pair(s, *at, s.channels)).collect();
    let offset: [Option<f64>; 6] = std::array::from_fn(|i| {
        mean(&pairs.iter().map(|p| p.error[i]).filter(|e| e.is_finite()).collect::<Vec<_>>())
    });
    for (pair, (state, _)) in pairs.iter_mut().zip(states) {
        pair.error = std::array::from_fn(|i| pair.error[i] - offset[i].unwrap_or(0.0));
        if pair.error[3..].iter().all(|e| !e.is_finite()) {
            pair.nees = normalised(&Vector6::from(pair.error), state);
        }
    }
    Comparison { pairs, offset }
}

/// A state with these channels beside the truth.
fn pair(state: &State, truth: [f64; 6], channels: [f64; 6]) -> Pair {
    let error = std::array::from_fn(|i| difference(i, channels[i], truth[i]));
    Pair { origin: state.origin, truth, error, sd: state.sd(), nees: None }
}

/// The square of an error, normalised by the covariance of the state, over the channels in which the error is finite.
fn normalised(error: &Vector6<f64>, state: &State) -> Option<(f64, usize)> {
    let known: [bool; 6] = std::array::from_fn(|i| error[i].is_finite());
    let covariance = SMatrix::<f64, 6, 6>::from_fn(|i, j| match (known[i] && known[j], i == j) {
        (true, _) => state.covariance[6 * i + j],
        (false, true) => 1.0,
        (false, false) => 0.0,
    });
    let error = error.map(|e| if e.is_finite() { e } else { 0.0 });
    Some((nees(&error, &covariance)?, known.iter().filter(|k| **k).count()))
}

/// The pose of six channels, m and rad.
pub fn pose(channels: [f64; 6]) -> Isometry3<f64> {
    let [x, y, z, pitch, roll, yaw] = channels;
    PoseNumbers { position: [x, y, z], pitch, roll, yaw }.pose()
}

/// The six channels of a pose, m and rad.
pub fn numbers(pose: &Isometry3<f64>) -> [f64; 6] {
    let n = PoseNumbers::of(pose);
    let [x, y, z] = n.position;
    [x, y, z, n.pitch, n.roll, n.yaw]
}

/// Figures of the errors of one channel about the offset, in mm or degrees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorFigures {
    /// The estimate's topic.
    pub topic: String,
    pub channel: &'static str,
    /// Unit of all figures.
    pub unit: &'static str,
    /// Estimates that have a truth.
    pub samples: usize,
    /// The offset that was removed: the distance of the two points of the head, and the bias of the sensor.
    pub offset: f64,
    /// Root mean square of the error about the offset.
    pub rms: f64,
    /// Square of the root mean square.
    pub variance: f64,
    /// 95 % quantile of the absolute error.
    pub p95: f64,
    pub worst: f64,
    /// Root mean square of the standard deviations that the estimate claims.
    pub claimed: f64,
    /// Largest distance of the truth from its first value.
    pub moved: f64,
}

impl Comparison {
    /// The errors of a channel with their times, ns, in mm or degrees.
    pub fn errors(&self, channel: usize) -> impl Iterator<Item = (u64, f64)> {
        let scale = unit(channel).1;
        self.pairs.iter().map(move |p| (p.origin, p.error[channel] * scale)).filter(|(_, e)| e.is_finite())
    }

    /// The figures of a channel, where it is known.
    pub fn figures(&self, topic: &str, channel: usize) -> Option<ErrorFigures> {
        let (unit, scale) = unit(channel);
        let offset = self.offset[channel]? * scale;
        let mut sizes: Vec<f64> = self.errors(channel).map(|(_, e)| e.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let known = || self.pairs.iter().filter(|p| p.error[channel].is_finite());
        let claims: Vec<f64> = known().map(|p| (p.sd[channel] * scale).powi(2)).collect();
        let first = known().next()?.truth[channel];
        let moved = known().map(|p| difference(channel, p.truth[channel], first).abs() * scale);
        let variance = mean(&sizes.iter().map(|e| e * e).collect::<Vec<_>>())?;
        Some(ErrorFigures {
            topic: topic.to_owned(),
            channel: CHANNELS[channel],
            unit,
            samples: sizes.len(),
            offset,
            rms: variance.sqrt(),
            variance,
            p95: quantile(&sizes, 0.95)?,
            worst: *sizes.last()?,
            claimed: mean(&claims)?.sqrt(),
            moved: moved.fold(0.0, f64::max),
        })
    }

    /// Histogram of the errors of a channel, from `-largest` to `largest`.
    pub fn histogram(&self, channel: usize, largest: f64, bins: usize) -> Histogram {
        Histogram::of(self.errors(channel).map(|(_, e)| e), -largest, largest, bins)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::PoseRole;
    use crate::thinned::Thinned;

    fn state(origin: u64, channels: [f64; 6]) -> State {
        let covariance = std::array::from_fn(|i| if i % 7 == 0 { 1e-6 } else { 0.0 });
        State { origin, channels, covariance, nis: f64::NAN, standing: Standing::Measured }
    }

    fn signal(states: impl IntoIterator<Item = State>) -> Signal {
        let mut retained = Thinned::default();
        states.into_iter().for_each(|s| retained.push(s));
        Signal {
            topic: "rig.truth".into(),
            frame: None,
            part: PoseRole::Truth,
            states: retained,
            tracking: None,
            references: Vec::new(),
        }
    }

    #[test]
    fn a_constant_offset_is_no_error_and_errors_are_as_they_were_put_in() {
        let truth = signal((0..100).map(|k| state(k * 1000, [0.0, 0.0, 1e-4 * k as f64, 0.0, 0.0, 0.0])));
        // 50 mm above, and 2 mm to and fro.
        let estimate: Vec<State> = (0..99)
            .map(|k| {
                let z = 1e-4 * (k as f64 + 0.5) + 0.05 + if k % 2 == 0 { 2e-3 } else { -2e-3 };
                state(k * 1000 + 500, [f64::NAN, f64::NAN, z, f64::NAN, f64::NAN, f64::NAN])
            })
            .collect();
        let found = compare(&Truth::of(&truth), &estimate);
        assert_eq!(found.pairs.len(), 99);
        let z = found.figures("e", 2).unwrap();
        // 50 of 99 are above: the mean is a little higher, and so the rest lower.
        let mean = 2.0 / 99.0;
        assert!((z.offset - 50.0 - mean).abs() < 1e-9, "{z:?}");
        assert!(
            (z.variance - (4.0 - mean * mean)).abs() < 1e-9 && (z.worst - 2.0 - mean).abs() < 1e-9,
            "{z:?}"
        );
        assert!((z.claimed - 1.0).abs() < 1e-12 && z.unit == "mm" && z.samples == 99);
        assert_eq!((found.figures("e", 0), found.offset[3]), (None, None));
        let histogram = found.histogram(2, 3.0, 6);
        assert_eq!((histogram.counts, histogram.outside), (vec![49, 0, 0, 0, 50, 0], 0));
    }

    #[test]
    fn another_point_of_a_head_that_turns_makes_no_error() {
        let true_pose =
            |k: u64| [0.0, 0.0, 0.1, 0.2 * (k as f64 * 0.1).sin(), 0.0, 0.1 * (k as f64 * 0.07).sin()];
        let truth = signal((0..200).map(|k| state(k, true_pose(k))));
        let own = pose([0.03, -0.08, 0.05, 0.3, -0.2, 0.1]);
        let estimate: Vec<State> = (0..200).map(|k| state(k, numbers(&(pose(true_pose(k)) * own)))).collect();
        let found = compare(&Truth::of(&truth), &estimate);
        for channel in 0..6 {
            assert!(found.figures("e", channel).unwrap().worst < 1e-9, "{channel}");
        }
    }

    /// Numbers of a normal distribution's shape: the sum of twelve even ones, less six.
    fn noise() -> impl FnMut() -> f64 {
        let mut seed = 1_u64;
        move || {
            let mut even = || {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (seed >> 11) as f64 / (1_u64 << 53) as f64
            };
            (0..12).map(|_| even()).sum::<f64>() - 6.0
        }
    }

    #[test]
    fn errors_that_are_as_claimed_have_a_normalised_square_of_as_many_as_there_are_channels() {
        // Errors of 1 mm in the height, and in all channels, where x goes with the turn about z: x = 2 mm, turn = 1 mrad.
        let true_pose =
            |k: u64| [0.0, 0.0, 0.1, 0.2 * (k as f64 * 0.1).sin(), 0.5, 0.1 * (k as f64 * 0.07).sin()];
        let truth = signal((0..3000).map(|k| state(k, true_pose(k))));
        let own = pose([0.03, -0.08, 0.05, 0.3, -0.2, 0.1]);
        let mut normal = noise();
        let mut poses = Vec::new();
        for k in 0..3000 {
            let turn = normal() * 1e-3;
            let [x, y, z, a, b] = std::array::from_fn(|_| normal() * 1e-3);
            let error = Vector6::new(x + turn, y, z, a, b, turn);
            let mut at = state(k, numbers(&(pose(true_pose(k)) * own).plus(&error)));
            at.covariance[0] = 2e-6;
            (at.covariance[5], at.covariance[30]) = (1e-6, 1e-6);
            poses.push(at);
        }
        let mean_of = |found: &Comparison, channels: usize| {
            let of = found.pairs.iter().filter_map(|p| p.nees).inspect(|(_, n)| assert_eq!(*n, channels));
            mean(&of.map(|(square, _)| square).collect::<Vec<_>>()).unwrap()
        };
        let whole = mean_of(&compare(&Truth::of(&truth), &poses), 6);
        assert!((whole - 6.0).abs() < 0.25, "{whole}");
        let heights: Vec<State> = (0..3000)
            .map(|k| {
                let z = true_pose(k)[2] + 0.05 + normal() * 1e-3;
                state(k, [f64::NAN, f64::NAN, z, f64::NAN, f64::NAN, f64::NAN])
            })
            .collect();
        let height = mean_of(&compare(&Truth::of(&truth), &heights), 1);
        assert!((height - 1.0).abs() < 0.1, "{height}");
    }

    #[test]
    fn another_reference_has_another_offset() {
        let true_pose = |k: u64| [0.0, 0.0, 0.1, 0.2 * (k as f64 * 0.1).sin(), 0.0, 0.1];
        let mut truth = signal((0..200).map(|k| state(k, true_pose(k))));
        let own = [[0.03, -0.08, 0.05, 0.3, -0.2, 0.1], [0.0, 0.01, 0.02, 0.0, 0.1, -0.1]].map(pose);
        let estimate: Vec<State> =
            (0..200).map(|k| state(k, numbers(&(pose(true_pose(k)) * own[usize::from(k >= 120)])))).collect();
        assert!(compare(&Truth::of(&truth), &estimate).figures("e", 3).unwrap().worst > 1.0);
        truth.references = vec![120];
        let found = compare(&Truth::of(&truth), &estimate);
        assert_eq!(found.pairs.len(), 200);
        assert!((0..6).all(|channel| found.figures("e", channel).unwrap().worst < 1e-9));
    }

    #[test]
    fn the_first_estimate_counts_no_more_than_others() {
        // The head turns to and fro; the first estimate is off by 5 mm, the others by none.
        let true_pose = |k: u64| [0.0, 0.0, 0.1, 0.2 * (k as f64 * 0.1).sin(), 0.0, 0.0];
        let truth = signal((0..200).map(|k| state(k, true_pose(k))));
        let own = pose([0.03, -0.08, 0.05, 0.3, -0.2, 0.1]);
        let estimate = |k: u64| {
            let mut channels = numbers(&(pose(true_pose(k)) * own));
            channels[0] += if k == 0 { 5e-3 } else { 0.0 };
            state(k, channels)
        };
        let found = compare(&Truth::of(&truth), &(0..200).map(estimate).collect::<Vec<_>>());
        let x = found.figures("e", 0).unwrap();
        assert!((x.worst - 5.0).abs() < 0.05 && (x.rms - 5.0 / 200.0_f64.sqrt()).abs() < 0.05, "{x:?}");
        // The truth's origin on the head that the estimate follows.
        let expected = numbers(&own.inverse());
        assert!((x.offset - expected[0] * 1e3).abs() < 0.1, "{x:?}");
    }

    #[test]
    fn nothing_is_guessed_over_a_gap_or_beyond_the_ends() {
        let times = [0, 10, 20, 30, 100, 110];
        let truth = signal(times.map(|t| state(t, [t as f64; 6])));
        let truth = Truth::of(&truth);
        assert_eq!(truth.at(15).unwrap()[0], 15.0);
        assert_eq!(truth.at(30).unwrap()[0], 30.0);
        assert!(truth.at(50).is_none() && truth.at(111).is_none());
    }
}
