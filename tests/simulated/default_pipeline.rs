//! `pipeline.yaml` at the root: from camera to valve and beam.

use stillpoint_operator::files::DiskFiles;
use stillpoint_operator::{Registry, Stage};
use stillpoint_pipeline::graph::Priority;
use stillpoint_pipeline::live::contracts;
use stillpoint_samples::{
    Actuation, ActuationReason, ActuationState, DepthImage, FarEnd, FarEndDoing, Gate, GateReason, Pose,
    PoseReport, PoseStatus, Proof, RigState, Target, Track, View,
};
use stillpoint_testing::run::START;
use stillpoint_testing::{Run, run};

use crate::held_head::{hold_bladders, stays_armed};
use crate::{FAMILIES, from_root};

pub fn default_pipeline(changes: &[(&str, &str)], ms: u64) -> Run {
    default_pipeline_of(&[], changes, ms)
}

/// The same with further kinds of operators.
pub fn default_pipeline_of(kinds: &'static [Stage], changes: &[(&str, &str)], ms: u64) -> Run {
    let path = from_root("pipeline.yaml");
    let mut text = std::fs::read_to_string(&path).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "the pipeline lacks {from}");
        text = text.replace(from, to);
    }
    let registry = Registry::new(&[FAMILIES, &[kinds]].concat());
    let run = run(&text, &registry, &DiskFiles::next_to(&path), ms).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(run.failed(), [] as [&str; 0]);
    run
}

/// Time of a sample since the start of the run, s.
pub fn seconds(stamp: u64) -> f64 {
    (stamp - START) as f64 * 1e-9
}

/// Errors of height in mm, pitch and roll in degrees, against the target at the same time.
fn errors(run: &Run) -> Vec<(f64, [f64; 3])> {
    let targets = run.samples::<Target>("target.reference");
    let newest = |stamp: u64| targets.iter().rev().find(|t| t.header.stamp <= stamp)?.first();
    run.samples::<Track>("filter.state")
        .iter()
        .filter_map(|state| {
            let (track, target) = (state.first()?, newest(state.header.stamp)?);
            let [w, x, y, z] = track.orientation;
            let q = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
            let (pitch, roll, _) = q.euler_angles();
            let height = (track.position[2] - target.position[2]) * 1e3;
            let angle = |is: f64, due: f64| (is - due).to_degrees();
            Some((
                seconds(state.header.stamp),
                [height, angle(pitch, target.angles[0]), angle(roll, target.angles[1])],
            ))
        })
        .collect()
}

#[test]
fn from_camera_to_valve_a_step_is_reached_and_the_beam_waits_for_it() {
    let run = default_pipeline(&[("at: 2.5 s, z:", "at: 4 s, z:")], 21_500);
    // Armed by the script's person, and never in want of anything after that.
    let last_state = |at: f64| {
        let states = run.samples::<Actuation>("valves.state");
        states.iter().rev().find(|s| seconds(s.header.stamp) < at).unwrap().first().unwrap().state
    };
    assert_eq!(last_state(1.4), ActuationState::Disarmed as u32);
    assert_eq!(last_state(2.0), ActuationState::Armed as u32);
    assert_eq!(last_state(21.0), ActuationState::Armed as u32);
    // The beam is on while the head is held, off while it moves, and on again where it is to be.
    let beam = |from: f64, until: f64| {
        let gates = run.samples::<Gate>("gate.state");
        let within = gates.iter().filter(|g| (from..until).contains(&seconds(g.header.stamp)));
        let on: Vec<bool> = within.map(|g| g.first().unwrap().beam == 1).collect();
        on.iter().filter(|on| **on).count() as f64 / on.len() as f64
    };
    // The breath has to move the head beyond its noise before the first beam.
    let on = run
        .samples::<Gate>("gate.state")
        .iter()
        .find(|g| g.first().unwrap().beam == 1)
        .map(|g| seconds(g.header.stamp));
    assert!(on.is_some_and(|on| on < 4.6) && beam(4.6, 5.0) > 0.9, "held before the step: {on:?}");
    assert_eq!(beam(5.2, 9.5), 0.0, "on its way");
    assert!(beam(15.5, 21.5) > 0.95, "held after the step");
    let far = run.samples::<FarEnd>("far.state");
    let last = far.last().unwrap().first().unwrap();
    assert_eq!((last.doing(), last.beam, last.refused, last.missing), (FarEndDoing::Following, 1, 0, 0));
    for (time, [height, pitch, roll]) in errors(&run).iter().filter(|(time, _)| *time > 16.5) {
        assert!(
            height.abs() < 0.5 && pitch.abs() < 0.2 && roll.abs() < 0.2,
            "{time} s: {height:.3} mm, {pitch:.3} deg, {roll:.3} deg"
        );
    }
    let states = run.samples::<RigState>("rig.state");
    assert!(states.iter().all(|s| s.first().unwrap().pressure.iter().all(|p| *p < 40e3)));
    assert!(states.iter().all(|s| s.first().unwrap().force[..3].iter().all(|f| *f > 0.5)), "none pulls");
}

