//! `actuate.far_end`: datagrams to duties, where the valves are.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup, WireForm};
use stillpoint_operator::{Feeder, FeederConflict};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{
    Cause, Datagram, Diagnostics, Duties, DutiesElement, FarEnd as FarEndSample, FarEndDoing, FarEndElement,
    Metric, RigState, Sample,
};

use super::params::key;
use crate::acknowledgement::{self, PRESSURES};
use crate::far_end::{Doing, FarEnd};
use crate::key::Key;
use crate::message::{Receiving, Safe, Session};
use crate::receiver::{Act, Clock, Receives};
use crate::refusal::DatagramRefusal;

const VALVES: usize = 0;
const BEAM: usize = 1;
const MEASURED: usize = 2;
const DUTIES: usize = 0;
const STATE: usize = 1;
const DIAGNOSTICS: usize = 2;
const ACKNOWLEDGEMENT: usize = 3;
const METRICS: usize = DatagramRefusal::ALL.len();

/// Parameters of `actuate.far_end`.
#[derive(Clone, Debug, Params)]
pub struct FarEndParams {
    /// The key file of the sender, a path relative to the pipeline file. The session keeps it.
    #[param(file)]
    pub key: String,
    /// Bladders, each with an inlet and an outlet.
    #[param(default = 3, min = 1, max = 8)]
    pub bladders: u32,
    /// What the valves do before the first datagram.
    #[param(default = "vent")]
    pub idle: Safe,
    /// Largest difference between the clocks of both ends.
    #[param(unit = "ns", default = "5 ms", min = "0 ms", max = "1 s")]
    pub clocks_within: u64,
    /// Time in which duties grow from zero after silence.
    #[param(unit = "ns", default = "100 ms", min = "0 ms", max = "10 s")]
    pub ramp: u64,
    /// How often it acknowledges orders. Without it there are no acknowledgements.
    #[param(unit = "ns", min = "1 ms", max = "1 s")]
    pub acknowledge_every: Option<u64>,
}

/// Takes datagrams for valves and beam, refuses invalid ones, and sends the duties of the valves at each tick: those of
/// the valid datagram, or those of the safe state if no datagram is valid.
pub struct ActuateFarEnd {
    far_end: FarEnd,
    key: Key,
    valves: usize,
    arrived: u64,
    doing: FarEndDoing,
    since: Option<u64>,
    refused: u64,
    acknowledge_every: Option<u64>,
    /// When it last acknowledged, ns.
    acknowledged: Option<u64>,
    /// Its session and the number of the next acknowledgement in it.
    session: Option<Session>,
    number: u64,
    /// Measured pressures, Pa, and how many.
    measured: ([f32; PRESSURES], usize),
    bytes: [u8; acknowledgement::LONGEST],
    metrics: [Metric; METRICS],
}

