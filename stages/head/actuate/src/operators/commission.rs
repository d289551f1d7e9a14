//! `actuate.commission`: the guided sequence, as datagrams for the far end.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup, WireForm};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Cause, ConsoleCommand, Datagram, Diagnostics, Metric, Sample};

use super::params::{check_life, key};
use crate::datagram::{self, LONGEST};
use crate::far_watch::{FarWatch, FarWatchParams};
use crate::message::{Order, Receiving, Safe};
use crate::sender::Sender;
use crate::sequence::{Act, Phase, Port, Sequence, SequenceParams};

const ARM: usize = 0;
const DISARM: usize = 1;
const ACKNOWLEDGEMENT: usize = 2;
const DATAGRAM: usize = 0;
const READINGS_PORT: usize = 1;

/// Names of the metrics of `readings`.
pub const READINGS: [&str; 5] = ["phase", "bladder", "inlet", "outlet", "pressure_pa"];

/// Parameters of `actuate.commission`.
#[derive(Clone, Debug, Params)]
pub struct CommissionParams {
    /// The key file, a path relative to the pipeline file: 64 hexadecimal digits. The session keeps it.
    #[param(file)]
    pub key: String,
    /// Bladders, each with an inlet and an outlet.
    #[param(default = 3, min = 1, max = 8)]
    pub bladders: u32,
    /// Time for which a datagram is valid.
    #[param(unit = "ns", default = "60 ms", min = "4 ms", max = "1 s")]
    pub life: u64,
    /// How far the pressure of each bladder is raised from that of its start.
    #[param(unit = "Pa", default = "1.5 kPa", min = "500 Pa", max = "50 kPa")]
    pub rise: f64,
    /// Pressure above that of the room at which the sequence stops and the bladders are vented.
    #[param(unit = "Pa", default = "40 kPa", above = "0 Pa", max = "200 kPa")]
    pub limit: f64,
    /// Time for which each bladder is held with its valves shut: a leak shows in it.
    #[param(unit = "ns", default = "10 s", min = "2 s", max = "10 min")]
    pub hold: u64,
    /// Time for which pressures settle after each pulse.
    #[param(unit = "ns", default = "1 s", min = "300 ms", max = "1 min")]
    pub settle: u64,
    /// For how long the far end may be silent.
    pub far: FarWatchParams,
}

impl CommissionParams {
    /// Bounds of the sequence.
    #[must_use]
    pub fn sequence(&self) -> SequenceParams {
        SequenceParams {
            bladders: self.bladders as usize,
            rise: self.rise,
            limit: self.limit,
            hold: self.hold as f64 * 1e-9,
            settle: self.settle as f64 * 1e-9,
        }
    }
}

/// Sends the orders of the guided sequence to the far end, by the pressures that the far end measures.
///
/// The sequence begins when a person arms it and the far end answers with a pressure for each bladder. If the far end is
/// silent, or a pressure is above the limit, the sequence stops and the bladders are vented; a person begins a new run then.
pub struct ActuateCommission {
    sequence: Sequence,
    bladders: usize,
    is_armed: bool,
    /// When the sequence began, ns.
    begin: Option<u64>,
    is_stopped: bool,
    far: FarWatch,
    sender: Sender,
    metrics: [Metric; READINGS.len()],
}

