//! The data of a session that a report needs, read in one pass: small samples as series over time. Images and clouds are
//! not read.

use std::path::{Path, PathBuf};

use stillpoint_recorder::{Recorded, Role as TopicRole, Session, Topic};
use stillpoint_samples::{
    Actuation, ActuationReason, BytesError, Codes, Contacts, Diagnostics, Duties, DutiesElement, FarEnd,
    Gate, Health, Names, Pieces, Pose, PoseReport, Rejection, RigFault, RigState, Sample, SampleKind, Target,
    Track,
};

pub use super::rows::{
    Alignments, Fit, Gates, Metrics, Order, Orders, PoseRole, Pressures, RefusedFrame, Signal, State,
    TargetTrack, Touch, Touches, Tracking, Verdict,
};
use super::thinned::Thinned;
use super::wiring::Wiring;
use crate::far_end::{FarEnds, doing};

/// Number of unreadable samples whose reasons are kept; the others are only counted.
const UNREADABLE_SHOWN: usize = 10;

/// A session with the data that a report needs.
pub struct Recording<'s> {
    pub session: &'s Session,
    pub path: PathBuf,
    /// Its operators and edges.
    pub wiring: Wiring,
    /// First and last time of its journals, ns.
    pub span: [u64; 2],
    /// Poses and tracks, in the order of the session's topics.
    pub signals: Vec<Signal>,
    pub metrics: Vec<Metrics>,
    /// Verdicts on sensors, at each change.
    pub verdicts: Vec<Verdict>,
    /// Reports of pose estimates.
    pub alignments: Vec<Alignments>,
    pub targets: Vec<TargetTrack>,
    pub duties: Vec<Orders>,
    /// States of the gates of beams.
    pub gates: Vec<Gates>,
    /// Far ends of valves and beam.
    pub far_ends: Vec<FarEnds>,
    /// Pressures, true ones of a rig or estimates of actuation.
    pub pressures: Vec<Pressures>,
    pub contacts: Vec<Touches>,
    /// States of actuation and of rigs, at each change.
    pub states: Vec<Verdict>,
    /// Frames without a result.
    pub refusals: Thinned<RefusedFrame>,
    /// The first reasons why samples could not be read, and the number of these samples.
    pub unreadable: (Vec<String>, u64),
}

impl<'s> Recording<'s> {
    /// Reads a session. Samples that cannot be read are counted and left out.
    pub fn read(session: &'s Session, path: &Path) -> Self {
        Self::read_kinds(session, path, READ)
    }

    /// Reads only the samples of some kinds.
    pub fn read_kinds(session: &'s Session, path: &Path, kinds: &[&SampleKind]) -> Self {
        let wiring = Wiring::of(session);
        let mut recording = Self {
            session,
            path: path.to_owned(),
            span: span(session),
            signals: Vec::new(),
            metrics: Vec::new(),
            verdicts: Vec::new(),
            alignments: Vec::new(),
            targets: Vec::new(),
            duties: Vec::new(),
            gates: Vec::new(),
            far_ends: Vec::new(),
            pressures: Vec::new(),
            contacts: Vec::new(),
            states: Vec::new(),
            refusals: Thinned::default(),
            unreadable: (Vec::new(), 0),
            wiring,
        };
        // By number of the topic: where its samples go.
        let places: Vec<Option<usize>> = session.topics().iter().map(|t| recording.open(t)).collect();
        for recorded in session.samples_where(|t| is_any_of(t, kinds)) {
            let sentence = recorded.map_err(|e| e.to_string()).and_then(|r| {
                let topic = &session.topics()[r.topic];
                recording.take(topic, places[r.topic], &r).map_err(|e| format!("{}: {e}", topic.name))
            });
            if let Err(reason) = sentence {
                recording.unreadable.1 += 1;
                if recording.unreadable.0.len() < UNREADABLE_SHOWN {
                    recording.unreadable.0.push(reason);
                }
            }
        }
        let mut references: Vec<u64> =
            recording.alignments.iter().flat_map(|a| a.reference.1.iter().copied()).collect();
        references.sort_unstable();
        for signal in &mut recording.signals {
            signal.states.items_mut().sort_by_key(|s| s.origin);
            if signal.part == PoseRole::Truth {
                signal.references.clone_from(&references);
            }
        }
        recording
    }

