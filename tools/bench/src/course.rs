//! One simulated run of the head on three bladders, from camera to valve, and its figures.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use nalgebra::Isometry3;
use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::placement::Local;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Events, Observer};
use stillpoint_pipeline::spec::check;
use stillpoint_pose::PoseNumbers;
use stillpoint_samples::{
    Actuation, ActuationElement, Entry, FarEnd, FarEndElement, Outcome, Pose, PoseElement, PoseReport,
    PoseStatus, RigState, Target, TargetElement,
};

use stillpoint::Failure;
use stillpoint::{EMBEDDED, EMBEDDED_FILES};

use crate::observed::{first, isometry, output};

/// What seeing takes: nothing is seen before it could be.
const LATENCIES: [&str; 3] = ["cloud.latency=1 ms", "face.latency=12 ms", "head.latency=5 ms"];
/// The dissertation's step: height in mm, pitch and roll in degrees.
pub const STEP: [f64; 3] = [11.5, 1.35, 10.0];
/// A point is kept at most so often, ns.
const KEPT_EVERY: u64 = 20_000_000;
/// How long a lease of the beam lasts, ns.
const LEASE: u64 = 100_000_000;
/// How many truths are remembered until the frame of their time has become a reference.
const REMEMBERED: usize = 400;

/// The trained network of the project, by its path from the pipeline file.
pub const NETWORK: (&str, &[u8]) = (
    "stages/control/data/controller-3dof.safetensors",
    include_bytes!("../../../stages/control/data/controller-3dof.safetensors"),
);

/// A pipeline, what is changed in it, and how long it runs.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The text of the pipeline.
    pub text: String,
    /// Texts of the file and what stands in their place.
    pub changes: Vec<(String, String)>,
    /// `operator.param=value`.
    pub sets: Vec<String>,
    /// Session time, s.
    pub seconds: f64,
}

impl Plan {
    /// A pipeline as it is.
    pub fn of(text: String) -> Self {
        Self { text, changes: Vec::new(), sets: Vec::new(), seconds: 0.0 }
    }

    /// From camera to valve. Seeing takes its time.
    pub fn from_camera_to_valve() -> Self {
        Self { sets: LATENCIES.map(str::to_owned).to_vec(), ..Self::of(EMBEDDED.to_owned()) }
    }
}

/// Where the head was, by the truth, at a moment: height in mm, pitch and roll in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Since the start of the run, s.
    pub time: f64,
    /// How far the point that the tracker follows, and the head, have moved since the reference was taken.
    pub moved: [f64; 3],
    /// Where the target has it less where it was taken.
    pub target: [f64; 3],
    /// The far end has the beam on.
    pub beam: bool,
}

impl Point {
    /// Truth less target.
    pub fn error(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.moved[i] - self.target[i])
    }
}

/// What a run showed.
#[derive(Clone, Debug, Default)]
pub struct Course {
    /// In the order of time, from the first target on.
    pub points: Vec<Point>,
    /// Greatest pressure in a bladder over the room's, Pa: the rig's own, not an estimate.
    pub pressure: f64,
    /// Greatest duty that was sent.
    pub duty: f64,
    /// A duty was sent that is below 0 or no number.
    pub duty_broken: bool,
    /// Duties as sent, added up over valves and time: seconds of a valve wide open.
    pub effort: f64,
    /// Greatest |truth - target| while the beam was on and the target had stood for as long as a lease.
    pub astray: [f64; 3],
    /// What actuation was at, with the seconds in each state.
    pub states: BTreeMap<&'static str, f64>,
    /// Operators of which an activation failed.
    pub failed: Vec<String>,
}

