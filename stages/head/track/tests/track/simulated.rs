//! The rig's head followed in the simulated executor, captured by a command.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::{Activation, Operator, Outputs, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Registry, Role, SetupError, Stage, StepError, Timer};
use stillpoint_samples::{Command, ConsoleCommand, PointCloud, Pose, PoseReport, PoseStatus, Sample, Verb};
use stillpoint_testing::{Run, run};

/// Stands for a person at the console: at its fourth tick it commands a capture.
struct Person;

impl Operator for Person {
    type Params = ();
    const KIND: Kind = Kind {
        name: "test.person",
        about: "Commands a capture at its fourth tick.",
        role: Role::Source,
        inputs: &[],
        outputs: &[Output {
            name: "capture",
            sample: ConsoleCommand::KIND,
            frame: FrameRule::None,
            about: "The command.",
        }],
        timer: Timer::Required,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if activation.index != 3 {
            return Ok(());
        }
        outputs.send::<ConsoleCommand>(0, &Command { verb: Verb::Capture as u32, ..Command::default() })
    }
}

const TEXT: &str = "
stillpoint: 1
name: captured
seed: 3
frames:
  camera: { parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] }
operators:
  person: { use: test.person, every: 130 ms }
  rig: { use: rig.camera, every: 100 ms, frame: camera, params: { motion: sweep } }
  cloud: { use: ingest.depth, inputs: { image: rig.depth }, frame: camera }
  face: { use: segment.face, inputs: { cloud: cloud.cloud }, params: { body: waived } }
  head: { use: track.head, inputs: { face: face.face, command: person.capture }, frame: couch, params: { capture: command } }
";

fn simulated() -> Run {
    let registry = Registry::new(&[
        &[Stage::of::<Person>()],
        stillpoint_rig::STAGES,
        stillpoint_ingest::STAGES,
        stillpoint_segment::STAGES,
        stillpoint_track::STAGES,
    ]);
    run(TEXT, &registry, &MemoryFiles::default(), 3000).unwrap()
}

fn poses(run: &Run, topic: &str) -> Vec<(u64, Isometry3<f64>)> {
    let pose = |p: stillpoint_samples::View<'_, Pose>| {
        let element = p.first().unwrap();
        let [w, x, y, z] = element.orientation;
        let turn = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
        (p.header.origin, Isometry3::from_parts(Vector3::from(element.position).into(), turn))
    };
    run.samples::<Pose>(topic).into_iter().map(pose).collect()
}

#[test]
fn a_person_captures_the_reference_and_the_head_is_followed_from_there() {
    let run = simulated();
    assert_eq!(run.failed(), [] as [&str; 0]);
    let statuses: Vec<_> = run
        .samples::<PoseReport>("head.report")
        .iter()
        .map(|r| PoseStatus::from_number(r.first().unwrap().status).unwrap())
        .collect();
    let before = statuses.iter().take_while(|s| **s == PoseStatus::NoReference).count();
    assert!((1..10).contains(&before), "{statuses:?}");
    assert_eq!(statuses[before], PoseStatus::Captured);
    assert!(statuses[before + 1..].iter().all(|s| *s == PoseStatus::Tracked), "{statuses:?}");
    assert_eq!(run.samples::<PointCloud>("head.reference").len(), 1);

    let (found, truth) = (poses(&run, "head.pose"), poses(&run, "rig.truth"));
    assert_eq!(found.len(), statuses.len() - before);
    let at = |origin: u64| truth.iter().find(|(o, _)| *o == origin).unwrap().1;
    let (begin, first) = found[0];
    let (end, last) = *found.last().unwrap();
    let (expected, seen) = (at(end) * at(begin).inverse(), last * first.inverse());
    let centre = nalgebra::Point3::from(at(begin).translation.vector);
    let mm = (expected * centre - seen * centre).norm() * 1e3;
    let degrees = expected.rotation.angle_to(&seen.rotation).to_degrees();
    assert!(mm < 0.3 && degrees < 0.3, "{mm} mm, {degrees} degrees");
}

#[test]
fn two_runs_send_the_same_bytes() {
    let (a, b) = (simulated(), simulated());
    for topic in ["head.pose", "head.three_points", "head.reference", "head.report"] {
        assert!(!a.bytes(topic).is_empty(), "{topic}");
        assert!(a.bytes(topic) == b.bytes(topic), "{topic}");
    }
}
