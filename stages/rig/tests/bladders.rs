//! `rig.one_bladder`, `rig.three_bladders` and `rig.eight_bladders` in the simulated executor.

#![allow(clippy::unwrap_used, clippy::panic)]

use stillpoint_pipeline::files::KeptFiles;
use stillpoint_pipeline::operator::{
    FrameRule, Kind, Output, Registry, Role, SetupError, Stage, StepError, Timer,
};
use stillpoint_pipeline::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_samples::{DepthImage, Duties, DutiesElement, Pose, RigMode, RigState, Sample};
use stillpoint_testing::{Bench, Run, run};

/// Duties that a test writes down: one valve open from one time to another.
#[derive(Clone, Params)]
struct ScriptParams {
    /// How many valves there are.
    #[param(default = 6)]
    valves: u32,
    /// Which of them opens.
    #[param(default = 0)]
    valve: u32,
    /// How far.
    #[param(default = 0.25)]
    duty: f64,
    /// When.
    #[param(unit = "ns", default = "500 ms")]
    from: u64,
    /// Until when.
    #[param(unit = "ns", default = "2500 ms")]
    to: u64,
    /// When the script falls silent.
    #[param(unit = "ns", default = "1 h")]
    silent_from: u64,
}

struct Script {
    params: ScriptParams,
    begin: Option<u64>,
}

impl Operator for Script {
    type Params = ScriptParams;
    const KIND: Kind = Kind {
        name: "test.duties",
        about: "Duties that a test writes down.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "duties",
            sample: Duties::KIND,
            frame: FrameRule::None,
            about: "The duties.",
        }],
        timer: Timer::Required,
    };

    fn new(params: ScriptParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { params, begin: None })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let since = activation.time - *self.begin.get_or_insert(activation.time);
        let p = &self.params;
        if since >= p.silent_from {
            return Ok(());
        }
        let mut element = DutiesElement { valves: p.valves, ..Default::default() };
        element.duty[p.valve as usize] = if (p.from..p.to).contains(&since) { p.duty } else { 0.0 };
        outputs.send::<Duties>(0, &element)
    }
}

const STAGES: &[Stage] = &[Stage::of::<Script>()];

const CAMERA: &str = "camera: { width: 160 px, height: 120 px, focal_length: 141 px }";

/// A rig of this kind with these params besides its camera, driven by a script with these params.
fn text(kind: &str, params: &str, script: &str) -> String {
    format!(
        "
stillpoint: 1
name: rig
seed: 7
frames: {{ camera: {{ parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] }} }}
operators:
  script: {{ use: test.duties, every: 10 ms, params: {{ {script} }} }}
  rig: {{ use: rig.{kind}, every: 10 ms, frame: camera, inputs: {{ duties: script.duties }}, params: {{ {CAMERA}, {params} }} }}
"
    )
}

fn simulate(text: &str, ms: u64) -> Run {
    let registry = Registry::new(&[stillpoint_rig::STAGES, STAGES]);
    let run = run(text, &registry, &KeptFiles::default(), ms).unwrap();
    assert!(run.failed().is_empty(), "{:?}", run.failed());
    run
}

fn heights(run: &Run) -> Vec<f64> {
    run.samples::<Pose>("rig.truth").iter().map(|p| p.first().unwrap().position[2]).collect()
}

fn pitch(run: &Run, index: usize) -> f64 {
    let poses = run.samples::<Pose>("rig.truth");
    let [w, x, y, z] = poses[index].first().unwrap().orientation;
    (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y))
}

fn last_state(run: &Run) -> stillpoint_samples::RigStateElement {
    *run.samples::<RigState>("rig.state").last().unwrap().first().unwrap()
}

#[test]
fn a_still_head_with_shut_valves_stays_where_it_is() {
    let run = simulate(&text("three_bladders", "motion: still", "duty: 0"), 3000);
    let heights = heights(&run);
    assert!(heights.iter().all(|z| (z - heights[0]).abs() < 1e-9), "{heights:?}");
    let state = last_state(&run);
    assert_eq!((state.mode(), state.bladders, state.faults, state.unmodelled), (RigMode::Driven, 3, 0, 0));
    assert!(state.pressure[..3].iter().all(|p| (1e3..5e4).contains(p)), "{state:?}");
}

#[test]
fn poses_come_at_the_rigs_rate_and_images_at_the_cameras() {
    let run = simulate(&text("three_bladders", "motion: still", ""), 1000);
    let images = run.samples::<DepthImage>("rig.depth");
    assert_eq!((images.len(), run.samples::<Pose>("rig.truth").len()), (10, 100));
    for pair in images.windows(2) {
        assert_eq!(pair[1].head.stamp - pair[0].head.stamp, 100_000_000);
        // The duties behind it are older than what it shows.
        assert_eq!(pair[1].head.origin, pair[1].head.stamp);
    }
}