    /// Creates the series for the samples of a topic.
    fn open(&mut self, topic: &Topic) -> Option<usize> {
        if is_any_of(topic, &[Pose::KIND, Track::KIND]) {
            self.signals.push(Signal {
                topic: topic.name.clone(),
                frame: topic.frame.clone(),
                part: self.part(topic),
                states: Thinned::default(),
                tracking: None,
                references: Vec::new(),
            });
            return Some(self.signals.len() - 1);
        }
        if is_any_of(topic, &[Diagnostics::KIND]) {
            let is_timing = topic.role == TopicRole::Measured;
            self.metrics.push(Metrics { topic: topic.name.clone(), is_timing, values: Vec::new() });
            return Some(self.metrics.len() - 1);
        }
        if is_any_of(topic, &[PoseReport::KIND]) {
            self.alignments.push(Alignments { topic: topic.name.clone(), ..Alignments::default() });
            return Some(self.alignments.len() - 1);
        }
        if is_any_of(topic, &[Target::KIND]) {
            let (topic, frame) = (topic.name.clone(), topic.frame.clone());
            self.targets.push(TargetTrack { topic, frame, ..TargetTrack::default() });
            return Some(self.targets.len() - 1);
        }
        if is_any_of(topic, &[Duties::KIND]) {
            self.duties.push(Orders { topic: topic.name.clone(), ..Orders::default() });
            return Some(self.duties.len() - 1);
        }
        if is_any_of(topic, &[Gate::KIND]) {
            self.gates.push(Gates { topic: topic.name.clone(), ..Gates::default() });
            return Some(self.gates.len() - 1);
        }
        if is_any_of(topic, &[FarEnd::KIND]) {
            let stage = self.wiring.producer(&topic.name).map(|(stage, _)| stage);
            let is_reasons = |t: &&Topic| {
                stage.is_some_and(|s| s.outputs.contains(&t.name)) && is_any_of(t, &[Diagnostics::KIND])
            };
            let reasons = self.session.topics().iter().find(is_reasons).map(|t| t.name.clone());
            self.far_ends.push(FarEnds::new(&topic.name, reasons));
            return Some(self.far_ends.len() - 1);
        }
        if is_any_of(topic, &[Contacts::KIND]) {
            self.contacts.push(Touches { topic: topic.name.clone(), ..Touches::default() });
            return Some(self.contacts.len() - 1);
        }
        if is_any_of(topic, &[Actuation::KIND, RigState::KIND]) {
            self.pressures.push(Pressures { topic: topic.name.clone(), ..Pressures::default() });
            return Some(self.pressures.len() - 1);
        }
        None
    }

    /// The part of a topic. A track that is computed from tracks is fused.
    fn part(&self, topic: &Topic) -> PoseRole {
        if is_any_of(topic, &[Pose::KIND]) {
            return if topic.name.ends_with(".truth") { PoseRole::Truth } else { PoseRole::Raw };
        }
        let is_track = |name: &String| {
            self.session.topics().iter().any(|t| t.name == *name && is_any_of(t, &[Track::KIND]))
        };
        let made_of = self.wiring.producer(&topic.name).map_or(&[][..], |(stage, _)| &stage.inputs);
        if made_of.iter().any(is_track) { PoseRole::Fused } else { PoseRole::Filtered }
    }

