//! Drafts: the samples of an activation in the buffers of a placement, before the activation is committed.

use stillpoint_operator::outputs::OutputBuffers;
use stillpoint_samples::{AlignedBytes, Pieces, SampleKind};

/// A buffer for one sample.
pub enum Buffer {
    /// In shared memory: written where the consumers will read it.
    Shared(stillpoint_shm::Loan),
    /// On the heap: meta bytes and elements one behind the other.
    Heap {
        /// Header, body and elements.
        bytes: AlignedBytes,
        /// Bytes of header and body.
        meta: usize,
    },
}

impl Buffer {
    /// A heap buffer for `elements` elements.
    pub fn heap(kind: &SampleKind, elements: usize) -> Self {
        let meta = kind.meta_size();
        Self::Heap { bytes: AlignedBytes::zeroed(meta + elements * kind.element_size), meta }
    }

    /// Header and body, and room for the elements.
    pub fn parts_mut(&mut self) -> (&mut [u8], &mut [u8]) {
        match self {
            Self::Shared(loan) => loan.parts_mut(),
            Self::Heap { bytes, meta } => bytes.split_at_mut(*meta),
        }
    }

    /// The bytes as they stand; the payload may reach beyond the header's count.
    pub fn pieces(&self) -> Pieces<'_> {
        match self {
            Self::Shared(loan) => loan.pieces(),
            Self::Heap { bytes, meta } => {
                let (meta, payload) = bytes.split_at(*meta);
                Pieces { meta, payload }
            }
        }
    }
}

/// Where buffers come from: the placement.
pub trait Lender {
    /// A buffer for `elements` elements on an output, or `None` where its memory is used up.
    fn loan(&mut self, port: usize, elements: usize) -> Option<Buffer>;

    /// Stage number `lap` of the step has ended. Only a placement that measures takes notice.
    fn lap(&mut self, _lap: usize) {}
}

/// A sample that is sent when the activation is committed.
pub struct Draft {
    /// Number of the output.
    pub port: usize,
    /// Its bytes.
    pub buffer: Buffer,
}

/// The drafts of one activation, as its operator writes them.
pub struct DraftBuffers<'a> {
    kinds: &'a [(&'static SampleKind, usize)],
    lender: &'a mut dyn Lender,
    drafts: &'a mut Vec<Draft>,
    open: Option<Draft>,
}

impl<'a> DraftBuffers<'a> {
    /// Buffers of these kinds and capacities (elements), of which those that are kept go to `drafts`.
    pub fn new(
        kinds: &'a [(&'static SampleKind, usize)],
        lender: &'a mut dyn Lender,
        drafts: &'a mut Vec<Draft>,
    ) -> Self {
        Self { kinds, lender, drafts, open: None }
    }
}

impl OutputBuffers for DraftBuffers<'_> {
    fn open(&mut self, port: usize, elements: usize) {
        // What was open and not kept goes back before the next loan.
        self.open = None;
        let Some((kind, _)) = self.kinds.get(port) else { return };
        // Where the memory of the port is used up, the sample waits on the heap: those that are sent before it may make room.
        let mut buffer = self.lender.loan(port, elements).unwrap_or_else(|| Buffer::heap(kind, elements));
        buffer.parts_mut().0.fill(0);
        self.open = Some(Draft { port, buffer });
    }

    fn parts_mut(&mut self) -> (&mut [u8], &mut [u8]) {
        self.open.as_mut().map_or((&mut [], &mut []), |draft| draft.buffer.parts_mut())
    }

    fn keep(&mut self) {
        self.drafts.extend(self.open.take());
    }

    fn lap(&mut self, lap: usize) {
        self.lender.lap(lap);
    }
}
