//! What a report needs of a session, read in one pass: the small samples as numbers over time. Images and clouds are
//! left where they are.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::Serialize;
use stillpoint_recorder::{Recorded, Role as TopicRole, Session, Topic, TopicKind};
use stillpoint_samples::{
    BytesError, Diagnostics, Health, Pieces, Pose, Rejection, Sample, SampleKind, Standing, Track,
};
use stillpoint_track::PoseNumbers;

use super::thinned::Thinned;
use super::wiring::Wiring;

/// Samples that could not be read and are shown; more are counted.
const UNREADABLE_SHOWN: usize = 10;

/// What a pose is to the estimate of a head.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Where the head really is.
    Truth,
    /// A measurement.
    Raw,
    /// A measurement behind a filter.
    Filtered,
    /// Several tracks as one.
    Fused,
}

/// A pose or a track at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// When what is behind it was acquired, ns.
    pub origin: u64,
    /// x, y, z in m, pitch, roll, yaw in rad; NaN where not known.
    pub channels: [f64; 6],
    /// Standard deviations of the position in m, and of small rotations about the frame's axes in rad.
    pub sd: [f64; 6],
    /// Normalised innovation squared; NaN where nothing was measured.
    pub nis: f64,
    /// What a track stands on; a pose is measured.
    pub standing: Standing,
}

/// What the last sample of a track says of its filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tracking {
    /// The channels of the filter, a bit each.
    pub channels: u32,
    /// Measurements used.
    pub accepted: u64,
    /// Measurements refused.
    pub rejected: u64,
    /// Standard deviation of the acceleration by channel, m/s2 and rad/s2.
    pub acceleration_sd: [f64; 6],
    /// How long such an acceleration lasts, s; 0 where from one measurement to the next.
    pub acceleration_hold_s: f64,
    /// The last gains that were used, by channel: of the position, and of the rate per second.
    pub gains: [[f64; 2]; 6],
}

/// A pose or a track over time, in the order of acquisition.
#[derive(Clone, Debug)]
pub struct Signal {
    /// Its topic.
    pub topic: String,
    /// Its frame.
    pub frame: Option<String>,
    /// What it is to the estimate.
    pub part: Part,
    /// Its samples.
    pub states: Thinned<State>,
    /// Of a track.
    pub tracking: Option<Tracking>,
}

/// Named numbers over time.
#[derive(Clone, Debug, Default)]
pub struct Metrics {
    /// Their topic.
    pub topic: String,
    /// Whether they are durations that the live executor measured.
    pub is_timing: bool,
    /// By name, in the order in which they came first: (stamp in ns, value).
    pub values: Vec<(String, Thinned<(u64, f64)>)>,
}

/// What was said of a sensor, from some time on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Verdict {
    /// The topic.
    pub topic: String,
    /// The sensor.
    pub sensor: String,
    /// `used`, or why not.
    pub reason: String,
    /// Since when, ns.
    pub since: u64,
}

/// A frame that gave no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// The topic that says so.
    pub topic: String,
    /// When, ns.
    pub stamp: u64,
    /// Why.
    pub reason: String,
}

/// A session with what a report needs of it.
pub struct Recording<'s> {
    /// The session.
    pub session: &'s Session,
    /// Where it is.
    pub path: PathBuf,
    /// Who feeds whom.
    pub wiring: Wiring,
    /// First and last time of its journals, ns.
    pub span: [u64; 2],
    /// Poses and tracks, in the order of the session's topics.
    pub signals: Vec<Signal>,
    /// Diagnostics.
    pub metrics: Vec<Metrics>,
    /// What was said of sensors, where it changed.
    pub verdicts: Vec<Verdict>,
    /// Frames that gave no result.
    pub refusals: Thinned<Refusal>,
    /// Why samples could not be read, the first of them; and how many could not.
    pub unreadable: (Vec<String>, u64),
}

