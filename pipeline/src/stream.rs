//! The far end of a link whose samples come as a stream: whole, of any size, from a pipeline that serves them.

use std::marker::PhantomData;

use stillpoint_samples::{
    DepthImage, Diagnostics, GreyImage, HEADER_SIZE, Header, Metric, Pieces, Sample, SampleKind,
};
use zerocopy::{FromBytes, IntoBytes};

use crate::activation::Activation;
use crate::operator::Setup;
use crate::operator::{
    FrameRule, Input, Kind, Operator, Output, Policy, Role, SetupError, Stage, StepError, Timer,
};
use crate::outputs::Outputs;
use crate::outside::Arrivals;

/// Name of input and output.
pub const PORT: &str = "sample";
/// Number of both.
pub const SAMPLE: usize = 0;
/// Samples that may wait for their operator; one on top costs the oldest.
pub const MOST_WAITING: usize = 4;

const DIAGNOSTICS: usize = 1;
const METRICS: usize = 3;

/// A type of sample that a stream carries.
pub trait Carried: Sample {
    /// Name of the kind at its far end.
    const FAR_END: &'static str;
    /// What that does.
    const ABOUT_FAR_END: &'static str;
}

impl Carried for DepthImage {
    const FAR_END: &'static str = "link.depth";
    const ABOUT_FAR_END: &'static str =
        "The far end of a stream of depth images. The section `links` creates it.";
}

impl Carried for GreyImage {
    const FAR_END: &'static str = "link.grey";
    const ABOUT_FAR_END: &'static str =
        "The far end of a stream of grey images. The section `links` creates it.";
}

/// Sends on what came over a stream in a live run, with the time at which it was acquired; in any other run, what its
/// input brings.
///
/// It is a source: what came over a wire cannot be made again, so a session keeps it.
pub struct Stream<S> {
    arrivals: Option<Arrivals>,
    /// Header of the sample that came last.
    last: Option<Header>,
    lost: u64,
    malformed: u64,
    dropped: u64,
    sample: PhantomData<fn() -> S>,
}

impl<S: Carried> Operator for Stream<S> {
    type Params = ();
    const KIND: Kind = Kind {
        name: S::FAR_END,
        about: S::ABOUT_FAR_END,
        role: Role::Source,
        inputs: &[Input {
            name: PORT,
            sample: S::KIND,
            policy: Policy::Queue(MOST_WAITING as u32),
            required: true,
            about: "The samples to send over the link.",
        }],
        outputs: &[
            Output {
                name: PORT,
                sample: S::KIND,
                frame: FrameRule::SameAs(PORT),
                about: "The samples that arrived.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "Counts of samples that did not arrive, that were invalid, and that newer samples replaced, when there are new ones.",
            },
        ],
        timer: Timer::Required,
    };

    fn new((): (), setup: &Setup<'_>) -> Result<Self, SetupError> {
        let arrivals = setup.outside.arrivals.clone();
        Ok(Self { arrivals, last: None, lost: 0, malformed: 0, dropped: 0, sample: PhantomData })
    }

    /// A graph lays the sample out as its producer does.
    fn capacities((): &()) -> Vec<usize> {
        vec![1, METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(arrivals) = self.arrivals.clone() else {
            if let Some(view) = activation.fresh::<S>(SAMPLE) {
                outputs.send_slice::<S>(SAMPLE, view.body, view.elements)?;
            }
            return Ok(());
        };
        let missing = self.lost + self.malformed + self.dropped;
        // One at a time: each has its own time of acquisition.
        if let Some(bytes) = arrivals.take() {
            let sent = self.send(&bytes, activation.time, outputs);
            arrivals.give_back(bytes);
            sent?;
        }
        self.dropped += arrivals.dropped();
        if self.lost + self.malformed + self.dropped > missing {
            let metrics = [
                Metric::new("lost", self.lost as f64),
                Metric::new("malformed", self.malformed as f64),
                Metric::new("too_many_at_once", self.dropped as f64),
            ];
            outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &metrics)?;
        }
        Ok(())
    }
}

impl<S: Carried> Stream<S> {
    fn send(&mut self, bytes: &[u8], now: u64, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let pieces = Pieces::split(S::KIND, bytes).ok();
        let body = |p: &Pieces<'_>| S::Body::read_from_bytes(&p.meta[HEADER_SIZE..]).ok();
        let Some((pieces, body)) = pieces.and_then(|p| Some((p, body(&p)?))) else {
            self.malformed += 1;
            return Ok(());
        };
        let header = pieces.header();
        let count = header.count as usize;
        if count > outputs.capacity(SAMPLE) {
            self.malformed += 1;
            return Ok(());
        }
        // Numbers go on within a life of the producer; in a new one, whose stamps are later, they begin anew.
        self.lost += match self.last {
            Some(last) if last.incarnation == header.incarnation => {
                header.sequence.saturating_sub(last.sequence + 1)
            }
            _ => 0,
        };
        self.last = Some(header);
        // A clock that is ahead of this one acquires nothing in the future.
        outputs.acquired_at(header.origin.min(now));
        let mut writer = outputs.open::<S>(SAMPLE, count)?;
        *writer.body() = body;
        writer.elements().as_mut_bytes().copy_from_slice(pieces.payload);
        writer.finish(count)
    }
}

/// The far end of depth images.
pub const DEPTH: Stage = Stage::of::<Stream<DepthImage>>();
/// The far end of grey images.
pub const GREY: Stage = Stage::of::<Stream<GreyImage>>();
/// All far ends of streams.
pub const STAGES: &[Stage] = &[DEPTH, GREY];

/// The far end of a stream of these samples.
pub fn carrier(sample: &SampleKind) -> Option<Stage> {
    STAGES.iter().find(|s| *s.kind.inputs[SAMPLE].sample == *sample).copied()
}
