//! The far end of an edge between hosts: whole samples, of any type and size.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use stillpoint_samples::{Diagnostics, Header, Metric, Pieces, Sample, SampleKind};

use crate::operator::activation::Activation;
use crate::operator::outputs::Outputs;
use crate::operator::outside::{Arrivals, ClockOffset};
use crate::operator::params::CheckedParams;
use crate::operator::{
    AdoptError, ErasedOperator, FrameRule, Input, Kind, Output, Params, Policy, Role, Setup, SetupError,
    Stage, StepError, Timer,
};

/// Name of the kind, whatever its type of sample.
const KIND_NAME: &str = "host.sample";
/// Name of input and output.
pub const PORT: &str = "sample";
/// Number of both.
pub const SAMPLE: usize = 0;
/// Samples that may wait for their operator; one on top costs the oldest.
pub const MOST_WAITING: usize = 4;

const DIAGNOSTICS: usize = 1;
const METRICS: usize = 5;

/// Sends on what came from another host in a live run, with the time at which it was acquired; in any other run, what its
/// input brings. Type and frame of the samples are those of its ports.
///
/// It is a source: replay cannot make a sample of another program again, so a session keeps it.
pub struct FarEnd {
    arrivals: Option<Arrivals>,
    /// Header of the sample that came last.
    last: Option<Header>,
    lost: u64,
    malformed: u64,
    dropped: u64,
    /// The clock of the other host, as it was last told.
    clock: Option<ClockOffset>,
}

impl FarEnd {
    fn new(setup: &Setup<'_>) -> Self {
        let arrivals = setup.outside.arrivals.clone();
        Self { arrivals, last: None, lost: 0, malformed: 0, dropped: 0, clock: None }
    }

    /// Takes the clock of the other host. Gives whether it is another one than that told before.
    fn take_clock(&mut self, clock: Option<ClockOffset>) -> bool {
        let Some(clock) = clock else { return false };
        let is_known = self.clock.is_some_and(|reported| {
            reported.offset.abs_diff(clock.offset)
                <= reported.uncertainty.max(clock.uncertainty).unsigned_abs()
        });
        if !is_known {
            self.clock = Some(clock);
        }
        !is_known
    }

    fn send(
        &mut self,
        bytes: &[u8],
        clock: Option<ClockOffset>,
        now: u64,
        outputs: &mut Outputs<'_>,
    ) -> Result<(), StepError> {
        let kind = outputs.kind(SAMPLE).ok_or_else(|| StepError("it has no output".to_string()))?;
        let whole = Pieces::split(kind, bytes).ok();
        let Some(pieces) = whole.filter(|p| p.header().count as usize <= outputs.capacity(SAMPLE)) else {
            self.malformed += 1;
            return Ok(());
        };
        let header = pieces.header();
        // Numbers go on within an incarnation of the producer; in a new one they begin anew.
        self.lost += match self.last {
            Some(last) if last.incarnation == header.incarnation => {
                header.sequence.saturating_sub(last.sequence.saturating_add(1))
            }
            _ => 0,
        };
        self.last = Some(header);
        let origin = clock.map_or(header.origin, |clock| clock.here(header.origin));
        // A clock that is ahead of this one acquires nothing in the future.
        outputs.acquired_at(origin.min(now));
        outputs.send_pieces(SAMPLE, pieces)
    }
}

impl ErasedOperator for FarEnd {
    fn adopt(&mut self, _: &CheckedParams) -> Result<(), AdoptError> {
        Err(AdoptError(format!("{KIND_NAME} has no parameters")))
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(arrivals) = self.arrivals.clone() else {
            return match activation.fresh_pieces(SAMPLE) {
                Some(pieces) => outputs.send_pieces(SAMPLE, pieces),
                None => Ok(()),
            };
        };
        let missing = self.lost + self.malformed + self.dropped;
        let clock = arrivals.clock();
        // One at a time: each has its own time of acquisition.
        if let Some(bytes) = arrivals.take() {
            let sent = self.send(&bytes, clock, activation.time, outputs);
            arrivals.give_back(bytes);
            sent?;
        }
        self.dropped += arrivals.dropped();
        if self.take_clock(clock) | (self.lost + self.malformed + self.dropped > missing) {
            let mut metrics = vec![
                Metric::new("lost", self.lost as f64),
                Metric::new("malformed", self.malformed as f64),
                Metric::new("too_many_at_once", self.dropped as f64),
            ];
            if let Some(clock) = self.clock {
                metrics.push(Metric::new("clock_offset_s", clock.offset as f64 * 1e-9));
                metrics.push(Metric::new("clock_uncertainty_s", clock.uncertainty as f64 * 1e-9));
            }
            outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &metrics)?;
        }
        Ok(())
    }
}

/// Ports of the far end of one type of sample.
const fn inputs(sample: &'static SampleKind) -> [Input; 1] {
    [Input {
        name: PORT,
        sample,
        policy: Policy::Queue(MOST_WAITING as u32),
        required: true,
        about: "The samples that another host sends.",
    }]
}

const fn outputs(sample: &'static SampleKind) -> [Output; 2] {
    [
        Output { name: PORT, sample, frame: FrameRule::SameAs(PORT), about: "The samples that arrived." },
        Output {
            name: "diagnostics",
            sample: Diagnostics::KIND,
            frame: FrameRule::None,
            about: "Counts of samples that did not arrive, that were invalid, and that newer samples replaced, and the offset of the clock of another host, when one of them is new.",
        },
    ]
}

const fn stage(inputs: &'static [Input], outputs: &'static [Output]) -> Stage {
    Stage {
        kind: Kind {
            name: KIND_NAME,
            about: "The far end of an edge between hosts. The section `hosts` creates it.",
            role: Role::Source,
            inputs,
            outputs,
            timer: Timer::Required,
        },
        laps: &[],
        wire: None,
        fields: <() as Params>::FIELDS,
        described: None,
        read: |_, reader| {
            <() as Params>::read(reader)?;
            Some(CheckedParams {
                value: Arc::new(()),
                resolved: reader.resolved(),
                given: reader.given().into(),
            })
        },
        validate: |_| Ok(()),
        validate_period: |_, _| Ok(()),
        validate_input: |_, _, _| Ok(()),
        check_files: |_, _| Ok(()),
        cut_files: |_, _| Ok(std::collections::BTreeMap::new()),
        remarks: |_, _| Vec::new(),
        // A graph lays the sample out as its producer does.
        capacities: |_| vec![1, METRICS],
        subscriptions: |_| Vec::new(),
        listens: |_| None,
        finishes: |_| false,
        build: |_, setup| Ok::<_, SetupError>(Box::new(FarEnd::new(setup))),
    }
}

/// The far ends by type of sample: each is made once, when a pipeline first has an edge between hosts of its type.
static STAGES: Mutex<BTreeMap<String, Stage>> = Mutex::new(BTreeMap::new());

/// The far end of samples of this type.
pub fn of(sample: &'static SampleKind) -> Stage {
    let mut stages = STAGES.lock().unwrap_or_else(PoisonError::into_inner);
    // Ports live as long as the program, as those of all other kinds do; there are as many as types of samples.
    let made = || stage(Box::leak(Box::new(inputs(sample))), Box::leak(Box::new(outputs(sample))));
    *stages.entry(sample.type_name()).or_insert_with(made)
}
