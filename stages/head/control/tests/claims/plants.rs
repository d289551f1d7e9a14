//! Test operators that stand in for a head with cameras: plants that answer to duties with tracks.

use nalgebra::{Isometry3, Matrix3, Vector1, Vector3};
use stillpoint_mechanics::plant::{OneDof, State, ThreeDof};
use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup, Stage};
use stillpoint_operator::{
    FrameRule, Input, Kind, Output, Policy, Registry, Role, SetupError, StepError, Timer,
};
use stillpoint_pose::PoseNumbers;
use stillpoint_samples::{Duties, DutiesElement, Sample, Standing, Track, TrackElement};
use stillpoint_testing::{Run, run};

use stillpoint_mechanics::random::Random;

/// What answers to the duties.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Kinetics {
    /// Channels that integrate what the bladders do, with the default effect of the controllers, and drift.
    Linear,
    /// A head on three bladders.
    Rig,
    /// A head on one bladder.
    OneBladder,
}

/// Parameters of `test.head`.
#[derive(Clone, Debug, Params)]
pub struct HeadParams {
    /// What answers.
    #[param(default = "linear")]
    kinetics: Kinetics,
    /// Mass of the head.
    #[param(unit = "kg", default = "5 kg")]
    mass: f64,
    /// Standard deviation of the height that is seen.
    #[param(unit = "m", default = "0 mm")]
    noise: f64,
    /// Standard deviation of the angles that are seen.
    #[param(unit = "rad", default = "0 deg")]
    angle_noise: f64,
    /// Frequency of the breath of the patient: 0.3 mm, and 0.2 degrees of pitch. Only the linear channels breathe.
    #[param(unit = "Hz", default = "0 Hz")]
    breath: f64,
    /// Nothing is seen before.
    #[param(unit = "ns", default = "0 s")]
    opens: u64,
    /// What goes wrong, if anything.
    #[param(default = "nothing")]
    fault: Fault,
    /// When it begins.
    #[param(unit = "ns", default = "0 s")]
    begin: u64,
    /// When it ends.
    #[param(unit = "ns", default = "0 s")]
    end: u64,
}

/// What goes wrong with the estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
enum Fault {
    /// Nothing.
    Nothing,
    /// No track comes.
    Silent,
    /// Tracks come that say that there is no estimate.
    None,
    /// Tracks come that were predicted, with the time of the prediction.
    Predicted,
    /// The height is no number.
    Nan,
}

enum Body {
    Linear(Vector3<f64>),
    Rig(Box<(ThreeDof, State<3, 3>)>),
    OneBladder(Box<(OneDof, State<1, 1>)>),
}

/// A head that a camera sees every 100 ms.
pub struct TestHead {
    params: HeadParams,
    body: Body,
    began: Option<u64>,
    accepted: u64,
}

impl Operator for TestHead {
    type Params = HeadParams;
    const KIND: Kind = Kind {
        name: "test.head",
        about: "A head on bladders.",
        role: Role::Source,
        inputs: &[Input {
            name: "duties",
            sample: Duties::KIND,
            policy: Policy::Latest,
            required: true,
            about: "How far the valves are open.",
        }],
        outputs: &[
            Output { name: "state", sample: Track::KIND, frame: FrameRule::Key, about: "What is seen." },
            Output { name: "truth", sample: Track::KIND, frame: FrameRule::Key, about: "Where it is." },
        ],
        timer: Timer::Required,
    };

