//! An operator whose stages are measured.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Diagnostics, Sample};

use crate::mixer::busy;

const SHORT: usize = 0;
const LONG: usize = 1;

/// Parameters of [`Lapping`].
#[derive(Clone, Params)]
pub struct LappingParams {
    /// Time of each turn of the stage `long`, without sleeping.
    #[param(unit = "ns", default = "300 us", max = "1 s")]
    pub work: u64,
    /// Ends a lap that it does not have at this activation; 0: never.
    #[param(default = 0)]
    pub unknown_at: u64,
}

/// Sends on what it gets, in two stages of which one is entered twice, and a third that it never enters.
pub struct Lapping(LappingParams);

impl Operator for Lapping {
    type Params = LappingParams;
    const KIND: Kind = Kind {
        name: "kit.lapping",
        about: "Sends on what it gets, in measured stages.",
        role: Role::Operator,
        inputs: &[Input {
            name: "from",
            sample: Diagnostics::KIND,
            policy: Policy::Queue(4),
            required: true,
            about: "Numbers.",
        }],
        outputs: &[Output {
            name: "same",
            sample: Diagnostics::KIND,
            frame: FrameRule::None,
            about: "What came in.",
        }],
        timer: Timer::No,
    };
    const LAPS: &'static [&'static str] = &["short", "long", "never"];

    fn new(params: LappingParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self(params))
    }

    fn capacities(_: &LappingParams) -> Vec<usize> {
        vec![4]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(view) = activation.input::<Diagnostics>(0) else { return Ok(()) };
        outputs.lap(SHORT);
        busy(self.0.work);
        outputs.lap(LONG);
        outputs.send_slice::<Diagnostics>(0, &(), view.elements)?;
        outputs.lap(SHORT);
        busy(self.0.work);
        outputs.lap(LONG);
        if self.0.unknown_at > 0 && activation.index == self.0.unknown_at {
            outputs.lap(Self::LAPS.len());
        }
        Ok(())
    }
}