impl Course {
    /// Runs it.
    ///
    /// # Errors
    /// The pipeline lacks a text that is to be changed, or cannot run.
    pub fn of(plan: &Plan, registry: &Registry) -> Result<Self, Failure> {
        let mut text = plan.text.clone();
        for (from, to) in &plan.changes {
            if !text.contains(from) {
                return Err(Failure::failed(format!("the pipeline of the bench lacks `{from}`")));
            }
            text = text.replace(from, to);
        }
        let mut files = MemoryFiles::default();
        let named = EMBEDDED_FILES.iter().chain([&NETWORK]);
        files.files.extend(named.map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec())));
        let graph = check(&text, "bench.yaml", &plan.sets, registry, &files).map_err(Failure::wrong)?;
        let graph = Arc::new(graph);
        let mut watch = Watch::new(graph.clone());
        let mut placement = Local::new(graph.clone(), &files);
        let length = (plan.seconds * 1e9) as u64;
        Events::new(graph).run(&mut placement, 0, length, &mut watch).map_err(Failure::failed)?;
        Ok(watch.course)
    }

    /// When the target last stepped, s.
    pub fn step_at(&self) -> Option<f64> {
        self.points.windows(2).rev().find(|w| w[0].target != w[1].target).map(|w| w[1].time)
    }

    /// The points from a time on, s.
    pub fn since(&self, time: f64) -> &[Point] {
        &self.points[self.points.partition_point(|p| p.time < time)..]
    }
}

/// Greatest |truth - target| of some points; NaN where there are none.
pub fn worst(points: &[Point]) -> [f64; 3] {
    if points.is_empty() {
        return [f64::NAN; 3];
    }
    points.iter().fold([0.0; 3], |most, p| {
        let error = p.error();
        std::array::from_fn(|i| greater(most[i], error[i].abs()))
    })
}

/// The greater of two; NaN where one is, which `max` would pass over.
fn greater(a: f64, b: f64) -> f64 {
    if a.is_nan() || b <= a { a } else { b }
}

/// Truth less the reference model of this rise, which began where the target was before it stepped at `at`; s, and the
/// unit of the channel.
pub fn from_model(point: &Point, channel: usize, at: f64, rise: f64) -> f64 {
    let left = (-(point.time - at) * 9f64.ln() / rise).exp();
    point.error()[channel] + STEP[channel] * left
}

/// Sees the run.
struct Watch {
    graph: Arc<Graph>,
    course: Course,
    /// The truth of the last ticks by its time.
    truths: VecDeque<(u64, Isometry3<f64>)>,
    /// Whether the last frame became the reference, or a part of it.
    capturing: bool,
    /// The truth when the reference was taken, and the point that the tracker follows.
    reference: Option<(Isometry3<f64>, Isometry3<f64>)>,
    target: Option<TargetElement>,
    /// The target as points have it, and since when, ns.
    wanted: Option<(u64, [f64; 3])>,
    beam: bool,
    actuation: Option<(u64, ActuationElement)>,
    kept: Option<u64>,
}

impl Watch {
    fn new(graph: Arc<Graph>) -> Self {
        Self {
            graph,
            course: Course::default(),
            truths: VecDeque::new(),
            capturing: false,
            reference: None,
            target: None,
            wanted: None,
            beam: false,
            actuation: None,
            kept: None,
        }
    }

    fn truth(&mut self, time: u64, pose: &PoseElement) {
        let pose = isometry(pose);
        self.truths.push_back((time, pose));
        if self.truths.len() > REMEMBERED {
            self.truths.pop_front();
        }
        let (Some((start, point)), Some(target)) = (&self.reference, &self.target) else { return };
        // The head's own motion, with the axes of the couch at the place of the tracked point.
        let moved = numbers(&(pose * start.inverse() * point));
        let from = numbers(point);
        let wanted = [target.position[2] * 1e3, target.angles[0].to_degrees(), target.angles[1].to_degrees()];
        let point = Point {
            time: time as f64 * 1e-9,
            moved: std::array::from_fn(|i| moved[i] - from[i]),
            target: std::array::from_fn(|i| wanted[i] - from[i]),
            beam: self.beam,
        };
        if point.target.iter().any(|t| t.is_nan()) {
            return;
        }
        if self.wanted.is_none_or(|(_, target)| target != point.target) {
            self.wanted = Some((time, point.target));
        }
        if self.beam && self.wanted.is_some_and(|(since, _)| time - since > LEASE) {
            let error = point.error();
            self.course.astray = std::array::from_fn(|i| greater(self.course.astray[i], error[i].abs()));
        }
        if self.kept.is_none_or(|kept| time >= kept + KEPT_EVERY) {
            self.kept = Some(time);
            self.course.points.push(point);
        }
    }

