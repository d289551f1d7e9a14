//! A person on the rig whose neck bends and whose face moves, in the default pipeline, closed from camera to valve.

use nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_samples::{
    Actuation, ActuationReason, ActuationState, Gate, Pose, PoseReport, PoseStatus, Proof, Target,
};
use stillpoint_testing::Run;

use crate::default_pipeline::{default_pipeline, seconds};

/// What the face does, from when and until when, s.
const ACTS: [(&str, f64, f64); 6] = [
    ("smile", 13.0, 16.0),
    ("swallow", 18.0, 19.2),
    ("jaw", 21.0, 23.0),
    ("talk", 25.0, 28.0),
    ("brow", 30.0, 31.5),
    ("blink", 33.0, 34.5),
];
const MS: u64 = 37_000;

/// The default pipeline with this person.
fn person(acts: &[(&str, f64, f64)], soft_tissue: &str, ms: u64) -> Run {
    let act = |(act, from, to): &(&str, f64, f64)| {
        format!("{{ act: {act}, at: {from} s, lasts: {} ms }}", ((to - from) * 1e3).round())
    };
    let acts: Vec<String> = acts.iter().map(act).collect();
    let rig = format!("motion: breathes, neck: skin, expressions: [{}], camera", acts.join(", "));
    let head = format!("soft_tissue: {soft_tissue}, origin: centre");
    default_pipeline(&[("motion: breathes, camera", &rig), ("origin: centre", &head)], ms)
}

/// True height less its target, mm, and pitch and roll, degrees, at each time, s.
fn errors(run: &Run) -> Vec<(f64, [f64; 3])> {
    let targets = run.samples::<Target>("target.reference");
    let error = |pose: &stillpoint_samples::View<'_, Pose>| {
        let target = targets.iter().rev().find(|t| t.header.stamp <= pose.header.stamp)?.first()?;
        let pose_numbers = pose.first()?;
        let [w, x, y, z] = pose_numbers.orientation;
        let (pitch, roll, _) = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).euler_angles();
        let height = (pose_numbers.position[2] - target.position[2]) * 1e3;
        let angles = [pitch - target.angles[0], roll - target.angles[1]].map(f64::to_degrees);
        Some((seconds(pose.header.stamp), [height, angles[0], angles[1]]))
    };
    run.samples::<Pose>("rig.truth").iter().filter_map(error).collect()
}

/// Period of the breath, s.
const BREATH: f64 = 4.0;

/// Greatest change of the errors, each in the mean of a breath, from one time to another, s: valves that hold let the
/// breath pass.
fn off(errors: &[(f64, [f64; 3])], from: f64, to: f64) -> [f64; 3] {
    let mean = |until: f64| {
        let of = || errors.iter().filter(move |(at, _)| (until - BREATH..until).contains(at)).map(|(_, e)| e);
        let count = of().count() as f64;
        std::array::from_fn::<f64, 3, _>(|i| of().map(|e| e[i]).sum::<f64>() / count)
    };
    let before = mean(from);
    assert!(before.iter().all(|e| e.is_finite()));
    let steps = (0..).map(|k| from + 0.1 * f64::from(k)).take_while(|at| *at <= to).map(mean);
    steps.fold([0.0; 3], |most, now| std::array::from_fn(|i| f64::max(most[i], (now[i] - before[i]).abs())))
}

/// Greatest deviation of the errors, at any time, from their mean in the breath before a time, s: with the breath.
fn peak(errors: &[(f64, [f64; 3])], before: f64, from: f64, to: f64) -> [f64; 3] {
    let of =
        |from: f64, to: f64| errors.iter().filter(move |(at, _)| (from..to).contains(at)).map(|(_, e)| e);
    let count = of(before - BREATH, before).count() as f64;
    let mean: [f64; 3] =
        std::array::from_fn(|i| of(before - BREATH, before).map(|e| e[i]).sum::<f64>() / count);
    of(from, to)
        .fold([0.0; 3], |most, now| std::array::from_fn(|i| f64::max(most[i], (now[i] - mean[i]).abs())))
}

