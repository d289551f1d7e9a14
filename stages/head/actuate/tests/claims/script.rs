//! Sources that send what a script says, with a fault from one time to another.

use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, Stage, StepError, Timer};
use stillpoint_samples::{
    Command, ConsoleCommand, Duties, DutiesElement, PlanRequest, PlanRequestElement, PlanStanding,
    PlanUpdate, PlanUpdateBody, PoseReport, PoseReportElement, PoseStatus, Proof, Sample, Standing, Target,
    TargetElement, TargetStatus, Track, TrackElement, Verb,
};
use stillpoint_testing::run::START;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Fault {
    /// Nothing.
    None,
    /// Nothing is sent.
    Silent,
    /// A number is none.
    NotFinite,
    /// There is no estimate, no target, or nothing to act on.
    Nothing,
    /// The same again and again.
    Frozen,
    /// Out of tolerance, or for another number of valves.
    Off,
    /// Not known well.
    Vague,
    /// The target moves, or there is a new reference.
    Moves,
    /// The face moves, and its skull has no pose.
    Face,
    /// The head is elsewhere in a channel that the target does not hold.
    Slid,
    /// An arm is before the head, which is followed where it is expected.
    Arm,
}

/// When what goes wrong.
#[derive(Clone, Params)]
pub struct ScriptParams {
    /// What.
    #[param(default = "none")]
    fault: Fault,
    /// From when, since the start.
    #[param(unit = "ns", default = "0 s")]
    from: u64,
    /// Until when, since the start.
    #[param(unit = "ns", default = "1 h")]
    to: u64,
    /// Duty of the inlets.
    #[param(default = 0.4)]
    duty: f64,
}

impl ScriptParams {
    fn fault(&self, activation: &Activation<'_>) -> Fault {
        let since = activation.time - START;
        if (self.from..self.to).contains(&since) { self.fault } else { Fault::None }
    }
}

/// A track of z, pitch and roll near zero.
pub fn track(count: u64) -> TrackElement {
    let mut track =
        TrackElement { channels: 0x3f, standing: Standing::Measured as u32, ..TrackElement::NONE };
    (track.position, track.orientation) = ([0.0, 0.0, 1e-4], [1.0, 0.0, 0.0, 0.0]);
    (track.velocity, track.angular_velocity) = ([0.0; 3], [0.0; 3]);
    (0..6).for_each(|i| track.covariance[13 * i] = 1e-8);
    track.accepted = count;
    track
}

/// An order of a controller for six valves.
pub fn duties(duty: f64) -> DutiesElement {
    let mut duties = DutiesElement { valves: 6, ..DutiesElement::default() };
    (0..3).for_each(|bladder| duties.duty[2 * bladder] = duty);
    duties
}

/// A target of z, pitch and roll at zero.
pub fn target() -> TargetElement {
    TargetElement {
        position: [f64::NAN, f64::NAN, 0.0],
        angles: [0.0, 0.0, f64::NAN],
        velocity: [0.0; 3],
        angle_rates: [0.0; 3],
        channels: 4 | 8 | 16,
        status: TargetStatus::Held as u32,
        unreachable: 0,
        asked: 1,
        refusal: 0,
        reserved: 0,
    }
}

/// A report on a pose against this reference.
pub fn report(reference: u32) -> PoseReportElement {
    PoseReportElement {
        sensitivity: [f64::NAN; 6],
        direction_sd: [f64::NAN; 6],
        directions: [f64::NAN; 36],
        centre: [f64::NAN; 3],
        length: f64::NAN,
        residual_rms: f64::NAN,
        residual_sd: f64::NAN,
        overlap: f64::NAN,
        three_points_gap: f64::NAN,
        status: PoseStatus::Tracked as u32,
        refused: 0,
        iterations: 0,
        points: 0,
        not_finite: 0,
        reference,
        confidence: 1.0,
        certainty: [1.0; 5],
        scale: 1.0,
        apart: 0.0,
        moved: 1.0,
        confirmed: 1,
        unproven: 0,
        face: 1,
        proof: Proof::Proven as u32,
    }
}

/// A person's command.
pub fn command(verb: Verb) -> Command {
    Command { verb: verb as u32, ..Command::default() }
}

macro_rules! script {
    ($name:ident, $kind:literal, $port:literal, $sample:ty, $frame:expr, $make:expr) => {
        /// A source of one kind of sample.
        pub struct $name {
            params: ScriptParams,
            count: u64,
        }

        impl Operator for $name {
            type Params = ScriptParams;
            const KIND: Kind = Kind {
                name: $kind,
                about: "What a script says.",
                role: Role::Source,
                inputs: &[],
                outputs: &[Output { name: $port, sample: <$sample>::KIND, frame: $frame, about: "It." }],
                timer: Timer::Required,
            };

            fn new(params: ScriptParams, _: &Setup<'_>) -> Result<Self, SetupError> {
                Ok(Self { params, count: 0 })
            }

            fn step(&mut self, a: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
                let fault = self.params.fault(a);
                if fault == Fault::Silent {
                    return Ok(());
                }
                self.count += 1;
                let make: fn(Fault, u64, f64) -> <$sample as Sample>::Element = $make;
                outputs.send::<$sample>(0, &make(fault, self.count, self.params.duty))
            }
        }
    };
}