/// How far the point that the tracker follows, and the head's axes, have moved by the truth: mm and degrees.
pub fn tracked_point_moved(run: &Run) -> Vec<[f64; 6]> {
    let tracks = run.samples::<Track>("filter.state");
    let point = nalgebra::Point3::from(tracks[0].first().unwrap().position);
    let poses: Vec<nalgebra::Isometry3<f64>> = run
        .samples::<Pose>("rig.truth")
        .iter()
        .map(|pose| {
            let pose = pose.first().unwrap();
            let [w, x, y, z] = pose.orientation;
            let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
            nalgebra::Isometry3::from_parts(nalgebra::Translation3::from(pose.position), turn)
        })
        .collect();
    let from_start = poses.iter().map(|pose| pose * poses[0].inverse());
    from_start
        .map(|motion| {
            let p = (motion * point - point) * 1e3;
            let (pitch, roll, yaw) = motion.rotation.euler_angles();
            [p.x, p.y, p.z, pitch.to_degrees(), roll.to_degrees(), yaw.to_degrees()]
        })
        .collect()
}

/// Figure 4.11, by the truth: a step of 11.5 mm, 1.35 and 10 degrees with the dissertation's reference model of 20 s.
#[test]
fn a_breathing_head_goes_along_the_sources_step_as_the_reference_model_says() {
    let small = "camera: { every: 100 ms, width: 320 px, height: 240 px, focal_length: 283 px }";
    let run = default_pipeline(
        &[
            ("rise: 5 s", "rise: 20 s"),
            ("at: 2.5 s, z:", "at: 2 s, z:"),
            ("camera: { every: 100 ms }", small),
        ],
        60_000,
    );
    let moved = tracked_point_moved(&run);
    let at = |ms: usize| ms / 5;
    // Targets count from where the head is seen to be on the average in the second after the reference is taken.
    let second = &moved[at(600)..at(1600)];
    let start: [f64; 6] =
        std::array::from_fn(|i| second.iter().map(|m| m[i]).sum::<f64>() / second.len() as f64);
    let route = |moved: &[f64; 6], channel: usize| moved[2 + channel] - start[2 + channel];
    let step = [11.5, 1.35, 10.0];
    // The step is asked for at 3.6 s; a first-order rise of 20 s takes it to 90 % in 21 s.
    for (channel, size) in step.iter().enumerate() {
        let part = route(&moved[at(24_600)], channel) / size;
        assert!((0.8..1.0).contains(&part), "channel {channel}: {part} of the step after 21 s");
    }
    let most: Vec<f64> = (0..3)
        .map(|i| moved[at(43_600)..].iter().map(|m| (route(m, i) - step[i]).abs()).fold(0.0, f64::max))
        .collect();
    eprintln!("at most {most:.3?} (mm, deg, deg) off the step from 40 s to the end");
    assert!(most[0] < 0.5 && most[1] < 0.2 && most[2] < 0.2, "{most:?}");
    hold_bladders(&run);
    stays_armed(&run);
}

