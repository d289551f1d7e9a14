//! Rows of small samples over time: poses, tracks, named numbers, fits, targets, duties, verdicts, refusals.

use serde::Serialize;
use stillpoint_pose::PoseNumbers;
use stillpoint_samples::{
    DutiesElement, GateElement, PoseElement, PoseReportElement, PoseStatus, Proof, Standing, TrackElement,
};

use super::thinned::Thinned;
use crate::target_refusals::Refusals;

/// The role of a pose in the estimation of a head.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseRole {
    /// The true pose of the head.
    Truth,
    Raw,
    Filtered,
    /// A track that is fused from several tracks.
    Fused,
}

/// A pose or a track at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Acquisition time of the data behind it, ns.
    pub origin: u64,
    /// x, y, z in m, pitch, roll, yaw in rad; NaN where not known.
    pub channels: [f64; 6],
    /// Covariance of the position in m and of small rotations about the frame's axes in rad, row by row.
    pub covariance: [f64; 36],
    /// Normalised innovation squared; NaN where nothing was measured.
    pub nis: f64,
    /// What a track stands on; a pose is measured.
    pub standing: Standing,
}

/// The state of a filter in the last sample of its track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tracking {
    /// The channels of the filter, a bit each.
    pub channels: u32,
    pub accepted: u64,
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
    pub topic: String,
    pub frame: Option<String>,
    pub part: PoseRole,
    pub states: Thinned<State>,
    pub tracking: Option<Tracking>,
    /// Of a truth: when, ns, a tracker that is compared with it took another reference. From then on its poses have
    /// another offset.
    pub references: Vec<u64>,
}

/// Named numbers over time.
#[derive(Clone, Debug, Default)]
pub struct Metrics {
    /// Topic of the samples.
    pub topic: String,
    /// Whether they are durations that the live executor measured.
    pub is_timing: bool,
    /// By name, in the order in which they came first: (stamp in ns, value).
    pub values: Vec<(String, Thinned<(u64, f64)>)>,
}

/// What was said of a sensor, from some time on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Verdict {
    pub topic: String,
    pub sensor: String,
    /// `used`, or why not.
    pub reason: String,
    /// Since when, ns.
    pub since: u64,
}

/// Place of what is no [`PoseStatus`] of this build, behind those that are.
pub const UNKNOWN_STATUS: usize = PoseStatus::ALL.len();

/// What a pose estimate said of itself over time.
#[derive(Clone, Debug, Default)]
pub struct Alignments {
    pub topic: String,
    /// Frames by what became of them, in the order of the numbers of a status; the last counts those unknown here.
    pub statuses: [u64; UNKNOWN_STATUS + 1],
    /// Frames in which a direction was refused, by how many.
    pub refused: [u64; 7],
    /// Those that have a fit.
    pub fits: Thinned<Fit>,
    /// Frames whose identity was checked.
    pub sure: Thinned<Sure>,
    /// Why the newest reference is not proven, a code; and how many captures found no face on the reference.
    pub unproven: u32,
    pub without_a_face: u64,
    /// Number of the newest reference, and when, ns, there was another one than before.
    pub reference: (u32, Vec<u64>),
}

/// How well a frame fits the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// When, ns.
    pub origin: u64,
    /// Root mean square of the distances, m.
    pub residual: f64,
    /// Part of the surface that lies on the reference.
    pub overlap: f64,
    pub iterations: u32,
    pub points: u32,
}

/// The confidence that a frame shows what was captured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sure {
    /// Acquisition time, ns.
    pub origin: u64,
    /// The least of the parts, from 0 to 1.
    pub confidence: f64,
    /// The parts, in the order of `IdentityPart`.
    pub certainty: [f64; 5],
    /// The parts of the reference were seen to move together since the capture.
    pub is_proven: bool,
}

/// A target over time.
#[derive(Clone, Debug, Default)]
pub struct TargetTrack {
    pub topic: String,
    pub frame: Option<String>,
    /// (stamp in ns; x, y, z in m, pitch, roll, yaw in rad, NaN where not controlled).
    pub values: Thinned<(u64, [f64; 6])>,
    /// Those that were refused.
    pub refusals: Refusals,
}

/// Duties of valves over time.
#[derive(Clone, Debug, Default)]
pub struct Orders {
    /// Topic of the samples.
    pub topic: String,
    /// How many valves there are.
    pub valves: usize,
    pub values: Thinned<Order>,
}

/// Duties of valves at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// When, ns.
    pub stamp: u64,
    /// Parts of full opening.
    pub duty: [f32; DutiesElement::ROOM],
    /// Valves of which the law asked for more than there is, a bit each.
    pub saturated: u32,
    /// Whether the controller had nothing to act on.
    pub idle: bool,
    /// What was out of order, as bits.
    pub reasons: u32,
}

/// What a gate of the beam said over time.
#[derive(Clone, Debug, Default)]
pub struct Gates {
    pub topic: String,
    /// (stamp in ns, whether the beam may be on, reasons against it).
    pub values: Thinned<(u64, bool, u32)>,
    /// The last word: leases begun, how long the beam was allowed and watched in all, ns.
    pub totals: [u64; 3],
    /// How long the leases were held that ended, ns.
    pub held: Thinned<u64>,
    /// How long the beam had been allowed in all when the present lease began, ns.
    pub begun: Option<u64>,
}

