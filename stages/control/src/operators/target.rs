//! `control.target`: where the head is to be.

use stillpoint_pipeline::operator::{
    FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_pipeline::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_samples::{ConsoleCommand, Diagnostics, Metric, Sample, Target, Track};

use crate::channels::{ALL, Channel, Channels};
use crate::goal::{Asked, Goal, GoalParams, PlannedMove};
use crate::moves::Profile;

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
    /// How it goes.
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
    /// The channels that are to be held.
    #[param(default = "[z, pitch, roll]")]
    pub channels: Vec<Channel>,
    /// What moves and commanded targets are counted from.
    #[param(default = "start")]
    pub counted_from: CountedFrom,
    /// Moves of the target, in the order of their times: steps, ramps, or the places of a trajectory.
    #[param(default = "[]")]
    pub moves: Vec<MoveParams>,
    /// How far from the start the bladders can take the head. A target beyond is refused.
    #[param(
        default = "{ x: [-20 mm, 20 mm], y: [-20 mm, 20 mm], z: [-15 mm, 25 mm], pitch: [-10 deg, 10 deg], roll: [-20 deg, 20 deg], yaw: [-10 deg, 10 deg] }"
    )]
    pub reach: ReachParams,
    /// How long estimates are averaged to find the start. Until then there is no target.
    #[param(unit = "ns", default = "500 ms", max = "1 min")]
    pub settle: u64,
    /// How long the way to a commanded target takes; 0 s for a step.
    #[param(unit = "ns", default = "0 s", max = "1 h")]
    pub command_over: u64,
}

/// The pose that a controller is to reach.
///
/// The head is held where it is found until a move or a command (`stillpoint send console.target VALUES`, one value in m
/// or rad for each of `channels`) says else. A target out of reach is refused: the one before stands, and the sample
/// names the channels; a move of the config that can never be reached is refused before the run. A new capture takes the
/// start anew and holds the head there; moves that have begun are not repeated, those to come are counted from then. An
/// operator that was restarted makes no moves of the config.
pub struct ControlTarget {
    goal: Goal,
}

impl Operator for ControlTarget {
    type Params = TargetParams;
    const KIND: Kind = Kind {
        name: "control.target",
        about: "Where the head is to be: steps, ramps, trajectories and commands of people; what is out of reach is refused.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "state",
                sample: Track::KIND,
                policy: Policy::Latest,
                required: true,
                about: "Where the head is.",
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
                about: "The pose that is to be reached, and its rates.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "What was asked for last, counted as it was asked, and what the reach is.",
            },
        ],
        timer: Timer::Required,
    };

    fn new(params: TargetParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let channels = Channels::new(&params.channels).map_err(|e| SetupError(format!("`channels`: {e}")))?;
        let reach = reach(&params.reach, &channels)?;
        let moves = planned(&params.moves, &channels)?;
        let absolute = params.counted_from == CountedFrom::Frame;
        if !absolute {
            refuse_unreachable(&moves, &reach, &channels)?;
        }
        let (settle, over) = (params.settle, params.command_over);
        Ok(Self { goal: Goal::new(GoalParams { channels, absolute, moves, reach, settle, over }) })
    }

    fn capacities(params: &TargetParams) -> Vec<usize> {
        vec![1, 2 * params.channels.len() + 1]
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
            self.goal.see(track, state.head.origin, activation.time);
        }
        let command = activation.fresh::<ConsoleCommand>(COMMAND);
        if let Some(command) = command.as_ref().and_then(|c| c.first()) {
            let given = (command.given as usize).min(command.values.len());
            self.goal.ask(&command.values[..given], activation.time);
        }
        let element = self.goal.at(activation.time);
        outputs.send::<Target>(REFERENCE, &element)?;
        let Asked { values, standing } = self.goal.asked();
        let mut metrics =
            [Metric::new("start_known", if self.goal.start().is_some() { 1.0 } else { 0.0 }); 13];
        let count = self.goal.channels().count();
        for (i, channel) in self.goal.channels().iter().enumerate() {
            metrics[1 + i] = Metric::new(ASKED[channel.place()], values[i]);
            metrics[1 + count + i] = Metric::new(TARGET[channel.place()], standing[i]);
        }
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &metrics[..=2 * count])
    }
}