#[test]
fn a_camera_that_goes_blind_ends_the_beam_and_then_vents_the_rig() {
    let blind = ("motion: breathes,", "motion: breathes, faults: [{ kind: blind_camera, at: 5 s }],");
    let run = default_pipeline(&[blind, ("at: 2.5 s, z: 11.5 mm", "at: 1 h, z: 11.5 mm")], 7_000);
    let gates = run.samples::<Gate>("gate.state");
    let off = gates
        .iter()
        .find(|g| seconds(g.header.stamp) > 5.0 && g.first().unwrap().beam == 0)
        .map(|g| seconds(g.header.stamp))
        .unwrap();
    let far = run.samples::<FarEnd>("far.state");
    assert!(is_beam_on(&run, 5.0), "the beam is on when it happens");
    let vents = far
        .iter()
        .find(|s| seconds(s.header.stamp) > 5.0 && s.first().unwrap().doing() == FarEndDoing::Venting)
        .map(|s| seconds(s.header.stamp))
        .unwrap();
    let dark = far
        .iter()
        .find(|s| seconds(s.header.stamp) > 5.0 && s.first().unwrap().beam == 0)
        .map(|s| seconds(s.header.stamp))
        .unwrap();
    // From the event to beam off: 1.5 frame periods and 20 ms. The last good frame is of 4.9 s: stale after three frames,
    // and safe 100 ms later.
    assert!(
        off <= 5.17 && dark <= 5.17 && dark < vents && vents <= 5.3 + 1e-9,
        "off {off}, dark {dark}, vents {vents}"
    );
}

/// Whether the far end has the beam on at a time, s.
fn is_beam_on(run: &Run, at: f64) -> bool {
    let far = run.samples::<FarEnd>("far.state");
    far.iter().rfind(|s| seconds(s.header.stamp) <= at).unwrap().first().unwrap().beam == 1
}

/// When the far end first has the beam off, and with it the gate's reasons, after `event`, s.
pub fn beam_off_after(run: &Run, event: f64) -> (f64, Vec<&'static str>) {
    let far = run.samples::<FarEnd>("far.state");
    let is_on = |s: &View<'_, FarEnd>| s.first().unwrap().beam == 1;
    assert!(is_beam_on(run, event), "the beam is on when it happens");
    let off = far.iter().find(|s| seconds(s.header.stamp) > event && !is_on(s)).unwrap();
    let gates = run.samples::<Gate>("gate.state");
    let output_text =
        gates.iter().find(|g| seconds(g.header.stamp) > event && g.first().unwrap().beam == 0).unwrap();
    (seconds(off.header.stamp), GateReason::words(output_text.first().unwrap().reasons).collect())
}

#[test]
fn a_camera_that_falls_silent_ends_the_beam_as_fast_as_one_that_freezes() {
    for ms in [100, 35] {
        let silent = format!(
            "motion: breathes, camera: {{ every: {ms} ms }}, faults: [{{ kind: silent_camera, at: 5 s }}] }} }}"
        );
        let frames = format!(
            "report: head.report }}, params: {{ key: examples/data/rig.key, pose: {{ frame_period: {ms} ms }} }}"
        );
        let changes = [
            ("motion: breathes, camera: { every: 100 ms } } }", silent.as_str()),
            ("at: 2.5 s, z: 11.5 mm", "at: 1 h, z: 11.5 mm"),
            ("report: head.report }, params: { key: examples/data/rig.key }", frames.as_str()),
        ];
        let run = default_pipeline(&changes, 5_400);
        // The head may move as soon as the last image is taken.
        let images = run.samples::<DepthImage>("rig.depth");
        let last = images.iter().map(|i| seconds(i.header.origin)).rfind(|t| *t < 5.0).unwrap();
        let (off, reasons) = beam_off_after(&run, last);
        let bound = 1.5e-3 * f64::from(ms) + 0.02;
        assert!(off - last <= bound + 1e-9, "{off} after {last}: {reasons:?}");
        assert!(reasons.contains(&"tracker") || reasons.contains(&"pose stale"), "{reasons:?}");
    }
}

