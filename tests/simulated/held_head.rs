//! Heads on bladders whose loop closes through images.

use nalgebra::{UnitQuaternion, Vector3};
use stillpoint_control::response::{response, steps};
use stillpoint_mechanics::contact::friction::{FingerForce, Friction};
use stillpoint_mechanics::plant::layouts;
use stillpoint_operator::files::DiskFiles;
use stillpoint_samples::{Actuation, Duties, Pose, RigMode, RigState, Target, Track};
use stillpoint_testing::{Run, run_keeping};

use crate::{from_root, registry};

pub fn held(name: &str, changes: &[(&str, &str)], ms: u64) -> Run {
    let path = from_root("examples").join(name);
    let mut text = std::fs::read_to_string(&path).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "{name} lacks {from}");
        text = text.replace(from, to);
    }
    let run = run_keeping(no_image, &text, &registry(), &DiskFiles::next_to(&path), ms)
        .unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!(run.failed(), [] as [&str; 0], "{name}");
    run
}

/// Five minutes of images are some gigabytes.
fn no_image(topic: &str) -> bool {
    let others =
        ["valves.state", "far.state", "law.duties", "target.reference", "fused.state", "contacts.contacts"];
    topic.starts_with("rig.") && topic != "rig.depth" || others.contains(&topic)
}

/// x, y, z in mm and pitch, roll, yaw in degrees from the first pose, by the truth.
pub fn moved(run: &Run) -> Vec<[f64; 6]> {
    let poses = run.samples::<Pose>("rig.truth");
    let first = poses[0].first().unwrap().position;
    poses
        .iter()
        .map(|pose| {
            let pose = pose.first().unwrap();
            let [w, x, y, z] = pose.orientation;
            let q = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
            let (pitch, roll, yaw) = q.euler_angles();
            let p: [f64; 3] = std::array::from_fn(|i| (pose.position[i] - first[i]) * 1e3);
            [p[0], p[1], p[2], pitch.to_degrees(), roll.to_degrees(), yaw.to_degrees()]
        })
        .collect()
}

pub fn rms(moved: &[[f64; 6]]) -> [f64; 6] {
    std::array::from_fn(|i| (moved.iter().map(|m| m[i] * m[i]).sum::<f64>() / moved.len() as f64).sqrt())
}

/// A quarter of the pixels, for the test's time.
pub const SMALL: (&str, &str) = (
    "camera: { every: 50 ms }",
    "camera: { every: 50 ms, width: 320 px, height: 240 px, focal_length: 283 px }",
);

const TINY: (&str, &str) = (
    "camera: { every: 50 ms }",
    "camera: { every: 50 ms, width: 160 px, height: 120 px, focal_length: 141.5 px }",
);

/// Every bladder pushes, below the limit of the rigs, and within what its model covers.
pub fn hold_bladders(run: &Run) {
    for state in &run.samples::<RigState>("rig.state")[100..] {
        let state = state.first().unwrap();
        assert!(state.mode() != RigMode::Waiting && state.unmodelled == 0, "{state:?}");
        let bladders = state.bladders as usize;
        assert!(state.pressure[..bladders].iter().all(|p| *p < 40e3), "{state:?}");
        assert!(state.force[..bladders].iter().all(|f| *f > 0.5), "{state:?}");
    }
}

/// Rubber on skin or cloth.
const FRICTION: Friction = Friction { sliding: 0.5, spinning: 0.0 };

/// The force of each of the eight is inside the friction cone of its place on the head, which turns under it.
fn hold_without_slipping(run: &Run) {
    let turn =
        |[w, x, y, z]: [f64; 4]| UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
    let turns: Vec<_> =
        run.samples::<Pose>("rig.truth").iter().map(|p| turn(p.first().unwrap().orientation)).collect();
    let states = run.samples::<RigState>("rig.state");
    assert_eq!(states.len(), turns.len());
    let mut steepest = 0.0_f64;
    for (state, turned) in states.iter().zip(&turns).skip(100) {
        let state = state.first().unwrap();
        for bladder in 0..8 {
            let (place, push) = layouts::around(bladder);
            let inwards = -Vector3::new(place.x, 0.0, place.z).normalize();
            let normal = turned * turns[0].inverse() * inwards;
            let force = push * state.force[bladder];
            let along = force.dot(&normal);
            let across = (force - normal * along).norm();
            steepest = steepest.max(across / along);
            let finger = FingerForce { force: Vector3::new(across, 0.0, along), torque: 0.0 };
            assert!(FRICTION.margin(&finger).is_inside(), "bladder {bladder}: {finger:?}");
        }
    }
    eprintln!("greatest part across the normal: {steepest:.3}");
}