    fn take(&mut self, topic: &Topic, place: Option<usize>, r: &Recorded) -> Result<(), BytesError> {
        let Some(kind) = topic.kind.kind() else { return Ok(()) };
        let pieces = Pieces::split(kind, &r.sample)?;
        let head = pieces.header();
        if *kind == *Pose::KIND {
            let signal = place.and_then(|p| self.signals.get_mut(p));
            if let (Some(signal), Some(pose)) = (signal, pieces.view::<Pose>()?.first()) {
                signal.states.push(State::of_pose(head.origin, pose));
            }
        } else if *kind == *Track::KIND {
            let signal = place.and_then(|p| self.signals.get_mut(p));
            if let (Some(signal), Some(track)) = (signal, pieces.view::<Track>()?.first()) {
                signal.states.push(State::of_track(head.origin, track));
                signal.tracking = Some(Tracking::of(track, signal.tracking.as_ref()));
            }
        } else if *kind == *FarEnd::KIND {
            let far = place.and_then(|p| self.far_ends.get_mut(p));
            if let (Some(far), Some(state)) = (far, pieces.view::<FarEnd>()?.first()) {
                far.take(head.stamp, state);
                note(&mut self.states, &topic.name, "", doing(state), head.stamp);
            }
        } else if *kind == *Diagnostics::KIND {
            let of = |far: &&mut FarEnds| far.diagnostics.as_deref() == Some(&topic.name);
            if let Some(far) = self.far_ends.iter_mut().find(of) {
                far.take_reasons(pieces.view::<Diagnostics>()?.elements);
            }
            if let Some(metrics) = place.and_then(|p| self.metrics.get_mut(p)) {
                for metric in pieces.view::<Diagnostics>()?.elements {
                    metrics.push(metric.name(), head.stamp, metric.value);
                }
            }
        } else if *kind == *Health::KIND {
            for sensor in pieces.view::<Health>()?.elements {
                note(&mut self.verdicts, &topic.name, sensor.name(), sensor.reason(), head.stamp);
            }
        } else if *kind == *PoseReport::KIND {
            let alignments = place.and_then(|p| self.alignments.get_mut(p));
            if let (Some(alignments), Some(report)) = (alignments, pieces.view::<PoseReport>()?.first()) {
                alignments.take(head.origin, report);
            }
        } else if *kind == *Target::KIND {
            let target_track = place.and_then(|p| self.targets.get_mut(p));
            if let (Some(target_track), Some(target)) = (target_track, pieces.view::<Target>()?.first()) {
                let ([x, y, z], [pitch, roll, yaw]) = (target.position, target.angles);
                target_track.values.push((head.stamp, [x, y, z, pitch, roll, yaw]));
                target_track.refusals.take(head.stamp, target);
            }
        } else if *kind == *Duties::KIND {
            let orders = place.and_then(|p| self.duties.get_mut(p));
            if let (Some(orders), Some(duties)) = (orders, pieces.view::<Duties>()?.first()) {
                orders.valves = orders.valves.max((duties.valves as usize).min(DutiesElement::ROOM));
                orders.values.push(Order {
                    stamp: head.stamp,
                    duty: duties.duty.map(|d| d as f32),
                    saturated: duties.saturated,
                    idle: duties.idle != 0,
                    reasons: duties.reasons,
                });
            }
        } else if *kind == *Gate::KIND {
            let gates = place.and_then(|p| self.gates.get_mut(p));
            if let (Some(gates), Some(gate)) = (gates, pieces.view::<Gate>()?.first()) {
                gates.take(head.stamp, gate);
            }
        } else if *kind == *Contacts::KIND {
            let touches = place.and_then(|p| self.contacts.get_mut(p));
            if let (Some(touches), Some(c)) = (touches, pieces.view::<Contacts>()?.first())
                && c.bladders > 0
            {
                touches.bladders = touches.bladders.max((c.bladders as usize).min(c.force.len()));
                let (force, margin) = (c.force.map(|f| f as f32), c.margin.map(|m| m as f32));
                touches.values.push(Touch { stamp: head.stamp, force, margin, low: c.low, slides: c.slides });
            }
        } else if *kind == *Actuation::KIND {
            if let (Some(place), Some(a)) = (place, pieces.view::<Actuation>()?.first()) {
                self.press(place, head.stamp, a.pressure, a.valves as usize / 2);
                let why: Vec<&str> = ActuationReason::words(a.reasons).collect();
                note(
                    &mut self.states,
                    &topic.name,
                    "",
                    &with_reasons(a.state().word(), &why.join(", ")),
                    head.stamp,
                );
            }
        } else if *kind == *RigState::KIND {
            if let (Some(place), Some(rig)) = (place, pieces.view::<RigState>()?.first()) {
                self.press(place, head.stamp, rig.pressure, rig.bladders as usize);
                let mode = rig.mode().word();
                let faults = if rig.faults == 0 {
                    String::new()
                } else {
                    let words = Names::Bits(RigFault::CODES).text(u64::from(rig.faults));
                    words.map_or_else(String::new, |words| format!("faults: {words}"))
                };
                note(&mut self.states, &topic.name, "", &with_reasons(mode, &faults), head.stamp);
            }
        } else if *kind == *Rejection::KIND
            && let Some(rejection) = pieces.view::<Rejection>()?.first()
        {
            let reason = rejection.reason().to_owned();
            self.refusals.push(RefusedFrame { topic: topic.name.clone(), stamp: head.stamp, reason });
        }
        Ok(())
    }

