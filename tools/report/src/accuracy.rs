//! The accuracy of a session: how far the filtered head is from the truth of the rig.

use std::path::Path;

use nalgebra::Vector3;
use serde::Serialize;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pose, PoseReport, Sample, SampleKind, Track};

use crate::motion::{Comparison, Pair, Truth, compare, pose};
use crate::recording::{PoseRole, Recording, Signal};
use crate::wiring::{Stage, Wiring};

/// The kinds of samples that the accuracy is made of: truths, tracks, and when a tracker took another reference.
const KINDS: &[&SampleKind] = &[Pose::KIND, Track::KIND, PoseReport::KIND];

/// Motion of the filtered head against the truth.
///
/// A track follows another point of the head, and has other axes, than the truth of the rig: only motion can be compared.
/// The mean offset of each reference of the tracker is removed first, as in the report: a rigid offset if the track has
/// all six channels, else the mean of each channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// The estimate's topic.
    pub topic: String,
    /// Number of pairs of truth and estimate.
    pub samples: usize,
    /// Root mean square per axis of the frame, mm; none if the track does not follow the axis. For a track with rotations,
    /// the error at the origin of the truth.
    pub rms_mm: [Option<f64>; 3],
    /// Largest distance, mm.
    pub worst_mm: f64,
    /// Largest distance of the truth from its first position, mm.
    pub moved_mm: f64,
    /// Rotations, where the track has them.
    pub turns: Option<Turns>,
}

/// Rotation of the filtered head against the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Turns {
    /// Root mean square of pitch (about x), roll (about y) and yaw (about z), degrees.
    pub rms_deg: [f64; 3],
    /// Largest angle, degrees.
    pub worst_deg: f64,
    /// Largest angle of the truth from its first orientation, degrees.
    pub turned_deg: f64,
}

impl std::fmt::Display for Accuracy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let named = ["x", "y", "z"].into_iter().zip(self.rms_mm);
        let axes =
            named.filter_map(|(axis, rms)| Some(format!("{axis} {}", three(rms?)))).collect::<Vec<_>>();
        write!(
            f,
            "accuracy of {} against the truth of the rig, without the constant offset: rms {} mm, worst {} mm, while the \
             head moved up to {} mm",
            self.topic,
            axes.join(", "),
            three(self.worst_mm),
            three(self.moved_mm)
        )?;
        if let Some(Turns { rms_deg: [x, y, z], worst_deg, turned_deg }) = self.turns {
            let [x, y, z, worst, turned] = [x, y, z, worst_deg, turned_deg].map(three);
            write!(
                f,
                "; rms pitch {x}, roll {y}, yaw {z} degrees, worst {worst}, while the head turned up to {turned}"
            )?;
        }
        write!(f, " ({} samples)", self.samples)
    }
}

/// A number with three significant digits, and at most six decimals.
fn three(value: f64) -> String {
    let before = if value == 0.0 { 0.0 } else { libm::log10(value.abs()).floor() };
    let digits = (2.0 - before).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}

/// The accuracy of a session that keeps a truth and a track in one frame, else `None`. If there are several tracks, the
/// last of a chain counts. The report and this function share one comparison.
pub fn of_session(session: &Session) -> Option<Accuracy> {
    // Neither the path nor any other sample has a part in it.
    let recording = Recording::read_kinds(session, Path::new(""), KINDS);
    let tracks: Vec<&Signal> =
        recording.signals.iter().filter(|s| matches!(s.part, PoseRole::Filtered | PoseRole::Fused)).collect();
    let names: Vec<&str> = tracks.iter().map(|s| s.topic.as_str()).collect();
    let last = last_of(&names, &recording.wiring);
    tracks.into_iter().filter(|s| last.contains(&s.topic.as_str())).find_map(|track| {
        let truth = recording.truth_of(track)?;
        of_comparison(&track.topic, &compare(&Truth::of(truth), track.states.items()))
    })
}

/// The tracks from which no operator makes another track.
fn last_of<'a>(tracks: &[&'a str], wiring: &Wiring) -> Vec<&'a str> {
    let makes_another =
        |stage: &Stage, of: &str| stage.outputs.iter().any(|o| o != of && tracks.contains(&o.as_str()));
    let is_last = |name: &&&str| !wiring.consumers(name).any(|stage| makes_another(stage, name));
    tracks.iter().filter(is_last).copied().collect()
}

/// The figures of a comparison; `None` where it has no pairs.
fn of_comparison(topic: &str, found: &Comparison) -> Option<Accuracy> {
    let pairs = &found.pairs;
    let first = position(&pairs.first()?.truth);
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    // An axis that the track does not follow has no error.
    let error = |pair: &Pair| position(&pair.error).map(|e| if e.is_nan() { 0.0 } else { e });
    let rms = |channel: usize| found.figures(topic, channel).map(|figures| figures.rms);
    Some(Accuracy {
        topic: topic.to_owned(),
        samples: pairs.len(),
        rms_mm: [0, 1, 2].map(rms),
        worst_mm: most(&mut pairs.iter().map(|p| error(p).norm())) * 1e3,
        moved_mm: most(&mut pairs.iter().map(|p| (position(&p.truth) - first).norm())) * 1e3,
        turns: turns(pairs, [rms(3), rms(4), rms(5)]),
    })
}

fn position(channels: &[f64; 6]) -> Vector3<f64> {
    Vector3::new(channels[0], channels[1], channels[2])
}

