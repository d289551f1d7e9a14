//! `actuate.valves`: duties to datagrams.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup, WireForm};
use stillpoint_operator::{Feeder, FeederConflict};
use stillpoint_operator::{
    FrameRule, Input, Kind, Output, ParamConflict, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_samples::{
    Actuation, ActuationElement, ActuationReason as Reason, Cause, ConsoleCommand, Contacts, Datagram,
    Diagnostics, Duties, Metric, PoseReport, RigState, Sample, Track,
};

use super::params::{FreshnessParams, check_life, extrinsic, key};
use super::watch::{ACKNOWLEDGEMENT, COMMAND, CONTACTS, MEASURED, REFERENCE, STATE, Watch};
use crate::answer::{AnswerParams, AnswerWatch, Answered};
use crate::datagram::{self, LONGEST};
use crate::drive::{Drive, Driven};
use crate::far_watch::{FarWatch, FarWatchParams};
use crate::machine::{Machine, Rules};
use crate::message::{Order, Receiving, Safe};
use crate::pressure::{PressureEstimator, PressureParams};
use crate::sender::Sender;
use crate::shaping::{Bounds, Shaped, Shaper};
use stillpoint_pose::extrinsic::{ExtrinsicParams, Need};

const DATAGRAM: usize = 0;
const ACTUATION: usize = 1;
const DIAGNOSTICS: usize = 2;

/// Parameters of `actuate.valves`.
#[derive(Clone, Debug, Params)]
pub struct ValvesParams {
    /// The key file, a path relative to the pipeline file: 64 hexadecimal digits. The session keeps it.
    #[param(file)]
    pub key: String,
    /// Bladders, each with an inlet and an outlet.
    #[param(default = 3, min = 1, max = 8)]
    pub bladders: u32,
    /// The safe state: used when a condition is missing or a fault occurs, and by the far end when datagrams stop.
    #[param(default = "vent")]
    pub safe: Safe,
    /// Time for which a datagram is valid.
    #[param(unit = "ns", default = "60 ms", min = "4 ms", max = "1 s")]
    pub life: u64,
    /// Age at which a command is stale: more than twice the period of the controller.
    #[param(unit = "ns", default = "60 ms", min = "1 ms", max = "10 s")]
    pub watchdog: u64,
    /// Conditions under which the pose is fresh.
    pub pose: FreshnessParams,
    /// Whether arming needs a captured reference.
    #[param(default = "required")]
    pub reference: Need,
    /// Conditions under which the extrinsics of the cameras are valid.
    pub extrinsic: ExtrinsicParams,
    /// Time for which the valves hold before they vent: the beam's lease ends within it, and a late frame may still
    /// arrive.
    #[param(unit = "ns", default = "40 ms", min = "1 ms", max = "80 ms")]
    pub lead: u64,
    /// Time for which every condition must hold after a vent before commands are followed.
    #[param(unit = "ns", default = "100 ms", min = "0 ms", max = "10 s")]
    pub settle: u64,
    /// Time for which a condition may be missing before this is a fault, which waits for a person. Short gaps add up if
    /// a condition is missing for more than a fifth of the time.
    #[param(unit = "ns", default = "5 s", min = "10 ms", max = "10 min")]
    pub patience: u64,
    /// Largest duty.
    #[param(default = 1, above = 0, max = 1)]
    pub max_duty: f64,
    /// Dead band of the valves: the duty up to which one stays shut. An opening that is asked for is sent as a duty beyond
    /// it, and the estimate of the pressures counts what is beyond it. Rather too small than too large: valves that open
    /// sooner than that let more air pass than was asked for and is counted.
    #[param(default = 0, min = 0, max = 0.5)]
    pub dead_band: f64,
    /// Largest growth of an opening per second: of the duty, where there is no dead band. A valve may shut at once.
    #[param(unit = "1/s", default = "10 1/s", above = "0 1/s", max = "1000 1/s")]
    pub slew: f64,
    /// Limits and estimate of the pressures.
    pub pressure: PressureParams,
    /// For how long the head may fail to answer.
    pub answer: AnswerParams,
    /// For how long the far end may be silent.
    pub far: FarWatchParams,
}

/// Sends an order to the valves at each tick and at each command of a person, with its state and the reasons for it.
///
/// Follows commands only while armed; see [`machine`](crate::machine) for the states. Duties are kept within bounds, grow
/// no faster than `slew` from what was sent last, and inlets shut on the way to the limit of the estimated pressure.
pub struct ActuateValves {
    watch: Watch,
    answer: AnswerWatch,
    /// `None` where the acknowledgements of the far end are not connected.
    far: Option<FarWatch>,
    /// Whether the estimate of a pressure limited an inlet of the last order.
    is_limited: bool,
    machine: Machine,
    drive: Drive,
    sender: Sender,
    /// When the last order was sent, ns, and the least time from it to one that a command causes.
    sent_at: Option<u64>,
    apart: u64,
    metrics: [Metric; METRICS],
}

/// Least time between an order and one that a command causes, ns: a law that floods does not flood the far end.
const APART: u64 = 2_000_000;

/// Metrics, and those of them that need no far end that answers.
const METRICS: usize = 11;
const METRICS_ALONE: usize = 8;

const fn person(name: &'static str, required: bool, about: &'static str) -> Input {
    Input { name, sample: ConsoleCommand::KIND, policy: Policy::Queue(8), required, about }
}

impl Operator for ActuateValves {
    type Params = ValvesParams;
    const WIRE: Option<WireForm> = Some(datagram::WIRE);
    const KIND: Kind = Kind {
        name: "actuate.valves",
        about: "Sends duties to the valves as datagrams, within limits and only while armed, and else the safe state.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "command",
                sample: Duties::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The duties of the controller.",
            },
            Input {
                name: "state",
                sample: Track::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The estimate that the controller uses: its age and its values are checked.",
            },
            Input {
                name: "reference",
                sample: PoseReport::KIND,
                policy: Policy::Latest,
                required: false,
                about: "The reports of the tracker: they name the reference of the poses.",
            },
            person("arm", true, "A person arms actuation."),
            person("disarm", false, "A person disarms actuation: the valves shut."),
            person("resume", false, "A person lets actuation continue after a fault or a vent."),
            person("vent", false, "A person vents the bladders."),
            Input {
                name: "measured",
                sample: RigState::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Measured pressures, which replace the estimated ones.",
            },
            Input {
                name: "acknowledgement",
                sample: Datagram::KIND,
                policy: Policy::Queue(64),
                required: false,
                about: "What the far end answers: the newest order that it accepted, and measured pressures.",
            },
            Input {
                name: "contacts",
                sample: Contacts::KIND,
                policy: Policy::Latest,
                required: false,
                about: "The contact forces of `control.contacts`.",
            },
        ],
        outputs: &[
            Output {
                name: "datagram",
                sample: Datagram::KIND,
                frame: FrameRule::None,
                about: "The order to the valves, as a signed datagram.",
            },
            Output {
                name: "state",
                sample: Actuation::KIND,
                frame: FrameRule::None,
                about: "State of actuation, the order that was sent, and the reasons.",
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

    fn validate(params: &ValvesParams) -> Result<(), ParamConflict> {
        if params.max_duty <= params.dead_band {
            return Err(ParamConflict::inside(
                &["max_duty"],
                SetupError("it is within the dead band, so that no valve would ever open".into()),
            ));
        }
        let (starts, bladders) = (params.pressure.start.len(), params.bladders as usize);
        if starts == 1 || starts == bladders {
            return Ok(());
        }
        let description = format!(
            "`start` has {starts} pressures for {bladders} bladders: give one for all or one for each"
        );
        Err(ParamConflict::inside(&["pressure"], SetupError(description)))
    }

    fn validate_input(params: &ValvesParams, input: usize, from: &Feeder<'_>) -> Result<(), FeederConflict> {
        let known = from.text(&["plant", "rig"]).and_then(stillpoint_mechanics::plant::rigs::RigSpec::named);
        let listed = || Some(from.param(&["plant", "bladders"])?.as_array()?.len());
        match known.map(|rig| rig.bladders()).or_else(listed) {
            Some(theirs) if input == COMMAND && theirs != params.bladders as usize => Err(FeederConflict {
                reason: format!(
                    "{} sends duties for {theirs} bladders, but there are {} here: every command would be refused",
                    from.operator, params.bladders
                ),
                help: format!("write `bladders: {theirs}` here, or change the plant of {}", from.operator),
            }),
            _ => Ok(()),
        }
    }

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
        let driven = Driven {
            valves,
            safe: params.safe,
            life: params.life,
            every: setup.every.unwrap_or(params.life / 2),
        };
        let bounds = Bounds { greatest: params.max_duty, slew: params.slew, dead_band: params.dead_band };
        let apart = APART.max((1e9 * bounds.seconds_to_open()) as u64);
        let drive = Drive::new(driven, Shaper::new(bounds), PressureEstimator::new(&params.pressure));
        Ok(Self {
            watch,
            answer: AnswerWatch::new(params.answer),
            far: setup.is_connected(ACKNOWLEDGEMENT).then(|| FarWatch::new(key.clone(), params.far)),
            is_limited: false,
            machine: Machine::new(rules),
            drive,
            sender: Sender::new(key, Receiving::Valves, params.safe, params.life),
            sent_at: None,
            apart,
            metrics: [
                "state",
                "reasons",
                "command_age_s",
                "pose_age_s",
                "largest_duty",
                "largest_pressure_pa",
                "faults",
                "refused",
                "acknowledged_age_s",
                "orders_lost",
                "acknowledgements_refused",
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
        if self.is_acknowledgement_alone(activation) || self.is_soon(activation) {
            return Ok(());
        }
        self.sent_at = Some(now);
        self.drive.pass(now);
        if let Some(sample) = activation.fresh::<RigState>(MEASURED)
            && let Some(rig) = sample.first()
        {
            let bladders = (rig.bladders as usize).min(rig.pressure.len());
            self.drive.measure(rig.pressure[..bladders].iter().copied());
        }
        let far = self.far.as_ref().and_then(FarWatch::last).map(|received| received.pressures());
        let is_measured_there = far.is_some_and(|pressures| !pressures.is_empty());
        if let Some(pressures) = far {
            self.drive.measure(pressures.iter().map(|p| f64::from(*p)));
        }
        let mut seen = self.watch.seen(now);
        seen.missing |= self.far.as_ref().map_or(0, |far| far.missing(now));
        if self.drive.is_exceeded() {
            seen.faults |= Reason::PRESSURE;
        }
        let contacts = activation.input::<Contacts>(CONTACTS);
        let loose = contacts.as_ref().and_then(|view| view.first()).is_some_and(|held| held.low != 0);
        let error = self.watch.has_tracking_error();
        let is_measured = is_measured_there || activation.input::<RigState>(MEASURED).is_some();
        let no_effect = self.watch.has_no_effect();
        let without_effect = no_effect && !is_measured;
        let answered = Answered { error, limited: self.is_limited, loose, without_effect };
        seen.faults |= self.answer.look(now, self.machine.state(), answered);
        for asked in Watch::asked(activation) {
            self.machine.ask(asked, &seen);
        }
        let order = self.machine.look(&seen);
        let shaped = self.drive.give(now, order, self.watch.duties());
        self.is_limited = !is_measured && shaped.reasons & Reason::PRESSURE_LIMITED != 0;
        let error = answered.error && order == Order::Follow;
        let warnings = self.far.as_ref().map_or(0, |far| far.warnings(now))
            | if loose { Reason::CONTACT_LOW } else { 0 }
            | if no_effect { Reason::NO_EFFECT } else { 0 };
        let error = if error { Reason::TRACKING_ERROR } else { 0 };
        let reasons = self.machine.reasons() | shaped.reasons | warnings | error;
        let duties = &self.drive.duties()[..self.drive.valves()];
        let bytes = self.sender.datagram(activation, order, reasons, duties)?;
        outputs.send_slice::<Datagram>(DATAGRAM, &(), bytes)?;
        let element = self.element(now, order, reasons, shaped);
        self.say(now, &element);
        outputs.send::<Actuation>(ACTUATION, &element)?;
        let metrics = if self.far.is_some() { METRICS } else { METRICS_ALONE };
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &self.metrics[..metrics])
    }
}

impl ActuateValves {
    /// Takes an acknowledgement, and says whether it alone caused this activation: then there is nothing to send.
    fn is_acknowledgement_alone(&mut self, activation: &Activation<'_>) -> bool {
        let Some(view) = activation.fresh::<Datagram>(ACKNOWLEDGEMENT) else { return false };
        if let Some(far) = &mut self.far {
            // A refusal is counted, and changes nothing.
            let (session, sent) = (self.sender.session(), self.sender.sent());
            let _ = far.take(view.elements, session, sent, activation.time);
        }
        activation.cause != Cause::Timer && Watch::asked(activation).next().is_none()
    }

    /// Whether a command alone caused this activation, right after an order: the next tick follows it.
    fn is_soon(&self, activation: &Activation<'_>) -> bool {
        let is_right_after = self.sent_at.is_some_and(|at| activation.time.saturating_sub(at) < self.apart);
        activation.cause != Cause::Timer && is_right_after && Watch::asked(activation).next().is_none()
    }

    fn element(&self, now: u64, order: Order, reasons: u32, shaped: Shaped) -> ActuationElement {
        let session = self.sender.session();
        let ((faults, fault), (refused, lacking)) = (self.machine.faults(), self.machine.refused());
        ActuationElement {
            duty: self.drive.duties().map(f64::from),
            pressure: self.drive.pressures(),
            session_started: session.started,
            session_nonce: session.nonce,
            datagram: self.sender.sequence(),
            since: now.saturating_sub(self.machine.since()),
            refused,
            faults,
            state: self.machine.state() as u32,
            order: order as u32,
            reasons,
            fault,
            lacking,
            limited: shaped.limited,
            valves: self.drive.valves() as u32,
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
            seconds(self.far.as_ref().and_then(|far| far.age(now))),
            self.far.as_ref().map_or(f64::NAN, |far| far.lost() as f64),
            self.far.as_ref().map_or(f64::NAN, |far| far.refused() as f64),
        ];
        for (metric, value) in self.metrics.iter_mut().zip(values) {
            metric.value = value;
        }
    }
}
