//! The console: commands of people as samples.

use std::collections::VecDeque;

use stillpoint_samples::{
    Actuation, ActuationElement, ActuationReason, ActuationState, Command, ConsoleCommand, PoseReport,
    PoseReportElement, PoseStatus, Rejection, RejectionElement, Sample, Setting, SettingElement, Verb,
};

use crate::activation::Activation;
use crate::operator::Setup;
use crate::operator::{
    FrameRule, Input, Kind, Operator, Output, ParamConflict, Policy, Role, SetupError, Stage, StepError,
    Timer,
};
use crate::outputs::Outputs;
use crate::outside::{Inbox, Message};
use crate::params::{Choice, Params};

/// Name of the kind.
pub const KIND_NAME: &str = "console";
/// Values that a command has room for.
const VALUES: usize = 6;
/// The input with the state of the valves: whether `arm` was accepted.
pub const ACTUATION: usize = 0;
/// The input with the reports of the tracker: whether `capture` and `confirm` were accepted.
pub const REPORT: usize = 1;
/// The output with the reasons for which a command was said again.
const REFUSED: usize = Verb::ALL.len();
/// The output with changes of parameters.
pub const SETTING: usize = REFUSED + 1;

/// What a person says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum ScriptCommand {
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
    /// Change a live parameter.
    Set,
}

impl ScriptCommand {
    /// The input that states whether the command was accepted; `None` where no operator answers it.
    pub fn answered_on(self) -> Option<usize> {
        match self {
            Self::Arm => Some(ACTUATION),
            Self::Capture | Self::Confirm => Some(REPORT),
            _ => None,
        }
    }

    /// The verb; `None` of a change, which is no command.
    fn verb(self) -> Option<Verb> {
        Some(match self {
            Self::Arm => Verb::Arm,
            Self::Disarm => Verb::Disarm,
            Self::Capture => Verb::Capture,
            Self::Target => Verb::Target,
            Self::Resume => Verb::Resume,
            Self::Vent => Verb::Vent,
            Self::Fault => Verb::Fault,
            Self::Confirm => Verb::Confirm,
            Self::Accept => Verb::Accept,
            Self::Set => return None,
        })
    }

    fn word(self) -> &'static str {
        self.verb().map_or("set", Verb::word)
    }
}

/// A command of the script.
#[derive(Clone, Debug, Params)]
pub struct ScriptedCommand {
    /// Time after the beginning of the run.
    #[param(unit = "ns")]
    pub at: u64,
    /// The command.
    pub say: ScriptCommand,
    /// Values of it, SI units.
    #[param(default = "[]")]
    pub values: Vec<f64>,
    /// Of `set`: operator and parameter, such as `law.proportional`.
    pub parameter: Option<String>,
    /// Of `set`: the value with its unit; a list in quotes.
    pub value: Option<String>,
    /// Say it again after this time, until it is accepted: of `capture`, `confirm` and `arm`. Later commands of the script
    /// wait until then.
    #[param(unit = "ns", min = "20 ms", max = "1 h")]
    pub repeat: Option<u64>,
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
    script: VecDeque<Line>,
    /// The command that is said until it is accepted.
    waiting: Option<Waiting>,
    every: u64,
    /// Session time up to which the script was said, ns; `None` before the first activation.
    issued: Option<u64>,
}

/// A command of the script, checked.
struct Line {
    at: u64,
    issued: ScriptCommand,
    repeat: Option<u64>,
    message: Message,
}

