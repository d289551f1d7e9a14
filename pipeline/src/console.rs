//! The console: commands of people as samples.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use stillpoint_samples::{Command, ConsoleCommand, Sample, Verb};

use crate::activation::Activation;
use crate::operator::{FrameRule, Kind, Operator, Output, Role, SetupError, Stage, StepError, Timer};
use crate::outputs::Outputs;
use crate::setup::Setup;

/// Name of the kind.
pub const KIND_NAME: &str = "console";

/// Commands that arrived from people and were not sent on yet. Executors fill it; only a console takes from it.
#[derive(Clone, Default)]
pub struct Inbox(Arc<Mutex<VecDeque<Command>>>);

impl Inbox {
    /// Adds a command.
    pub fn put(&self, command: Command) {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push_back(command);
    }

    /// The oldest command.
    pub fn take(&self) -> Option<Command> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).pop_front()
    }
}

/// Turns the commands of `stillpoint send` into samples, at each tick of its timer.
pub struct Console {
    inbox: Inbox,
}

const fn verb(name: &'static str, about: &'static str) -> Output {
    Output { name, sample: ConsoleCommand::KIND, frame: FrameRule::None, about }
}

impl Operator for Console {
    type Params = ();
    const KIND: Kind = Kind {
        name: KIND_NAME,
        about: "Commands of people (`stillpoint send`) as samples, one output per verb.",
        role: Role::Source,
        inputs: &[],
        outputs: &[
            verb("arm", "Allow actuation."),
            verb("disarm", "Forbid actuation."),
            verb("capture", "Take a reference of what the camera sees."),
            verb("target", "Move to a target: up to six values, SI units."),
            verb("resume", "Go on after a fault."),
            verb("vent", "Let all pressure out."),
        ],
        timer: Timer::Required,
    };

    fn new((): (), setup: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { inbox: setup.inbox.clone() })
    }

    fn step(&mut self, _: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        while let Some(command) = self.inbox.take() {
            let Some(port) = Verb::ALL.iter().position(|(_, verb)| *verb as u32 == command.verb) else {
                return Err(StepError(format!("there is no verb {}", command.verb)));
            };
            outputs.send::<ConsoleCommand>(port, &command)?;
        }
        Ok(())
    }
}

/// The console's entry in the list of kinds.
pub const STAGES: &[Stage] = &[Stage::of::<Console>()];
