//! An operator that prints.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Diagnostics, Metric, Sample};

/// Parameters of [`Printing`].
#[derive(Clone, Params)]
pub struct PrintingParams {
    /// What it prints.
    #[param(default = "here I am")]
    pub text: String,
}

/// Prints when it is made and at each tick, also what looks like the end of its process.
pub struct Printing(PrintingParams);

impl Operator for Printing {
    type Params = PrintingParams;
    const KIND: Kind = Kind {
        name: "kit.printing",
        about: "Prints at each tick.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "value",
            sample: Diagnostics::KIND,
            frame: FrameRule::None,
            about: "How often it has printed.",
        }],
        timer: Timer::Required,
    };

    fn new(params: PrintingParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        println!("{}: made", params.text);
        Ok(Self(params))
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        println!("{}: {}", self.0.text, activation.index);
        println!("\"Stopped\"");
        print!("{{");
        outputs.send_slice::<Diagnostics>(0, &(), &[Metric::new("printed", activation.index as f64)])
    }
}
