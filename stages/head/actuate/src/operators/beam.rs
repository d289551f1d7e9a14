//! `gate.beam`: the lease of the beam.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup, WireForm};
use stillpoint_operator::{
    AdoptError, FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_samples::{
    Actuation, ActuationState, Datagram, Diagnostics, Gate, GateElement, GateReason as Reason, Health,
    Metric, PlanRequest, PlanUpdate, PoseReport, PoseReportElement, PoseStatus, Proof, Sample, SensorHealth,
    Target, TargetElement, Track,
};

use super::limits::Limits;
use super::params::{check_life, extrinsic, key, too_old_for_beam};
use crate::aim::{Aim, Tolerances};
use crate::couch;
use crate::datagram::{self, LONGEST};
use crate::drift::{Drift, DriftLimits};
use crate::lease::{Lease, LeaseRules};
use crate::message::{Order, Receiving, Safe};
use crate::plan_watch::PlanWatch;
use crate::pose_watch::PoseWatch;
use crate::sender::Sender;
use stillpoint_pose::extrinsic::{Extrinsic, ExtrinsicParams, Need};

const STATE: usize = 0;
const TARGET: usize = 1;
const ACTUATION: usize = 2;
const REPORT: usize = 3;
const PLAN: usize = 4;
const PLAN_REQUEST: usize = 5;
const CAMERAS: usize = 6;
const DATAGRAM: usize = 0;
const GATE: usize = 1;
const DIAGNOSTICS: usize = 2;

/// Parameters of `gate.beam`.
#[derive(Clone, Debug, Params)]
pub struct BeamParams {
    /// The key file, a path relative to the pipeline file: 64 hexadecimal digits. The session keeps it.
    #[param(file)]
    pub key: String,
    /// Length of a lease that is not renewed.
    #[param(unit = "ns", default = "100 ms", min = "4 ms", max = "200 ms")]
    pub lease: u64,
    /// Time without a reason against the beam before a lease begins.
    #[param(unit = "ns", default = "500 ms", min = "0 ms", max = "1 min", live)]
    pub dwell: u64,
    /// Largest error of a coordinate that the target holds.
    #[param(unit = "m", default = "1 mm", above = "0 mm", max = "100 mm", live)]
    pub position_tolerance: f64,
    /// Largest error of an angle that the target holds.
    #[param(unit = "rad", default = "0.5 deg", above = "0 deg", max = "90 deg", live)]
    pub angle_tolerance: f64,
    /// How far a coordinate that the target does not hold may be from where it was when the beam first began for this
    /// target and reference.
    #[param(unit = "m", default = "2 mm", above = "0 mm", max = "10 m", live)]
    pub drift_tolerance: f64,
    /// How far an angle that the target does not hold may be from where it was when the beam first began.
    #[param(unit = "rad", default = "1.5 deg", above = "0 deg", max = "180 deg", live)]
    pub drift_angle: f64,
    /// Fraction by which errors must lie below the tolerances for a lease to begin.
    #[param(default = 0.2, min = 0, max = 0.9, live)]
    pub hysteresis: f64,
    /// Largest standard deviation of a coordinate that the target holds.
    #[param(unit = "m", default = "0.5 mm", above = "0 mm", max = "100 mm", live)]
    pub position_sd: f64,
    /// Largest standard deviation of an angle that the target holds.
    #[param(unit = "rad", default = "0.3 deg", above = "0 deg", max = "90 deg", live)]
    pub angle_sd: f64,
    /// Conditions under which the pose is fresh.
    pub pose: BeamFreshnessParams,
    /// Whether the lease requires a tracker that reports a pose in every frame (`report`).
    #[param(default = "required")]
    pub tracker: Need,
    /// Least confidence of the tracker that it follows what was captured.
    #[param(default = 0.5, min = 0, max = 1, live)]
    pub confidence: f64,
    /// Whether the parts of the reference must have been seen to move together since the capture.
    #[param(default = "required")]
    pub proof: Need,
    /// Age at which the newest target sample is too old.
    #[param(unit = "ns", default = "500 ms", min = "1 ms", max = "1 min")]
    pub target_timeout: u64,
    /// Age at which the newest sample of actuation is too old.
    #[param(unit = "ns", default = "30 ms", min = "1 ms", max = "100 ms")]
    pub actuation_timeout: u64,
    /// Conditions under which the extrinsics of the cameras are valid.
    pub extrinsic: ExtrinsicParams,
    /// Couch angle of the session (patient support, IEC 61217): how the couch stands whose axes the frame of the poses has.
    #[param(unit = "rad", default = "0 deg", min = "-360 deg", max = "360 deg")]
    pub couch: f64,
    /// Couch angle of the beam that is delivered next, as its plan states it. The beam stays off unless it is that of the
    /// session.
    #[param(unit = "rad", default = "0 deg", min = "-360 deg", max = "360 deg", live)]
    pub beam_couch: f64,
}

/// When the beam takes a pose for fresh.
#[derive(Clone, Debug, Params)]
pub struct BeamFreshnessParams {
    /// Period of the camera's frames. A pose whose newest measurement, and a report whose frame, is older than 1.5 of them
    /// and 5 ms is stale: a camera that falls silent ends the beam as fast as one that freezes.
    #[param(unit = "ns", default = "100 ms", min = "1 ms", max = "1 s")]
    pub frame_period: u64,
    /// Number of repetitions of the same measurement after which the pose is stale at once: the camera is frozen.
    #[param(default = 1, min = 1, max = 1000000)]
    pub frozen_after: u64,
}

/// Sends at each tick, at each word of actuation and at each report of the tracker whether the beam may be on for the
/// length of a lease.
///
/// The lease is renewed only while nothing speaks against it: a fresh, well-known pose within tolerance of a target that
/// does not move, a tracker that found a pose in the newest frame, a valid extrinsic, actuation that is armed and, where
/// `plan` is connected, a standing plan that holds in the set-up that was requested last. The beam that is delivered next must
/// have the couch angle of the session. The first word against the lease ends it at once, and it begins again after a dwell,
/// within narrower tolerances.
pub struct GateBeam {
    limits: Limits,
    tolerances: Tolerances,
    stale: u64,
    target_timeout: u64,
    actuation_timeout: u64,
    extrinsic: Extrinsic,
    pose: PoseWatch,
    /// The newest target and its stamp, ns.
    target: Option<(TargetElement, u64)>,
    /// Whether actuation was armed when it last spoke, and when that was, ns.
    actuation: Option<(bool, u64)>,
    tracker: Need,
    confidence: f64,
    proof: Need,
    /// What the tracker's newest report says against the beam, and when that frame was acquired, ns.
    report: Option<(u32, u64)>,
    /// Number of the reference of the tracker's newest report; 0 without a report.
    reference: u32,
    drift: Drift,
    /// Couch angle of the session, rad.
    couch: f64,
    /// Whether the beam that is delivered next has this couch angle.
    is_at_couch: bool,
    /// What is known of the standing plan; `None` where no plan is connected.
    plan: Option<PlanWatch>,
    /// The cameras that were left out of the newest merged cloud.
    lost: [Option<SensorHealth>; CAMERAS_MOST],
    lease: Lease,
    sender: Sender,
    metrics: [Metric; METRICS],
    /// Whether the beam was on when the log last had it.
    logged: Option<bool>,
}

const METRICS: usize = 9;
/// Cameras of a merged cloud.
const CAMERAS_MOST: usize = 4;
/// What a tracker lacks that a lost camera may be the cause of.
const BY_CAMERA: u32 = Reason::TRACKER | Reason::IDENTITY | Reason::UNPROVEN;

impl Operator for GateBeam {
    type Params = BeamParams;
    const WIRE: Option<WireForm> = Some(datagram::WIRE);
    const KIND: Kind = Kind {
        name: "gate.beam",
        about: "Gives the lease of the beam, and renews it only while the head is within the tolerances of its target.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "state",
                sample: Track::KIND,
                policy: Policy::Latest,
                required: true,
                about: "The estimated pose of the head.",
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
                policy: Policy::Queue(4),
                required: true,
                about: "The state of actuation: the gate reacts to each sample at once.",
            },
            Input {
                name: "report",
                sample: PoseReport::KIND,
                policy: Policy::Queue(4),
                required: false,
                about: "The tracker's report on each frame: a frame without a pose ends the lease at once. Required unless `tracker` is `waived`.",
            },
            Input {
                name: "plan",
                sample: PlanUpdate::KIND,
                policy: Policy::Queue(4),
                required: false,
                about: "What `plan.optimizer` says of the standing plan: the beam needs one that holds in the newest requested set-up. Not connected: plans have no effect.",
            },
            Input {
                name: "plan_request",
                sample: PlanRequest::KIND,
                policy: Policy::Queue(4),
                required: false,
                about: "Requests for plans, as `plan.optimizer` gets them: an unanswered request ends the lease. Required with `plan`.",
            },
            Input {
                name: "cameras",
                sample: Health::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Which cameras the merged cloud is of, from `ingest.merge`: while one is left out and the tracker has no pose or no proof, the reasons name it, and the log says which and why. It never ends a lease alone.",
            },
        ],
        outputs: &[
            Output {
                name: "datagram",
                sample: Datagram::KIND,
                frame: FrameRule::None,
                about: "The order to the beam, as a signed datagram.",
            },
            Output {
                name: "state",
                sample: Gate::KIND,
                frame: FrameRule::None,
                about: "Whether the beam may be on, the judged errors, and the reasons against it.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "How long and how often the beam was allowed.",
            },
        ],
        timer: Timer::Required,
    };

    fn new(params: BeamParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        check_life("lease", params.lease, setup)?;
        if params.tracker == Need::Required && !setup.is_connected(REPORT) {
            return Err(SetupError(
                "the beam is to be on only while a tracker sees the head: connect `report: head.report`, or say \
                 `tracker: waived`"
                    .into(),
            ));
        }
        let plan = setup.is_connected(PLAN);
        if plan != setup.is_connected(PLAN_REQUEST) {
            return Err(SetupError(
                "a plan is judged for the newest request: connect both `plan` (plan.optimizer) and `plan_request` \
                 (the requests that it gets), or neither"
                    .into(),
            ));
        }
        if plan && !couch::is_same(params.couch, 0.0) {
            return Err(SetupError(format!(
                "the plans of plan.optimizer have all beams at couch angle 0, and `couch` is {} deg: disconnect `plan` and \
                 `plan_request`, or leave `couch` out",
                degrees(params.couch)
            )));
        }
        Ok(Self {
            limits: Limits::of(&params),
            tolerances: Limits::of(&params).tolerances(),
            stale: too_old_for_beam(params.pose.frame_period),
            target_timeout: params.target_timeout,
            actuation_timeout: params.actuation_timeout,
            extrinsic: extrinsic(&params.extrinsic, STATE, setup)?,
            pose: PoseWatch::new(params.pose.frozen_after),
            target: None,
            actuation: None,
            tracker: params.tracker,
            confidence: params.confidence,
            proof: params.proof,
            report: None,
            reference: 0,
            drift: Drift::new(DriftLimits { position: params.drift_tolerance, angle: params.drift_angle }),
            couch: params.couch,
            is_at_couch: couch::is_same(params.couch, params.beam_couch),
            plan: plan.then(PlanWatch::default),
            lost: [None; CAMERAS_MOST],
            lease: Lease::new(LeaseRules { length: params.lease, dwell: params.dwell }),
            sender: Sender::new(key(&params.key, setup)?, Receiving::Beam, Safe::Hold, params.lease),
            metrics: [
                "beam",
                "reasons",
                "well_s",
                "on_s",
                "watched_s",
                "duty",
                "leases",
                "longest_s",
                "shortest_s",
            ]
            .map(|name| Metric::new(name, f64::NAN)),
            logged: None,
        })
    }

    fn adopt(&mut self, params: BeamParams) -> Result<(), AdoptError> {
        let limits = Limits::of(&params);
        if self.lease.is_held() {
            limits.refuse_wider(&self.limits)?;
        }
        self.tolerances = limits.tolerances();
        self.confidence = params.confidence;
        self.drift.set_limits(DriftLimits { position: params.drift_tolerance, angle: params.drift_angle });
        self.lease.set_dwell(params.dwell);
        self.is_at_couch = couch::is_same(self.couch, params.beam_couch);
        self.limits = limits;
        Ok(())
    }

    fn capacities(_: &BeamParams) -> Vec<usize> {
        vec![LONGEST, 1, METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let now = activation.time;
        self.take(activation);
        let aim = self.aim(now);
        let mut against = aim.against | self.against(now);
        let is_on = self.lease.look(now, against);
        if is_on && let (Some(track), Some((target, _))) = (self.pose.track(), &self.target) {
            self.drift.begin(track, target, self.reference);
        }
        if !is_on && against == 0 {
            against = Reason::DWELLING;
        }
        if self.logged.replace(is_on) != Some(is_on) {
            match is_on {
                true => tracing::info!("the beam may be on"),
                false => tracing::info!("the beam is off: {}", self.words(against)),
            }
        }
        let order = if is_on { Order::Follow } else { Order::Hold };
        let bytes = self.sender.datagram(activation, order, against, &[])?;
        outputs.send_slice::<Datagram>(DATAGRAM, &(), bytes)?;
        let element = self.element(now, is_on, against, &aim);
        outputs.send::<Gate>(GATE, &element)?;
        self.say(&element);
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &self.metrics)
    }
}

