//! The observer of a run of the campaign. It compares the capture and the beam with the true pose of the head.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Point3, Vector6};
use serde::Serialize;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Observer, ObserverError};
use stillpoint_pose::PoseNumbers;
use stillpoint_rig::shape::Ellipsoid;
use stillpoint_samples::{
    Entry, FarEnd, Gate, GateReason, Outcome, PointCloud, Pose, PoseReport, PoseStatus, Rejection, Target,
    TargetElement, Track,
};

use super::camera::LATEST;
use super::scene::Case;
use crate::observed::{first, isometry, output};

/// Tolerance of the gate plus the standard deviation that it permits: m, rad.
pub const LIMITS: [f64; 2] = [1.5e-3, 0.8 * std::f64::consts::PI / 180.0];
/// A captured point counts as a point of the head up to this distance outside its surface, m.
const NEAR: f64 = 0.010;
/// Number of true poses that are kept. The figures of a frame need the true pose of its acquisition time.
const REMEMBERED: usize = 200;
/// Time for which a run goes on after the latest time of its event, ns.
const AFTER: u64 = 1_500_000_000;
/// A run without a capture ends at this time, ns. In a scene without a head, the objects of the event appear earlier.
const CAPTURED_BY: u64 = 4_000_000_000;

/// 95 % quantile of chi squared with six degrees of freedom.
pub const REGION_95: f64 = 12.592;

/// Figures of a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Seen {
    /// Fraction of the captured points that lie on the head; `None` without a capture.
    pub purity: Option<f64>,
    /// Number of frames without a face before the capture, by reason, and of captures that the tracker refused.
    pub refusals: BTreeMap<String, u32>,
    /// Time at which the beam was first on, s.
    pub beam_at: Option<f64>,
    /// Total time with the beam on, s.
    pub beam_s: f64,
    /// Time at which the head first passed the limits with the beam on, s.
    pub beyond_at: Option<f64>,
    /// Longest time for which the beam was on after the head had passed the limits, ms.
    pub astray_ms: f64,
    /// Reasons of the gate when it first ended the beam after `beyond_at`.
    pub ended_by: Vec<&'static str>,
    /// Number of frames that the tracker reported as doubted.
    pub doubted: u32,
    /// Last reasons of the gate against the beam.
    pub against: Vec<&'static str>,
    /// Operators with a failed activation.
    pub failed: Vec<String>,
    /// Errors of the measured poses, before the event.
    pub measured: Consistency,
    /// The same of the filtered poses, which the gate uses.
    pub filtered: Consistency,
}

/// The errors of poses in units of their covariance.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Consistency {
    /// Poses with a finite covariance.
    pub poses: u32,
    /// Sum of their normalised estimation errors squared (NEES). 6 for each pose is right.
    pub nees: f64,
    /// Number of poses whose error lies inside the region that should hold 95 % of them.
    pub inside: u32,
}

impl Consistency {
    fn add(&mut self, estimate: &Isometry3<f64>, truth: &Isometry3<f64>, covariance: &Matrix6<f64>) {
        let turn = (estimate.rotation * truth.rotation.inverse()).scaled_axis();
        let shift = estimate.translation.vector - truth.translation.vector;
        let error = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        let nees = covariance.cholesky().map(|c| error.dot(&c.solve(&error))).filter(|nees| nees.is_finite());
        if let Some(nees) = nees {
            self.poses += 1;
            self.nees += nees;
            self.inside += u32::from(nees <= REGION_95);
        }
    }

    /// Adds the poses of another run.
    pub fn join(&mut self, other: &Self) {
        self.poses += other.poses;
        self.nees += other.nees;
        self.inside += other.inside;
    }

    /// Mean NEES; NaN without a pose.
    pub fn mean(&self) -> f64 {
        self.nees / f64::from(self.poses)
    }

    /// Fraction of the poses inside the 95 % region; NaN without a pose.
    pub fn share(&self) -> f64 {
        f64::from(self.inside) / f64::from(self.poses)
    }
}

/// The observer of one run.
pub struct Watch {
    graph: Arc<Graph>,
    couch_from_camera: Isometry3<f64>,
    head: Vec<Ellipsoid>,
    /// Figures of the run so far.
    pub seen: Seen,
    /// Whether the figures are complete, so that the run can end.
    pub is_done: bool,
    /// Last true poses of the head in the couch frame, with their times, ns.
    truths: VecDeque<(u64, Isometry3<f64>)>,
    /// Acquisition time (ns) and points of the last face, in the camera frame.
    face: Option<(u64, Vec<Point3<f64>>)>,
    reference: u32,
    /// True pose of the head when the reference was captured.
    captured: Option<Isometry3<f64>>,
    /// Pose of the tracked point at that time.
    point: Option<Isometry3<f64>>,
    target: Option<TargetElement>,
    /// Time at which the head passed the limits, ns; `None` while it is within them.
    beyond: Option<u64>,
    /// Time of the last state of the far end with the beam on, ns; `None` while the beam is off.
    beam: Option<u64>,
    /// Time at which the beam was first on, ns.
    first_on: Option<u64>,
    gate_was_on: bool,
    /// Time from beam on to the event, ns, and the latest time of the event, ns.
    wait: u64,
    latest: u64,
}

