//! The activation: the only thing that ever enters an operator.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use stillpoint_samples::{Cause, Header, Pieces, Sample, View};

/// A sample that an activation consumes.
#[derive(Clone, Copy)]
pub struct Consumed<'a> {
    /// Its bytes.
    pub pieces: Pieces<'a>,
    /// Seen by an earlier activation and held (`latest`).
    pub held: bool,
}

/// One input of an activation.
#[derive(Clone, Copy, Default)]
pub struct ActivationInput<'a> {
    /// The sample, where there is one.
    pub sample: Option<Consumed<'a>>,
    /// Samples on this input that were sent and never taken since the last activation.
    pub missed: u64,
    /// The producer was restarted since the last activation.
    pub restarted: bool,
}

/// One activation: why, when, and with what.
pub struct Activation<'a> {
    /// Number of the activation in its incarnation, from 0.
    pub index: u64,
    /// Time of the activation, ns since the epoch. It never goes back within a session.
    pub time: u64,
    /// When it was due: the timer's tick, else `time`.
    pub nominal: u64,
    /// Number of the timer's tick, from 0; meaningful where the cause is the timer.
    pub tick: u64,
    /// Acquisition time of the oldest sensor sample behind it, ns since the epoch; `time` where there is none.
    pub origin: u64,
    /// What caused it.
    pub cause: Cause,
    /// The input that caused it, where an input did.
    pub port: usize,
    /// What each input brings, in the order of the ports.
    pub inputs: &'a [ActivationInput<'a>],
    /// Key of the random numbers.
    pub key: RandomKey,
}

/// What the random numbers of an activation are made from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RandomKey {
    /// The pipeline's seed.
    pub seed: u64,
    /// Hash of the operator's name.
    pub operator: u64,
    /// The operator's incarnation.
    pub incarnation: u32,
}

impl<'a> Activation<'a> {
    /// The sample on an input, read in place. `None` where there is none.
    pub fn input<S: Sample>(&self, port: usize) -> Option<View<'a, S>> {
        self.inputs.get(port)?.sample?.pieces.view::<S>().ok()
    }

    /// Like [`input`](Self::input), but only a sample that no earlier activation has seen.
    pub fn fresh<S: Sample>(&self, port: usize) -> Option<View<'a, S>> {
        let consumed = self.inputs.get(port)?.sample.filter(|s| !s.held)?;
        consumed.pieces.view::<S>().ok()
    }

    /// The bytes of the sample on an input that no earlier activation has seen, whatever its type.
    pub fn fresh_pieces(&self, port: usize) -> Option<Pieces<'a>> {
        Some(self.inputs.get(port)?.sample.filter(|s| !s.held)?.pieces)
    }

    /// The header of the sample on an input.
    pub fn header(&self, port: usize) -> Option<Header> {
        Some(self.inputs.get(port)?.sample?.pieces.header())
    }

    /// Samples on an input that were sent and never taken since the last activation.
    pub fn missed(&self, port: usize) -> u64 {
        self.inputs.get(port).map_or(0, |b| b.missed)
    }

    /// Whether the producer of an input was restarted since the last activation.
    pub fn restarted(&self, port: usize) -> bool {
        self.inputs.get(port).is_some_and(|b| b.restarted)
    }

    /// Random numbers of this activation: the same for the same seed, operator, incarnation and index, whatever ran
    /// before. Each call starts the stream from its beginning.
    pub fn random(&self) -> ChaCha8Rng {
        let mut key = [0u8; 32];
        key[..8].copy_from_slice(&self.key.seed.to_le_bytes());
        key[8..16].copy_from_slice(&self.key.operator.to_le_bytes());
        key[16..24].copy_from_slice(&u64::from(self.key.incarnation).to_le_bytes());
        key[24..].copy_from_slice(&self.index.to_le_bytes());
        ChaCha8Rng::from_seed(key)
    }
}
