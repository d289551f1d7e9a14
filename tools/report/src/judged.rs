//! How far the head was from its target while the beam was allowed, by the truth: at the point that the gate judges, and at
//! the origin of the truth, another point of the same head.

use nalgebra::{Isometry3, Vector3};
use serde::Serialize;

use crate::motion::{Truth, numbers, pose};
use crate::offset::mean_offset;
use crate::recording::{Gates, PoseRole, Recording, Signal};

/// Distances from the target while the beam was allowed, over the coordinates that the target holds, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// Samples of the truth at which the beam was allowed.
    samples: usize,
    /// Distance between the two points of the head.
    pub apart_mm: f64,
    /// Root mean square at the judged point.
    pub point_rms_mm: f64,
    /// Largest distance at the judged point.
    pub point_worst_mm: f64,
    /// Root mean square at the origin of the truth.
    pub origin_rms_mm: f64,
    /// Largest distance at the origin of the truth.
    pub origin_worst_mm: f64,
}

impl Judged {
    /// Of a gate. `None` without a truth, a target and a track with all six channels, or if the beam was never allowed.
    pub fn of(recording: &Recording<'_>, gates: &Gates) -> Option<Self> {
        let (gate, _) = recording.wiring.producer(&gates.topic)?;
        let target = recording.targets.iter().find(|t| gate.inputs.contains(&t.topic))?;
        let is_judged = |s: &&Signal| s.part != PoseRole::Truth && gate.inputs.contains(&s.topic);
        let track = recording.signals.iter().find(is_judged)?;
        let signal = recording.truth_of(track)?;
        let truth = Truth::of(signal);
        // The poses of an earlier reference are those of another point.
        let since = signal.references.last().copied().unwrap_or(0);
        let states = track.states.items().iter().filter(|s| s.origin >= since);
        let whole = states.filter(|s| s.channels.iter().all(|c| c.is_finite()));
        let pairs: Vec<_> =
            whole.filter_map(|s| Some((pose(truth.at(s.origin)?), pose(s.channels)))).collect();
        let point_from_origin = mean_offset(&pairs)?;
        let truths = signal.states.items().iter().map(|s| (s.origin, s.channels));
        let truths = truths.filter(|(origin, _)| *origin >= since);
        Self::from(truths, &point_from_origin, target.values.items(), gates.values.items())
    }

    fn from(
        truths: impl Iterator<Item = (u64, [f64; 6])>,
        point_from_origin: &Isometry3<f64>,
        targets: &[(u64, [f64; 6])],
        gate: &[(u64, bool, u32)],
    ) -> Option<Self> {
        let back = point_from_origin.inverse();
        let (mut samples, mut squares, mut worst) = (0, [0.0; 2], [0.0_f64; 2]);
        for (time, channels) in truths {
            let last = gate.partition_point(|(stamp, ..)| *stamp <= time).checked_sub(1);
            let aimed = targets.partition_point(|(stamp, _)| *stamp <= time).checked_sub(1);
            let (Some(last), Some(aimed)) = (last, aimed) else { continue };
            let held = targets[aimed].1;
            if !gate[last].1 || held[..3].iter().all(|c| c.is_nan()) {
                continue;
            }
            let origin = pose(channels);
            let point = origin * back;
            // What the target does not hold is as it is.
            let now = numbers(&point);
            let requested = pose(std::array::from_fn(|i| if held[i].is_nan() { now[i] } else { held[i] }));
            let off = |is: &Isometry3<f64>, expected: &Isometry3<f64>| {
                let gap = is.translation.vector - expected.translation.vector;
                1e3 * Vector3::from_fn(|i, _| if held[i].is_nan() { 0.0 } else { gap[i] }).norm()
            };
            for (i, distance) in [off(&point, &requested), off(&origin, &(requested * point_from_origin))]
                .into_iter()
                .enumerate()
            {
                squares[i] += distance * distance;
                worst[i] = worst[i].max(distance);
            }
            samples += 1;
        }
        let rms = squares.map(|s| (s / f64::from(samples)).sqrt());
        (samples > 0).then_some(Self {
            samples: samples as usize,
            apart_mm: 1e3 * point_from_origin.translation.vector.norm(),
            point_rms_mm: rms[0],
            point_worst_mm: worst[0],
            origin_rms_mm: rms[1],
            origin_worst_mm: worst[1],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: f64 = f64::NAN;

    #[test]
    fn a_nod_about_the_judged_point_moves_the_other_one_alone() {
        // The origin of the truth lies 50 mm along y from the judged point, which stays at z = 100 mm.
        let point_from_origin = Isometry3::translation(0.0, 0.05, 0.0);
        let angle = |i: u64| 0.01 * (i as f64 * 0.9).sin();
        let nod = |i| numbers(&(pose([0.0, 0.0, 0.1, angle(i), 0.0, 0.0]) * point_from_origin));
        let truths = || (0..20).map(|i| (i, nod(i)));
        let targets = [(0, [NAN, NAN, 0.1, 0.0, 0.0, NAN])];
        let gate = [(0, false, 1), (5, true, 0), (15, false, 1)];
        let found = Judged::from(truths(), &point_from_origin, &targets, &gate).unwrap();
        assert_eq!(found.samples, 10);
        assert!(found.point_worst_mm < 1e-9 && (found.apart_mm - 50.0).abs() < 1e-9, "{found:?}");
        let expected = (5..15).map(|i| 50.0 * angle(i).sin().abs()).fold(0.0, f64::max);
        assert!((found.origin_worst_mm - expected).abs() < 1e-9 && expected > 0.4, "{found:?} {expected}");
        assert_eq!(Judged::from(truths(), &point_from_origin, &targets, &gate[..1]), None);
        // Along x and y the target holds nothing, and a shift there is no error.
        let aside = truths().map(|(i, c)| (i, [c[0] + 0.02, c[1], c[2] + 1e-3, c[3], c[4], c[5]]));
        let found = Judged::from(aside, &point_from_origin, &targets, &gate).unwrap();
        assert!((found.point_worst_mm - 1.0).abs() < 1e-9, "{found:?}");
    }
}