    fn new(params: HeadParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let body = match params.kinetics {
            Kinetics::Linear => Body::Linear(Vector3::new(0.1, 0.02, 0.0)),
            Kinetics::Rig => {
                let plant = ThreeDof::rig(params.mass);
                // The air that a head of 5 kg has at the start of the reference run.
                let air = Vector3::new(0.000_851_624_302_651, 0.000_716_638_449_801, 0.000_716_638_449_801);
                let rest = plant
                    .equilibrium(&air, Vector3::new(0.008, 0.037, 0.0))
                    .map_err(|e| SetupError(e.to_string()))?;
                Body::Rig(Box::new((plant, State::at_rest(rest, air))))
            }
            Kinetics::OneBladder => {
                let plant = OneDof::rig(params.mass);
                let air = Vector1::new(0.000_9);
                let rest =
                    plant.equilibrium(&air, Vector1::new(0.09)).map_err(|e| SetupError(e.to_string()))?;
                Body::OneBladder(Box::new((plant, State::at_rest(rest, air))))
            }
        };
        Ok(Self { params, body, began: None, accepted: 0 })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let began = *self.began.get_or_insert(activation.time);
        let duties = activation.input::<Duties>(0).and_then(|d| d.first().copied()).unwrap_or_default();
        self.body.advance(&duties, 10);
        let begun = (activation.time - began) as f64 * 1e-9;
        self.body.breathe(self.params.breath, begun, 0.01);
        if !activation.tick.is_multiple_of(10) {
            return Ok(());
        }
        let now = activation.time - began;
        // A new measurement, not one that is as old as the duties.
        outputs.acquired_at(activation.time);
        let [height, pitch, roll] = self.body.pose();
        outputs.send::<Track>(1, &track([height, pitch, roll], 0, Standing::Measured))?;
        let fault = if (self.params.begin..self.params.end).contains(&now) {
            self.params.fault
        } else {
            Fault::Nothing
        };
        if now < self.params.opens || fault == Fault::Silent {
            return Ok(());
        }
        let mut random = Random::new(activation.index);
        let mut seen = [height + self.params.noise * random.normal(), pitch, roll];
        seen[1..].iter_mut().for_each(|v| *v += self.params.angle_noise * random.normal());
        if fault == Fault::Nan {
            seen[0] = f64::NAN;
        }
        let standing = match fault {
            Fault::None => Standing::None,
            Fault::Predicted => Standing::Predicted,
            _ => Standing::Measured,
        };
        self.accepted += u64::from(standing == Standing::Measured);
        outputs.send::<Track>(0, &track(seen, self.accepted, standing))
    }
}

fn track([height, pitch, roll]: [f64; 3], accepted: u64, standing: Standing) -> TrackElement {
    if standing == Standing::None {
        return TrackElement { channels: 0x3f, accepted, ..TrackElement::NONE };
    }
    let pose: Isometry3<f64> = PoseNumbers { position: [0.0, 0.0, height], pitch, roll, yaw: 0.0 }.pose();
    let q = pose.rotation.quaternion();
    TrackElement {
        position: [0.0, 0.0, height],
        orientation: [q.w, q.i, q.j, q.k],
        channels: 0x3f,
        accepted,
        standing: standing as u32,
        ..TrackElement::NONE
    }
}

/// What the default bladders of the controllers do, m/s and rad/s.
fn linear() -> Matrix3<f64> {
    let degree = std::f64::consts::PI / 180.0;
    Matrix3::new(
        13.23e-3,
        9.05e-3,
        9.05e-3,
        6.225 * degree,
        -9.272 * degree,
        -9.272 * degree,
        0.0,
        11.1 * degree,
        -11.1 * degree,
    )
}

impl Body {
    /// Advances by some ms.
    fn advance(&mut self, duties: &DutiesElement, ms: u32) {
        for _ in 0..ms {
            match self {
                Self::Linear(pose) => {
                    let net = Vector3::from_fn(|j, _| duties.duty[2 * j] - duties.duty[2 * j + 1]);
                    let drift = Vector3::new(-2e-4, 1e-3, 0.0);
                    *pose += (linear() * net + drift) * 1e-3;
                }
                Self::Rig(both) => {
                    let (plant, state) = &mut **both;
                    let mut drive = plant.idle();
                    drive.duty = std::array::from_fn(|j| [duties.duty[2 * j], duties.duty[2 * j + 1]]);
                    *state = plant.advance(state, &drive, 1e-3);
                }
                Self::OneBladder(both) => {
                    let (plant, state) = &mut **both;
                    let mut drive = plant.idle();
                    drive.duty = [[duties.duty[0], duties.duty[1]]];
                    *state = plant.advance(state, &drive, 1e-3);
                }
            }
        }
    }