#[test]
fn a_camera_that_freezes_ends_the_beam_and_then_vents_the_rig() {
    let frozen = ("motion: breathes,", "motion: breathes, faults: [{ kind: frozen_camera, at: 5 s }],");
    let run = default_pipeline(&[frozen, ("at: 2.5 s, z: 11.5 mm", "at: 1 h, z: 11.5 mm")], 7_000);
    let first = |stamps: &mut dyn Iterator<Item = u64>| stamps.map(seconds).find(|s| *s > 5.0).unwrap();
    assert!(is_beam_on(&run, 5.0), "the beam is on when it happens");
    let gates = run.samples::<Gate>("gate.state");
    let off = first(&mut gates.iter().filter(|g| g.first().unwrap().beam == 0).map(|g| g.header.stamp));
    let states = run.samples::<Actuation>("valves.state");
    let is_armed = |a: &View<'_, Actuation>| a.first().unwrap().state == ActuationState::Armed as u32;
    let left = first(&mut states.iter().filter(|a| !is_armed(a)).map(|a| a.header.stamp));
    let far = run.samples::<FarEnd>("far.state");
    let dark = first(&mut far.iter().filter(|s| s.first().unwrap().beam == 0).map(|s| s.header.stamp));
    let is_venting = |s: &View<'_, FarEnd>| s.first().unwrap().doing() == FarEndDoing::Venting;
    let vents = first(&mut far.iter().filter(|s| is_venting(s)).map(|s| s.header.stamp));
    // From the event to beam off: 1.5 frame periods and 20 ms. The image of 5.0 s comes again at 5.1, 5.2 and 5.3 s. That
    // last time it is no news for the valves: the pose is of 5.2 s, stale after three frames, and the rig is safe 100 ms
    // later.
    assert!(
        off <= 5.17 && dark <= 5.17 && left <= 5.52 && dark < vents && vents <= 5.6 + 1e-9,
        "{off} {left} {dark} {vents}"
    );
    // Until then it was held, and it does not come back.
    let tracks = run.samples::<Track>("filter.state");
    let frozen = tracks.iter().filter(|t| seconds(t.header.origin) > 5.0 - 1e-9);
    let repeated: Vec<u64> = frozen.map(|t| t.first().unwrap().repeated).collect();
    assert!(repeated.iter().copied().eq(0..20), "{repeated:?}");
    assert!(states.iter().filter(|a| (2.1..5.0).contains(&seconds(a.header.stamp))).all(is_armed));
    assert!(!is_armed(states.last().unwrap()));
}