/// A command that was said and is not accepted yet.
struct Waiting {
    line: Line,
    /// When it is said again, ns of session time.
    repeats: u64,
    /// How often it was said.
    times: u32,
    /// The number of the reference when it was said first.
    reference: u32,
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
        inputs: &[
            Input {
                name: "actuation",
                sample: Actuation::KIND,
                policy: Policy::Latest,
                required: false,
                about: "State of the valves, with a delay: a script that repeats `arm` needs it.",
            },
            Input {
                name: "report",
                sample: PoseReport::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Report of the tracker, with a delay: a script that repeats `capture` or `confirm` needs it.",
            },
        ],
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
            Output {
                name: "refused",
                sample: Rejection::KIND,
                frame: FrameRule::None,
                about: "Why a command of the script was repeated; `found` is how often it was sent.",
            },
            Output {
                name: "set",
                sample: Setting::KIND,
                frame: FrameRule::None,
                about: "Changes of live parameters (`stillpoint set`).",
            },
        ],
        timer: Timer::Required,
    };

    fn validate(params: &ConsoleParams) -> Result<(), ParamConflict> {
        let refuse = |reason: String, help| Err(ParamConflict { params: &["script"], reason, help });
        for line in &params.script {
            command(line).map_err(|e| ParamConflict::inside(&["script"], e))?;
            if line.repeat.is_some() && line.say.answered_on().is_none() {
                let word = line.say.word();
                return refuse(
                    format!("no operator answers `{word}`, so it cannot be repeated until it is accepted"),
                    "use `repeat` for capture, confirm and arm only",
                );
            }
        }
        Ok(())
    }

    fn new(params: ConsoleParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let mut script = params.script.iter().map(command).collect::<Result<Vec<_>, _>>()?;
        script.sort_by_key(|line| line.at);
        if let Some(input) = params.unanswered().find(|input| !setup.is_connected(*input)) {
            let name = Self::KIND.inputs[input].name;
            return Err(SetupError(format!(
                "`repeat` needs the input `{name}`: connect it, or remove `repeat`"
            )));
        }
        let inbox = setup.outside.inbox.clone();
        Ok(Self {
            inbox,
            script: script.into(),
            waiting: None,
            every: setup.every.unwrap_or(0),
            issued: None,
        })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let now = activation.tick.saturating_mul(self.every);
        // A console that was restarted does not say again what its earlier life has said.
        let from = match (self.issued, activation.key.incarnation) {
            (Some(issued), _) => issued + 1,
            (None, 0) => 0,
            (None, _) => now,
        };
        if self.issued.is_none() {
            self.script.retain(|line| line.at >= from);
        }
        self.issued = Some(now);
        let actuation = activation.input::<Actuation>(ACTUATION).and_then(|view| view.first().copied());
        let report = activation.input::<PoseReport>(REPORT).and_then(|view| view.first().copied());
        if let Some(mut waiting) = self.waiting.take()
            && let Err(why) =
                accepted(waiting.line.issued, waiting.reference, actuation.as_ref(), report.as_ref())
        {
            if now >= waiting.repeats {
                let (issued, times) = (waiting.line.issued, waiting.times);
                let number = issued.verb().map_or(0, |verb| verb as u32);
                let reason = format!("{} repeated: {why}", issued.word());
                outputs.send::<Rejection>(
                    REFUSED,
                    &RejectionElement::new(number, &reason, f64::from(times), 0.0),
                )?;
                send(&waiting.line.message, outputs)?;
                waiting.times += 1;
                waiting.repeats = now.saturating_add(waiting.line.repeat.unwrap_or(u64::MAX));
            }
            self.waiting = Some(waiting);
        }
        while self.waiting.is_none()
            && self.script.front().is_some_and(|line| line.at <= now)
            && let Some(line) = self.script.pop_front()
        {
            send(&line.message, outputs)?;
            if let Some(repeat) = line.repeat {
                let reference = report.map_or(0, |report| report.reference);
                self.waiting =
                    Some(Waiting { repeats: now.saturating_add(repeat), times: 1, reference, line });
            }
        }
        while let Some(message) = self.inbox.take() {
            send(&message, outputs)?;
        }
        Ok(())
    }
}

impl ConsoleParams {
    /// The changes of parameters in the script: operator and parameter, and the value.
    pub fn settings(&self) -> impl Iterator<Item = (&str, &str)> {
        let sets = self.script.iter().filter(|line| line.say == ScriptCommand::Set);
        sets.filter_map(|line| Some((line.parameter.as_deref()?, line.value.as_deref()?)))
    }

    /// The inputs that the repeated commands of the script need.
    pub fn unanswered(&self) -> impl Iterator<Item = usize> {
        self.script.iter().filter(|line| line.repeat.is_some()).filter_map(|line| line.say.answered_on())
    }
}

