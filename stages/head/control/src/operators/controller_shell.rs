//! The part that all controllers share: checks estimate and target, is idle if it cannot act, and sends duties.

use stillpoint_operator::{Activation, Outputs, Setup};
use stillpoint_operator::{FrameRule, Input, Output, Policy, SetupError, StepError};
use stillpoint_samples::{
    Actuation, ActuationState, Codes, Diagnostics, Duties, DutiesElement, DutyReason, Metric, Names, Sample,
    Standing, Target, TargetStatus, Track, TrackElement,
};

use crate::balance::Balance;
use crate::channels::{Channel, difference};
use crate::harmonic::{CHANNELS, TONES};
use crate::operators::freshness::Freshness;
use crate::operators::params::{CheckedPlant, MOST_BLADDERS, Motion, PlantParams};
use crate::reference::{ReferenceModel, pole_of_rise};
use crate::squeeze::Squeeze;
use crate::tracking::Tracking;
use crate::valves::split;

/// The input of the estimate.
pub const STATE: usize = 0;
const TARGET: usize = 1;
const ACTUATION: usize = 2;
const DUTIES: usize = 0;
const DIAGNOSTICS: usize = 1;

/// Inputs of every controller.
pub const INPUTS: &[Input] = &[
    Input {
        name: "state",
        sample: Track::KIND,
        policy: Policy::Queue(4),
        required: true,
        about: "The estimated pose of the head. The law acts on its timer and when a new estimate arrives.",
    },
    Input {
        name: "target",
        sample: Target::KIND,
        policy: Policy::Latest,
        required: true,
        about: "The target of the head, in the frame of the state.",
    },
    Input {
        name: "actuation",
        sample: Actuation::KIND,
        policy: Policy::Latest,
        required: false,
        about: "Pressures of the bladders and whether the valves follow, `valves.state`: required if there are more bladders than channels. Else it shows orders without effect.",
    },
];

/// Outputs of every controller.
pub const OUTPUTS: &[Output] = &[
    Output {
        name: "duties",
        sample: Duties::KIND,
        frame: FrameRule::None,
        about: "Duties of the valves. If the controller cannot act, all valves are shut and the reason is given.",
    },
    Output {
        name: "diagnostics",
        sample: Diagnostics::KIND,
        frame: FrameRule::None,
        about: "Age of the estimate, errors, and the state of the law.",
    },
];

/// A longer pause than this many periods counts as this many: a law is not told to make up for it.
const LONGEST: u64 = 4;

/// What an activation brings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// The controller cannot act, for these reasons.
    Idle(u32),
    /// Pose and target are there.
    Ready {
        /// Seconds since the law last acted; the timer's period where it did not.
        dt: f64,
        /// The law starts here: its integrals must be cleared.
        begins: bool,
        /// Reasons that do not stop the controller.
        reasons: u32,
    },
}

/// Between samples and a law.
pub struct ControllerShell {
    plant: CheckedPlant,
    squeeze: Squeeze,
    /// The newest estimate, with its origin.
    track: Option<(TrackElement, u64)>,
    tracking: Tracking,
    /// What the bladders let in and out, where each moves a coordinate of its own.
    balance: Option<Balance>,
    /// Where the model was when the law last acted, in scales, and the time since then, s.
    model: [f64; CHANNELS],
    dt: f64,
    /// What the valves do, as far as it is known.
    actuation: Option<ActuationState>,
    resting: bool,
    /// Of the samples that duties are made from; the pressures, which are made from duties, do not count.
    origin: Option<u64>,
    every: u64,
    stale: u64,
    freshness: Freshness,
    /// Where control began, m and rad: what laws count from.
    start: Option<[f64; 6]>,
    acted_at: Option<u64>,
    pose: [f64; 6],
    target: [f64; 6],
    age: f64,
    metrics: Vec<Metric>,
    /// What the log has: the reasons for which the law was idle, 0 where it acted.
    logged: Option<u32>,
    /// Place of the first number about what was learned of patient and valves.
    learned: usize,
}

/// Speed of the model, scales per second, up to which the head is to rest.
const RESTING: f64 = 2e-3;

/// Numbers of the diagnostics that every controller sends first.
const OWN: usize = 2;