const ASKED: [&str; 6] =
    ["asked_x_m", "asked_y_m", "asked_z_m", "asked_pitch_rad", "asked_roll_rad", "asked_yaw_rad"];
const TARGET: [&str; 6] =
    ["target_x_m", "target_y_m", "target_z_m", "target_pitch_rad", "target_roll_rad", "target_yaw_rad"];

fn reach(params: &ReachParams, channels: &Channels) -> Result<[[f64; 2]; 6], SetupError> {
    let all = [params.x, params.y, params.z, params.pitch, params.roll, params.yaw];
    let mut reach = [[f64::NEG_INFINITY, f64::INFINITY]; 6];
    for (to, channel) in reach.iter_mut().zip(channels.iter()) {
        let name = channel.name();
        let Some([low, high]) = all[channel.place()] else {
            return Err(SetupError(format!(
                "`reach` lacks {name}, which is held: add `{name}: [-5 {0}, 5 {0}]`",
                if channel.unit() == "m" { "mm" } else { "deg" }
            )));
        };
        if !(low <= 0.0 && high >= 0.0) {
            return Err(SetupError(format!(
                "`reach.{name}` is from {low} to {high} {}: the start, 0, must lie in it",
                channel.unit()
            )));
        }
        *to = [low, high];
    }
    Ok(reach)
}

fn planned(params: &[MoveParams], channels: &Channels) -> Result<Vec<PlannedMove>, SetupError> {
    let mut moves: Vec<PlannedMove> = Vec::with_capacity(params.len());
    for (place, given) in params.iter().enumerate() {
        let all = [given.x, given.y, given.z, given.pitch, given.roll, given.yaw];
        let mut to = [None; 6];
        for (to, channel) in to.iter_mut().zip(channels.iter()) {
            *to = all[channel.place()];
        }
        let named = |c: &Channel| all[c.place()].is_some() && !channels.iter().any(|held| held == *c);
        if let Some(stray) = ALL.iter().find(|c| named(c)) {
            let name = stray.name();
            return Err(SetupError(format!(
                "`moves[{place}]` moves {name}, which is not held: add {name} to `channels`, or take it out"
            )));
        }
        if to.iter().all(Option::is_none) {
            return Err(SetupError(format!(
                "`moves[{place}]` moves nothing: name a channel, such as `z: 5 mm`"
            )));
        }
        if let Some(before) = moves.last().filter(|before| before.at > given.at) {
            return Err(SetupError(format!(
                "`moves[{place}]` begins at {} s, before the move above it at {} s: put moves in the order of their times",
                given.at as f64 * 1e-9,
                before.at as f64 * 1e-9
            )));
        }
        moves.push(PlannedMove { at: given.at, over: given.over, profile: given.profile, to });
    }
    Ok(moves)
}

fn refuse_unreachable(
    moves: &[PlannedMove],
    reach: &[[f64; 2]; 6],
    channels: &Channels,
) -> Result<(), SetupError> {
    for (place, planned) in moves.iter().enumerate() {
        for ((to, [low, high]), channel) in planned.to.iter().zip(reach).zip(channels.iter()) {
            if let Some(to) = to.filter(|to| !(*low..=*high).contains(to)) {
                let (name, unit) = (channel.name(), channel.unit());
                return Err(SetupError(format!(
                    "`moves[{place}].{name}` is {to} {unit}, and the bladders reach from {low} to {high} {unit}: move less, or widen `reach.{name}` if the rig can"
                )));
            }
        }
    }
    Ok(())
}