#[test]
fn a_head_that_never_moves_is_never_proven_and_the_gate_says_so() {
    let still = [("motion: breathes,", "motion: still,"), (", { at: 1.5 s, say: arm, repeat: 500 ms }", "")];
    let run = default_pipeline(&still, 12_000);
    let reports = run.samples::<PoseReport>("head.report");
    let (last, most) =
        (reports.last().unwrap().first().unwrap(), |r: &View<'_, PoseReport>| r.first().unwrap().moved);
    eprintln!("moved at most {:.2} of what counts", reports.iter().map(most).fold(0.0, f64::max));
    assert!(reports.iter().all(|r| r.first().unwrap().proof != Proof::Proven as u32));
    assert_eq!((last.proof, last.confirmed), (Proof::Failed as u32, 1));
    let gates = run.samples::<Gate>("gate.state");
    assert_ne!(gates.last().unwrap().first().unwrap().reasons & GateReason::UNPROVEN, 0);
    assert!(gates.iter().all(|g| g.first().unwrap().beam == 0));
}

#[test]
fn nothing_arms_and_no_beam_is_allowed_on_a_reference_that_nobody_confirmed() {
    let unconfirmed = ("{ at: 1 s, say: confirm, repeat: 500 ms }, ", "");
    let run = default_pipeline(&[unconfirmed, ("at: 2.5 s, z: 11.5 mm", "at: 1 h, z: 11.5 mm")], 6_000);
    let states = run.samples::<Actuation>("valves.state");
    let last = states.last().unwrap().first().unwrap();
    assert_eq!((last.state, last.lacking), (ActuationState::Disarmed as u32, ActuationReason::UNCONFIRMED));
    let gates = run.samples::<Gate>("gate.state");
    assert!(gates.iter().all(|g| g.first().unwrap().beam == 0));
    let reasons = gates.last().unwrap().first().unwrap().reasons;
    assert_ne!(reasons & GateReason::UNCONFIRMED, 0);
    assert_eq!(reasons & GateReason::UNPROVEN, 0, "the head was seen to move by then");
}

#[test]
fn every_frame_of_the_default_pipeline_becomes_a_state() {
    let run = default_pipeline(&[], 3000);
    for topic in
        ["rig.depth", "rig.truth", "cloud.cloud", "face.face", "head.pose", "head.report", "filter.state"]
    {
        assert!(!run.bytes(topic).is_empty(), "{topic}");
    }
    let states = run.samples::<Track>("filter.state");
    // The report of the second reference comes behind its first pose, whose state is made anew.
    let mut frames: Vec<u64> = states.iter().map(|s| s.header.origin).collect();
    assert_eq!(frames.len(), 31);
    frames.dedup();
    assert_eq!(frames.len(), 30);
    let last = states.last().unwrap();
    assert_eq!((last.first().unwrap().accepted, last.first().unwrap().rejected), (31, 0));
    let statuses = run.samples::<PoseReport>("head.report");
    let status = |i: usize| PoseStatus::from_number(statuses[i].first().unwrap().status).unwrap();
    // The first face is a reference, and the one after the script's word at 500 ms.
    let captured: Vec<usize> = (0..30).filter(|i| status(*i) == PoseStatus::Captured).collect();
    assert!(captured.len() == 2 && captured[0] == 0 && (5..=6).contains(&captured[1]), "{captured:?}");
    let others: Vec<_> = (0..30).map(|i| (i, status(i))).filter(|(i, _)| !captured.contains(i)).collect();
    // Now and then one is found by the search, in the same frame.
    let has_pose = |status| matches!(status, PoseStatus::Tracked | PoseStatus::Found);
    assert!(others.iter().all(|(_, status)| has_pose(*status)), "{others:?}");
    let tracked = others.iter().filter(|(_, status)| *status == PoseStatus::Tracked).count();
    assert!(tracked >= 24, "{others:?}");
}

#[test]
fn two_runs_send_the_same_bytes_and_another_seed_others() {
    let (a, b) = (default_pipeline(&[], 1500), default_pipeline(&[], 1500));
    assert_eq!(a.topics(), b.topics());
    for topic in a.topics() {
        assert!(a.bytes(topic) == b.bytes(topic), "{topic} differs");
    }
    let other = default_pipeline(&[("seed: 7", "seed: 8")], 1500);
    assert!(a.bytes("rig.depth") != other.bytes("rig.depth"));
}

#[test]
fn law_valves_and_beam_ask_for_a_priority_where_the_machine_allows_it_and_no_other_process_does() {
    let graph = default_pipeline(&[], 1).graph;
    for process in &graph.processes {
        let asked = if process.name == "control" { Priority::FifoIfAllowed(40) } else { Priority::Normal };
        assert_eq!(process.priority, asked, "{}", process.name);
    }
}

#[test]
fn the_topics_of_the_default_pipeline_fit_a_small_shared_memory() {
    let graph = default_pipeline(&[], 1).graph;
    let mut contracts = contracts::all(&graph);
    contracts.sort_by_key(|c| std::cmp::Reverse(c.pool_bytes()));
    for contract in contracts.iter().take(5) {
        eprintln!("{:20} {:6.1} MiB", contract.topic, contract.pool_bytes() as f64 / f64::from(1 << 20));
    }
    // Containers give 64 MiB by default, and others need some of it. The console takes the state of the valves and the
    // report of the tracker, which costs a MiB.
    let total: usize = contracts.iter().map(|c| c.pool_bytes()).sum();
    assert!(total < 60 << 20, "{} MiB", total >> 20);
}