impl<'s> Recording<'s> {
    /// Reads a session. What cannot be read of it is counted, and left out.
    pub fn read(session: &'s Session, path: &Path) -> Self {
        let wiring = Wiring::of(session);
        let mut recording = Self {
            session,
            path: path.to_owned(),
            span: span(session),
            signals: Vec::new(),
            metrics: Vec::new(),
            verdicts: Vec::new(),
            refusals: Thinned::default(),
            unreadable: (Vec::new(), 0),
            wiring,
        };
        // By number of the topic: where its samples go.
        let places: Vec<Option<usize>> = session.topics().iter().map(|t| recording.open(t)).collect();
        for recorded in session.samples_where(|t| is_any_of(t, READ)) {
            let said = recorded.map_err(|e| e.to_string()).and_then(|r| {
                let topic = &session.topics()[r.topic];
                recording.take(topic, places[r.topic], &r).map_err(|e| format!("{}: {e}", topic.name))
            });
            if let Err(reason) = said {
                recording.unreadable.1 += 1;
                if recording.unreadable.0.len() < UNREADABLE_SHOWN {
                    recording.unreadable.0.push(reason);
                }
            }
        }
        for signal in &mut recording.signals {
            signal.states.items_mut().sort_by_key(|s| s.origin);
        }
        recording
    }

    /// Makes room for the samples of a topic.
    fn open(&mut self, topic: &Topic) -> Option<usize> {
        if is_any_of(topic, &[Pose::KIND, Track::KIND]) {
            self.signals.push(Signal {
                topic: topic.name.clone(),
                frame: topic.frame.clone(),
                part: self.part(topic),
                states: Thinned::default(),
                tracking: None,
            });
            return Some(self.signals.len() - 1);
        }
        if is_any_of(topic, &[Diagnostics::KIND]) {
            let is_timing = topic.role == TopicRole::Measured;
            self.metrics.push(Metrics { topic: topic.name.clone(), is_timing, values: Vec::new() });
            return Some(self.metrics.len() - 1);
        }
        None
    }

    /// A track that is made of tracks is fused.
    fn part(&self, topic: &Topic) -> Part {
        if is_any_of(topic, &[Pose::KIND]) {
            return if topic.name.ends_with(".truth") { Part::Truth } else { Part::Raw };
        }
        let is_track = |name: &String| {
            self.session.topics().iter().any(|t| t.name == *name && is_any_of(t, &[Track::KIND]))
        };
        let made_of = self.wiring.producer(&topic.name).map_or(&[][..], |(stage, _)| &stage.inputs);
        if made_of.iter().any(is_track) { Part::Fused } else { Part::Filtered }
    }

    fn take(&mut self, topic: &Topic, place: Option<usize>, r: &Recorded) -> Result<(), BytesError> {
        let TopicKind::Known(kind) = topic.kind else { return Ok(()) };
        let pieces = Pieces::split(kind, &r.sample)?;
        let head = pieces.head();
        if *kind == *Pose::KIND {
            let signal = place.and_then(|p| self.signals.get_mut(p));
            if let (Some(signal), Some(pose)) = (signal, pieces.view::<Pose>()?.first()) {
                let sd = std::array::from_fn(|i| pose.covariance[7 * i].sqrt());
                let channels = known(channels(pose.position, pose.orientation), sd);
                let standing = Standing::Measured;
                signal.states.push(State { origin: head.origin, channels, sd, nis: f64::NAN, standing });
            }
        } else if *kind == *Track::KIND {
            let signal = place.and_then(|p| self.signals.get_mut(p));
            if let (Some(signal), Some(track)) = (signal, pieces.view::<Track>()?.first()) {
                let sd = std::array::from_fn(|i| track.covariance[13 * i].sqrt());
                let channels = known(channels(track.position, track.orientation), sd);
                let standing = track.standing();
                signal.states.push(State { origin: head.origin, channels, sd, nis: track.nis, standing });
                let gains = std::array::from_fn(|i| [track.gain[7 * i], track.gain[7 * i + 36]]);
                let before = signal.tracking.map(|t| t.gains).unwrap_or_default();
                signal.tracking = Some(Tracking {
                    channels: track.channels,
                    accepted: track.accepted,
                    rejected: track.rejected,
                    acceleration_sd: track.acceleration_sd,
                    acceleration_hold_s: track.acceleration_hold,
                    gains: if gains == [[0.0; 2]; 6] { before } else { gains },
                });
            }
        } else if *kind == *Diagnostics::KIND {
            if let Some(metrics) = place.and_then(|p| self.metrics.get_mut(p)) {
                for metric in pieces.view::<Diagnostics>()?.elements {
                    metrics.push(metric.name(), head.stamp, metric.value);
                }
            }
        } else if *kind == *Health::KIND {
            for sensor in pieces.view::<Health>()?.elements {
                self.judge(&topic.name, sensor.name(), sensor.reason(), head.stamp);
            }
        } else if *kind == *Rejection::KIND
            && let Some(rejection) = pieces.view::<Rejection>()?.first()
        {
            let reason = rejection.reason().to_owned();
            self.refusals.push(Refusal { topic: topic.name.clone(), stamp: head.stamp, reason });
        }
        Ok(())
    }

