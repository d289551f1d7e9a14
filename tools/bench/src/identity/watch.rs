//! What a run of the campaign showed: the capture, the beam, and where the head truly was.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use nalgebra::{Isometry3, Point3};
use serde::Serialize;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::Observer;
use stillpoint_pose::PoseNumbers;
use stillpoint_rig::shape::Ellipsoid;
use stillpoint_samples::{
    Entry, FarEnd, Gate, GateReason, Outcome, PointCloud, Pose, PoseReport, PoseStatus, Rejection, Target,
    TargetElement,
};

use super::scene::Case;
use crate::observed::{first, isometry, output};

/// What the gate tolerates, and what it lets an estimate be uncertain by, both together: m and rad.
pub const LIMITS: [f64; 2] = [1.5e-3, 0.8 * std::f64::consts::PI / 180.0];
/// A point of a captured face is the head's if it is no farther from its surface, m.
const NEAR: f64 = 0.010;
/// Truths that are remembered until the frame of their time has been judged.
const REMEMBERED: usize = 200;
/// The run goes on for so long after the event, ns.
const AFTER: u64 = 1_500_000_000;
/// Nothing is captured any more that was not captured by then, ns: what comes into a scene without a head does so before.
const CAPTURED_BY: u64 = 4_000_000_000;

/// What a run showed.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Seen {
    /// Part of the captured points that are the head's; nothing where nothing was captured.
    pub purity: Option<f64>,
    /// Why frames before the capture had no face, and captured faces made no reference.
    pub refusals: BTreeMap<String, u32>,
    /// When the beam was first on, s.
    pub beam_at: Option<f64>,
    /// How long it was on, s.
    pub beam_s: f64,
    /// When the head was first beyond the limits with the beam on, s.
    pub beyond_at: Option<f64>,
    /// Longest time that the beam was on while the head was beyond the limits, from the moment it was, ms.
    pub astray_ms: f64,
    /// The reasons that ended the beam first after that moment.
    pub ended_by: Vec<&'static str>,
    /// Frames with a pose that were doubted.
    pub doubted: u32,
    /// The gate's last reasons against the beam.
    pub against: Vec<&'static str>,
    /// Operators of which an activation failed.
    pub failed: Vec<String>,
}

/// Watches a run.
pub struct Watch {
    graph: Arc<Graph>,
    couch_from_camera: Isometry3<f64>,
    head: Vec<Ellipsoid>,
    /// What was seen so far.
    pub seen: Seen,
    /// Set when nothing more is to be seen.
    pub is_done: bool,
    truths: VecDeque<(u64, Isometry3<f64>)>,
    /// The last face: its time and its points in the camera's frame.
    face: Option<(u64, Vec<Point3<f64>>)>,
    reference: u32,
    /// The truth when the reference was taken; then the point that the tracker follows, at that time.
    captured: Option<Isometry3<f64>>,
    point: Option<Isometry3<f64>>,
    target: Option<TargetElement>,
    /// Since when the head is beyond the limits, ns.
    beyond: Option<u64>,
    beam: Option<u64>,
    /// When the beam was first on, ns.
    first_on: Option<u64>,
    gate_was_on: bool,
}

impl Watch {
    /// Of a scene, before its run.
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
        }
    }

    fn truth_at(&self, time: u64) -> Option<Isometry3<f64>> {
        self.truths.iter().find(|(at, _)| *at == time).map(|(_, truth)| *truth)
    }

    /// Part of the last face's points that are the head's.
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
    ) -> Result<(), String> {
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
                    // What happens does so within a second of the first beam.
                    self.is_done = self.first_on.is_some_and(|on| time > on + 1_000_000_000 + AFTER)
                        || (self.reference == 0 && time > CAPTURED_BY);
                }
            }
            _ => {}
        }
        if self.is_done { Err("seen".into()) } else { Ok(()) }
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

/// Whether a pose is farther from the target, in a channel that it holds, than the limits.
fn is_beyond(pose: &Isometry3<f64>, target: &TargetElement) -> bool {
    let now = PoseNumbers::of(pose);
    let angles = [now.pitch, now.roll, now.yaw];
    (0..3).any(|i| {
        let holds = |channel: usize| target.channels >> channel & 1 == 1;
        (holds(i) && (now.position[i] - target.position[i]).abs() > LIMITS[0])
            || (holds(i + 3) && (angles[i] - target.angles[i]).abs() > LIMITS[1])
    })
}

/// Distance of a place from the surface of an ellipsoid, m, to the first order; negative inside.
fn distance(shape: &Ellipsoid, place: &Point3<f64>) -> f64 {
    let p = shape.parent_from_shape().inverse_transform_point(place).coords;
    let unit = p.component_div(shape.semi_axes());
    let gradient = unit.component_div(shape.semi_axes()).norm();
    let level = unit.norm();
    if gradient > 0.0 { level * (level - 1.0) / gradient } else { -shape.semi_axes().min() }
}
