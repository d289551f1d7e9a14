//! `bench.poison`: tracks whose position is NaN from the first command of a person on.

use stillpoint_operator::{Activation, Operator, Outputs, Setup, Stage};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{ConsoleCommand, Sample, Track};

const STATE: usize = 0;
const SENT: usize = 1;

/// Forwards tracks. From the first command on their position is NaN.
pub struct NanInjection {
    acts: bool,
}

impl Operator for NanInjection {
    type Params = ();
    const KIND: Kind = Kind {
        name: "bench.poison",
        about: "Sends tracks on; from the first command on without a number in their position.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "state",
                sample: Track::KIND,
                policy: Policy::Queue(4),
                required: true,
                about: "The tracks.",
            },
            Input {
                name: "said",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(4),
                required: true,
                about: "The command.",
            },
        ],
        outputs: &[Output {
            name: "state",
            sample: Track::KIND,
            frame: FrameRule::SameAs("state"),
            about: "The tracks.",
        }],
        timer: Timer::No,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { acts: false })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        self.acts |= activation.fresh::<ConsoleCommand>(SENT).is_some();
        let Some(view) = activation.fresh::<Track>(STATE) else { return Ok(()) };
        let Some(mut track) = view.first().copied() else { return Ok(()) };
        if self.acts {
            track.position = [f64::NAN; 3];
        }
        outputs.send::<Track>(STATE, &track)
    }
}

/// Entry of `bench.poison` in the list of kinds.
pub const STAGE: Stage = Stage::of::<NanInjection>();
