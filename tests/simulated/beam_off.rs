//! From what happens to beam off at the far end, one cause at a time: at most 1.5 frame periods and 20 ms. What happens
//! does so just behind a frame, so that a whole period passes before the camera can show it.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use stillpoint_operator::*;
use stillpoint_rig::camera::Pinhole;
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::{NoiseModel, NoiseParams};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::scene::Scene;
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_samples::{DepthImage, Gate, Pose, PoseReport, PoseStatus, Sample};
use stillpoint_testing::Run;

use crate::default_pipeline::{beam_off_after, default_pipeline_of, seconds, tracked_point_moved};

/// When it happens, s: 1 ms behind the frame of 5.0 s.
const EVENT: f64 = 5.001;
/// 1.5 frame periods of 100 ms, and 20 ms.
const BOUND: f64 = 0.17;
const SMALL: (&str, &str) = (
    "camera: { every: 100 ms }",
    "camera: { every: 100 ms, width: 320 px, height: 240 px, focal_length: 283 px }",
);
const NO_STEP: (&str, &str) = ("at: 2.5 s, z: 11.5 mm", "at: 1 h, z: 11.5 mm");

/// Of this file.
const KINDS: &[Stage] = &[Stage::of::<Screen>()];

/// What is seen from the event on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
enum Shown {
    /// The couch without a head.
    Nothing,
    /// A head of another size in the same place.
    OtherHead,
    /// A head that is hardly smaller.
    Alike,
}

#[derive(Clone, Params)]
struct ScreenParams {
    /// What is seen from the event on.
    shown: Shown,
}

/// Shows the rig's images until the event, and others from then on.
struct Screen {
    renderer: Renderer,
    sensor: DepthSensor,
    /// Whether the head is there.
    has_head: bool,
    begin: Option<u64>,
}

impl Operator for Screen {
    type Params = ScreenParams;
    const KIND: Kind = Kind {
        name: "test.screen",
        about: "Shows the rig's images until the event, and others from then on.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "depth",
                sample: DepthImage::KIND,
                policy: Policy::Queue(1),
                required: true,
                about: "The rig's images.",
            },
            Input {
                name: "truth",
                sample: Pose::KIND,
                policy: Policy::Latest,
                required: true,
                about: "Where the rig's head is.",
            },
        ],
        outputs: &[Output {
            name: "depth",
            sample: DepthImage::KIND,
            frame: FrameRule::Key,
            about: "The images.",
        }],
        timer: Timer::No,
    };

    fn new(params: ScreenParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let rigid = setup.transform("couch", "camera").ok_or_else(|| SetupError("no camera".into()))?;
        let [w, x, y, z] = rigid.quaternion();
        let couch_from_camera = Isometry3::from_parts(
            Translation3::from(rigid.translation),
            UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)),
        );
        let fault = |e: &dyn std::fmt::Display| SetupError(e.to_string());
        let camera = Pinhole::new(283.0, 283.0, 159.5, 119.5, 320, 240).map_err(|e| fault(&e))?;
        let scale = match params.shown {
            Shown::OtherHead => 0.85,
            Shown::Alike => 0.93,
            Shown::Nothing => 1.0,
        };
        let head = Head::new(scale).map_err(|e| fault(&e))?;
        let scene = Scene::treatment_couch().map_err(|e| fault(&e))?;
        let noise = NoiseModel::new(NoiseParams::structured_light()).map_err(|e| fault(&e))?;
        Ok(Self {
            renderer: Renderer::new(camera, &couch_from_camera, &scene, head).map_err(|e| fault(&e))?,
            sensor: DepthSensor::new(&camera, noise),
            has_head: params.shown != Shown::Nothing,
            begin: None,
        })
    }

    fn capacities(_: &ScreenParams) -> Vec<usize> {
        vec![320 * 240]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(seen) = activation.fresh::<DepthImage>(0) else { return Ok(()) };
        let truth = activation.input::<Pose>(1);
        let Some(truth) = truth.as_ref().and_then(|t| t.first()) else { return Ok(()) };
        let origin = seen.header.origin;
        let begin = *self.begin.get_or_insert(origin);
        let mut image = outputs.open::<DepthImage>(0, seen.elements.len())?;
        *image.body() = *seen.body;
        if ((origin - begin) as f64) < EVENT * 1e9 {
            image.elements().copy_from_slice(seen.elements);
        } else {
            let [w, x, y, z] = truth.orientation;
            let turn = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
            let mut pose = Isometry3::from_parts(Translation3::from(truth.position), turn);
            if !self.has_head {
                pose.translation.vector.z = -20.0;
            }
            let view = self.renderer.render(&pose).map_err(|e| StepError(e.to_string()))?;
            let sensed = self.sensor.sense(view, &mut activation.random(), image.elements());
            sensed.map_err(|e| StepError(e.to_string()))?;
        }
        image.finish(seen.elements.len())
    }
}