script!(Filter, "test.filter", "state", Track, FrameRule::Key, |fault, count, _| {
    let mut track = track(count);
    match fault {
        Fault::NotFinite => track.position[2] = f64::NAN,
        Fault::Nothing => track = TrackElement { accepted: count, ..TrackElement::NONE },
        Fault::Frozen => track.repeated = count,
        Fault::Off => track.position[2] = 3e-3,
        Fault::Slid => track.position[0] = 3e-3,
        Fault::Vague => track.covariance[26] = 1e-4,
        _ => {}
    }
    track
});

script!(Controller, "test.controller", "duties", Duties, FrameRule::None, |fault, _, duty| {
    let mut duties = duties(duty);
    match fault {
        Fault::NotFinite => duties.duty[3] = f64::NAN,
        Fault::Nothing => duties.idle = 1,
        Fault::Off => duties.valves = 4,
        _ => {}
    }
    duties
});

script!(Aim, "test.target", "reference", Target, FrameRule::Key, |fault, _, _| {
    let mut target = target();
    match fault {
        Fault::NotFinite => target.angles[0] = f64::NAN,
        Fault::Nothing => target.status = TargetStatus::None as u32,
        Fault::Moves => target.status = TargetStatus::Moving as u32,
        _ => {}
    }
    target
});

script!(Head, "test.head", "report", PoseReport, FrameRule::Key, |fault, _, _| {
    let status = match fault {
        Fault::Off => PoseStatus::Lost,
        Fault::Vague => PoseStatus::NoFace,
        Fault::NotFinite => PoseStatus::TooFewPoints,
        Fault::Face => PoseStatus::FaceUnsure,
        Fault::Arm => PoseStatus::Followed,
        _ => PoseStatus::Tracked,
    };
    let reference = match fault {
        Fault::Nothing => 0,
        Fault::Moves => 2,
        _ => 1,
    };
    PoseReportElement { status: status as u32, ..report(reference) }
});

/// When a person says what, since the start.
#[derive(Clone, Params)]
pub struct PersonParams {
    /// When the person asks to follow commands.
    #[param(unit = "ns")]
    arm: Option<u64>,
    /// When the person asks to follow none.
    #[param(unit = "ns")]
    disarm: Option<u64>,
    /// When the person asks to go on.
    #[param(unit = "ns")]
    resume: Option<u64>,
    /// When the person asks to let the air out.
    #[param(unit = "ns")]
    vent: Option<u64>,
}

/// A person with a script.
pub struct Person {
    says: [(Option<u64>, Verb); 4],
}

const fn verb(name: &'static str) -> Output {
    Output { name, sample: ConsoleCommand::KIND, frame: FrameRule::None, about: "A verb." }
}

impl Operator for Person {
    type Params = PersonParams;
    const KIND: Kind = Kind {
        name: "test.person",
        about: "A person with a script.",
        role: Role::Source,
        inputs: &[],
        outputs: &[verb("arm"), verb("disarm"), verb("resume"), verb("vent")],
        timer: Timer::Required,
    };

    fn new(p: PersonParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let says =
            [(p.arm, Verb::Arm), (p.disarm, Verb::Disarm), (p.resume, Verb::Resume), (p.vent, Verb::Vent)];
        Ok(Self { says })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        for (port, (at, verb)) in self.says.iter_mut().enumerate() {
            if at.is_some_and(|at| activation.time - START >= at) {
                *at = None;
                outputs.send::<ConsoleCommand>(port, &command(*verb))?;
            }
        }
        Ok(())
    }
}

/// Requests, and what is said of the standing plan: it holds in the first set-up from 300 ms on, and in the set-up that is
/// requested at 1500 ms it fails from 1600 ms on; the plan that is accepted at 2 s holds.
pub struct Plans;

impl Operator for Plans {
    type Params = ();
    const KIND: Kind = Kind {
        name: "test.plans",
        about: "What a script says of plans.",
        role: Role::Source,
        inputs: &[],
        outputs: &[
            Output { name: "request", sample: PlanRequest::KIND, frame: FrameRule::None, about: "Requests." },
            Output { name: "plan", sample: PlanUpdate::KIND, frame: FrameRule::None, about: "Answers." },
        ],
        timer: Timer::Required,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let answer = |request, standing: PlanStanding| PlanUpdateBody {
            request,
            standing: standing as u32,
            ..PlanUpdateBody::default()
        };
        let description = match activation.tick {
            0 | 150 => {
                let request = PlanRequestElement {
                    position: [0.0; 3],
                    orientation: [1.0, 0.0, 0.0, 0.0],
                    case_hash: [0; 4],
                    beams: 5,
                    budget: 8,
                };
                return outputs.send::<PlanRequest>(0, &request);
            }
            10 => answer(0, PlanStanding::Unknown),
            30 => answer(0, PlanStanding::Holds),
            155 => answer(1, PlanStanding::Unknown),
            160 => answer(1, PlanStanding::Fails),
            200 => answer(1, PlanStanding::Holds),
            _ => return Ok(()),
        };
        outputs.send_slice::<PlanUpdate>(1, &description, &[])
    }
}

/// The kinds of this file.
pub const STAGES: &[Stage] = &[
    Stage::of::<Filter>(),
    Stage::of::<Controller>(),
    Stage::of::<Aim>(),
    Stage::of::<Head>(),
    Stage::of::<Person>(),
    Stage::of::<Plans>(),
];