impl ControllerShell {
    /// A controller's shell, with these names of numbers behind those that every controller sends.
    ///
    /// # Errors
    /// There is no timer, its period is not below `stale`, or nobody says the pressures that have to be held.
    pub fn new(
        plant: CheckedPlant,
        rise: f64,
        stale: u64,
        setup: &Setup<'_>,
        names: impl IntoIterator<Item = String>,
    ) -> Result<Self, SetupError> {
        let every =
            setup.every.ok_or_else(|| SetupError("a controller needs a timer: add `every: 10 ms`".into()))?;
        if every >= stale {
            return Err(SetupError(format!(
                "`stale` is {} ms and the timer ticks every {} ms: an estimate would be old before it is used",
                stale as f64 * 1e-6,
                every as f64 * 1e-6
            )));
        }
        let squeeze = Squeeze::new(&plant.effect);
        if squeeze.is_free() && !setup.is_connected(ACTUATION) {
            let (bladders, channels) = (plant.effect.bladders(), plant.effect.channels());
            return Err(SetupError(format!(
                "{bladders} bladders hold {channels} channels, and with them how hard they squeeze the head, which no pose \
                 tells: connect `actuation: {{ from: valves.state, delay: 10 ms }}`"
            )));
        }
        let mut metrics = vec![Metric::new("age_s", f64::NAN), Metric::new("idle", 1.0)];
        metrics.extend(names.into_iter().map(|name| Metric::new(&name, f64::NAN)));
        let learned = metrics.len();
        let is_weighed = plant.effect.bladders() == plant.effect.channels() && setup.is_connected(ACTUATION);
        let balance = is_weighed.then(Balance::default);
        metrics.extend(learned_names(&plant, is_weighed).iter().map(|name| Metric::new(name, f64::NAN)));
        let model = ReferenceModel::new(pole_of_rise(rise), plant.channels.count());
        let tracking = Tracking::new(model, plant.delay);
        let learns = plant.motion == Motion::Learned;
        Ok(Self {
            tracking: if learns { tracking.with_periodic(plant.effect.decoupling()) } else { tracking },
            balance,
            model: [0.0; CHANNELS],
            dt: 0.0,
            actuation: None,
            learned,
            logged: None,
            resting: true,
            track: None,
            plant,
            squeeze,
            origin: None,
            every,
            stale,
            freshness: Freshness::default(),
            start: None,
            acted_at: None,
            pose: [0.0; 6],
            target: [0.0; 6],
            age: f64::NAN,
            metrics,
        })
    }

    /// Most diagnostics of a controller of this plant, with this many of the law's own.
    pub fn metrics(plant: &PlantParams, own: usize) -> usize {
        let learned = if plant.motion == Motion::Learned { TONES + 1 + CHANNELS + MOST_BLADDERS } else { 0 };
        OWN + own + MOST_BLADDERS + learned
    }

    /// Goes on with another rise of the reference model, s.
    pub fn set_rise(&mut self, rise: f64) {
        self.tracking.set_pole(pole_of_rise(rise));
    }

    pub fn plant(&self) -> &CheckedPlant {
        &self.plant
    }

    /// Looks at the samples of an activation.
    pub fn look(&mut self, activation: &Activation<'_>) -> Look {
        self.keep(activation);
        self.feel(activation);
        match self.read(activation) {
            Err(reason) => {
                self.acted_at = None;
                self.resting = true;
                Look::Idle(reason.bit())
            }
            Ok((pose_age, reasons)) => {
                let gone = self.acted_at.map_or(self.every, |at| activation.nominal.saturating_sub(at));
                self.acted_at = Some(activation.nominal);
                let dt = gone.min(LONGEST * self.every) as f64 * 1e-9;
                let n = self.plant.channels.count();
                let begins = std::mem::take(&mut self.resting);
                if begins {
                    self.tracking.restart(&self.pose[..n]);
                    self.balance.iter_mut().for_each(Balance::restart);
                    self.model = self.pose;
                }
                self.tracking.look(&self.pose[..n], pose_age, &self.target[..n], dt);
                self.dt = dt;
                Look::Ready { dt, begins, reasons }
            }
        }
    }

    /// Keeps a new estimate.
    pub fn keep(&mut self, activation: &Activation<'_>) {
        if let Some(state) = activation.input::<Track>(STATE)
            && let Some(track) = state.first()
        {
            self.freshness.see(track, state.header.origin);
            self.track = Some((*track, state.header.origin));
        }
    }

    /// Takes the pressures, of valves that follow.
    fn feel(&mut self, activation: &Activation<'_>) {
        self.squeeze.rest();
        let state = self.track.map(|(_, origin)| origin);
        let target = activation.input::<Target>(TARGET).map(|t| t.header.origin);
        self.origin = Some(state.into_iter().chain(target).min().unwrap_or(activation.time));
        let Some(actuation) = activation.input::<Actuation>(ACTUATION) else { return };
        self.actuation = actuation.first().map(|a| a.state());
        if let Some(element) = actuation.first().filter(|a| a.state() == ActuationState::Armed) {
            self.squeeze.see(&element.pressure);
        }
    }

