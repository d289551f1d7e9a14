//! The Rust examples, one for each seam: a plan, a session, a transport, a control law. (`guide` has that of an operator.)

use std::num::NonZeroUsize;
use std::path::Path;

use stillpoint_patient::case::phantom;
use stillpoint_plan::recipe::{PlanRequest, SetupSpec};
use stillpoint_recorder::Session;
use stillpoint_samples::{
    Actuation, ActuationState, Header, Pieces, Pose, PoseElement, Sample, Target, TargetElement, Track,
};
use stillpoint_transport::conformance::conforms;
use stillpoint_transport::{Channel, Transport};
use zerocopy::{FromZeros, IntoBytes};

use crate::default_pipeline::default_pipeline_of;
use crate::own_control_law::MY_LAWS;
use crate::own_transport::Memory;
use crate::{from_root, plan_a_case, read_session};

#[test]
fn the_example_of_a_plan_covers_the_target_by_the_recomputed_dose() {
    // Wide bixels and far points, so that the test is fast.
    let spec = SetupSpec { grid_mm: 10.0, bixel_mm: 15.0, ..SetupSpec::shipped().unwrap() };
    let request = PlanRequest::of_angles(vec![0.0, 72.0, 144.0, 216.0, 288.0]);
    let planned = plan_a_case::planned(phantom(0).unwrap(), spec, &request).unwrap();
    assert_eq!(planned.angles_deg(), [0.0, 72.0, 144.0, 216.0, 288.0]);
    let figures = plan_a_case::doses(&planned, NonZeroUsize::MIN).unwrap();
    let of = |name: &str| figures.iter().find(|f| f.name == name).unwrap();
    assert!(of("PTV").d95_gy > 0.9 * 78.0, "{:?}", of("PTV"));
    assert!(of("Rectum").mean_gy < 0.6 * 78.0, "{:?}", of("Rectum"));
}

#[test]
fn the_example_of_a_session_reads_the_session_of_a_release() {
    let session = Session::open(&from_root("tests/tests/sessions/0.1.0.mcap")).unwrap();
    let summary = read_session::summary(&session, "mix.sum").unwrap();
    assert_eq!(summary.values().map(|s| s.count).max(), Some(23), "{summary:?}");
    assert!(summary.values().all(|s| s.least <= s.mean && s.mean <= s.largest), "{summary:?}");
    let missing = read_session::summary(&session, "mix.nothing").unwrap_err().to_string();
    assert!(missing.contains("`mix.nothing`"), "{missing}");
    assert!(read_session::summary(&session, "mix.journal").is_err(), "a topic of another type");
}

#[test]
fn the_example_of_a_transport_conforms() {
    conforms(&|| Box::new(Memory::default()));
}

#[test]
fn the_example_of_a_transport_hands_a_pose_to_another_thread() {
    let memory = Memory::default();
    let channel = Channel { kind: Pose::KIND, frame: Some("couch".into()), capacity: 1 };
    let mut receiver = memory.open_receiver(&channel).unwrap();
    let sender = std::thread::spawn(move || {
        let header = Header { count: 1, sequence: 41, ..Header::default() };
        let pose = PoseElement { position: [0.1, 0.2, 0.3], ..PoseElement::new_zeroed() };
        let sample = Pieces { meta: header.as_bytes(), payload: pose.as_bytes() };
        memory.open_sender(&channel).unwrap().send(sample).unwrap();
    });
    sender.join().unwrap();
    let mut bytes = Vec::new();
    receiver.receive(&mut bytes).unwrap().unwrap();
    let bytes = stillpoint_samples::AlignedBytes::copy_of(&bytes);
    let pose = Pieces::split(Pose::KIND, &bytes).unwrap().view::<Pose>().unwrap();
    assert_eq!((pose.header.sequence, pose.first().unwrap().position), (41, [0.1, 0.2, 0.3]));
}

#[test]
fn the_example_of_a_control_law_brings_the_head_to_its_target_in_the_default_pipeline() {
    let law = [
        ("use: control.pi", "use: my.proportional"),
        (", actuation: { from: valves.state, delay: 10 ms } }, params", " }, params"),
        (
            "params: { rise: 5 s, proportional: 2.37 1/s, integral: 2.55, plant: { motion: learned, outlet: 0.54 } }",
            "params: { gain: 0.8 1/s }",
        ),
        (" law.diagnostics,", ""),
    ];
    let run = default_pipeline_of(MY_LAWS, &law, 15_000);
    let states = run.samples::<Actuation>("valves.state");
    assert_eq!(states.last().unwrap().first().unwrap().state, ActuationState::Armed as u32);
    let targets = run.samples::<Target>("target.reference");
    let is_set = |target: &&TargetElement| target.position[2].is_finite();
    let first = targets.iter().filter_map(|sample| sample.first()).find(is_set).unwrap();
    let last = targets.last().unwrap().first().unwrap();
    assert!((last.position[2] - first.position[2] - 0.0115).abs() < 1e-9, "the step of the file");
    let at = run.samples::<Track>("filter.state").last().unwrap().first().unwrap().position[2];
    assert!((at - last.position[2]).abs() < 1e-3, "{at} m, not {} m", last.position[2]);
}

#[test]
fn every_rust_example_is_short_and_listed() {
    let list = std::fs::read_to_string(from_root("examples/README.md")).unwrap();
    let is_code = |line: &&str| !line.trim().is_empty() && !line.trim_start().starts_with("//");
    let mut count = 0;
    for entry in std::fs::read_dir(from_root("examples")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "rs") {
            let name = Path::new(path.file_name().unwrap()).display().to_string();
            let lines = std::fs::read_to_string(&path).unwrap().lines().filter(is_code).count();
            assert!(lines < 80, "{name} has {lines} lines of code");
            assert!(list.contains(&format!("({name})")), "examples/README.md does not link {name}");
            count += 1;
        }
    }
    assert!(count >= 5, "{count} examples");
}
