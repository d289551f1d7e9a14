//! The outputs of a step, in memory.

use stillpoint_samples::{HEADER_SIZE, SampleKind};

use super::wire::Bytes;
use crate::outputs::OutputBuffers;

/// A sample that a step sends.
#[derive(Debug)]
pub struct Sent {
    /// Number of the output.
    pub port: usize,
    /// Header and body.
    pub meta: Bytes,
    /// The elements.
    pub payload: Bytes,
}

/// Buffers for outputs of these kinds.
pub struct Buffers<'k> {
    kinds: &'k [(&'static SampleKind, usize)],
    open: Option<Sent>,
    /// What was sent, in order.
    pub stored: Vec<Sent>,
}

impl<'k> Buffers<'k> {
    /// Empty ones.
    pub fn new(kinds: &'k [(&'static SampleKind, usize)]) -> Self {
        Self { kinds, open: None, stored: Vec::new() }
    }
}

impl OutputBuffers for Buffers<'_> {
    fn open(&mut self, port: usize, elements: usize) {
        let Some((kind, _)) = self.kinds.get(port) else { return };
        let payload = Bytes::zeros(elements * kind.element_size);
        self.open = Some(Sent { port, meta: Bytes::zeros(kind.meta_size()), payload });
    }

    fn parts_mut(&mut self) -> (&mut [u8], &mut [u8]) {
        match &mut self.open {
            Some(sent) => (sent.meta.get_mut(), sent.payload.get_mut()),
            None => (&mut [], &mut []),
        }
    }

    fn keep(&mut self) {
        let Some(mut sent) = self.open.take() else { return };
        let count = &sent.meta.get()[HEADER_SIZE - 4..HEADER_SIZE];
        let count = count.iter().rev().fold(0, |number, byte| number << 8 | usize::from(*byte));
        sent.payload.shorten(count * self.kinds[sent.port].0.element_size);
        self.stored.push(sent);
    }
}
