//! The console: commands of people as samples.

use stillpoint_samples::{Command, ConsoleCommand, Sample, Verb};

use crate::activation::Activation;
use crate::operator::Setup;
use crate::operator::{FrameRule, Kind, Operator, Output, Role, SetupError, Stage, StepError, Timer};
use crate::outputs::Outputs;
use crate::outside::Inbox;
use crate::params::{Choice, Params};

/// Name of the kind.
pub const KIND_NAME: &str = "console";
/// Values that a command has room for.
const VALUES: usize = 6;

/// What a person says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Said {
    /// Allow actuation.
    Arm,
    /// Forbid actuation.
    Disarm,
    /// Capture a reference of the head.
    Capture,
    /// Move to a target.
    Target,
    /// Go on after a fault.
    Resume,
    /// Vent all bladders.
    Vent,
    /// Begin a fault on a simulated rig.
    Fault,
    /// Confirm that the reference shows the head.
    Confirm,
    /// Accept the offered plan of the request whose number is the value.
    Accept,
}

impl Said {
    fn verb(self) -> Verb {
        match self {
            Self::Arm => Verb::Arm,
            Self::Disarm => Verb::Disarm,
            Self::Capture => Verb::Capture,
            Self::Target => Verb::Target,
            Self::Resume => Verb::Resume,
            Self::Vent => Verb::Vent,
            Self::Fault => Verb::Fault,
            Self::Confirm => Verb::Confirm,
            Self::Accept => Verb::Accept,
        }
    }
}

/// A command of the script.
#[derive(Clone, Debug, Params)]
pub struct ScriptedCommand {
    /// Time after the beginning of the run.
    #[param(unit = "ns")]
    pub at: u64,
    /// The command.
    pub say: Said,
    /// Values of it, SI units.
    #[param(default = "[]")]
    pub values: Vec<f64>,
}

/// Parameters of `console`.
#[derive(Clone, Debug, Params)]
pub struct ConsoleParams {
    /// Commands that are sent without a person, for simulations, demonstrations and tests.
    #[param(default = "[]")]
    pub script: Vec<ScriptedCommand>,
}

/// Turns the commands of `stillpoint send`, and those of its script, into samples, at each tick of its timer.
pub struct Console {
    inbox: Inbox,
    /// By time, the earliest first.
    script: Vec<(u64, Command)>,
    every: u64,
    /// Session time up to which the script was said, ns; `None` before the first activation.
    said: Option<u64>,
}

const fn verb(name: &'static str, about: &'static str) -> Output {
    Output { name, sample: ConsoleCommand::KIND, frame: FrameRule::None, about }
}

impl Operator for Console {
    type Params = ConsoleParams;
    const KIND: Kind = Kind {
        name: KIND_NAME,
        about: "Commands of people (`stillpoint send`) as samples, one output per verb.",
        role: Role::Source,
        inputs: &[],
        outputs: &[
            verb("arm", "Allow actuation."),
            verb("disarm", "Forbid actuation."),
            verb("capture", "Capture a reference of the head."),
            verb("target", "Move to a target: up to six values, SI units."),
            verb("resume", "Go on after a fault."),
            verb("vent", "Vent all bladders."),
            verb("fault", "Cause a fault on a simulated rig, or remove it."),
            verb("confirm", "Confirm that the reference shows the head."),
            verb("accept", "Accept the offered plan of a request: the number of the request."),
        ],
        timer: Timer::Required,
    };

    fn new(params: ConsoleParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let mut script = params.script.iter().map(command).collect::<Result<Vec<_>, _>>()?;
        script.sort_by_key(|(at, _)| *at);
        Ok(Self { inbox: setup.outside.inbox.clone(), script, every: setup.every.unwrap_or(0), said: None })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let now = activation.tick.saturating_mul(self.every);
        // A console that was restarted does not say again what its earlier life has said.
        let from = match (self.said, activation.key.incarnation) {
            (Some(said), _) => said + 1,
            (None, 0) => 0,
            (None, _) => now,
        };
        self.said = Some(now);
        for (_, command) in self.script.iter().filter(|(at, _)| (from..=now).contains(at)) {
            send(command, outputs)?;
        }
        while let Some(command) = self.inbox.take() {
            send(&command, outputs)?;
        }
        Ok(())
    }
}

fn command(line: &ScriptedCommand) -> Result<(u64, Command), SetupError> {
    if line.values.len() > VALUES || line.values.iter().any(|v| !v.is_finite()) {
        return Err(SetupError(format!(
            "the script's command at {} ms has {} values: a command has up to {VALUES} finite ones",
            line.at / 1_000_000,
            line.values.len()
        )));
    }
    let mut command =
        Command { verb: line.say.verb() as u32, given: line.values.len() as u32, ..Command::default() };
    command.values[..line.values.len()].copy_from_slice(&line.values);
    command.by[..6].copy_from_slice(b"script");
    Ok((line.at, command))
}

fn send(command: &Command, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
    let Some(port) = Verb::ALL.iter().position(|(_, verb)| *verb as u32 == command.verb) else {
        return Err(StepError(format!("there is no verb {}", command.verb)));
    };
    outputs.send::<ConsoleCommand>(port, command)
}

/// The console's entry in the list of kinds.
pub const STAGE: Stage = Stage::of::<Console>();