/// The reference trajectory `c_rig_3dof_traj`: after 2.5 s the base's inlet was open for 2 s at 0.25.
#[test]
fn the_head_follows_the_plant_of_the_reference() {
    let run = simulate(&text("three_bladders", "motion: still", ""), 2510);
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/vectors/c_rig_3dof_traj.json");
    let file: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let y = &file["cases"][0]["out"]["y"];
    let row = |n: usize| [0, 1].map(|i| y[n][i].as_f64().unwrap());
    let (start, end) = (row(0), row(10));
    let heights = heights(&run);
    let rise = heights[250] - heights[0];
    assert!((rise - (end[0] - start[0])).abs() < 1e-6, "{rise} {}", end[0] - start[0]);
    let turn = pitch(&run, 250);
    assert!((turn - (end[1] - start[1])).abs() < 1e-5, "{turn} {}", end[1] - start[1]);
}

#[test]
fn the_camera_sees_the_head_rise() {
    let run = simulate(&text("one_bladder", "motion: still", "valves: 2, duty: 0.5"), 3000);
    let heights = heights(&run);
    let rise = heights[299] - heights[0];
    assert!(rise > 8e-3, "{rise}");
    let images = run.samples::<DepthImage>("rig.depth");
    // The middle of the image shows the face, from 45 degrees above the feet.
    let depth = |image: usize| {
        let counts = &images[image].elements;
        let patch: Vec<f64> =
            (0..400).map(|i| f64::from(counts[(50 + i / 20) * 160 + 70 + i % 20])).collect();
        let seen: Vec<f64> = patch.into_iter().filter(|c| *c > 0.0).collect();
        seen.iter().sum::<f64>() / seen.len() as f64 * 1e-4
    };
    let nearer = depth(0) - depth(29);
    assert!(nearer > 0.3 * rise && nearer < 1.7 * rise, "{nearer} {rise}");
}

#[test]
fn when_duties_stop_the_rig_vents_by_itself() {
    let run = simulate(&text("three_bladders", "motion: still", "silent_from: 1 s"), 9000);
    let states = run.samples::<RigState>("rig.state");
    let vents = states.iter().position(|s| s.first().unwrap().mode() == RigMode::Venting).unwrap();
    // The last duties were made at 990 ms.
    assert!((105..=106).contains(&vents), "{vents}");
    let heights = heights(&run);
    assert!(heights[899] < heights[100] - 5e-3, "{} {}", heights[100], heights[899]);
    // It sinks onto the foam and stays there.
    assert!((heights[899] - heights[880]).abs() < 1e-3);
    let state = last_state(&run);
    assert!(state.pressure[..3].iter().all(|p| p.abs() < 2e3), "{state:?}");
    let speeds: Vec<f64> = heights.windows(2).map(|w| (w[1] - w[0]) / 0.01).collect();
    assert!(speeds.iter().all(|v| v.abs() < 0.03), "{:?}", speeds.iter().copied().fold(0.0, f64::min));
}

#[test]
fn a_rig_that_holds_keeps_the_head_up() {
    let run = simulate(&text("three_bladders", "motion: still, safe: hold", "silent_from: 1 s"), 4000);
    assert_eq!(last_state(&run).mode(), RigMode::Holding);
    let heights = heights(&run);
    assert!((heights[399] - heights[200]).abs() < 1e-5, "{} {}", heights[200], heights[399]);
}

#[test]
fn a_stuck_valve_keeps_its_opening() {
    let faults = "motion: still, faults: [{ kind: stuck_valve, which: 0, at: 1 s, lasts: 2 s }]";
    let run = simulate(&text("three_bladders", faults, "to: 1500 ms"), 3500);
    let states = run.samples::<RigState>("rig.state");
    let opening = |at: usize| states[at].first().unwrap().opening[0];
    assert!((opening(290) - 0.25).abs() < 1e-3 && opening(340) < 1e-3, "{} {}", opening(290), opening(340));
    assert_eq!((states[200].first().unwrap().faults, states[340].first().unwrap().faults), (1, 0));
}

#[test]
fn a_leak_lets_the_head_sink_and_a_lost_supply_does_not_lift_it() {
    let still = heights(&simulate(&text("three_bladders", "motion: still", "duty: 0"), 4000))[399];
    let leak = "motion: still, faults: [{ kind: leak, which: 0, at: 1 s, diameter: 0.5 mm }]";
    let leaking = heights(&simulate(&text("three_bladders", leak, "duty: 0"), 4000))[399];
    assert!(leaking < still - 1e-3, "{leaking} {still}");
    let supply = "motion: still, faults: [{ kind: weak_supply, left: 0.2, at: 0 s }]";
    let whole = heights(&simulate(&text("three_bladders", "motion: still", ""), 3000))[299];
    let weak = heights(&simulate(&text("three_bladders", supply, ""), 3000))[299];
    assert!(weak < whole - 1e-3, "{weak} {whole}");
}