/// Times in which actuation was in a state, s.
fn times(run: &Run, state: ActuationState) -> Vec<f64> {
    let states = run.samples::<Actuation>("valves.state");
    let is = |s: &&stillpoint_samples::View<'_, Actuation>| s.first().unwrap().state() == state;
    states.iter().filter(is).map(|s| seconds(s.header.stamp)).collect()
}

#[test]
fn a_face_that_moves_costs_beam_at_most_and_vents_nothing() {
    let run = person(&ACTS, "weighted", MS);
    let reports = run.samples::<PoseReport>("head.report");
    assert_eq!(reports.last().unwrap().first().unwrap().proof, Proof::Proven as u32);
    let gates = run.samples::<Gate>("gate.state");
    let errors = errors(&run);
    let beam = |from: f64, to: f64| {
        let of = gates.iter().filter(|g| (from..to).contains(&seconds(g.header.stamp)));
        let (on, all) = of.fold((0, 0), |(on, all), g| (on + g.first().unwrap().beam, all + 1));
        f64::from(on) / f64::from(all)
    };
    eprintln!("beam before the first face {:.2}, off by {:.2?}", beam(11.0, 13.0), off(&errors, 11.0, 13.0));
    for (act, from, to) in ACTS {
        let status = |s: PoseStatus| {
            let of = reports.iter().filter(|r| (from..to).contains(&seconds(r.header.origin)));
            of.filter(|r| r.first().unwrap().status == s as u32).count()
        };
        let back = gates
            .iter()
            .find(|g| seconds(g.header.stamp) >= to && g.first().unwrap().beam == 1)
            .map(|g| seconds(g.header.stamp) - to);
        let off = off(&errors, from, to + 2.0);
        let (peak, quiet) = (peak(&errors, from, from, to + 2.0), peak(&errors, from, from - BREATH, from));
        eprintln!(
            "{act:8} moves {}, unsure {}, doubted {}, tracked {}; beam {:.2}, back after {back:.2?} s; head off by {off:.2?}, at most {peak:.2?}, {quiet:.2?} in the breath before",
            status(PoseStatus::FaceMoves),
            status(PoseStatus::FaceUnsure),
            status(PoseStatus::Doubted),
            status(PoseStatus::Tracked),
            beam(from, to),
        );
    }
    let armed = times(&run, ActuationState::Armed)[0];
    let after = |state| times(&run, state).into_iter().filter(|at| *at > armed).collect::<Vec<_>>();
    assert_eq!(after(ActuationState::Venting), [0.0; 0]);
    assert_eq!(after(ActuationState::Fault), [0.0; 0]);
    for (act, from, to) in ACTS {
        let [mm, pitch, roll] = off(&errors, from, to + 2.0);
        assert!(mm < 0.5 && pitch < 0.4 && roll < 0.4, "{act}: {mm} mm, {pitch}, {roll} degrees");
        // At any moment, with the breath that valves which hold let pass.
        let [mm, pitch, roll] = peak(&errors, from, from, to + 2.0);
        assert!(mm < 1.2 && pitch < 0.5 && roll < 0.6, "{act}: at most {mm} mm, {pitch}, {roll} degrees");
        let back = |g: &&stillpoint_samples::View<'_, Gate>| {
            (to..to + 1.0).contains(&seconds(g.header.stamp)) && g.first().unwrap().beam == 1
        };
        assert!(gates.iter().any(|g| back(&g)), "{act}: no beam within a second");
    }
    // Some of them are seen as what they are.
    let holding = run.samples::<Actuation>("valves.state");
    assert!(holding.iter().any(|s| s.first().unwrap().reasons == ActuationReason::FACE_MOVES));
}

/// What it is about: without the weighing of soft tissue the same smile lets go of the head.
#[test]
fn a_smile_vents_where_soft_tissue_is_ignored() {
    let run = person(&[("smile", 8.0, 11.0)], "ignored", 11_000);
    assert!(!times(&run, ActuationState::Venting).is_empty());
}