impl GateBeam {
    fn take(&mut self, activation: &Activation<'_>) {
        let now = activation.time;
        if let Some(sample) = activation.fresh::<Track>(STATE)
            && let Some(track) = sample.first()
        {
            self.pose.see(track, sample.header.origin, sample.header.incarnation, now);
        }
        if let Some(sample) = activation.fresh::<Target>(TARGET)
            && let Some(target) = sample.first()
        {
            self.target = Some((*target, sample.header.stamp.min(now)));
        }
        if let Some(sample) = activation.fresh::<Actuation>(ACTUATION)
            && let Some(element) = sample.first()
        {
            let is_armed = element.state() == ActuationState::Armed && element.order == Order::Follow as u32;
            self.actuation = Some((is_armed, sample.header.stamp.min(now)));
        }
        if let Some(sample) = activation.fresh::<PoseReport>(REPORT)
            && let Some(report) = sample.first()
        {
            self.report = Some((self.reported(report), sample.header.origin.min(now)));
            self.reference = report.reference;
        }
        if let Some(cameras) = activation.fresh::<Health>(CAMERAS) {
            self.lost = [None; CAMERAS_MOST];
            let lost = cameras.elements.iter().filter(|camera| !camera.is_used());
            self.lost.iter_mut().zip(lost).for_each(|(slot, camera)| *slot = Some(*camera));
        }
        let Some(plan) = &mut self.plan else { return };
        if let Some(sample) = activation.fresh::<PlanRequest>(PLAN_REQUEST) {
            plan.ask(sample.header.incarnation, sample.header.sequence);
        }
        if let Some(sample) = activation.fresh::<PlanUpdate>(PLAN) {
            plan.answer(sample.body);
        }
    }