impl Watch {
    /// Makes the observer of the run of a scene. `head` holds the ellipsoids of the head.
    pub fn new(graph: Arc<Graph>, case: &Case, head: Vec<Ellipsoid>) -> Self {
        Self {
            graph,
            couch_from_camera: case.patient.couch_from_camera,
            head,
            seen: Seen::default(),
            is_done: false,
            truths: VecDeque::new(),
            face: None,
            reference: 0,
            captured: None,
            point: None,
            target: None,
            beyond: None,
            beam: None,
            first_on: None,
            gate_was_on: false,
            wait: (case.wait * 1e9) as u64,
            latest: (LATEST * 1e9) as u64,
        }
    }

    fn truth_at(&self, time: u64) -> Option<Isometry3<f64>> {
        self.truths.iter().find(|(at, _)| *at == time).map(|(_, truth)| *truth)
    }

    /// Fraction of the points of the last face that lie on the head at a time, ns; NaN without a face or a true pose.
    fn purity(&self, time: u64) -> f64 {
        let (Some((_, points)), Some(truth)) = (&self.face, self.truth_at(time)) else { return f64::NAN };
        let head_from_camera = truth.inverse() * self.couch_from_camera;
        let is_head = |p: &&Point3<f64>| {
            let place = head_from_camera * **p;
            self.head.iter().any(|part| distance(part, &place) < NEAR)
        };
        points.iter().filter(is_head).count() as f64 / points.len().max(1) as f64
    }

    fn truth(&mut self, time: u64, pose: Isometry3<f64>) {
        self.truths.push_back((time, pose));
        if self.truths.len() > REMEMBERED {
            self.truths.pop_front();
        }
        let is_beyond = match (&self.captured, &self.point, &self.target) {
            (Some(start), Some(point), Some(target)) => is_beyond(&(pose * start.inverse() * point), target),
            _ => false,
        };
        if !is_beyond {
            self.beyond = None;
        } else if self.beyond.is_none() {
            self.beyond = Some(time);
            if self.beam.is_some() && self.seen.beyond_at.is_none() {
                self.seen.beyond_at = Some(time as f64 * 1e-9);
            }
        }
    }

    fn reported(&mut self, owned: &OwnedSample) {
        let Some(report) = first::<PoseReport>(owned) else { return };
        let origin = owned.header().origin;
        match PoseStatus::from_number(report.status) {
            Some(PoseStatus::Doubted) => self.seen.doubted += 1,
            Some(PoseStatus::CaptureRefused) => {
                *self.seen.refusals.entry("the tracker refused the capture".into()).or_default() += 1;
            }
            _ => {}
        }
        if report.reference != self.reference {
            self.reference = report.reference;
            self.seen.purity = Some(self.purity(origin));
            (self.captured, self.point) = (self.truth_at(origin), None);
        }
    }

    /// The true pose of the tracked point at a time before the event, ns.
    fn due(&self, time: u64) -> Option<Isometry3<f64>> {
        let is_before = self.first_on.is_none_or(|on| time < on + self.wait);
        let truth = self.truth_at(time).filter(|_| is_before && time < self.latest)?;
        Some(truth * self.captured?.inverse() * self.point?)
    }

    fn measured(&mut self, owned: &OwnedSample) {
        let (Some(pose), Some(due)) = (first::<Pose>(owned), self.due(owned.header().origin)) else { return };
        let covariance = Matrix6::from_row_slice(&pose.covariance);
        self.seen.measured.add(&isometry(&pose), &due, &covariance);
    }

    fn filtered(&mut self, owned: &OwnedSample) {
        let (Some(track), Some(due)) = (first::<Track>(owned), self.due(owned.header().origin)) else {
            return;
        };
        let covariance = Matrix6::from_fn(|i, j| track.covariance[12 * i + j]);
        let estimate = stillpoint_pose::isometry(track.position, track.orientation);
        if track.run > 0 {
            self.seen.filtered.add(&estimate, &due, &covariance);
        }
    }

    fn far(&mut self, time: u64, is_on: bool) {
        if is_on {
            let before = self.beam.replace(time);
            self.first_on.get_or_insert(time);
            self.seen.beam_at.get_or_insert(time as f64 * 1e-9);
            if let Some(before) = before {
                self.seen.beam_s += (time - before) as f64 * 1e-9;
            }
            if let Some(since) = self.beyond {
                let astray = time.saturating_sub(since) as f64 * 1e-6;
                self.seen.astray_ms = self.seen.astray_ms.max(astray);
            }
        } else {
            self.beam = None;
        }
    }