impl Operator for ActuateFarEnd {
    type Params = FarEndParams;
    const WIRE: Option<WireForm> = Some(acknowledgement::WIRE);
    const KIND: Kind = Kind {
        name: "actuate.far_end",
        about: "Obeys the datagrams for valves and beam while they are valid, and else takes the safe state.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "valves",
                sample: Datagram::KIND,
                policy: Policy::Queue(64),
                required: true,
                about: "Datagrams of `actuate.valves`, and any other datagram that arrives.",
            },
            Input {
                name: "beam",
                sample: Datagram::KIND,
                policy: Policy::Queue(64),
                required: false,
                about: "Datagrams of `gate.beam`. Without them the beam is never on.",
            },
            Input {
                name: "measured",
                sample: RigState::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Measured pressures, which the acknowledgements bring to the sender.",
            },
        ],
        outputs: &[
            Output {
                name: "duties",
                sample: Duties::KIND,
                frame: FrameRule::None,
                about: "The duties of the valves, at each tick.",
            },
            Output {
                name: "state",
                sample: FarEndSample::KIND,
                frame: FrameRule::None,
                about: "The present order or safe state, since when it holds, and the counts of datagrams, at each tick.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "Refused datagrams by reason, when there are new ones.",
            },
            Output {
                name: "acknowledgement",
                sample: Datagram::KIND,
                frame: FrameRule::None,
                about: "The newest accepted order and what the valves do, as a signed datagram for `actuate.valves`.",
            },
        ],
        timer: Timer::Required,
    };

    fn validate_input(params: &FarEndParams, _: usize, from: &Feeder<'_>) -> Result<(), FeederConflict> {
        from.check_bladders(u64::from(params.bladders))
    }

    fn new(params: FarEndParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let valves = 2 * params.bladders as usize;
        let receives = Receives {
            idle: params.idle,
            clock: Clock::Shared { within: params.clocks_within },
            ramp: params.ramp,
            ..Receives::valves(valves)
        };
        let key = key(&params.key, setup)?;
        Ok(Self {
            far_end: FarEnd::new(&key, receives),
            key,
            valves,
            arrived: 0,
            doing: FarEndDoing::Venting,
            since: None,
            refused: 0,
            acknowledge_every: params.acknowledge_every,
            acknowledged: None,
            session: None,
            number: 0,
            measured: ([0.0; PRESSURES], 0),
            bytes: [0; acknowledgement::LONGEST],
            metrics: DatagramRefusal::ALL.map(|refusal| Metric::new(refusal.name(), 0.0)),
        })
    }

    fn capacities(_: &FarEndParams) -> Vec<usize> {
        vec![1, 1, METRICS, acknowledgement::LONGEST]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        for port in [VALVES, BEAM] {
            if let Some(view) = activation.fresh::<Datagram>(port) {
                // A refusal is counted, and changes nothing.
                if let Ok(Receiving::Valves) = self.far_end.receive(view.elements, activation.time) {
                    self.arrived = activation.time;
                }
            }
        }
        if let Some(sample) = activation.fresh::<RigState>(MEASURED)
            && let Some(rig) = sample.first()
        {
            let bladders = (rig.bladders as usize).min(PRESSURES);
            self.measured = (rig.pressure.map(|p| p as f32), bladders);
        }
        if activation.cause != Cause::Timer {
            return Ok(());
        }
        let doing = self.far_end.step(activation.time);
        let (duties, now) = duties(doing.valves, self.valves);
        if self.since.is_none() || now != self.doing {
            (self.doing, self.since) = (now, Some(activation.time));
        }
        outputs.send::<Duties>(DUTIES, &duties)?;
        outputs.send::<FarEndSample>(STATE, &self.state(activation.time, doing.beam))?;
        self.acknowledge(activation, &doing, outputs)?;
        self.send_refusals(outputs)
    }
}

impl ActuateFarEnd {
    fn state(&self, now: u64, beam: bool) -> FarEndElement {
        let (valves, beam_counts) = (self.far_end.valves(), self.far_end.beam());
        let ends = self.far_end.valves_receiver().ends().unwrap_or(0);
        FarEndElement {
            arrived: self.arrived,
            ends,
            since: self.since.unwrap_or(now),
            accepted: valves.accepted,
            refused: valves.all_refused(),
            refused_beam: beam_counts.all_refused(),
            missing: valves.missing,
            doing: self.doing as u32,
            beam: u32::from(beam),
        }
    }

    /// Acknowledges the newest order, as often as it has to.
    fn acknowledge(
        &mut self,
        activation: &Activation<'_>,
        doing: &Doing,
        outputs: &mut Outputs<'_>,
    ) -> Result<(), StepError> {
        let Some(every) = self.acknowledge_every else { return Ok(()) };
        let now = activation.time;
        if self.acknowledged.is_some_and(|at| now.saturating_sub(at) < every) {
            return Ok(());
        }
        self.acknowledged = Some(now);
        let session = *self.session.get_or_insert_with(|| Session::begun(&self.key, now, &activation.key));
        let mut answer = self.far_end.acknowledgement(doing, session, self.number, now);
        (answer.pressure, answer.bladders) = self.measured;
        self.number += 1;
        let length = answer.encode(&self.key, &mut self.bytes);
        outputs.send_slice::<Datagram>(ACKNOWLEDGEMENT, &(), self.bytes.get(..length).unwrap_or(&self.bytes))
    }

    fn send_refusals(&mut self, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let (valves, beam) = (self.far_end.valves(), self.far_end.beam());
        let all = valves.all_refused() + beam.all_refused();
        if all == self.refused {
            return Ok(());
        }
        self.refused = all;
        for (metric, refusal) in self.metrics.iter_mut().zip(DatagramRefusal::ALL) {
            metric.value = (valves.refused(refusal) + beam.refused(refusal)) as f64;
        }
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &self.metrics)
    }
}

/// What an act is in duties of this many valves: inlets and outlets in turn.
fn duties(act: Act, valves: usize) -> (DutiesElement, FarEndDoing) {
    let mut duties = DutiesElement { valves: valves as u32, ..DutiesElement::default() };
    match act {
        Act::Hold => {}
        Act::Vent => duties = DutiesElement::vented(valves as u32),
        Act::Follow(opening) => {
            for (duty, opening) in duties.duty.iter_mut().zip(opening).take(valves) {
                *duty = f64::from(opening);
            }
        }
    }
    (duties, act.doing())
}