    /// The reasons against the beam for people, with the cameras that are left out.
    fn words(&self, against: u32) -> String {
        let mut words = Reason::words(against).collect::<Vec<_>>().join(", ");
        if against & Reason::CAMERA != 0 {
            let lost = self.lost.iter().flatten();
            let lost: Vec<_> = lost.map(|c| format!("{} is {}", c.name(), c.reason())).collect();
            words = format!("{words} ({})", lost.join(", "));
        }
        words
    }

    /// What a report of the tracker says against the beam.
    fn reported(&self, report: &PoseReportElement) -> u32 {
        let bit = |holds: bool, reason: u32| if holds { reason } else { 0 };
        let status = PoseStatus::from_number(report.status);
        let has_pose = matches!(
            status,
            Some(PoseStatus::Captured | PoseStatus::Tracked | PoseStatus::Found | PoseStatus::FaceMoves)
        );
        let is_face = matches!(status, Some(PoseStatus::FaceMoves | PoseStatus::FaceUnsure));
        let is_sure = report.confidence >= self.confidence;
        let is_doubted = status == Some(PoseStatus::Doubted) || (has_pose && !is_sure);
        bit(!has_pose, Reason::TRACKER)
            | bit(is_doubted, Reason::IDENTITY)
            | bit(is_face, Reason::FACE_MOVES)
            | bit(self.proof == Need::Required && report.proof != Proof::Proven as u32, Reason::UNPROVEN)
            | bit(report.confirmed != 1, Reason::UNCONFIRMED)
    }

