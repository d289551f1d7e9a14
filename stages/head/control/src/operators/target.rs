//! `control.target`: where the head is to be.

use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{Feeder, FeederConflict};
use stillpoint_operator::{
    FrameRule, Input, Kind, Output, ParamConflict, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_samples::{ConsoleCommand, Diagnostics, Metric, Sample, Target, Track};

use crate::channels::{Channel, Channels};
use crate::goal::{Asked, Goal, GoalParams};
use crate::moves::Profile;
use crate::operators::followed;
use crate::operators::planned::{planned, reach, refuse_unheld, refuse_unmoved, refuse_unreachable};
use crate::rig::{Rig, RigKind};

const STATE: usize = 0;
const COMMAND: usize = 1;
const CAPTURE: usize = 2;
const REFERENCE: usize = 0;
const DIAGNOSTICS: usize = 1;

/// What targets are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum CountedFrom {
    /// Where the head was when the first estimates came.
    Start,
    /// The origin of the state's frame.
    Frame,
}

/// A move of the target. A channel that is not named stays.
#[derive(Clone, Copy, Debug, PartialEq, Params)]
pub struct MoveParams {
    /// When it begins, counted from when the start is known.
    #[param(unit = "ns", default = "0 s", max = "24 h")]
    pub at: u64,
    /// How long it takes; 0 s for a step.
    #[param(unit = "ns", default = "0 s", max = "24 h")]
    pub over: u64,
    /// Profile of the motion over time.
    #[param(default = "linear")]
    pub profile: Profile,
    /// Where to, along x.
    #[param(unit = "m")]
    pub x: Option<f64>,
    /// Where to, along y.
    #[param(unit = "m")]
    pub y: Option<f64>,
    /// Where to, along z.
    #[param(unit = "m")]
    pub z: Option<f64>,
    /// Where to, about x.
    #[param(unit = "rad")]
    pub pitch: Option<f64>,
    /// Where to, about y.
    #[param(unit = "rad")]
    pub roll: Option<f64>,
    /// Where to, about z.
    #[param(unit = "rad")]
    pub yaw: Option<f64>,
}

/// Least and greatest distance from the start, for each channel that it is given for.
#[derive(Clone, Copy, Debug, PartialEq, Params)]
pub struct ReachParams {
    /// Along x.
    #[param(unit = "m")]
    pub x: Option<[f64; 2]>,
    /// Along y.
    #[param(unit = "m")]
    pub y: Option<[f64; 2]>,
    /// Along z.
    #[param(unit = "m")]
    pub z: Option<[f64; 2]>,
    /// About x.
    #[param(unit = "rad")]
    pub pitch: Option<[f64; 2]>,
    /// About y.
    #[param(unit = "rad")]
    pub roll: Option<[f64; 2]>,
    /// About z.
    #[param(unit = "rad")]
    pub yaw: Option<[f64; 2]>,
}

/// Parameters of `control.target`.
#[derive(Clone, Debug, Params)]
pub struct TargetParams {
    /// The channels that the target holds.
    #[param(default = "[z, pitch, roll]")]
    pub channels: Vec<Channel>,
    /// Origin of moves and of commanded targets.
    #[param(default = "start")]
    pub counted_from: CountedFrom,
    /// Moves of the target, in the order of their times: steps, ramps, or points of a trajectory.
    #[param(default = "[]")]
    pub moves: Vec<MoveParams>,
    /// Largest distances from the start. A target outside them is refused.
    #[param(
        default = "{ x: [-20 mm, 20 mm], y: [-20 mm, 20 mm], z: [-15 mm, 25 mm], pitch: [-10 deg, 10 deg], roll: [-20 deg, 20 deg], yaw: [-10 deg, 10 deg] }"
    )]
    pub reach: ReachParams,
    /// The rig, if its mechanics are known: a target that its bladders cannot hold is refused, too. The rig is assumed
    /// to start with the air of the simulated rig.
    #[param(default = "unknown")]
    pub rig: RigKind,
    /// Mass of the head on the rig.
    #[param(unit = "kg", default = "5 kg", min = "1 kg", max = "10 kg")]
    pub head_mass: f64,
    /// Time over which estimates are averaged to find the start. Until then there is no target.
    #[param(unit = "ns", default = "500 ms", max = "1 min")]
    pub settle: u64,
    /// Duration of the way to a commanded target; 0 s for a step.
    #[param(unit = "ns", default = "0 s", max = "1 h")]
    pub command_over: u64,
}