impl Gates {
    /// Takes the next word.
    pub fn take(&mut self, stamp: u64, gate: &GateElement) {
        let is_on = gate.beam != 0;
        match (is_on, self.begun) {
            (true, None) => self.begun = Some(gate.on_for),
            (false, Some(begun)) => {
                self.held.push(gate.on_for.saturating_sub(begun));
                self.begun = None;
            }
            _ => {}
        }
        self.values.push((stamp, is_on, gate.reasons));
        self.totals = [gate.leases, gate.on_for, gate.watched_for];
    }
}

/// Pressures in bladders over time.
#[derive(Clone, Debug, Default)]
pub struct Pressures {
    /// Topic of the samples.
    pub topic: String,
    /// How many bladders there are.
    pub bladders: usize,
    /// (stamp in ns, Pa over the room).
    pub values: Thinned<(u64, [f32; 8])>,
}

/// Contacts of bladders over time.
#[derive(Clone, Debug, Default)]
pub struct Touches {
    /// Topic of the samples.
    pub topic: String,
    /// How many bladders there are.
    pub bladders: usize,
    /// The samples with known forces.
    pub values: Thinned<Touch>,
}

/// The contacts of all bladders at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Touch {
    /// ns.
    pub stamp: u64,
    /// N.
    pub force: [f32; 8],
    /// Of the friction cone, N; NaN where it is not known.
    pub margin: [f32; 8],
    /// Bit i: bladder i pushes with less than the least force.
    pub low: u32,
    /// Bit i: contact i slides.
    pub slides: u32,
}

/// A frame that gave no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RefusedFrame {
    /// The topic that says so.
    pub topic: String,
    /// When, ns.
    pub stamp: u64,
    pub reason: String,
}

impl State {
    /// Of a pose that was acquired at `origin`, ns.
    pub fn of_pose(origin: u64, pose: &PoseElement) -> Self {
        let channels = known(channels(pose.position, pose.orientation), &pose.covariance);
        Self { origin, channels, covariance: pose.covariance, nis: f64::NAN, standing: Standing::Measured }
    }

    /// Of a track at `origin`, ns.
    pub fn of_track(origin: u64, track: &TrackElement) -> Self {
        // The rates stand behind.
        let covariance = std::array::from_fn(|i| track.covariance[i / 6 * 12 + i % 6]);
        let channels = known(channels(track.position, track.orientation), &covariance);
        Self { origin, channels, covariance, nis: track.nis, standing: track.standing() }
    }

    /// Standard deviations of the position in m, and of small rotations about the frame's axes in rad.
    pub fn sd(&self) -> [f64; 6] {
        std::array::from_fn(|i| self.covariance[7 * i].sqrt())
    }
}

impl Tracking {
    /// Of a track; where it used no measurement, with the gains of the one before.
    pub fn of(track: &TrackElement, before: Option<&Self>) -> Self {
        let gains = std::array::from_fn(|i| [track.gain[7 * i], track.gain[7 * i + 36]]);
        let used = gains != [[0.0; 2]; 6];
        Self {
            channels: track.channels,
            accepted: track.accepted,
            rejected: track.rejected,
            acceleration_sd: track.acceleration_sd,
            acceleration_hold_s: track.acceleration_hold,
            gains: if used { gains } else { before.map(|t| t.gains).unwrap_or_default() },
        }
    }
}

impl Alignments {
    /// Whether the tracker never had a reference: it had no pose.
    pub fn is_uncaptured(&self) -> bool {
        self.reference.0 == 0 && self.reference.1.is_empty() && self.statuses.iter().any(|n| *n > 0)
    }

    /// Takes the report of a frame that was acquired at `origin`, ns.
    pub fn take(&mut self, origin: u64, report: &PoseReportElement) {
        let status = PoseStatus::from_number(report.status).map_or(UNKNOWN_STATUS, |s| s as usize);
        self.statuses[status.min(UNKNOWN_STATUS)] += 1;
        self.refused[(report.refused & 63).count_ones() as usize] += 1;
        let (newest, changes) = &mut self.reference;
        if *newest != 0 && *newest != report.reference {
            changes.push(origin);
        }
        *newest = report.reference;
        self.unproven = report.unproven;
        let is_captured = report.status == PoseStatus::Captured as u32;
        self.without_a_face += u64::from(is_captured && report.face == 0);
        if report.confidence.is_finite() {
            self.sure.push(Sure {
                origin,
                confidence: report.confidence,
                certainty: report.certainty,
                is_proven: report.proof == Proof::Proven as u32,
            });
        }
        if report.residual_rms.is_finite() {
            self.fits.push(Fit {
                origin,
                residual: report.residual_rms,
                overlap: report.overlap,
                iterations: report.iterations,
                points: report.points,
            });
        }
    }
}

impl Metrics {
    pub fn push(&mut self, name: &str, stamp: u64, value: f64) {
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

/// Position, pitch, roll, yaw.
fn channels(position: [f64; 3], orientation: [f64; 4]) -> [f64; 6] {
    let numbers = PoseNumbers::of(&stillpoint_pose::isometry(position, orientation));
    let [x, y, z] = position;
    [x, y, z, numbers.pitch, numbers.roll, numbers.yaw]
}

/// A channel of infinite variance is not known.
fn known(channels: [f64; 6], covariance: &[f64; 36]) -> [f64; 6] {
    std::array::from_fn(|i| if covariance[7 * i].is_finite() { channels[i] } else { f64::NAN })
}