#[test]
fn a_blind_camera_sends_empty_images_and_a_silent_one_none() {
    let faults =
        "faults: [{ kind: blind_camera, at: 1 s, lasts: 1 s }, { kind: silent_camera, at: 3 s, lasts: 1 s }]";
    let run = simulate(&text("three_bladders", faults, ""), 5000);
    let images = run.samples::<DepthImage>("rig.depth");
    assert_eq!(images.len(), 40);
    let empty = images.iter().filter(|i| i.elements.iter().all(|c| *c == 0)).count();
    assert_eq!(empty, 10);
}

#[test]
fn a_camera_loses_the_part_of_its_images_that_the_config_says() {
    let lossy =
        text("three_bladders", "motion: still", "").replace("camera: { width", "camera: { lost: 0.3, width");
    let images = simulate(&lossy, 20_000).samples::<DepthImage>("rig.depth").len();
    assert!((110..170).contains(&images), "{images}");
}

#[test]
fn a_head_that_nothing_controls_moves_about_as_far_as_its_habit_says() {
    let run = simulate(&text("three_bladders", "motion: nods, seed: 3", "duty: 0"), 12_000);
    let turns: Vec<f64> = (0..1200).map(|i| pitch(&run, i).to_degrees()).collect();
    let (least, greatest) = turns.iter().fold((0.0, 0.0), |(l, g): (f64, f64), t| (l.min(*t), g.max(*t)));
    assert!((-2.5..-1.0).contains(&least) && (1.0..2.5).contains(&greatest), "{least} {greatest}");
}

#[test]
fn each_of_the_six_directions_moves_between_eight_bladders() {
    // The four from below: duty on their inlets lifts the head; on one of them it also turns it.
    let still = simulate(&text("eight_bladders", "motion: still", "valves: 16, duty: 0"), 2000);
    let heights = heights(&still);
    assert!(heights.iter().all(|z| (z - heights[0]).abs() < 1e-8), "{:?}", heights.last());
    let state = last_state(&still);
    assert_eq!((state.bladders, state.unmodelled), (8, 0));
    assert!(state.force.iter().all(|f| *f > 5.0), "{state:?}");
    let one = simulate(&text("eight_bladders", "motion: still", "valves: 16, valve: 0, duty: 0.3"), 3000);
    let poses = one.samples::<Pose>("rig.truth");
    let (first, last) = (*poses[0].first().unwrap(), *poses[299].first().unwrap());
    for i in 0..3 {
        let moved = (last.position[i] - first.position[i]).abs();
        assert!((2e-4..3e-2).contains(&moved), "{i}: {moved}");
        assert!((1e-3..0.3).contains(&last.orientation[i + 1].abs()), "{:?}", last.orientation);
    }
}

#[test]
fn duties_for_another_number_of_valves_are_refused_and_the_rig_waits() {
    let run = simulate(&text("three_bladders", "motion: still", "valves: 2"), 1000);
    let state = last_state(&run);
    assert!(state.refused > 90 && state.mode() == RigMode::Waiting && state.duties_age.is_nan(), "{state:?}");
}

#[test]
fn a_heavier_head_rests_on_more_pressure() {
    let base = |params: &str| {
        last_state(&simulate(&text("one_bladder", params, "valves: 2, duty: 0"), 100)).pressure[0]
    };
    let (light, heavy) = (base("head_mass: 3 kg, motion: still"), base("head_mass: 6 kg, motion: still"));
    assert!(heavy > 1.3 * light, "{light} {heavy}");
}

#[test]
fn the_bytes_depend_on_the_seeds_and_on_nothing_else() {
    let bytes = |text: &str| {
        let run = simulate(text, 1000);
        [run.bytes("rig.depth"), run.bytes("rig.truth"), run.bytes("rig.state")].concat()
    };
    let one = text("three_bladders", "seed: 7", "");
    assert!(bytes(&one) == bytes(&one));
    assert!(bytes(&one) != bytes(&text("three_bladders", "seed: 8", "")));
    assert!(bytes(&one) != bytes(&one.replace("seed: 7\nframes", "seed: 9\nframes")));
    let padded = |bytes| {
        let stages = [stillpoint_rig::STAGES, STAGES].concat();
        let bench = Bench::new(&one, "rig", &stages, &KeptFiles::default()).unwrap();
        let mut bench = bench.padded(bytes);
        (0..30).flat_map(|_| bench.tick().bytes()).collect::<Vec<u8>>()
    };
    assert!(padded(0) == padded(13));
}

#[test]
fn what_cannot_be_is_refused_with_what_to_do() {
    let refused = |text: &str| {
        let registry = Registry::new(&[stillpoint_rig::STAGES, STAGES]);
        run(text, &registry, &KeptFiles::default(), 100).err().unwrap()
    };
    let odd = text("three_bladders", "motion: still", "")
        .replace("camera: { width", "camera: { every: 33 ms, width");
    assert!(refused(&odd).contains("make the one a multiple of the other"), "{}", refused(&odd));
    let absent = text("one_bladder", "faults: [{ kind: leak, which: 1, at: 1 s }]", "valves: 2");
    assert!(refused(&absent).contains("fault 0 names bladder 1, and the rig has 1"), "{}", refused(&absent));
}