/// Why a command is not accepted, as far as it is known.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
enum NotAccepted {
    #[error("{0} not answered")]
    Silent(&'static str),
    #[error("{}", .0.join(", "))]
    Lacking(Vec<&'static str>),
    #[error("the tracker reports: {0}")]
    Tracker(&'static str),
}

/// Whether a command was accepted; else why not.
fn accepted(
    issued: ScriptCommand,
    reference: u32,
    actuation: Option<&ActuationElement>,
    report: Option<&PoseReportElement>,
) -> Result<(), NotAccepted> {
    match issued {
        ScriptCommand::Arm => {
            let silent = NotAccepted::Silent("the valves have");
            let Some(actuation) = actuation else { return Err(silent) };
            if actuation.state() != ActuationState::Disarmed {
                return Ok(());
            }
            let lacking: Vec<_> = ActuationReason::words(actuation.lacking).collect();
            Err(if lacking.is_empty() { silent } else { NotAccepted::Lacking(lacking) })
        }
        ScriptCommand::Capture | ScriptCommand::Confirm => {
            let report = report.ok_or(NotAccepted::Silent("the tracker has"))?;
            let is_done = match issued {
                ScriptCommand::Capture => report.reference > reference,
                _ => report.confirmed == 1,
            };
            let word = PoseStatus::from_number(report.status).map_or("unknown status", PoseStatus::word);
            if is_done { Ok(()) } else { Err(NotAccepted::Tracker(word)) }
        }
        _ => Ok(()),
    }
}

fn command(line: &ScriptedCommand) -> Result<Line, SetupError> {
    if line.values.len() > VALUES || line.values.iter().any(|v| !v.is_finite()) {
        return Err(SetupError(format!(
            "the script's command at {} ms has {} values: a command has up to {VALUES} finite ones",
            line.at / 1_000_000,
            line.values.len()
        )));
    }
    let is_set = line.say == ScriptCommand::Set;
    if is_set != line.parameter.is_some() || is_set != line.value.is_some() {
        return Err(SetupError(format!(
            "the script's command at {} ms: `parameter` and `value` belong to `say: set`, which needs both",
            line.at / 1_000_000
        )));
    }
    let Some(verb) = line.say.verb() else {
        return setting(line);
    };
    let mut command = Command { verb: verb as u32, given: line.values.len() as u32, ..Command::default() };
    command.values[..line.values.len()].copy_from_slice(&line.values);
    command.by[..6].copy_from_slice(b"script");
    Ok(Line { at: line.at, issued: line.say, repeat: line.repeat, message: Message::Command(command) })
}

/// A change of a parameter by the script. Whether its operator would take it is known when it does.
fn setting(line: &ScriptedCommand) -> Result<Line, SetupError> {
    let (path, value) = (line.parameter.as_deref().unwrap_or(""), line.value.as_deref().unwrap_or(""));
    let named = path.split_once('.').is_some_and(|(operator, rest)| !operator.is_empty() && !rest.is_empty());
    let element = SettingElement::new(path, value, "script").filter(|_| named && line.values.is_empty());
    let element = element.ok_or_else(|| {
        SetupError(format!(
            "invalid change by the script at {} ms: `{path}` (allowed: OPERATOR.PARAMETER of up to 96 bytes, a value of up to \
             160 bytes, and no `values`)",
            line.at / 1_000_000
        ))
    })?;
    Ok(Line { at: line.at, issued: line.say, repeat: line.repeat, message: Message::Setting(element) })
}

fn send(message: &Message, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
    let command = match message {
        Message::Command(command) => command,
        Message::Setting(setting) => return outputs.send::<Setting>(SETTING, setting),
    };
    let Some(port) = Verb::ALL.iter().position(|(_, verb)| *verb as u32 == command.verb) else {
        return Err(StepError(format!("there is no verb {}", command.verb)));
    };
    outputs.send::<ConsoleCommand>(port, command)
}

/// The console's entry in the list of kinds.
pub const STAGE: Stage = Stage::of::<Console>();
