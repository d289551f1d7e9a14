//! A store: the samples that wait for an operator whose activations are decided elsewhere.

use std::collections::BTreeMap;
use std::sync::Arc;

use stillpoint_samples::{AlignedBytes, Header, Pieces, SampleKind};

use crate::drafts::Buffer;

/// A sample on the heap, shared by its consumers: header, body and exactly `count` elements.
#[derive(Clone, Debug)]
pub struct OwnedSample {
    /// Its type.
    pub kind: &'static SampleKind,
    /// Its bytes.
    pub bytes: Arc<AlignedBytes>,
}

impl OwnedSample {
    /// A copy of a sample's bytes; what lies beyond its count is left behind.
    pub fn copy_of(kind: &'static SampleKind, pieces: Pieces<'_>) -> Self {
        let cut = pieces.check(kind).unwrap_or(pieces);
        Self { kind, bytes: Arc::new(AlignedBytes::joined(cut.meta, cut.payload)) }
    }

    /// The sample in a buffer, which is copied only where it is not on the heap.
    pub fn of(kind: &'static SampleKind, buffer: Buffer) -> Self {
        match buffer {
            Buffer::Heap { mut bytes, meta } => {
                let (meta, payload) = bytes.split_at(meta.min(bytes.len()));
                let cut = Pieces { meta, payload }.check(kind).map(|cut| cut.meta.len() + cut.payload.len());
                bytes.resize(cut.unwrap_or(bytes.len()));
                Self { kind, bytes: Arc::new(bytes) }
            }
            Buffer::Shared(_) => Self::copy_of(kind, buffer.pieces()),
        }
    }

    /// Its bytes in two pieces.
    pub fn pieces(&self) -> Pieces<'_> {
        let (meta, payload) = self.bytes.split_at(self.kind.meta_size().min(self.bytes.len()));
        Pieces { meta, payload }
    }

    /// Its header.
    pub fn header(&self) -> Header {
        self.pieces().header()
    }
}

/// The samples that wait for one operator, by input, producer's incarnation and sequence.
#[derive(Default)]
pub struct SampleStore {
    waiting: BTreeMap<(usize, u32, u64), OwnedSample>,
}

impl SampleStore {
    /// Adds a sample.
    pub fn put(&mut self, port: usize, owned: OwnedSample) {
        let header = owned.header();
        self.waiting.insert((port, header.incarnation, header.sequence), owned);
    }

    /// The sample of this name.
    pub fn get(&self, port: usize, incarnation: u32, sequence: u64) -> Option<&OwnedSample> {
        self.waiting.get(&(port, incarnation, sequence))
    }

    /// Forgets what came before this sample on the input: consumption never goes back.
    pub fn forget_before(&mut self, port: usize, incarnation: u32, sequence: u64) {
        while let Some((key, _)) = self.waiting.range((port, 0, 0)..(port, incarnation, sequence)).next() {
            let key = *key;
            self.waiting.remove(&key);
        }
    }
}
