//! An operator with more outputs than a word has bits.

use stillpoint_operator::{Activation, Operator, Outputs, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Diagnostics, Metric, Sample};

/// Outputs of [`Wide`].
const WIDTH: usize = 70;

/// Sends on its last output alone.
pub struct Wide;

/// `o00` to `o69`.
static NAMES: [[u8; 3]; WIDTH] = {
    let mut names = [*b"o00"; WIDTH];
    let mut i = 0;
    while i < WIDTH {
        names[i][1] += (i / 10) as u8;
        names[i][2] += (i % 10) as u8;
        i += 1;
    }
    names
};

static OUTPUTS: [Output; WIDTH] = {
    const ONE: Output =
        Output { name: "", sample: Diagnostics::KIND, frame: FrameRule::None, about: "One of many." };
    let mut outputs = [ONE; WIDTH];
    let mut i = 0;
    while i < WIDTH {
        if let Ok(name) = str::from_utf8(&NAMES[i]) {
            outputs[i] = Output { name, ..ONE };
        }
        i += 1;
    }
    outputs
};

impl Operator for Wide {
    type Params = ();
    const KIND: Kind = Kind {
        name: "kit.wide",
        about: "Sends on the last of its 70 outputs.",
        role: Role::Operator,
        inputs: &[],
        outputs: &OUTPUTS,
        timer: Timer::Required,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let metric = Metric::new("index", activation.index as f64);
        outputs.send_slice::<Diagnostics>(WIDTH - 1, &(), &[metric])
    }
}