    fn gate(&mut self, owned: &OwnedSample) {
        let Some(gate) = first::<Gate>(owned) else { return };
        if self.gate_was_on
            && gate.beam == 0
            && self.seen.beyond_at.is_some()
            && self.seen.ended_by.is_empty()
        {
            self.seen.ended_by = GateReason::words(gate.reasons).collect();
        }
        self.gate_was_on = gate.beam == 1;
        if gate.beam == 0 {
            self.seen.against = GateReason::words(gate.reasons).collect();
        }
    }
}

impl Observer for Watch {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        let graph = self.graph.clone();
        let node = &graph.operators[operator];
        if entry.outcome().is_none_or(Outcome::is_failure) {
            self.seen.failed.push(node.name.clone());
        }
        let sent = |port: &str| output(node, outputs, port);
        match node.name.as_str() {
            "patient" => {
                if let Some(owned) = sent("truth")
                    && let Some(pose) = first::<Pose>(owned)
                {
                    let time = owned.header().stamp;
                    self.truth(time, isometry(&pose));
                }
            }
            "face" => {
                if self.reference == 0
                    && let Some(owned) = sent("face")
                    && let Ok(view) = owned.pieces().view::<PointCloud>()
                {
                    let points = view.elements.iter().map(|p| Point3::from(p.xyz.map(f64::from)));
                    self.face = Some((owned.header().origin, points.collect()));
                }
                if self.reference == 0
                    && let Some(rejection) = sent("rejection").and_then(first::<Rejection>)
                {
                    *self.seen.refusals.entry(reason(&rejection)).or_default() += 1;
                }
            }
            "head" => {
                if let Some(owned) = sent("report") {
                    self.reported(owned);
                }
                if let Some(owned) = sent("pose")
                    && let (None, Some(start)) = (&self.point, &self.captured)
                    && let Some(truth) = self.truth_at(owned.header().origin)
                {
                    let pose = first::<Pose>(owned).map(|p| isometry(&p));
                    self.point = pose.map(|pose| start * truth.inverse() * pose);
                } else if let Some(owned) = sent("pose") {
                    self.measured(owned);
                }
            }
            "filter" => {
                if let Some(owned) = sent("state") {
                    self.filtered(owned);
                }
            }
            "target" => self.target = sent("reference").and_then(first::<Target>).or(self.target),
            "gate" => {
                if let Some(owned) = sent("state") {
                    self.gate(owned);
                }
            }
            "far" => {
                if let Some(owned) = sent("state")
                    && let Some(state) = first::<FarEnd>(owned)
                {
                    let time = owned.header().stamp;
                    self.far(time, state.beam == 1);
                    // The event comes within a second of the first beam.
                    self.is_done = self.first_on.is_some_and(|on| time > on + 1_000_000_000 + AFTER)
                        || (self.reference == 0 && time > CAPTURED_BY);
                }
            }
            _ => {}
        }
        if self.is_done { Err(ObserverError::Enough("seen".to_owned())) } else { Ok(()) }
    }
}

/// The reason of a rejection, without its numbers.
fn reason(rejection: &stillpoint_samples::RejectionElement) -> String {
    match rejection.code {
        1 => "too few voxels in range",
        2 => "no plane",
        3 => "no cluster",
        4 => "nothing of a head's size",
        5 => "nothing certain enough",
        6 => "ambiguous",
        _ => "another reason",
    }
    .into()
}

/// Whether a pose is farther from the target than the limits in a channel that the target holds.
fn is_beyond(pose: &Isometry3<f64>, target: &TargetElement) -> bool {
    let now = PoseNumbers::of(pose);
    let angles = [now.pitch, now.roll, now.yaw];
    (0..3).any(|i| {
        let holds = |channel: usize| target.channels >> channel & 1 == 1;
        (holds(i) && (now.position[i] - target.position[i]).abs() > LIMITS[0])
            || (holds(i + 3) && (angles[i] - target.angles[i]).abs() > LIMITS[1])
    })
}

/// First-order distance of a point from the surface of an ellipsoid, m; negative inside.
fn distance(shape: &Ellipsoid, place: &Point3<f64>) -> f64 {
    let p = shape.parent_from_shape().inverse_transform_point(place).coords;
    let unit = p.component_div(shape.semi_axes());
    let gradient = unit.component_div(shape.semi_axes()).norm();
    let level = unit.norm();
    if gradient > 0.0 { level * (level - 1.0) / gradient } else { -shape.semi_axes().min() }
}
