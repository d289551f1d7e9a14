//! `actuate.valves`: duties to datagrams.

use stillpoint_pipeline::operator::{
    FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_pipeline::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_samples::{
    Actuation, ActuationElement, ActuationReason as Reason, ConsoleCommand, Datagram, Diagnostics, Duties,
    Metric, PoseReport, RigState, Sample, Track,
};

use super::params::{FreshnessParams, check_life, extrinsic, key};
use super::watch::{MEASURED, REFERENCE, STATE, Watch};
use crate::datagram::LONGEST;
use crate::extrinsic::{ExtrinsicParams, Need};
use crate::machine::{Machine, Rules};
use crate::message::{Order, Receiving, Safe, VALVES};
use crate::pressure::{PressureEstimator, PressureParams};
use crate::sender::Sender;
use crate::shaping::{Bounds, Shaped, Shaper};

const DATAGRAM: usize = 0;
const ACTUATION: usize = 1;
const DIAGNOSTICS: usize = 2;

/// Parameters of `actuate.valves`.
#[derive(Clone, Debug, Params)]
pub struct ValvesParams {
    /// The key file, a path from the pipeline's file: 64 hexadecimal digits. The session keeps it.
    #[param(file)]
    pub key: String,
    /// Bladders, each with an inlet and an outlet.
    #[param(default = 3, min = 1, max = 8)]
    pub bladders: u32,
    /// What is done where something is missing or went wrong, and what the far end does when datagrams stop.
    #[param(default = "vent")]
    pub safe: Safe,
    /// How long a datagram lives.
    #[param(unit = "ns", default = "60 ms", min = "4 ms", max = "1 s")]
    pub life: u64,
    /// Age at which a command is stale.
    #[param(unit = "ns", default = "60 ms", min = "1 ms", max = "10 s")]
    pub watchdog: u64,
    /// When the pose is fresh.
    pub pose: FreshnessParams,
    /// Whether a captured reference is needed to be armed.
    #[param(default = "required")]
    pub reference: Need,
    /// When the place of the cameras can be trusted.
    pub extrinsic: ExtrinsicParams,
    /// How long valves are shut before they vent: the beam's lease ends within it.
    #[param(unit = "ns", default = "20 ms", min = "1 ms", max = "100 ms")]
    pub lead: u64,
    /// How long all must be there again before commands are followed.
    #[param(unit = "ns", default = "100 ms", min = "0 ms", max = "10 s")]
    pub settle: u64,
    /// How long something may be missing before it is a fault, which waits for a person.
    #[param(unit = "ns", default = "5 s", min = "10 ms", max = "10 min")]
    pub patience: u64,
    /// Greatest duty.
    #[param(default = 1, above = 0, max = 1)]
    pub max_duty: f64,
    /// How fast a duty may grow. A valve may shut at once.
    #[param(unit = "1/s", default = "10 1/s", above = "0 1/s", max = "1000 1/s")]
    pub slew: f64,
    /// Pressures that are allowed.
    pub pressure: PressureParams,
}

/// Sends an order to the valves at each tick and at each command of a person, with its state and the reasons for it.
///
/// Follows commands only while armed; see [`machine`](crate::machine) for the states. Duties are kept within bounds, grow
/// no faster than `slew` from what was sent last, and inlets shut on the way to the limit of the estimated pressure.
pub struct ActuateValves {
    watch: Watch,
    machine: Machine,
    shaper: Shaper,
    pressure: PressureEstimator,
    sender: Sender,
    safe: Safe,
    life: u64,
    every: u64,
    valves: usize,
    /// When the last order was sent, ns, and which.
    last: Option<(u64, Order)>,
    metrics: [Metric; METRICS],
}

const METRICS: usize = 8;

const fn person(name: &'static str, required: bool, about: &'static str) -> Input {
    Input { name, sample: ConsoleCommand::KIND, policy: Policy::Queue(8), required, about }
}

impl Operator for ActuateValves {
    type Params = ValvesParams;
    const KIND: Kind = Kind {
        name: "actuate.valves",
        about: "Duties to valves as datagrams, within limits and only while armed; else the safe state.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "command",
                sample: Duties::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The duties that a controller asks for.",
            },
            Input {
                name: "state",
                sample: Track::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The pose that the controller acts on: how old it is, and whether it has numbers.",
            },
            Input {
                name: "reference",
                sample: PoseReport::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Which reference the pose is against.",
            },
            person("arm", true, "A person allows actuation."),
            person("disarm", false, "A person forbids it: the valves shut."),
            person("resume", false, "A person has it go on after a fault or a vent."),
            person("vent", false, "A person lets the air out."),
            Input {
                name: "measured",
                sample: RigState::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Measured pressures, which replace the estimated ones.",
            },
        ],
        outputs: &[
            Output {
                name: "datagram",
                sample: Datagram::KIND,
                frame: FrameRule::None,
                about: "The order to the valves, as the far end receives it.",
            },
            Output {
                name: "state",
                sample: Actuation::KIND,
                frame: FrameRule::None,
                about: "What actuation is at, what was sent, and why.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "Ages of command and pose, largest duty and pressure, counts.",
            },
        ],
        timer: Timer::Required,
    };

    fn new(params: ValvesParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        check_life("life", params.life, setup)?;
        if params.reference == Need::Required && !setup.is_connected(REFERENCE) {
            return Err(SetupError(
                "it is to be armed with a reference only: connect `reference: head.report`, or say `reference: waived`"
                    .into(),
            ));
        }
        let valves = 2 * params.bladders as usize;
        let watch = Watch::new(
            params.pose.watch(),
            extrinsic(&params.extrinsic, STATE, setup)?,
            params.pose.stale(),
            params.watchdog,
            valves,
            params.reference,
        );
        let rules =
            Rules { safe: params.safe, lead: params.lead, settle: params.settle, patience: params.patience };
        let key = key(&params.key, setup)?;
        Ok(Self {
            watch,
            machine: Machine::new(rules),
            shaper: Shaper::new(Bounds { greatest: params.max_duty, slew: params.slew }),
            pressure: PressureEstimator::new(&params.pressure),
            sender: Sender::new(key, Receiving::Valves, params.safe, params.life),
            safe: params.safe,
            life: params.life,
            every: setup.every.unwrap_or(params.life / 2),
            valves,
            last: None,
            metrics: [
                "state",
                "reasons",
                "command_age_s",
                "pose_age_s",
                "largest_duty",
                "largest_pressure_pa",
                "faults",
                "refused",
            ]
            .map(|name| Metric::new(name, f64::NAN)),
        })
    }

    fn capacities(_: &ValvesParams) -> Vec<usize> {
        vec![LONGEST, 1, METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let now = activation.time;
        self.watch.take(activation);
        let gone = self.last.map_or(self.every, |(at, _)| now.saturating_sub(at));
        self.let_pass(gone);
        self.measure(activation);
        let mut seen = self.watch.seen(now);
        if self.pressure.is_exceeded(self.valves / 2) {
            seen.faults |= Reason::PRESSURE;
        }
        if let Some(asked) = Watch::asked(activation) {
            self.machine.ask(asked, &seen);
        }
        let order = self.machine.look(&seen);
        let (shaped, duties) = self.shape(order, gone);
        let reasons = self.machine.reasons() | shaped.reasons;
        self.last = Some((now, order));
        let bytes = self.sender.datagram(activation, order, reasons, &duties[..self.valves])?;
        outputs.send_slice::<Datagram>(DATAGRAM, &(), bytes)?;
        let element = self.element(now, order, reasons, shaped, &duties);
        self.say(now, &element);
        outputs.send::<Actuation>(ACTUATION, &element)?;
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &self.metrics)
    }
}

