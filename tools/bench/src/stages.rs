//! Operators that send, relay and time payloads. Only `stillpoint-bench` knows these kinds: no pipeline of a user can
//! name them.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup, Stage};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_pipeline::clock::SessionClock;
use stillpoint_samples::{Layout, Sample, SampleKind, Shape};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

/// Kinds of this file.
pub const STAGES: &[Stage] = &[Stage::of::<Source>(), Stage::of::<Relay>(), Stage::of::<Sink>()];

/// A sample of any size. Its first word is the time just before the payload was written, its second word the time just
/// after, ns.
pub struct Load;

/// One word of a [`Load`].
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Layout)]
#[repr(C)]
pub struct Word {
    /// Value of the word.
    pub word: u64,
}

impl Sample for Load {
    type Body = ();
    type Element = Word;
    const NAME: &'static str = "BenchLoad";
    const SHAPE: Shape = Shape::Slice;
    const ABOUT: &'static str = "Words that represent a payload, behind two times.";
    const KIND: &'static SampleKind = &SampleKind::of::<Self>();
}

/// The payload that every sender writes: smooth values with noise in the last bits, like those of a sensor.
pub fn payload(words: usize) -> Vec<Word> {
    let mut random = 1u64;
    let mut half = |i: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let noise = (random >> 40) as f32 * 1e-10;
        u64::from((0.5 + (i % 640) as f32 * 0.001 + noise).to_bits())
    };
    (0..words).map(|i| Word { word: half(i) << 32 | half(i) }).collect()
}

/// Writes a payload between two readings of the clock, and writes the readings into its first two words. The rest of a
/// longer buffer is unchanged.
pub fn write_load(to: &mut [Word], payload: &[Word], clock: &SessionClock) {
    let before = clock.now();
    let written = payload.len().min(to.len());
    to[..written].copy_from_slice(&payload[..written]);
    if let [first, second, ..] = to {
        first.word = before;
        second.word = clock.now();
    }
}

/// A session clock whose zero is that of the machine's monotonic clock, so that it is the same in every process.
pub fn machine_clock() -> SessionClock {
    SessionClock::zero()
}

const LOAD: Output =
    Output { name: "load", sample: Load::KIND, frame: FrameRule::None, about: "The payload." };
const TAKEN: Input = Input {
    name: "load",
    sample: Load::KIND,
    policy: Policy::Queue(4),
    required: true,
    about: "The payload.",
};

/// Parameters of [`Source`].
#[derive(Clone, Params)]
pub struct SourceParams {
    /// Words of 8 bytes in a sample.
    #[param(default = 8, min = 2, max = 1000000)]
    words: usize,
    /// Samples per activation.
    #[param(default = 1, min = 1, max = 1000)]
    burst: u32,
    /// Words that are written into each sample; the other words of the buffer are unchanged.
    #[param(default = 1000000, min = 2, max = 1000000)]
    written: usize,
}

/// Sends payloads. It reads the clock, so it is a source.
pub struct Source {
    words: usize,
    payload: Vec<Word>,
    burst: u32,
    clock: SessionClock,
}

impl Operator for Source {
    type Params = SourceParams;
    const KIND: Kind = Kind {
        name: "bench.source",
        about: "Sends payloads with the times of their writing.",
        role: Role::Source,
        inputs: &[],
        outputs: &[LOAD],
        timer: Timer::Required,
    };

    fn new(params: SourceParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self {
            words: params.words,
            payload: payload(params.words.min(params.written)),
            burst: params.burst,
            clock: machine_clock(),
        })
    }

    fn capacities(params: &SourceParams) -> Vec<usize> {
        vec![params.words]
    }

    fn step(&mut self, _: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        for _ in 0..self.burst {
            let mut writer = outputs.open::<Load>(0, self.words)?;
            write_load(writer.elements(), &self.payload, &self.clock);
            writer.finish(self.words)?;
        }
        Ok(())
    }
}

/// Parameters of [`Relay`].
#[derive(Clone, Params)]
pub struct RelayParams {
    /// Maximum number of words in a sample.
    #[param(default = 8, min = 2, max = 1000000)]
    words: usize,
}

/// Copies each sample, its times included, into a sample of its output.
pub struct Relay;

impl Operator for Relay {
    type Params = RelayParams;
    const KIND: Kind = Kind {
        name: "bench.relay",
        about: "Copies payloads.",
        role: Role::Operator,
        inputs: &[TAKEN],
        outputs: &[LOAD],
        timer: Timer::No,
    };

    fn new(_: RelayParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn capacities(params: &RelayParams) -> Vec<usize> {
        vec![params.words]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        match activation.input::<Load>(0) {
            Some(view) => outputs.send_slice::<Load>(0, &(), view.elements),
            None => Ok(()),
        }
    }
}

/// Parameters of [`Sink`].
#[derive(Clone, Params)]
pub struct SinkParams {
    /// Number of samples whose ages are sent together.
    #[param(default = 64, min = 1, max = 4096)]
    batch: usize,
}

/// Reads the clock at the beginning of its step, and sends two ages of each sample: since just before and since just
/// after its payload was written, ns.
pub struct Sink {
    ages: Vec<Word>,
    batch: usize,
    clock: SessionClock,
}

impl Operator for Sink {
    type Params = SinkParams;
    const KIND: Kind = Kind {
        name: "bench.sink",
        about: "Says how old payloads are when they come.",
        role: Role::Source,
        inputs: &[TAKEN],
        outputs: &[Output {
            name: "ages",
            sample: Load::KIND,
            frame: FrameRule::None,
            about: "For each sample two ages in ns: since before and since after its payload was written.",
        }],
        timer: Timer::No,
    };

    fn new(params: SinkParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { ages: Vec::with_capacity(2 * params.batch), batch: params.batch, clock: machine_clock() })
    }

    fn capacities(params: &SinkParams) -> Vec<usize> {
        vec![2 * params.batch]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let now = self.clock.now();
        if let Some([before, after, ..]) = activation.input::<Load>(0).map(|view| view.elements) {
            self.ages.push(Word { word: now.saturating_sub(before.word) });
            self.ages.push(Word { word: now.saturating_sub(after.word) });
        }
        if self.ages.len() >= 2 * self.batch {
            outputs.send_slice::<Load>(0, &(), &self.ages)?;
            self.ages.clear();
        }
        Ok(())
    }
}
