//! An operator that may not be made.

use std::sync::atomic::{AtomicBool, Ordering};

use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{Kind, Role, SetupError, StepError, Timer};

/// How it fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Interruption {
    /// It says why.
    Error,
    /// It panics.
    Panic,
    /// It never comes back.
    Hang,
    /// Not at all.
    Never,
}

/// Parameters of [`Fragile`].
#[derive(Clone, Params)]
pub struct FragileParams {
    /// How it fails.
    #[param(default = "error")]
    pub interruption: Interruption,
}

/// Cannot be made, unless its parameter says so. The check of a run makes it, as if what it needs were gone afterwards.
pub struct Fragile;

impl Operator for Fragile {
    type Params = FragileParams;
    const KIND: Kind = Kind {
        name: "kit.fragile",
        about: "Cannot be made.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[],
        timer: Timer::Required,
    };

    fn new(params: FragileParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        static CHECKED: AtomicBool = AtomicBool::new(false);
        let is_run = std::env::args_os().nth(1).is_some_and(|command| command == "run");
        if is_run && !CHECKED.swap(true, Ordering::Relaxed) {
            return Ok(Self);
        }
        match params.interruption {
            Interruption::Error => {
                Err(SetupError("the kit's model has 3 layers, but 4 are expected".to_string()))
            }
            Interruption::Panic => panic!("the kit panics while it is made"),
            Interruption::Hang => loop {
                std::thread::sleep(std::time::Duration::from_secs(1));
            },
            Interruption::Never => Ok(Self),
        }
    }

    fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
        Ok(())
    }
}
