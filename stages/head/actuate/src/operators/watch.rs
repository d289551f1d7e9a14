//! What `actuate.valves` sees on its inputs: commands, pose and reference, and what is wrong or missing with them.

use stillpoint_operator::Activation;
use stillpoint_samples::{
    ActuationReason as Reason, ConsoleCommand, Duties, DutiesElement, DutyReason, PoseReport, PoseStatus,
    Track, Verb,
};

use crate::face_watch::FaceWatch;
use crate::machine::{Asked, Seen};
use crate::message::VALVES;
use crate::pose_watch::PoseWatch;
use stillpoint_pose::extrinsic::{Extrinsic, Need};

pub const COMMAND: usize = 0;
pub const STATE: usize = 1;
pub const REFERENCE: usize = 2;
pub const MEASURED: usize = 7;
pub const ACKNOWLEDGEMENT: usize = 8;
pub const CONTACTS: usize = 9;
/// The first of the inputs of people.
pub const ARM: usize = 3;
/// What each of them asks, and the verb that it must carry.
pub const PEOPLE: [(Asked, Verb); 4] = [
    (Asked::Arm, Verb::Arm),
    (Asked::Disarm, Verb::Disarm),
    (Asked::Resume, Verb::Resume),
    (Asked::Vent, Verb::Vent),
];

/// What was seen so far.
pub struct Watch {
    pub pose: PoseWatch,
    pub extrinsic: Extrinsic,
    /// Age at which a pose is stale, ns.
    pub stale: u64,
    /// Age at which a command is stale, ns.
    pub watchdog: u64,
    pub valves: usize,
    pub reference: Need,
    /// The newest command and its stamp, ns.
    command: Option<(DutiesElement, u64)>,
    /// Number of the newest reference, and the incarnation of its tracker.
    captured: Option<(u32, u32)>,
    /// Whether a person has confirmed it.
    is_confirmed: bool,
    face: FaceWatch,
}

impl Watch {
    /// A watch without samples.
    pub fn new(
        pose: PoseWatch,
        extrinsic: Extrinsic,
        stale: u64,
        watchdog: u64,
        valves: usize,
        reference: Need,
    ) -> Self {
        Self {
            pose,
            extrinsic,
            stale,
            watchdog,
            valves,
            reference,
            command: None,
            captured: None,
            is_confirmed: false,
            face: FaceWatch::new(stale),
        }
    }

    /// Takes the samples of an activation.
    pub fn take(&mut self, activation: &Activation<'_>) {
        if let Some(sample) = activation.fresh::<Duties>(COMMAND)
            && let Some(duties) = sample.first()
        {
            self.command = Some((*duties, sample.header.stamp.min(activation.time)));
        }
        if let Some(sample) = activation.fresh::<Track>(STATE)
            && let Some(track) = sample.first()
        {
            self.pose.see(track, sample.header.origin, sample.header.incarnation, activation.time);
        }
        if let Some(sample) = activation.fresh::<PoseReport>(REFERENCE)
            && let Some(report) = sample.first()
        {
            self.is_confirmed = report.confirmed == 1;
            let is_fresh = self.pose.age(activation.time).is_some_and(|age| age <= self.stale);
            self.face.see(PoseStatus::from_number(report.status), is_fresh, activation.time);
            self.captured = (report.reference != 0).then_some((report.reference, sample.header.incarnation));
        }
    }

    /// What people ask in this activation, the safest last.
    pub fn asked<'a>(activation: &'a Activation<'_>) -> impl Iterator<Item = Asked> + 'a {
        PEOPLE.iter().enumerate().filter_map(|(place, (asked, verb))| {
            let sample = activation.fresh::<ConsoleCommand>(ARM + place)?;
            // An input that is connected to another verb's output asks for nothing.
            sample.first().is_some_and(|c| c.verb == *verb as u32).then_some(*asked)
        })
    }

    /// What there is at `now`, ns.
    pub fn seen(&self, now: u64) -> Seen {
        let bit = |holds: bool, reason: u32| if holds { reason } else { 0 };
        let command_age = self.command_age(now);
        let pose_age = self.pose.age(now);
        // A law that is lost says so itself, and asks that all valves be shut.
        let is_lost = |d: &DutiesElement| d.reasons & DutyReason::NotFinite.bit() != 0;
        let bad = |d: &DutiesElement| is_lost(d) || d.duty.iter().take(self.valves).any(|d| !d.is_finite());
        let misfit = |d: &DutiesElement| d.valves as usize != self.valves;
        let duties = self.command.as_ref().map(|(duties, _)| duties);
        let faults = bit(self.pose.is_broken(), Reason::POSE_NOT_FINITE)
            | bit(duties.is_some_and(bad), Reason::COMMAND_NOT_FINITE)
            | bit(duties.is_some_and(misfit), Reason::COMMAND_SHAPE);
        let unseen = bit(self.pose.track().is_none(), Reason::NO_POSE)
            | bit(pose_age.is_some_and(|age| age > self.stale), Reason::POSE_STALE);
        // A face that moves hides where the skull is: the valves hold, and the pose is not missed.
        let is_hidden = unseen != 0 && self.face.excuses(now);
        let missing = bit(!is_hidden, unseen)
            | bit(command_age.is_none(), Reason::NO_COMMAND)
            | bit(command_age.is_some_and(|age| age > self.watchdog), Reason::COMMAND_STALE);
        let needed = self.reference == Need::Required;
        let unready = bit(needed && self.captured.is_none(), Reason::REFERENCE)
            | bit(needed && self.captured.is_some() && !self.is_confirmed, Reason::UNCONFIRMED)
            | bit(!self.extrinsic.is_valid(now), Reason::EXTRINSIC);
        Seen {
            now,
            faults,
            missing,
            unready,
            is_idle: duties.is_some_and(|d| d.idle != 0),
            is_face: is_hidden || self.face.moves(now),
            reference: self.captured.filter(|_| needed),
        }
    }

    /// Whether the newest command reports a tracking error.
    pub fn has_tracking_error(&self) -> bool {
        self.reports(DutyReason::TrackingError)
    }

    /// Whether the newest command reports orders without effect.
    pub fn has_no_effect(&self) -> bool {
        self.reports(DutyReason::NoEffect)
    }

    fn reports(&self, reason: DutyReason) -> bool {
        self.command.as_ref().is_some_and(|(duties, _)| duties.reasons & reason.bit() != 0)
    }

    /// Age of the newest command, ns.
    pub fn command_age(&self, now: u64) -> Option<u64> {
        self.command.as_ref().map(|(_, stamp)| now.saturating_sub(*stamp))
    }

    /// The duties that the newest command asks for.
    pub fn duties(&self) -> &[f64] {
        const NONE: [f64; VALVES] = [0.0; VALVES];
        let asked = self.command.as_ref().map_or(&NONE, |(duties, _)| &duties.duty);
        asked.get(..self.valves).unwrap_or(asked)
    }
}