    /// Notes a verdict where it differs from the last one on the same sensor.
    fn judge(&mut self, topic: &str, sensor: &str, reason: &str, since: u64) {
        let last = self.verdicts.iter().rev().find(|v| v.topic == topic && v.sensor == sensor);
        if last.is_none_or(|v| v.reason != reason) && self.verdicts.len() < super::thinned::MOST {
            let [topic, sensor, reason] = [topic, sensor, reason].map(str::to_owned);
            self.verdicts.push(Verdict { topic, sensor, reason, since });
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

    /// The signals that are a part of the estimate.
    pub fn signals_of(&self, part: Part) -> impl Iterator<Item = &Signal> {
        self.signals.iter().filter(move |s| s.part == part && !s.states.items().is_empty())
    }

    /// The truth of a frame.
    pub fn truth(&self, frame: &Option<String>) -> Option<&Signal> {
        self.signals_of(Part::Truth).find(|s| s.frame == *frame)
    }

    /// Whether only one of several samples was kept of some topic.
    pub fn is_thinned(&self) -> bool {
        self.signals.iter().any(|s| s.states.stride() > 1)
            || self.metrics.iter().flat_map(|m| &m.values).any(|(_, v)| v.stride() > 1)
    }
}

impl Metrics {
    fn push(&mut self, name: &str, stamp: u64, value: f64) {
        match self.values.iter_mut().find(|(known, _)| known == name) {
            Some((_, values)) => values.push((stamp, value)),
            None => {
                let mut values = Thinned::default();
                values.push((stamp, value));
                self.values.push((name.to_owned(), values));
            }
        }
    }

    /// The numbers of this name.
    pub fn of(&self, name: &str) -> &[(u64, f64)] {
        self.values.iter().find(|(known, _)| known == name).map_or(&[], |(_, values)| values.items())
    }
}

/// The kinds that are read.
const READ: &[&SampleKind] = &[Pose::KIND, Track::KIND, Diagnostics::KIND, Health::KIND, Rejection::KIND];

/// Whether the samples of a topic are of one of these kinds, as this build has them.
pub fn is_any_of(topic: &Topic, kinds: &[&SampleKind]) -> bool {
    matches!(topic.kind, TopicKind::Known(kind) if kinds.iter().any(|k| **k == *kind))
}

/// First and last time of the journals; where there are none, nothing.
fn span(session: &Session) -> [u64; 2] {
    let stamps = || session.journals().values().flatten().map(|e| e.head.stamp).filter(|t| *t < u64::MAX);
    [stamps().min().unwrap_or(0), stamps().max().unwrap_or(0)]
}

/// Position, pitch, roll, yaw.
fn channels(position: [f64; 3], orientation: [f64; 4]) -> [f64; 6] {
    let [w, i, j, k] = orientation;
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    let numbers = PoseNumbers::of(&Isometry3::from_parts(Translation3::from(position), turn));
    let [x, y, z] = position;
    [x, y, z, numbers.pitch, numbers.roll, numbers.yaw]
}

/// A channel of infinite variance is not known.
fn known(channels: [f64; 6], sd: [f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| if sd[i].is_finite() { channels[i] } else { f64::NAN })
}
