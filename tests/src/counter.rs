//! Operators that send numbers.

use rand::Rng;
use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Diagnostics, Metric, Sample};

/// What a counter does wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Habit {
    /// Nothing.
    None,
    /// Panics at each activation whose index is a multiple of `at`, but not at 0.
    Panic,
    /// Returns an error there.
    Error,
    /// Never comes back from there.
    Hang,
    /// Reads the clock.
    Clock,
    /// Lets the order of a hashed map reach its output.
    Unordered,
    /// Reads how many threads the environment asks for.
    Threads,
    /// Adds one unit in the last place where the environment says so.
    Ulp,
    /// Says that it is there.
    Log,
    /// Ends its process there.
    Exit,
    /// Has no more after `at` activations.
    Finish,
}

/// Parameters of [`Counter`] and [`Outside`].
#[derive(Clone, Params)]
pub struct CounterParams {
    /// What it does wrong.
    #[param(default = "none")]
    pub habit: Habit,
    /// Where it does it.
    #[param(default = 10, min = 1)]
    pub at: u64,
    /// Samples per activation.
    #[param(default = 1, min = 1, max = 1000)]
    pub burst: u64,
}

/// Sends its count, and a random number, at each tick.
pub struct Counter {
    params: CounterParams,
    count: u64,
}

const VALUE: Output = Output {
    name: "value",
    sample: Diagnostics::KIND,
    frame: FrameRule::None,
    about: "Count and a random number.",
};

impl Operator for Counter {
    type Params = CounterParams;
    const KIND: Kind = Kind {
        name: "kit.counter",
        about: "Sends its count at each tick.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[VALUE],
        timer: Timer::Required,
    };

    fn new(params: CounterParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { params, count: 0 })
    }

    fn capacities(_: &CounterParams) -> Vec<usize> {
        vec![2]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if self.params.habit == Habit::Finish && activation.index >= self.params.at {
            outputs.finish();
            return Ok(());
        }
        let wrong = self.misbehave(activation)?;
        for _ in 0..self.params.burst {
            let random = random(activation) + wrong;
            let metrics = [Metric::new("count", self.count as f64), Metric::new("random", random)];
            outputs.send_slice::<Diagnostics>(0, &(), &metrics)?;
            self.count += 1;
        }
        Ok(())
    }
}

impl Counter {
    /// Something to add to the output, where the habit shows there.
    fn misbehave(&self, activation: &Activation<'_>) -> Result<f64, StepError> {
        let now = activation.index > 0 && activation.index.is_multiple_of(self.params.at);
        match self.params.habit {
            Habit::Panic if now => panic!("the kit panics at activation {}", activation.index),
            Habit::Error if now => {
                Err(StepError(format!("the kit fails at activation {}", activation.index)))
            }
            Habit::Hang if now => {
                eprintln!("the kit hangs at activation {}", activation.index);
                loop {
                    std::thread::sleep(std::time::Duration::from_secs(1));
                }
            }
            Habit::Exit if now => std::process::exit(3),
            Habit::Log => {
                if now {
                    tracing::warn!(index = activation.index, "the kit warns");
                }
                Ok(0.0)
            }
            Habit::Clock => {
                let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
                Ok(since.map_or(0.0, |d| f64::from(d.subsec_nanos()) * 1e-9))
            }
            Habit::Unordered => {
                let map: std::collections::HashMap<u32, u32> = (0..64).map(|i| (i, i)).collect();
                Ok(map.keys().take(8).fold(0.0, |sum, k| sum * 64.0 + f64::from(*k)))
            }
            Habit::Threads => {
                let threads: usize =
                    std::env::var("KIT_THREADS").ok().and_then(|t| t.parse().ok()).unwrap_or(2);
                Ok(summed(threads))
            }
            Habit::Ulp => Ok(if std::env::var_os("KIT_ULP").is_some() && now { f64::EPSILON } else { 0.0 }),
            _ => Ok(0.0),
        }
    }
}

/// A sum whose last digits depend on the number of threads that share it.
fn summed(threads: usize) -> f64 {
    let terms: Vec<f64> = (1..4000).map(|i| 1.0 / f64::from(i)).collect();
    let chunk = terms.len().div_ceil(threads.max(1));
    std::thread::scope(|scope| {
        let parts: Vec<_> = terms.chunks(chunk).map(|c| scope.spawn(move || c.iter().sum::<f64>())).collect();
        parts.into_iter().map(|p| p.join().unwrap_or(f64::NAN)).sum()
    })
}

/// A number in [0, 1) of the activation's own random stream.
fn random(activation: &Activation<'_>) -> f64 {
    (activation.random().next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Like [`Counter`], but a source: what it sends cannot be made again.
pub struct Outside(Counter);

impl Operator for Outside {
    type Params = CounterParams;
    const KIND: Kind = Kind {
        name: "kit.outside",
        about: "Sends its count at each tick, as a source.",
        role: Role::Source,
        ..Counter::KIND
    };

    fn new(params: CounterParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self(Counter::new(params, setup)?))
    }

    fn capacities(params: &CounterParams) -> Vec<usize> {
        Counter::capacities(params)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        outputs.acquired_at(activation.time.saturating_sub(1_000_000));
        self.0.step(activation, outputs)
    }
}