/// Nothing was ever in want of anything, from when it was armed to the end.
pub fn stays_armed(run: &Run) {
    let states = run.samples::<Actuation>("valves.state");
    let words: Vec<_> = states.iter().map(|s| s.first().unwrap().state().word()).collect();
    let armed = words.iter().position(|word| *word == "armed").expect("the script arms");
    assert!(words[armed..].iter().all(|word| *word == "armed"));
}

#[test]
fn eight_bladders_hold_a_head_that_breathes_and_nods() {
    let run = held("head-6dof.yaml", &[SMALL], 40_000);
    let held = rms(&moved(&run)[1000..]);
    eprintln!("rms from 10 s on, mm and deg: {held:.3?}");
    assert!(held[..3].iter().all(|mm| *mm < 0.5) && held[3..].iter().all(|deg| *deg < 0.3), "{held:?}");
    hold_bladders(&run);
    hold_without_slipping(&run);
    stays_armed(&run);
}

/// Mean force of each of the eight over 30 s, which have nods and breaths in them, N, one behind the other from 10 s
/// on.
fn forces(run: &Run) -> Vec<[f64; 8]> {
    let states = run.samples::<RigState>("rig.state");
    let mean = |part: &[stillpoint_samples::View<'_, RigState>]| {
        let sum = |j: usize| part.iter().map(|s| s.first().unwrap().force[j]).sum::<f64>();
        std::array::from_fn(|j| sum(j) / part.len() as f64)
    };
    states[1000..].chunks_exact(3000).map(mean).collect()
}

/// Pose feedback alone lets the eight press against each other ever harder: each of them pushed with 116 to 138 N after
/// five minutes.
#[test]
fn eight_bladders_squeeze_a_head_no_harder_after_a_hundred_seconds() {
    squeezes_no_harder(100);
}

#[test]
#[ignore = "a long hold: .ci/soak holds"]
fn eight_bladders_squeeze_a_head_no_harder_after_five_minutes() {
    squeezes_no_harder(310);
}

/// Over `seconds` no bladder pushes much harder or softer than over the first 30 s, and together they push no harder.
fn squeezes_no_harder(seconds: u64) {
    let run = held("head-6dof.yaml", &[TINY], 1000 * seconds);
    let held = rms(&moved(&run)[1000..]);
    let forces = forces(&run);
    let first = forces[0];
    let off = |later: &[f64; 8]| {
        later.iter().zip(&first).map(|(f, first)| (f / first - 1.0).abs()).fold(0.0, f64::max)
    };
    let most = forces.iter().map(off).fold(0.0, f64::max);
    eprintln!("rms, mm and deg: {held:.3?}; N, over 30 s each: {forces:.1?}");
    let mean = |each: &[f64; 8]| each.iter().sum::<f64>() / 8.0;
    let harder = forces.iter().map(mean).fold(0.0, f64::max) / mean(&first) - 1.0;
    eprintln!("farthest from the first: {:.1} %; mean of all eight: +{:.1} %", 100.0 * most, 100.0 * harder);
    // Loads of the person come and go, on one side or the other; the squeeze is what all have together.
    assert!(
        forces.len() as u64 == (seconds - 10) / 30 && harder < 0.05 && most < 0.4,
        "{harder} {most}: {forces:.1?}"
    );
    assert!(held[..3].iter().all(|mm| *mm < 0.5) && held[3..].iter().all(|deg| *deg < 0.3), "{held:?}");
    hold_bladders(&run);
    hold_without_slipping(&run);
    stays_armed(&run);
    // The pressures come from duties: these are as old as the image behind them all the same.
    let duties = run.samples::<Duties>("law.duties");
    assert!(
        duties.len() as u64 > 20 * (seconds - 10)
            && duties.iter().all(|d| d.header.stamp - d.header.origin < 300_000_000)
    );
}