    /// A pose of the frame of this time, and what became of the frame.
    fn tracked(&mut self, origin: u64, pose: &PoseElement, report: Option<PoseStatus>) {
        // Where there is no camera there is no report: what is tracked first is the reference.
        let captured = report.map_or(self.reference.is_none(), |r| r == PoseStatus::Captured);
        if captured && !self.capturing {
            let truth = self.truths.iter().find(|(time, _)| *time == origin);
            self.reference = truth.map(|(_, truth)| (*truth, isometry(pose)));
        }
        self.capturing = captured;
    }

    fn actuated(&mut self, time: u64, now: &ActuationElement) {
        for duty in &now.duty {
            self.course.duty = self.course.duty.max(*duty);
            self.course.duty_broken |= duty.is_nan() || *duty < 0.0;
        }
        if let Some((since, before)) = &self.actuation {
            let seconds = time.saturating_sub(*since) as f64 * 1e-9;
            *self.course.states.entry(before.state().word()).or_default() += seconds;
            self.course.effort += before.duty.iter().sum::<f64>() * seconds;
        }
        self.actuation = Some((time, *now));
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
            self.course.failed.push(node.name.clone());
        }
        let sent = |port: &str| output(node, outputs, port);
        match node.name.as_str() {
            "rig" => {
                if let Some(state) = sent("state").and_then(first::<RigState>) {
                    self.course.pressure = state.pressure.iter().copied().fold(self.course.pressure, greater);
                }
                if let Some(truth) = sent("truth") {
                    let time = truth.header().stamp;
                    first::<Pose>(truth).iter().for_each(|pose| self.truth(time, pose));
                }
            }
            "head" => {
                let report = sent("report").and_then(first::<PoseReport>);
                let status = report.and_then(|r| PoseStatus::from_number(r.status));
                if let Some(owned) = sent("pose") {
                    let origin = owned.header().origin;
                    first::<Pose>(owned).iter().for_each(|pose| self.tracked(origin, pose, status));
                }
            }
            "target" => {
                self.target = sent("reference").and_then(first::<Target>).or(self.target);
            }
            "valves" => {
                if let Some(owned) = sent("state") {
                    let time = owned.header().stamp;
                    first::<Actuation>(owned).iter().for_each(|now| self.actuated(time, now));
                }
            }
            "far" => {
                if let Some(state) = sent("state").and_then(first::<FarEnd>) {
                    let FarEndElement { beam, .. } = state;
                    self.beam = beam == 1;
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// Height in mm, pitch and roll in degrees.
fn numbers(pose: &Isometry3<f64>) -> [f64; 3] {
    let n = PoseNumbers::of(pose);
    [n.position[2] * 1e3, n.pitch.to_degrees(), n.roll.to_degrees()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_is_none_is_not_passed_over() {
        assert_eq!([greater(1.0, 2.0), greater(2.0, 1.0)], [2.0; 2]);
        assert!(greater(f64::NAN, 2.0).is_nan() && greater(2.0, f64::NAN).is_nan());
        let point = |moved| Point { time: 0.0, moved, target: [0.0; 3], beam: true };
        let all = worst(&[point([f64::NAN, 1.0, 0.0]), point([0.0, -2.0, 0.0])]);
        assert!(all[0].is_nan() && all[1..] == [2.0, 0.0]);
    }
}
