//! Heads on bladders whose loop closes through images.

use stillpoint_pipeline::files::DiskFiles;
use stillpoint_samples::{Pose, RigMode, RigState};
use stillpoint_testing::{Run, run};

use crate::{from_root, registry};

fn held(name: &str, changes: &[(&str, &str)], ms: u64) -> Run {
    let path = from_root("examples").join(name);
    let mut text = std::fs::read_to_string(&path).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "{name} lacks {from}");
        text = text.replace(from, to);
    }
    let run =
        run(&text, &registry(), &DiskFiles::beside(&path), ms).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!(run.failed(), [] as [&str; 0], "{name}");
    run
}

/// x, y, z in mm and pitch, roll, yaw in degrees from the first pose, by the truth.
fn moved(run: &Run) -> Vec<[f64; 6]> {
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

fn rms(moved: &[[f64; 6]]) -> [f64; 6] {
    std::array::from_fn(|i| (moved.iter().map(|m| m[i] * m[i]).sum::<f64>() / moved.len() as f64).sqrt())
}

/// A quarter of the pixels, for the test's time.
const SMALL: (&str, &str) = (
    "camera: { every: 50 ms }",
    "camera: { every: 50 ms, width: 320 px, height: 240 px, focal_length: 283 px }",
);

/// Every bladder pushes, below the limit of the rigs, within what its model covers, and nothing is vented.
fn hold_bladders(run: &Run) {
    for state in &run.samples::<RigState>("rig.state")[100..] {
        let state = state.first().unwrap();
        assert_eq!((state.mode(), state.unmodelled), (RigMode::Driven, 0), "{state:?}");
        let bladders = state.bladders as usize;
        assert!(state.pressure[..bladders].iter().all(|p| *p < 40e3), "{state:?}");
        assert!(state.force[..bladders].iter().all(|f| *f > 0.5), "{state:?}");
    }
}

#[test]
fn eight_bladders_hold_a_head_that_breathes_and_nods() {
    let run = held("head-6dof.yaml", &[SMALL], 40_000);
    let held = rms(&moved(&run)[1000..]);
    eprintln!("rms from 10 s on, mm and deg: {held:.3?}");
    assert!(held[..3].iter().all(|mm| *mm < 0.5) && held[3..].iter().all(|deg| *deg < 0.3), "{held:?}");
    hold_bladders(&run);
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
}
