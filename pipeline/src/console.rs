//! The console: commands of people as samples.

use stillpoint_samples::{ConsoleCommand, Sample, Verb};

use crate::activation::Activation;
use crate::operator::{FrameRule, Kind, Operator, Output, Role, SetupError, Stage, StepError, Timer};
use crate::outputs::Outputs;
use crate::outside::Inbox;
use crate::setup::Setup;

/// Name of the kind.
pub const KIND_NAME: &str = "console";

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
        Ok(Self { inbox: setup.outside.inbox.clone() })
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
pub const STAGE: Stage = Stage::of::<Console>();