    /// Reads pose and target; returns the age of the pose, s, and what is out of order nonetheless.
    fn read(&mut self, activation: &Activation<'_>) -> Result<(f64, u32), DutyReason> {
        self.age = f64::NAN;
        let (track, origin) = self.track.as_ref().ok_or(DutyReason::NoEstimate)?;
        let age = self.freshness.age(activation.time);
        self.age = age.map_or(f64::NAN, |age| age as f64 * 1e-9);
        if track.standing() == Standing::None {
            return Err(DutyReason::NoEstimate);
        }
        if age.is_none_or(|age| age > self.stale) {
            return Err(DutyReason::Stale);
        }
        let pose = self.plant.channels.of_track(track).ok_or(DutyReason::MissingChannel)?;
        let target = activation.input::<Target>(TARGET);
        let target = target.as_ref().and_then(|t| t.first()).ok_or(DutyReason::NoTarget)?;
        if target.status() == TargetStatus::None {
            return Err(DutyReason::NoTarget);
        }
        let requested = self.plant.channels.of_target(target).ok_or(DutyReason::MissingChannel)?;
        if pose.iter().chain(&requested).any(|v| !v.is_finite()) {
            return Err(DutyReason::NotFinite);
        }
        let start = *self.start.get_or_insert(pose);
        for (i, (channel, scale)) in self.plant.channels.iter().zip(&self.plant.scale).enumerate() {
            self.pose[i] = difference(channel, pose[i], start[i]) / scale;
            self.target[i] = difference(channel, requested[i], start[i]) / scale;
        }
        let refused = target.status() == TargetStatus::Refused;
        let pose_age = activation.time.saturating_sub(*origin) as f64 * 1e-9;
        Ok((pose_age, if refused { DutyReason::TargetRefused.bit() } else { 0 }))
    }

    /// The reference model, and how far the head is from it.
    pub fn tracking(&self) -> &Tracking {
        &self.tracking
    }

    /// Limits net duties to the effect that the valves can have.
    pub fn bound(&self, net: &mut [f64]) {
        self.plant.effect.bound(net);
    }

    /// Takes notice of what a law orders, as [`Tracking::acted`] does.
    pub fn acted(&mut self, [moved, compensation]: [&[f64]; 2]) {
        self.tracking.acted(moved, compensation);
    }

    /// The pose less the reference model, m or rad, and where the model is, in the frame of the state.
    pub fn error_and_model(&self, channel: usize) -> [f64; 2] {
        let error = self.tracking.errors().seen[channel] * self.plant.scale[channel];
        [error, self.absolute(channel, self.tracking.model()[channel])]
    }

    /// The pose, counted from where control began, in scales.
    pub fn pose(&self) -> &[f64] {
        &self.pose[..self.plant.channels.count()]
    }

    /// The target, counted from where control began, in scales.
    pub fn target(&self) -> &[f64] {
        &self.target[..self.plant.channels.count()]
    }

    /// Where control began, m and rad, once it is known.
    pub fn start(&self) -> Option<&[f64; 6]> {
        self.start.as_ref()
    }

    /// Where a place of a channel is that is counted from where control began, in scales: m or rad, in the frame of the
    /// state.
    pub fn absolute(&self, channel: usize, counted: f64) -> f64 {
        self.start.map_or(f64::NAN, |start| start[channel] + counted * self.plant.scale[channel])
    }

    /// Says the law's number `place`.
    pub fn say(&mut self, place: usize, value: f64) {
        if let Some(metric) = self.metrics.get_mut(OWN + place) {
            metric.value = value;
        }
    }

    /// Sends that all valves are to be shut.
    pub fn idle(&mut self, outputs: &mut Outputs<'_>, reasons: u32) -> Result<(), StepError> {
        let valves = 2 * self.plant.effect.bladders() as u32;
        self.metrics[OWN..].iter_mut().for_each(|metric| metric.value = f64::NAN);
        self.send(outputs, &DutiesElement::shut(valves, reasons))
    }