    fn press(&mut self, place: usize, stamp: u64, pressure: [f64; 8], bladders: usize) {
        if let Some(pressures) = self.pressures.get_mut(place) {
            pressures.bladders = pressures.bladders.max(bladders.min(pressure.len()));
            pressures.values.push((stamp, pressure.map(|p| p as f32)));
        }
    }

    /// Seconds since the session began.
    pub fn seconds(&self, time: u64) -> f64 {
        (time as f64 - self.span[0] as f64) * 1e-9
    }

    /// Length of the session, s.
    pub fn length(&self) -> f64 {
        self.span[1].saturating_sub(self.span[0]) as f64 * 1e-9
    }

    /// The signals of this part that have samples.
    pub fn signals_of(&self, part: PoseRole) -> impl Iterator<Item = &Signal> {
        self.signals.iter().filter(move |s| s.part == part && !s.states.items().is_empty())
    }

    /// The truth of an estimate: the truth in its frame that comes from the rig upstream; if no such rig is found, the first
    /// truth in its frame.
    pub fn truth_of(&self, estimate: &Signal) -> Option<&Signal> {
        let upstream = self.wiring.upstream(&estimate.topic);
        let makes = |truth: &&Signal| {
            let rig = self.wiring.producer(&truth.topic);
            rig.is_some_and(|(rig, _)| rig.outputs.iter().any(|o| upstream.contains(&o.as_str())))
        };
        let of_frame = || self.signals_of(PoseRole::Truth).filter(|s| s.frame == estimate.frame);
        of_frame().find(makes).or_else(|| of_frame().next())
    }

    /// Whether a series keeps only one of several samples.
    pub fn is_thinned(&self) -> bool {
        self.signals.iter().any(|s| s.states.stride() > 1)
            || self.metrics.iter().flat_map(|m| &m.values).any(|(_, v)| v.stride() > 1)
    }
}

/// The kinds that are read.
const READ: &[&SampleKind] = &[
    Pose::KIND,
    Track::KIND,
    Diagnostics::KIND,
    Health::KIND,
    PoseReport::KIND,
    Target::KIND,
    Duties::KIND,
    FarEnd::KIND,
    Gate::KIND,
    Actuation::KIND,
    RigState::KIND,
    Contacts::KIND,
    Rejection::KIND,
];

/// Whether the samples of a topic are of one of these kinds, in the layout of this build.
pub fn is_any_of(topic: &Topic, kinds: &[&SampleKind]) -> bool {
    topic.kind.kind().is_some_and(|kind| kinds.iter().any(|k| **k == *kind))
}

/// First and last time of the journals; zeros if there are no journals.
fn span(session: &Session) -> [u64; 2] {
    let stamps = || session.journals().values().flatten().map(|e| e.header.stamp).filter(|t| *t < u64::MAX);
    [stamps().min().unwrap_or(0), stamps().max().unwrap_or(0)]
}

/// Adds a verdict if it differs from the last verdict on the same sensor of the same topic.
fn note(verdicts: &mut Vec<Verdict>, topic: &str, sensor: &str, reason: &str, since: u64) {
    let last = verdicts.iter().rev().find(|v| v.topic == topic && v.sensor == sensor);
    if last.is_none_or(|v| v.reason != reason) && verdicts.len() < super::thinned::MOST {
        let [topic, sensor, reason] = [topic, sensor, reason].map(str::to_owned);
        verdicts.push(Verdict { topic, sensor, reason, since });
    }
}

/// A state with its reasons, if there are any.
fn with_reasons(state: &str, why: &str) -> String {
    if why.is_empty() { state.to_owned() } else { format!("{state}: {why}") }
}