/// The default pipeline, in which something else is shown from the event on.
fn shown(what: &str) -> Run {
    let screen = format!(
        "screen: {{ use: test.screen, inputs: {{ depth: rig.depth, truth: rig.truth }}, frame: camera, params: {{ shown: {what} }} }}\n  cloud: {{ use: ingest.depth, inputs: {{ image: screen.depth }}"
    );
    let changes =
        [SMALL, NO_STEP, ("cloud: { use: ingest.depth, inputs: { image: rig.depth }", screen.as_str())];
    default_pipeline_of(KINDS, &changes, 5_300)
}

/// Statuses of the frames from the event on.
fn statuses(run: &Run) -> Vec<PoseStatus> {
    let reports = run.samples::<PoseReport>("head.report");
    let after = reports.iter().filter(|r| seconds(r.header.origin) > EVENT);
    after.filter_map(|r| PoseStatus::from_number(r.first()?.status)).collect()
}

fn check(run: &Run, event: f64, reasons: &[&str]) {
    let (off, output_text) = beam_off_after(run, event);
    assert!(off - event <= BOUND + 1e-9, "{off} s after {event} s: {output_text:?}");
    assert!(output_text.iter().any(|reason| reasons.contains(reason)), "{output_text:?}");
}

#[test]
fn a_head_that_goes_ends_the_beam_in_time() {
    let run = shown("nothing");
    check(&run, EVENT, &["tracker"]);
    assert!(statuses(&run).iter().all(|s| *s == PoseStatus::NoFace), "{:?}", statuses(&run));
}

#[test]
fn another_head_in_its_place_ends_the_beam_in_time() {
    let run = shown("other_head");
    check(&run, EVENT, &["tracker", "identity"]);
    let wrong = [PoseStatus::Doubted, PoseStatus::Lost];
    assert!(statuses(&run).iter().all(|s| wrong.contains(s)), "{:?}", statuses(&run));
}

#[test]
fn a_confidence_that_is_lost_ends_the_beam_in_time() {
    let run = shown("alike");
    check(&run, EVENT, &["identity"]);
    // It fits the reference, and is not what was captured.
    assert!(statuses(&run).iter().all(|s| *s == PoseStatus::Doubted), "{:?}", statuses(&run));
}

#[test]
fn a_head_that_moves_beyond_the_limits_ends_the_beam_in_time() {
    let pushed = (
        "motion: breathes,",
        "motion: breathes, pushes: [{ at: 5001 ms, shift: [0 mm, 0 mm, 2.5 mm], turn: [0 deg, 0 deg, 0 deg] }],",
    );
    let run = default_pipeline_of(&[], &[SMALL, NO_STEP, pushed], 5_800);
    // By the truth, from where the gate saw it last.
    let moved = tracked_point_moved(&run);
    let truth: Vec<u64> = run.samples::<Pose>("rig.truth").iter().map(|t| t.header.stamp).collect();
    let at = truth.iter().rposition(|stamp| seconds(*stamp) <= EVENT).unwrap();
    let gates = run.samples::<Gate>("gate.state");
    let before = gates.iter().rfind(|g| seconds(g.header.stamp) <= EVENT).unwrap();
    let error = before.first().unwrap().position_error[2] * 1e3;
    // What the gate tolerates and what it lets the estimate be uncertain by, together.
    let beyond = (at..moved.len()).find(|i| (error + moved[*i][2] - moved[at][2]).abs() > 1.5).unwrap();
    check(&run, seconds(truth[beyond]), &["position"]);
}