/// The pose that a controller is to reach.
///
/// The head is held where it is found until a move or a command (`stillpoint send console.target VALUES`, one value in
/// m or rad for each of `channels`) changes the target. A target out of reach is refused: the previous target stays,
/// and the sample names the channels. A move of the config that can never be reached is refused before the run. After a
/// new capture the start is measured again, and the head is held there; moves that have begun are not repeated, and
/// later moves are counted from the new start. A restarted operator makes no moves of the config.
pub struct ControlTarget {
    goal: Goal,
}

impl Operator for ControlTarget {
    type Params = TargetParams;
    const KIND: Kind = Kind {
        name: "control.target",
        about: "Sends the target of the head: steps, ramps, trajectories and commands of people. Refuses targets out of reach.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "state",
                sample: Track::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The estimated pose of the head.",
            },
            Input {
                name: "command",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(4),
                required: false,
                about: "Targets of people: `console.target`.",
            },
            Input {
                name: "capture",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(4),
                required: false,
                about: "New references: `console.capture`.",
            },
        ],
        outputs: &[
            Output {
                name: "reference",
                sample: Target::KIND,
                frame: FrameRule::SameAs("state"),
                about: "The target pose and its rates.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "The last requested target, counted as it was requested, and the reach.",
            },
        ],
        timer: Timer::Required,
    };

    fn validate(params: &TargetParams) -> Result<(), ParamConflict> {
        goal(params).map(drop).map_err(|e| ParamConflict::inside(&["moves", "reach", "rig", "channels"], e))
    }

    fn validate_input(params: &TargetParams, input: usize, from: &Feeder<'_>) -> Result<(), FeederConflict> {
        if input == STATE { followed::check(&params.channels, from) } else { Ok(()) }
    }

    fn new(params: TargetParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { goal: goal(&params)? })
    }

    fn capacities(params: &TargetParams) -> Vec<usize> {
        vec![1, 2 * params.channels.len() + 2]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if activation.index == 0 && activation.key.incarnation > 0 {
            self.goal.skip_moves();
        }
        if activation.fresh::<ConsoleCommand>(CAPTURE).is_some() {
            self.goal.start_anew();
        }
        if let Some(state) = activation.input::<Track>(STATE)
            && let Some(track) = state.first()
        {
            self.goal.see(track, state.header.origin, activation.time);
        }
        let command = activation.fresh::<ConsoleCommand>(COMMAND);
        if let Some(command) = command.as_ref().and_then(|c| c.first()) {
            let given = (command.given as usize).min(command.values.len());
            self.goal.ask(&command.values[..given], activation.time);
        }
        let element = self.goal.at(activation.time);
        outputs.send::<Target>(REFERENCE, &element)?;
        let Asked { values, standing, bladder } = self.goal.asked();
        let mut metrics =
            [Metric::new("start_known", if self.goal.start().is_some() { 1.0 } else { 0.0 }); 14];
        let count = self.goal.channels().count();
        for (i, channel) in self.goal.channels().iter().enumerate() {
            metrics[1 + i] = Metric::new(ASKED[channel.place()], values[i]);
            metrics[1 + count + i] = Metric::new(TARGET[channel.place()], standing[i]);
        }
        let bladder = bladder.map_or(f64::NAN, |b| b as f64);
        metrics[2 * count + 1] = Metric::new("bladder_in_the_way", bladder);
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &metrics[..2 * count + 2])
    }
}

const ASKED: [&str; 6] =
    ["asked_x_m", "asked_y_m", "asked_z_m", "asked_pitch_rad", "asked_roll_rad", "asked_yaw_rad"];
const TARGET: [&str; 6] =
    ["target_x_m", "target_y_m", "target_z_m", "target_pitch_rad", "target_roll_rad", "target_yaw_rad"];

/// Builds the goal from the parameters.
fn goal(params: &TargetParams) -> Result<Goal, SetupError> {
    let channels = Channels::new(&params.channels).map_err(|e| SetupError(format!("`channels`: {e}")))?;
    let reach = reach(&params.reach, &channels)?;
    let moves = planned(&params.moves, &channels)?;
    let absolute = params.counted_from == CountedFrom::Frame;
    let rig = Rig::of(params.rig, params.head_mass)
        .map_err(|e| SetupError(format!("`head_mass` is {} kg: {e}", params.head_mass)))?;
    refuse_unmoved(&rig, &channels)?;
    if !absolute {
        refuse_unreachable(&moves, &reach, &channels)?;
        refuse_unheld(&moves, &rig, &channels)?;
    }
    let (settle, over) = (params.settle, params.command_over);
    Ok(Goal::new(GoalParams { channels, absolute, moves, reach, rig, settle, over }))
}
