//! Operators at the two ends of a link.

use stillpoint_operator::{Activation, Operator, Outputs, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Datagram, Diagnostics, Metric, Sample};

/// Sends the number of its activation as a datagram, at each tick.
pub struct Writing;

impl Operator for Writing {
    type Params = ();
    const KIND: Kind = Kind {
        name: "kit.writing",
        about: "Sends datagrams that hold a number.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "letter",
            sample: Datagram::KIND,
            frame: FrameRule::None,
            about: "Eight bytes: the number, from 0.",
        }],
        timer: Timer::Required,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn capacities((): &()) -> Vec<usize> {
        vec![16]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        outputs.send_slice::<Datagram>(0, &(), &activation.index.to_le_bytes())
    }
}

/// Counts the datagrams that it reads, and says at each tick, too, how many there were.
#[derive(Default)]
pub struct Reading {
    letters: u64,
    strangers: u64,
    newest: u64,
}

impl Operator for Reading {
    type Params = ();
    const KIND: Kind = Kind {
        name: "kit.reading",
        about: "Counts datagrams.",
        role: Role::Operator,
        inputs: &[Input {
            name: "letter",
            sample: Datagram::KIND,
            policy: Policy::Queue(64),
            required: true,
            about: "What it reads.",
        }],
        outputs: &[Output {
            name: "read",
            sample: Diagnostics::KIND,
            frame: FrameRule::None,
            about: "Letters, those that are none, and the newest number.",
        }],
        timer: Timer::Optional,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self::default())
    }

    fn capacities((): &()) -> Vec<usize> {
        vec![3]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if let Some(view) = activation.fresh::<Datagram>(0) {
            match <[u8; 8]>::try_from(view.elements) {
                Ok(number) => {
                    self.letters += 1;
                    self.newest = u64::from_le_bytes(number);
                }
                Err(_) => self.strangers += 1,
            }
        }
        let metrics = [
            Metric::new("letters", self.letters as f64),
            Metric::new("strangers", self.strangers as f64),
            Metric::new("newest", self.newest as f64),
        ];
        outputs.send_slice::<Diagnostics>(0, &(), &metrics)
    }
}