    /// Sends net duties of the bladders, each within -1 to 1, with what holds the squeeze. Returns false, and has all
    /// valves shut, where one of them is not a number: the law is lost then.
    pub fn act(&mut self, outputs: &mut Outputs<'_>, net: &[f64], reasons: u32) -> Result<bool, StepError> {
        if net.iter().any(|v| !v.is_finite()) {
            self.acted_at = None;
            self.resting = true;
            self.idle(outputs, reasons | DutyReason::NotFinite.bit())?;
            return Ok(false);
        }
        let mut duties = DutiesElement { valves: 2 * net.len() as u32, reasons, ..DutiesElement::default() };
        let held = &mut duties.net[..net.len()];
        held.copy_from_slice(net);
        self.plant.effect.open(held);
        self.squeeze.correct(held);
        duties.saturated = split(held, &mut duties.duty);
        if duties.saturated != 0 {
            duties.reasons |= DutyReason::Saturated.bit();
        }
        let seen = self.tracking.errors().seen;
        if seen.iter().zip(&self.plant.error_limit).any(|(error, limit)| error.abs() > *limit) {
            duties.reasons |= DutyReason::TrackingError.bit();
        }
        if self.weigh(net) {
            duties.reasons |= DutyReason::NoEffect.bit();
        }
        self.say_learned();
        self.send(outputs, &duties)?;
        Ok(true)
    }

    /// Sums what the bladders are to let in and out, and says whether one of them does not follow. Orders that the valves do
    /// not follow do not count, and arming begins anew.
    fn weigh(&mut self, net: &[f64]) -> bool {
        let Some(balance) = &mut self.balance else { return false };
        let follows = self.actuation == Some(ActuationState::Armed);
        if !follows && self.actuation != Some(ActuationState::Holding) {
            balance.restart();
        }
        let model = self.tracking.model();
        let rests =
            model.iter().zip(&self.model).all(|(now, before)| (now - before).abs() <= RESTING * self.dt);
        self.model[..model.len()].copy_from_slice(model);
        balance.take(net, self.dt, rests && follows);
        balance.is_missed()
    }

    /// Says what was learned, in the order of [`learned_names`].
    fn say_learned(&mut self) {
        let mut place = self.metrics[self.learned..].iter_mut();
        let mut say = |value: f64| {
            if let Some(metric) = place.next() {
                metric.value = value;
            }
        };
        if let Some(balance) = &self.balance {
            (0..self.plant.effect.bladders()).for_each(|j| say(balance.part(j).unwrap_or(f64::NAN)));
        }
        if let Some(periodic) = self.tracking.periodic() {
            (0..TONES).for_each(|tone| say(periodic.frequency(tone).unwrap_or(f64::NAN)));
            say(periodic.explained());
            (0..self.plant.channels.count()).for_each(|i| say(periodic.answered(i)));
            let mut flows = [f64::NAN; MOST_BLADDERS];
            if let Some(drift) = periodic.drift() {
                self.plant.effect.duties(&drift[..self.plant.channels.count()], &mut flows);
            }
            flows.iter().for_each(|flow| say(*flow));
        }
    }

    /// Logs why the law is idle, and that it acts: where it changes.
    fn log_change(&mut self, idle: u32) {
        if self.logged.replace(idle) == Some(idle) {
            return;
        }
        // The words are made only where somebody listens: a step allocates nothing.
        let words = || Names::Bits(DutyReason::CODES).text(u64::from(idle)).unwrap_or_default();
        match idle {
            0 => tracing::info!("the law acts"),
            _ => tracing::warn!("idle: {}", words()),
        }
    }

    fn send(&mut self, outputs: &mut Outputs<'_>, duties: &DutiesElement) -> Result<(), StepError> {
        self.log_change(if duties.idle == 0 { 0 } else { duties.reasons });
        self.metrics[0].value = self.age;
        self.metrics[1].value = f64::from(duties.idle);
        if let Some(origin) = self.origin {
            outputs.acquired_at(origin);
        }
        outputs.send::<Duties>(DUTIES, duties)?;
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &self.metrics)
    }
}

/// Names of the numbers about what is learned of patient and valves.
fn learned_names(plant: &CheckedPlant, is_weighed: bool) -> Vec<String> {
    let mut names = Vec::new();
    let bladders = plant.effect.bladders();
    if is_weighed {
        names.extend((0..bladders).map(|j| format!("inlet_part_{j}")));
    }
    if plant.motion == Motion::Learned {
        names.extend((1..=TONES).map(|tone| format!("tone_{tone}_hz")));
        names.push("motion_explained".to_owned());
        names.extend((0..plant.channels.count()).map(|i| format!("answered_{i}")));
        names.extend((0..bladders).map(|j| format!("unexplained_flow_{j}")));
    }
    names
}

/// The name of a number about a channel, with the channel's unit.
pub fn named(what: &str, channel: Channel) -> String {
    format!("{what}_{}_{}", channel.name(), channel.unit())
}
