//! Duties that a test writes down, and a rig that they drive.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Registry, Role, SetupError, Stage, StepError, Timer};
use stillpoint_samples::{Duties, DutiesElement, Pose, RigState, Sample};
use stillpoint_testing::{Run, run};

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
    /// When it begins to ask for the air to go out.
    #[param(unit = "ns", default = "1 h")]
    vent_from: u64,
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
        if since >= p.vent_from {
            return outputs.send::<Duties>(0, &DutiesElement::vented(p.valves));
        }
        let mut element = DutiesElement { valves: p.valves, ..Default::default() };
        element.duty[p.valve as usize] = if (p.from..p.to).contains(&since) { p.duty } else { 0.0 };
        outputs.send::<Duties>(0, &element)
    }
}

pub const STAGES: &[Stage] = &[Stage::of::<Script>()];

pub const CAMERA: &str = "camera: { width: 160 px, height: 120 px, focal_length: 141 px }";

/// A rig of this kind with these params besides its camera, driven by a script with these params.
pub fn text(kind: &str, params: &str, script: &str) -> String {
    // Valves and rubber are ideal, but for what the test names.
    let ideal = ["dead_band: 0", "creep: 0"];
    let named = |param: &&&str| param.split(':').next().is_some_and(|name| params.contains(name));
    let ideal: String =
        ideal.iter().filter(|param| !named(param)).map(|param| format!(", {param}")).collect();
    let params = format!("{params}{ideal}");
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

pub fn simulate(text: &str, ms: u64) -> Run {
    let registry = Registry::new(&[stillpoint_rig::STAGES, STAGES]);
    let run = run(text, &registry, &MemoryFiles::default(), ms).unwrap();
    assert!(run.failed().is_empty(), "{:?}", run.failed());
    run
}

pub fn heights(run: &Run) -> Vec<f64> {
    run.samples::<Pose>("rig.truth").iter().map(|p| p.first().unwrap().position[2]).collect()
}

pub fn pitch(run: &Run, index: usize) -> f64 {
    let poses = run.samples::<Pose>("rig.truth");
    let [w, x, y, z] = poses[index].first().unwrap().orientation;
    (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y))
}

pub fn last_state(run: &Run) -> stillpoint_samples::RigStateElement {
    *run.samples::<RigState>("rig.state").last().unwrap().first().unwrap()
}
