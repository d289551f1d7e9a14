//! What an activation sends: drafts in loaned buffers, sent only when the activation is committed.

use std::marker::PhantomData;

use stillpoint_samples::{AlignedBytes, HEADER_SIZE, Pieces, Sample, SampleKind};
use zerocopy::FromBytes;

use crate::operator::StepError;

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
    /// The port's memory was used up: the sample is made and counted, but cannot be sent.
    pub pool_exhausted: bool,
}

/// The outputs of one activation.
pub struct Outputs<'a> {
    kinds: &'a [(&'static SampleKind, usize)],
    laps: usize,
    lender: &'a mut dyn Lender,
    drafts: &'a mut Vec<Draft>,
    /// A lap that the kind does not name.
    pub(crate) unknown_lap: Option<usize>,
    /// Acquisition time that a source states for what it sends.
    pub(crate) origin: Option<u64>,
    /// The operator has no more of its own.
    pub(crate) finished: bool,
}

impl<'a> Outputs<'a> {
    /// Outputs of these kinds and capacities (elements), which leave their samples in `drafts`, of a kind with so many
    /// laps.
    pub fn new(
        kinds: &'a [(&'static SampleKind, usize)],
        laps: usize,
        lender: &'a mut dyn Lender,
        drafts: &'a mut Vec<Draft>,
    ) -> Self {
        Self { kinds, laps, lender, drafts, unknown_lap: None, origin: None, finished: false }
    }

    /// The most elements that a sample on this output can have.
    pub fn capacity(&self, port: usize) -> usize {
        self.kinds.get(port).map_or(0, |(_, c)| *c)
    }

    /// Sends a fixed sample.
    pub fn send<S: Sample<Body = ()>>(&mut self, port: usize, element: &S::Element) -> Result<(), StepError> {
        let mut writer = self.open::<S>(port, 1)?;
        if let Some(slot) = writer.elements().first_mut() {
            *slot = *element;
        }
        writer.finish(1)
    }

    /// Sends a slice sample by copying the elements.
    pub fn send_slice<S: Sample>(
        &mut self,
        port: usize,
        body: &S::Body,
        elements: &[S::Element],
    ) -> Result<(), StepError> {
        let mut writer = self.open::<S>(port, elements.len())?;
        *writer.body() = *body;
        writer.elements().copy_from_slice(elements);
        writer.finish(elements.len())
    }

    /// Opens a sample to be written in place, with room for `elements` elements. It is sent by
    /// [`finish`](Writer::finish); a writer that is dropped sends nothing.
    pub fn open<S: Sample>(&mut self, port: usize, elements: usize) -> Result<Writer<'_, 'a, S>, StepError> {
        let Some((kind, capacity)) = self.kinds.get(port).copied() else {
            return Err(StepError(format!("there is no output {port}")));
        };
        if *kind != *S::KIND {
            return Err(StepError(format!("output {port} sends {}, not {}", kind.name, S::NAME)));
        }
        if elements > capacity {
            return Err(StepError(format!(
                "a sample of {elements} elements exceeds the {capacity} that output {port} was laid out for"
            )));
        }
        let (mut buffer, pool_exhausted) = match self.lender.loan(port, elements) {
            Some(buffer) => (buffer, false),
            None => (Buffer::heap(kind, elements), true),
        };
        buffer.parts_mut().0.fill(0);
        Ok(Writer {
            outputs: self,
            draft: Draft { port, buffer, pool_exhausted },
            elements,
            sample: PhantomData,
        })
    }

    /// States the acquisition time of what a source sends, ns since the epoch. Without it, it is the activation's time.
    pub fn acquired_at(&mut self, origin: u64) {
        self.origin = Some(origin);
    }

    /// Says that the operator has no more of its own, as after the last file of a recording: its timer stops. A run ends
    /// in order when all that feeds it has finished.
    pub fn finish(&mut self) {
        self.finished = true;
    }

    /// Says that the stage `LAPS[lap]` of the step has just ended. A live run measures it from the lap before, or from
    /// the beginning of the step, and adds it up where a stage is entered again; elsewhere nothing happens. A lap that
    /// `LAPS` does not name fails the activation.
    pub fn lap(&mut self, lap: usize) {
        if lap < self.laps {
            self.lender.lap(lap);
        } else {
            self.unknown_lap.get_or_insert(lap);
        }
    }
}

/// A sample that is being written in place.
pub struct Writer<'o, 'a, S: Sample> {
    outputs: &'o mut Outputs<'a>,
    draft: Draft,
    elements: usize,
    sample: PhantomData<S>,
}

impl<S: Sample> Writer<'_, '_, S> {
    /// What is said once; zero at first. A trailing `length` is filled in by [`finish`](Self::finish).
    #[allow(clippy::expect_used)]
    pub fn body(&mut self) -> &mut S::Body {
        let (meta, _) = self.draft.buffer.parts_mut();
        // The lender's meta piece has the size and alignment that the kind states.
        S::Body::mut_from_bytes(&mut meta[HEADER_SIZE..]).expect("the lender's buffer fits the sample kind")
    }

    /// Room for the elements. It may hold bytes of an earlier sample: write each element that you count in.
    #[allow(clippy::expect_used)]
    pub fn elements(&mut self) -> &mut [S::Element] {
        let bytes = self.elements * size_of::<S::Element>();
        let (_, payload) = self.draft.buffer.parts_mut();
        <[S::Element]>::mut_from_bytes(&mut payload[..bytes])
            .expect("the lender's buffer fits the sample kind")
    }

    /// Sends the first `count` elements when the activation is committed.
    pub fn finish(mut self, count: usize) -> Result<(), StepError> {
        let fits = count <= self.elements && u32::try_from(count).is_ok();
        if !fits {
            return Err(StepError(format!("{count} elements were finished, but {} opened", self.elements)));
        }
        let (meta, _) = self.draft.buffer.parts_mut();
        let count = (count as u32).to_le_bytes();
        meta[HEADER_SIZE - 4..HEADER_SIZE].copy_from_slice(&count);
        if !S::KIND.body.is_empty() {
            let end = meta.len();
            meta[end - 4..].copy_from_slice(&count);
        }
        self.outputs.drafts.push(self.draft);
        Ok(())
    }
}