/// The figures of the rotation, where every pair has all three angles.
fn turns(pairs: &[Pair], rms: [Option<f64>; 3]) -> Option<Turns> {
    let [Some(pitch), Some(roll), Some(yaw)] = rms else { return None };
    let is_whole = |p: &Pair| p.truth[3..].iter().chain(&p.error[3..]).all(|angle| angle.is_finite());
    if !pairs.iter().all(is_whole) {
        return None;
    }
    let truth = |p: &Pair| pose(p.truth).rotation;
    let estimate = |p: &Pair| pose(std::array::from_fn(|i| p.truth[i] + p.error[i])).rotation;
    let first = truth(pairs.first()?);
    let most = |angles: &mut dyn Iterator<Item = f64>| angles.fold(0.0, f64::max).to_degrees();
    Some(Turns {
        rms_deg: [pitch, roll, yaw],
        worst_deg: most(&mut pairs.iter().map(|p| estimate(p).angle_to(&truth(p)))),
        turned_deg: most(&mut pairs.iter().map(|p| truth(p).angle_to(&first))),
    })
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::Standing;

    use super::*;
    use crate::motion::numbers;
    use crate::recording::State;
    use crate::thinned::Thinned;

    fn state(origin: usize, channels: [f64; 6]) -> State {
        let covariance = std::array::from_fn(|i| if i % 7 == 0 { 1e-6 } else { 0.0 });
        State { origin: origin as u64, channels, covariance, nis: f64::NAN, standing: Standing::Measured }
    }

    /// The accuracy of estimates at the times of these truths, with new references of the tracker at these times.
    fn of(truth: &[[f64; 6]], estimate: &[[f64; 6]], references: &[u64]) -> Option<Accuracy> {
        let states = |channels: &[[f64; 6]]| {
            let mut retained = Thinned::default();
            channels.iter().enumerate().for_each(|(k, c)| retained.push(state(k, *c)));
            retained
        };
        let truth = Signal {
            topic: "rig.truth".into(),
            frame: None,
            part: PoseRole::Truth,
            states: states(truth),
            tracking: None,
            references: references.to_vec(),
        };
        of_comparison("it", &compare(&Truth::of(&truth), states(estimate).items()))
    }

    /// A head that nods about a point 0.1 m below the one that is compared, 0.1 rad at most.
    fn nods() -> Vec<[f64; 6]> {
        let angle = |i: i32| 0.1 * (f64::from(i) * 0.7).sin();
        let nod = |i| [0.0, -0.1 * angle(i).sin(), 0.1 * angle(i).cos(), angle(i), 0.0, 0.0];
        (0..20).map(nod).collect()
    }

    fn seen_from(truth: &[f64; 6], own: [f64; 6]) -> [f64; 6] {
        numbers(&(pose(*truth) * pose(own)))
    }

    const NAN: f64 = f64::NAN;

    #[test]
    fn a_pose_of_another_place_on_the_head_is_exact() {
        let elsewhere = |truth: &[f64; 6]| seen_from(truth, [0.02, 0.05, -0.03, 0.3, -0.2, 1.0]);
        let estimates: Vec<_> = nods().iter().map(elsewhere).collect();
        let found = of(&nods(), &estimates, &[]).unwrap();
        let turns = found.turns.unwrap();
        assert!(found.worst_mm < 1e-9 && turns.worst_deg < 1e-5, "{} {turns:?}", found.worst_mm);
        assert!(found.moved_mm > 9.0 && turns.turned_deg > 5.0, "{turns:?}");
        // By its position alone it is not.
        let positions: Vec<_> = estimates.iter().map(|e| [e[0], e[1], e[2], NAN, NAN, NAN]).collect();
        let found = of(&nods(), &positions, &[]).unwrap();
        assert!(found.worst_mm > 1.0 && found.turns.is_none());
    }

    #[test]
    fn each_capture_has_an_offset_of_its_own() {
        let own = |k: usize| if k < 12 { [0.02, 0.05, -0.03, 0.3, -0.2, 1.0] } else { [0.0; 6] };
        let estimates: Vec<_> = nods().iter().enumerate().map(|(k, t)| seen_from(t, own(k))).collect();
        assert!(of(&nods(), &estimates, &[]).unwrap().worst_mm > 10.0);
        let found = of(&nods(), &estimates, &[12]).unwrap();
        assert!(found.worst_mm < 1e-9 && found.turns.as_ref().unwrap().worst_deg < 1e-5, "{found:?}");
        assert_eq!(found.samples, 20);
    }

    #[test]
    fn small_errors_keep_three_digits() {
        let reported = [0.0, 0.004_321, 0.3, 12.345, 1234.5].map(three);
        assert_eq!(reported, ["0.00", "0.00432", "0.300", "12.3", "1234"]);
    }

    #[test]
    fn errors_are_told_per_axis() {
        let still = vec![[0.0; 6]; 10];
        let off = |k: usize| if k.is_multiple_of(2) { 1e-3 } else { -1e-3 };
        let moved: Vec<_> = (0..10).map(|k| [NAN, off(k), 0.0, NAN, NAN, NAN]).collect();
        let found = of(&still, &moved, &[]).unwrap();
        assert_eq!(found.rms_mm[0], None);
        assert!((found.rms_mm[1].unwrap() - 1.0).abs() < 1e-9 && found.rms_mm[2].unwrap().abs() < 1e-9);
        let turned: Vec<_> = (0..10).map(|k| [0.0, 0.0, 0.0, 0.0, 0.0, off(k)]).collect();
        let found = of(&still, &turned, &[]).unwrap();
        assert!((found.turns.unwrap().rms_deg[2] - 1e-3_f64.to_degrees()).abs() < 1e-9);
        assert!(of(&still, &[], &[]).is_none());
    }
}