    /// What pose and target say.
    fn aim(&self, now: u64) -> Aim {
        if self.pose.is_broken() {
            return Aim::blind(Reason::NOT_FINITE);
        }
        let Some((target, _)) = &self.target else { return Aim::blind(Reason::NO_TARGET) };
        let Some(track) = self.pose.track() else { return Aim::blind(Reason::NO_POSE) };
        let mut aim = Aim::at(track, target, &self.tolerances, self.lease.ends().is_some_and(|e| now < e));
        if self.pose.is_frozen() || self.pose.age(now).is_none_or(|age| age > self.stale) {
            aim.against |= Reason::POSE_STALE;
        }
        if self.drift.is_beyond(track, target, self.reference) {
            aim.against |= Reason::DRIFT;
        }
        aim
    }

    /// The reasons from all other inputs.
    fn against(&self, now: u64) -> u32 {
        let is_old = |stamp: u64, timeout: u64| now.saturating_sub(stamp) > timeout;
        let bit = |holds: bool, reason: u32| if holds { reason } else { 0 };
        let (armed, spoke) = self.actuation.map_or((false, None), |(armed, stamp)| (armed, Some(stamp)));
        let tracker = match self.report {
            _ if self.tracker == Need::Waived => 0,
            Some((reported, origin)) => reported | bit(is_old(origin, self.stale), Reason::TRACKER),
            None => Reason::TRACKER,
        };
        let camera = bit(tracker & BY_CAMERA != 0 && self.lost[0].is_some(), Reason::CAMERA);
        bit(self.target.is_some_and(|(_, stamp)| is_old(stamp, self.target_timeout)), Reason::TARGET_STALE)
            | bit(!self.extrinsic.is_valid(now), Reason::EXTRINSIC)
            | bit(!armed, Reason::ACTUATION)
            | bit(spoke.is_none_or(|stamp| is_old(stamp, self.actuation_timeout)), Reason::ACTUATION_SILENT)
            | bit(!self.is_at_couch, Reason::COUCH)
            | tracker
            | camera
            | bit(self.plan.as_ref().is_some_and(|plan| !plan.holds()), Reason::PLAN)
    }