#[test]
fn a_head_that_is_pushed_by_5_mm_and_3_degrees_is_back_in_5_s() {
    let push = "motion: still, pushes: [{ at: 5 s, shift: [0 mm, 0 mm, 5 mm], turn: [3 deg, 0 deg, 0 deg] }]";
    let run = held("head-6dof.yaml", &[SMALL, ("motion: nods", push)], 14_000);
    let moved = moved(&run);
    let worst = |from: usize| {
        let after = &moved[from..];
        let most = |i: usize| after.iter().map(|m| m[i].abs()).fold(0.0, f64::max);
        [most(2), most(3)]
    };
    let (pushed, back) = (worst(500), worst(1000));
    eprintln!("pushed by {pushed:.2?} mm and deg, back within {back:.3?} after 5 s");
    assert!(pushed[0] > 1.0 && pushed[1] > 1.0, "{pushed:?}");
    assert!(back[0] < 0.5 && back[1] < 0.3, "{back:?}");
    hold_bladders(&run);
    hold_without_slipping(&run);
    // The filter takes no such jump for a measurement until it has seen it a few times: for that long the pose is
    // stale.
    let last = *run.samples::<Actuation>("valves.state").last().unwrap().first().unwrap();
    assert_eq!((last.state().word(), last.faults), ("armed", 0));
}

/// Section 4.2, figure 4.7: the dissertation's standard deviation is 1.5 mm, its overshoot 5 mm, it settles in 24 s. By
/// the measure of the reports, a band of 5 % of the step. The truth answers both steps; the estimate is judged with it,
/// but for when it settles: its noise alone leaves the quarter of a millimetre that the step down has for a band.
#[test]
fn one_bladder_and_two_cameras_hold_a_height() {
    for seed in ["3", "1", "2"] {
        let (seed, rig) = (format!("\nseed: {seed}\n"), format!("      motion: still\n      seed: {seed}\n"));
        let changes = [("\nseed: 3\n", seed.as_str()), ("      motion: still\n", rig.as_str())];
        let run = held("one-dof-lqg.yaml", &changes, 34_000);
        hold_bladders(&run);
        stays_armed(&run);
        let mm = |stamp: u64, m: f64| (stamp as f64 * 1e-9, m * 1e3);
        let targets = run.samples::<Target>("target.reference");
        let target: Vec<_> =
            targets.iter().map(|t| mm(t.header.stamp, t.first().unwrap().position[2])).collect();
        let poses = run.samples::<Pose>("rig.truth");
        let truth: Vec<_> =
            poses.iter().map(|p| mm(p.header.stamp, p.first().unwrap().position[2])).collect();
        let tracks = run.samples::<Track>("fused.state");
        let seen: Vec<_> =
            tracks.iter().map(|t| mm(t.header.origin, t.first().unwrap().position[2])).collect();
        let steps = steps(&target, target.last().unwrap().0);
        // The truth as the cameras would have it without what changes of their errors, as in a report.
        let at = |time: f64| truth.iter().rfind(|(t, _)| *t <= time).unwrap().1;
        let offset = seen.iter().map(|(time, z)| z - at(*time)).sum::<f64>() / seen.len() as f64;
        // The claimed variance is that of the errors. The filters allow for more acceleration than there is, so it is
        // rather too large.
        let squared = tracks.iter().map(|t| {
            let (track, time) = (t.first().unwrap(), t.header.origin as f64 * 1e-9);
            let error = (track.position[2] * 1e3 - at(time) - offset) * 1e-3;
            error * error / track.covariance[2 * 12 + 2]
        });
        let nees = squared.sum::<f64>() / tracks.len() as f64;
        eprintln!("seed {}: NEES {nees:.2}", seed.trim());
        assert!((0.5..1.5).contains(&nees), "{nees}");
        let as_seen: Vec<_> = truth.iter().map(|(time, z)| (*time, z + offset)).collect();
        let heights: Vec<f64> = steps.iter().map(|s| (s.to - s.from).round()).collect();
        assert_eq!(heights, [10.0, -5.0]);
        for step in steps {
            let by_truth = response(step, &as_seen).unwrap();
            let by_estimate = response(step, &seen).unwrap();
            eprintln!("seed {}: by truth {by_truth:.2?}\n  by estimate {by_estimate:.2?}", &seed.trim());
            assert!(by_truth.settling_s.is_some_and(|s| s <= 10.0), "{by_truth:?}");
            for found in [by_truth, by_estimate] {
                assert!(found.overshoot <= 1.0 && found.sd <= 0.5 && found.left.abs() < 0.25, "{found:?}");
            }
        }
    }
}
