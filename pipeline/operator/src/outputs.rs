//! What an activation sends: samples written into buffers of the executor, which sends them when it commits the
//! activation.

use std::marker::PhantomData;

use stillpoint_samples::{HEADER_SIZE, Pieces, Sample, SampleKind};
use zerocopy::FromBytes;

use crate::error::StepError;

/// The buffers behind the outputs of an activation. An executor implements it: over shared memory, or on the heap.
///
/// At most one buffer is open at a time.
pub trait OutputBuffers {
    /// Opens a buffer for a sample of `elements` elements on an output. Header and body are zero; the elements may hold
    /// bytes of an earlier sample. A buffer that is open and was not kept goes back.
    fn open(&mut self, port: usize, elements: usize);

    /// Header and body of the open buffer, and room for at least the elements that it was opened for.
    fn parts_mut(&mut self) -> (&mut [u8], &mut [u8]);

    /// Keeps the open buffer: its sample is sent when the activation is committed.
    fn keep(&mut self);

    /// Stage number `lap` of the step has ended. Only an executor that measures uses it.
    fn lap(&mut self, _lap: usize) {}
}

/// What a step reported beside its samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepReport {
    /// A lap that the kind does not name.
    pub unknown_lap: Option<usize>,
    /// Acquisition time that a source states for what it sends, ns since the epoch.
    pub origin: Option<u64>,
    /// The operator has no more samples of its own.
    pub finished: bool,
}

/// The outputs of one activation.
pub struct Outputs<'a> {
    kinds: &'a [(&'static SampleKind, usize)],
    laps: usize,
    buffers: &'a mut dyn OutputBuffers,
    report: StepReport,
}

impl<'a> Outputs<'a> {
    /// Outputs of these kinds and capacities (elements) over `buffers`, for a kind of operator with this many laps.
    pub fn new(
        kinds: &'a [(&'static SampleKind, usize)],
        laps: usize,
        buffers: &'a mut dyn OutputBuffers,
    ) -> Self {
        Self { kinds, laps, buffers, report: StepReport::default() }
    }

    /// What the step reported beside its samples.
    pub fn report(&self) -> StepReport {
        self.report
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

    /// Type of the samples of an output.
    pub fn kind(&self, port: usize) -> Option<&'static SampleKind> {
        self.kinds.get(port).map(|(kind, _)| *kind)
    }

    /// Sends a copy of body and elements of a sample whose type is known at run time alone.
    pub fn send_pieces(&mut self, port: usize, sample: Pieces<'_>) -> Result<(), StepError> {
        let (kind, capacity) = self.port(port)?;
        let sample = sample.check(kind).map_err(|e| StepError(e.to_string()))?;
        let count = sample.header().count as usize;
        fits(port, count, capacity)?;
        self.buffers.open(port, count);
        let (meta, payload) = self.buffers.parts_mut();
        meta[HEADER_SIZE..].copy_from_slice(&sample.meta[HEADER_SIZE..]);
        meta[HEADER_SIZE - 4..HEADER_SIZE].copy_from_slice(&sample.meta[HEADER_SIZE - 4..HEADER_SIZE]);
        payload[..sample.payload.len()].copy_from_slice(sample.payload);
        self.buffers.keep();
        Ok(())
    }

    fn port(&self, port: usize) -> Result<(&'static SampleKind, usize), StepError> {
        self.kinds.get(port).copied().ok_or_else(|| StepError(format!("there is no output {port}")))
    }

    /// Opens a sample to be written in place, with room for `elements` elements. [`finish`](Writer::finish) sends it; a
    /// writer that is dropped sends no sample.
    pub fn open<S: Sample>(&mut self, port: usize, elements: usize) -> Result<Writer<'_, 'a, S>, StepError> {
        let (kind, capacity) = self.port(port)?;
        if *kind != *S::KIND {
            return Err(StepError(format!("output {port} sends {}, not {}", kind.name, S::NAME)));
        }
        fits(port, elements, capacity)?;
        self.buffers.open(port, elements);
        Ok(Writer { outputs: self, elements, sample: PhantomData })
    }

    /// States the acquisition time of what a source sends, ns since the epoch. Without it, it is the activation's time.
    pub fn acquired_at(&mut self, origin: u64) {
        self.report.origin = Some(origin);
    }

    /// Says that the operator has no more of its own, as after the last file of a recording: its timer stops. A run ends
    /// in order when all that feeds it has finished.
    pub fn finish(&mut self) {
        self.report.finished = true;
    }

    /// Reports that the stage `LAPS[lap]` of the step has just ended. A live run measures it from the lap before, or
    /// from the beginning of the step, and adds the times of a stage that is entered again; other executors ignore it.
    /// A lap that is not in `LAPS` fails the activation.
    pub fn lap(&mut self, lap: usize) {
        if lap < self.laps {
            self.buffers.lap(lap);
        } else {
            self.report.unknown_lap.get_or_insert(lap);
        }
    }
}

/// Refuses a sample that is longer than its output was laid out for.
fn fits(port: usize, elements: usize, capacity: usize) -> Result<(), StepError> {
    if elements <= capacity {
        return Ok(());
    }
    Err(StepError(format!(
        "a sample of {elements} elements exceeds the {capacity} that output {port} was laid out for"
    )))
}

/// A sample that is being written in place.
pub struct Writer<'o, 'a, S: Sample> {
    outputs: &'o mut Outputs<'a>,
    elements: usize,
    sample: PhantomData<S>,
}

impl<S: Sample> Writer<'_, '_, S> {
    /// The body; zero at first. A trailing `length` is filled in by [`finish`](Self::finish).
    #[allow(clippy::expect_used)]
    pub fn body(&mut self) -> &mut S::Body {
        let (meta, _) = self.outputs.buffers.parts_mut();
        // The meta piece of a buffer has the size and alignment that the kind states.
        S::Body::mut_from_bytes(&mut meta[HEADER_SIZE..]).expect("the buffer fits the sample kind")
    }

    /// Room for the elements. It may hold bytes of an earlier sample: write each element that you count in.
    #[allow(clippy::expect_used)]
    pub fn elements(&mut self) -> &mut [S::Element] {
        let bytes = self.elements * size_of::<S::Element>();
        let (_, payload) = self.outputs.buffers.parts_mut();
        <[S::Element]>::mut_from_bytes(&mut payload[..bytes]).expect("the buffer fits the sample kind")
    }

    /// Sends the first `count` elements when the activation is committed.
    pub fn finish(self, count: usize) -> Result<(), StepError> {
        let fits = count <= self.elements && u32::try_from(count).is_ok();
        if !fits {
            return Err(StepError(format!("{count} elements were finished, but {} opened", self.elements)));
        }
        let (meta, _) = self.outputs.buffers.parts_mut();
        let count = (count as u32).to_le_bytes();
        meta[HEADER_SIZE - 4..HEADER_SIZE].copy_from_slice(&count);
        if !S::KIND.body.is_empty() {
            let end = meta.len();
            meta[end - 4..].copy_from_slice(&count);
        }
        self.outputs.buffers.keep();
        Ok(())
    }
}