    fn element(&self, now: u64, is_on: bool, reasons: u32, aim: &Aim) -> GateElement {
        let [x, y, z, pitch, roll, yaw] = aim.error;
        let stats = self.lease.stats();
        GateElement {
            position_error: [x, y, z],
            angle_error: [pitch, roll, yaw],
            position_sd: aim.position_sd,
            angle_sd: aim.angle_sd,
            lease_ends: self.lease.ends().unwrap_or(0),
            well_for: self.lease.well_for(now),
            on_for: stats.on,
            watched_for: stats.watched,
            leases: stats.leases,
            datagram: self.sender.sequence(),
            beam: u32::from(is_on),
            reasons,
            ended_by: self.lease.ended_by(),
            reserved: 0,
        }
    }

    fn say(&mut self, element: &GateElement) {
        let seconds = |ns: u64| ns as f64 * 1e-9;
        let stats = self.lease.stats();
        let duty = if stats.watched == 0 { 0.0 } else { stats.on as f64 / stats.watched as f64 };
        let values = [
            f64::from(element.beam),
            f64::from(element.reasons),
            seconds(element.well_for),
            seconds(stats.on),
            seconds(stats.watched),
            duty,
            stats.leases as f64,
            seconds(stats.longest),
            seconds(stats.shortest),
        ];
        for (metric, value) in self.metrics.iter_mut().zip(values) {
            metric.value = value;
        }
    }
}

/// An angle of `rad` in degrees, for people.
fn degrees(rad: f64) -> f64 {
    (rad.to_degrees() * 1e6).round() / 1e6
}
