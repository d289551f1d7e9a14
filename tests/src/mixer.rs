//! Operators with several inputs.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Diagnostics, Metric, Sample};

/// Parameters of the mixers.
#[derive(Clone, Params)]
pub struct MixerParams {
    /// Time that a step takes at least, without sleeping.
    #[param(unit = "ns", default = "0 s", max = "10 s")]
    pub work: u64,
    /// Panics at this activation of each incarnation; 0: never.
    #[param(default = 0)]
    pub panic_at: u64,
}

const fn input(name: &'static str, policy: Policy, required: bool) -> Input {
    Input { name, sample: Diagnostics::KIND, policy, required, about: "Numbers." }
}

const SUM: Output =
    Output { name: "sum", sample: Diagnostics::KIND, frame: FrameRule::None, about: "What came in, folded." };

/// Takes a queue and a held newest sample, with or without a timer.
pub struct Mixer {
    params: MixerParams,
    state: f64,
    missed: u64,
}

impl Operator for Mixer {
    type Params = MixerParams;
    const KIND: Kind = Kind {
        name: "kit.mixer",
        about: "Folds a queue and the newest of another input.",
        role: Role::Operator,
        inputs: &[
            input("queue", Policy::Queue(4), false),
            input("latest", Policy::Latest, false),
            input("second", Policy::Queue(4), false),
        ],
        outputs: &[SUM],
        timer: Timer::Optional,
    };

    fn new(params: MixerParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { params, state: 0.0, missed: 0 })
    }

    fn capacities(_: &MixerParams) -> Vec<usize> {
        vec![4]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        busy(self.params.work);
        if self.params.panic_at > 0 && activation.index == self.params.panic_at {
            panic!("the mixer panics at activation {}", activation.index);
        }
        for port in 0..3 {
            self.missed += activation.missed(port);
            if activation.restarted(port) {
                self.state *= 0.25;
            }
            if let Some(view) = activation.input::<Diagnostics>(port) {
                for metric in view.elements {
                    self.state = self.state * 0.5 + metric.value * (port + 1) as f64;
                }
            }
        }
        let metrics = [
            Metric::new("state", self.state),
            Metric::new("missed", self.missed as f64),
            Metric::new("tick", activation.tick as f64),
            Metric::new("time", activation.time as f64),
        ];
        outputs.send_slice::<Diagnostics>(0, &(), &metrics)
    }
}

/// Takes two inputs in step.
pub struct Paired;

impl Operator for Paired {
    type Params = ();
    const KIND: Kind = Kind {
        name: "kit.paired",
        about: "Sends the difference of two inputs in step.",
        role: Role::Operator,
        inputs: &[input("a", Policy::Queue(4), true), input("b", Policy::Queue(4), true)],
        outputs: &[SUM],
        timer: Timer::No,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let origin = |port| activation.header(port).map_or(0, |h| h.origin) as f64;
        outputs.send_slice::<Diagnostics>(0, &(), &[Metric::new("apart", origin(0) - origin(1))])
    }
}

/// Sends on what it gets, halved, and nothing once it is small: for loops.
pub struct Echoing;

impl Operator for Echoing {
    type Params = ();
    const KIND: Kind = Kind {
        name: "kit.echoing",
        about: "Sends half of what it gets.",
        role: Role::Operator,
        inputs: &[input("from", Policy::Queue(8), true)],
        outputs: &[SUM],
        timer: Timer::No,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let value =
            activation.input::<Diagnostics>(0).and_then(|v| v.first().map(|m| m.value)).unwrap_or(0.0);
        outputs.send_slice::<Diagnostics>(0, &(), &[Metric::new("half", value * 0.5)])
    }
}

/// Sends what it gets on two outputs, several samples on each, in turns.
pub struct Splitting;

const fn half(name: &'static str) -> Output {
    Output { name, ..SUM }
}

impl Operator for Splitting {
    type Params = ();
    const KIND: Kind = Kind {
        name: "kit.splitting",
        about: "Sends what it gets on two outputs in turns.",
        role: Role::Operator,
        inputs: &[input("from", Policy::Queue(8), true)],
        outputs: &[half("odd"), half("even")],
        timer: Timer::No,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn capacities((): &()) -> Vec<usize> {
        vec![1, 1]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let value =
            activation.input::<Diagnostics>(0).and_then(|v| v.first().map(|m| m.value)).unwrap_or(0.0);
        for turn in 0..6u32 {
            let metric = Metric::new("part", value + f64::from(turn));
            outputs.send_slice::<Diagnostics>((turn % 2) as usize, &(), &[metric])?;
        }
        Ok(())
    }
}

/// Keeps the core busy for so long.
pub fn busy(nanoseconds: u64) {
    let begun = std::time::Instant::now();
    while (begun.elapsed().as_nanos() as u64) < nanoseconds {
        std::hint::spin_loop();
    }
}