impl ActuateValves {
    /// Lets the valves do for `gone` ns what they were told last, and what they do by themselves once that has no life.
    fn let_pass(&mut self, gone: u64) {
        let Some((_, order)) = self.last else { return };
        let told = gone.min(self.life);
        self.obey(order, told);
        let safe = match self.safe {
            Safe::Hold => Order::Hold,
            Safe::Vent => Order::Vent,
        };
        self.obey(safe, gone - told);
    }

    /// Takes measured pressures for the estimated ones.
    fn measure(&mut self, activation: &Activation<'_>) {
        if let Some(sample) = activation.fresh::<RigState>(MEASURED)
            && let Some(rig) = sample.first()
        {
            for (bladder, pressure) in rig.pressure.iter().enumerate().take(rig.bladders as usize) {
                self.pressure.correct(bladder, *pressure);
            }
        }
    }

    fn obey(&mut self, order: Order, ns: u64) {
        let seconds = ns as f64 * 1e-9;
        match order {
            Order::Follow => {
                let sent = self.shaper.sent().map(f64::from);
                self.pressure.advance(seconds, &sent[..self.valves]);
            }
            Order::Vent => self.pressure.vent(seconds, self.valves / 2),
            Order::Hold => {}
        }
    }

    /// The duties to send, `gone` ns after the last.
    fn shape(&mut self, order: Order, gone: u64) -> (Shaped, [f32; VALVES]) {
        let mut shaped = Shaped::default();
        let is_gap = gone > self.life;
        if order != Order::Follow || is_gap {
            // Meanwhile the valves were, or are now, in another state than that of the last duties.
            self.shaper.rest();
        }
        if order == Order::Follow {
            let seconds = if is_gap { self.every } else { gone } as f64 * 1e-9;
            let pressure = &self.pressure;
            shaped = self.shaper.shape(self.watch.duties(), seconds, |bladder| pressure.ceiling(bladder));
        }
        shaped.reasons |= if is_gap { Reason::GAP } else { 0 };
        (shaped, *self.shaper.sent())
    }

    fn element(
        &self,
        now: u64,
        order: Order,
        reasons: u32,
        shaped: Shaped,
        duties: &[f32; VALVES],
    ) -> ActuationElement {
        let session = self.sender.session();
        let ((faults, fault), (refused, lacking)) = (self.machine.faults(), self.machine.refused());
        let counts = |bladder: usize| 2 * bladder < self.valves;
        ActuationElement {
            duty: duties.map(f64::from),
            pressure: std::array::from_fn(|i| if counts(i) { self.pressure.pressure(i) } else { 0.0 }),
            session_started: session.started,
            session_nonce: session.nonce,
            sequence: self.sender.sequence(),
            since: now.saturating_sub(self.machine.since()),
            refused,
            faults,
            state: self.machine.state() as u32,
            order: order as u32,
            reasons,
            fault,
            lacking,
            limited: shaped.limited,
            valves: self.valves as u32,
            reference: self.machine.reference(),
        }
    }

    fn say(&mut self, now: u64, element: &ActuationElement) {
        let seconds = |age: Option<u64>| age.map_or(f64::NAN, |age| age as f64 * 1e-9);
        let largest = |all: &[f64]| all.iter().copied().fold(0.0, f64::max);
        let values = [
            f64::from(element.state),
            f64::from(element.reasons),
            seconds(self.watch.command_age(now)),
            seconds(self.watch.pose.age(now)),
            largest(&element.duty),
            largest(&element.pressure),
            element.faults as f64,
            element.refused as f64,
        ];
        for (metric, value) in self.metrics.iter_mut().zip(values) {
            metric.value = value;
        }
    }
}