impl Operator for ActuateCommission {
    type Params = CommissionParams;
    const WIRE: Option<WireForm> = Some(datagram::WIRE);
    const KIND: Kind = Kind {
        name: "actuate.commission",
        about: "Opens and shuts the valves of each bladder by a guided sequence, from which `stillpoint qa commission` finds dead bands, volumes, supply and leaks.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "arm",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(8),
                required: true,
                about: "A person begins the sequence.",
            },
            Input {
                name: "disarm",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(8),
                required: false,
                about: "A person stops the sequence: the bladders are vented.",
            },
            Input {
                name: "acknowledgement",
                sample: Datagram::KIND,
                policy: Policy::Queue(64),
                required: true,
                about: "What the far end answers, with measured pressures.",
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
                name: "readings",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "The phase of the sequence, its bladder, the duties of its inlet and outlet, and its pressure.",
            },
        ],
        timer: Timer::Required,
    };

    fn new(params: CommissionParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        check_life("life", params.life, setup)?;
        let key = key(&params.key, setup)?;
        Ok(Self {
            sequence: Sequence::new(params.sequence()),
            bladders: params.bladders as usize,
            is_armed: false,
            begin: None,
            is_stopped: false,
            far: FarWatch::new(key.clone(), params.far),
            sender: Sender::new(key, Receiving::Valves, Safe::Vent, params.life),
            metrics: READINGS.map(|name| Metric::new(name, f64::NAN)),
        })
    }

    fn capacities(_: &CommissionParams) -> Vec<usize> {
        vec![LONGEST, READINGS.len()]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if let Some(view) = activation.fresh::<Datagram>(ACKNOWLEDGEMENT) {
            // A refusal is counted, and changes nothing.
            let (session, sent) = (self.sender.session(), self.sender.sent());
            let _ = self.far.take(view.elements, session, sent, activation.time);
        }
        self.is_armed |= activation.fresh::<ConsoleCommand>(ARM).is_some();
        self.is_stopped |= activation.fresh::<ConsoleCommand>(DISARM).is_some();
        if activation.cause != Cause::Timer {
            return Ok(());
        }
        let act = self.look(activation.time);
        let mut duties = [0.0; 2 * crate::pressure::BLADDERS];
        if let Some((port, duty)) = act.open {
            duties[2 * act.bladder + usize::from(port == Port::Outlet)] = duty as f32;
        }
        let order = match act.phase {
            Phase::Waiting | Phase::Done => Order::Hold,
            Phase::Stopped => Order::Vent,
            _ => Order::Follow,
        };
        let bytes = self.sender.datagram(activation, order, 0, &duties[..2 * self.bladders])?;
        outputs.send_slice::<Datagram>(DATAGRAM, &(), bytes)?;
        self.say(&act);
        outputs.send_slice::<Diagnostics>(READINGS_PORT, &(), &self.metrics)
    }
}

impl ActuateCommission {
    fn look(&mut self, now: u64) -> Act {
        let pressures = self.far.last().map_or(&[][..], |received| received.pressures());
        let is_measured = pressures.len() >= self.bladders;
        let is_silent = self.far.missing(now) != 0;
        let idle = |phase| Act { phase, bladder: 0, open: None };
        if self.begin.is_none() && self.is_armed && is_measured && !is_silent {
            self.begin = Some(now);
        }
        let Some(begin) = self.begin else {
            return idle(if self.is_stopped { Phase::Stopped } else { Phase::Waiting });
        };
        self.is_stopped |= is_silent || !is_measured;
        if self.is_stopped {
            return idle(Phase::Stopped);
        }
        let mut gauge = [0.0; crate::pressure::BLADDERS];
        for (to, pressure) in gauge.iter_mut().zip(pressures) {
            *to = f64::from(*pressure);
        }
        let act = self.sequence.look((now - begin) as f64 * 1e-9, &gauge[..self.bladders]);
        self.is_stopped |= act.phase == Phase::Stopped;
        act
    }

    fn say(&mut self, act: &Act) {
        let pressure = self.far.last().and_then(|received| received.pressures().get(act.bladder));
        let duty = |port: Port| act.open.filter(|(open, _)| *open == port).map_or(0.0, |(_, duty)| duty);
        let values = [
            f64::from(act.phase as u32),
            act.bladder as f64,
            duty(Port::Inlet),
            duty(Port::Outlet),
            pressure.map_or(f64::NAN, |p| f64::from(*p)),
        ];
        for (metric, value) in self.metrics.iter_mut().zip(values) {
            metric.value = value;
        }
    }
}