    /// Adds the breath of `dt` seconds from a time on.
    fn breathe(&mut self, hertz: f64, from: f64, dt: f64) {
        let Self::Linear(pose) = self else { return };
        let phase = |time: f64| (std::f64::consts::TAU * hertz * time).sin();
        let part = phase(from + dt) - phase(from);
        *pose += Vector3::new(0.3e-3, 0.2_f64.to_radians(), 0.0) * part;
    }

    /// Height, pitch and roll.
    fn pose(&self) -> [f64; 3] {
        match self {
            Self::Linear(pose) => (*pose).into(),
            Self::Rig(both) => both.1.position.into(),
            Self::OneBladder(both) => [both.1.position.x, 0.0, 0.0],
        }
    }
}

/// The controllers and the test head.
pub fn registry() -> Registry {
    Registry::new(&[
        stillpoint_testing::pipeline::STAGES,
        stillpoint_control::STAGES,
        &[Stage::of::<TestHead>()],
    ])
}

/// A pipeline of head, target and controller, run for so many seconds.
pub fn closed_loop(head: &str, target: &str, controller: &str, seconds: u64) -> Run {
    closed_loop_with(&stillpoint_operator::files::MemoryFiles::default(), head, target, controller, seconds)
}

/// [`closed_loop`] with files that the controller names.
pub fn closed_loop_with(
    files: &dyn stillpoint_operator::Files,
    head: &str,
    target: &str,
    controller: &str,
    seconds: u64,
) -> Run {
    let run = try_loop(files, head, target, controller, seconds).unwrap();
    assert!(run.failed().is_empty(), "{:?}", run.failed());
    run
}

/// [`closed_loop_with`], or why it cannot be.
pub fn try_loop(
    files: &dyn stillpoint_operator::Files,
    head: &str,
    target: &str,
    controller: &str,
    seconds: u64,
) -> Result<Run, String> {
    let text = format!(
        "
stillpoint: 1
name: loop
frames: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}
operators:
  head: {{ use: test.head, every: 10 ms, frame: couch, inputs: {{ duties: {{ from: law.duties, delay: 5 ms }} }}, params: {{ {head} }} }}
  target: {{ use: control.target, every: 50 ms, inputs: {{ state: head.state }}, params: {{ {target} }} }}
  law: {{ use: {controller}, inputs: {{ state: head.state, target: target.reference }} }}
"
    );
    run(&text, &registry(), files, seconds * 1000)
}

/// Duties with their times, s since the first.
pub fn duties(run: &Run) -> Vec<(f64, DutiesElement)> {
    let samples = run.samples::<Duties>("law.duties");
    let begin = samples[0].header.stamp;
    samples.iter().map(|s| ((s.header.stamp - begin) as f64 * 1e-9, *s.first().unwrap())).collect()
}

/// Where the head was, with times, s: height, pitch, roll.
pub fn truth(run: &Run) -> Vec<(f64, [f64; 3])> {
    let samples = run.samples::<Track>("head.truth");
    let begin = samples[0].header.stamp;
    let numbers = |t: &TrackElement| {
        let [w, x, y, z] = t.orientation;
        let turn = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
        let n = PoseNumbers::of(&Isometry3::from_parts(nalgebra::Translation3::identity(), turn));
        [t.position[2], n.pitch, n.roll]
    };
    samples.iter().map(|s| ((s.header.stamp - begin) as f64 * 1e-9, numbers(s.first().unwrap()))).collect()
}
