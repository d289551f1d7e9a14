//! One simulated run of the head on three bladders, from camera to valve, and its figures.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use nalgebra::Isometry3;
use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_pipeline::config::check;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::placement::Local;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Events, Observer, ObserverError};
use stillpoint_pose::PoseNumbers;
use stillpoint_samples::{
    Actuation, ActuationElement, Contacts, Entry, FarEnd, Outcome, Pose, PoseElement, PoseReport, PoseStatus,
    RigState, Target, TargetElement,
};

use stillpoint::Failure;
use stillpoint::{EMBEDDED, EMBEDDED_FILES};

use crate::monitor::Monitor;
use crate::observed::{first, isometry, output};

/// Latencies of perception. Without them a simulated run would know each pose at the acquisition time of its frame.
const LATENCIES: [&str; 3] = ["cloud.latency=1 ms", "face.latency=12 ms", "head.latency=5 ms"];
/// The dissertation's step: height in mm, pitch and roll in degrees.
pub const STEP: [f64; 3] = [11.5, 1.35, 10.0];
/// Minimum time between two kept points, ns.
const RETAINED_EVERY: u64 = 20_000_000;
/// Length of a lease of the beam, ns.
const LEASE: u64 = 100_000_000;
/// Number of true poses that are kept. A reference needs the true pose at the acquisition time of its frame.
const REMEMBERED: usize = 400;

/// The trained network of the project, by its path from the pipeline file.
pub const NETWORK: (&str, &[u8]) = (
    "stages/head/control/data/controller-3dof.safetensors",
    include_bytes!("../../../../stages/head/control/data/controller-3dof.safetensors"),
);

/// A pipeline, its changes, and the length of its run.
#[derive(Clone, Debug)]
pub struct RunSpec {
    /// The text of the pipeline.
    pub text: String,
    /// Replacements in the text: old text and new text.
    pub changes: Vec<(String, String)>,
    /// Parameters that are set: `operator.param=value`.
    pub sets: Vec<String>,
    /// Length of the run in session time, s.
    pub seconds: f64,
}

impl RunSpec {
    /// Plan of a pipeline without changes. The length of its run is 0 s.
    pub fn of(text: String) -> Self {
        Self { text, changes: Vec::new(), sets: Vec::new(), seconds: 0.0 }
    }

    /// Plan of the default pipeline, from camera to valve, with the latencies of perception.
    pub fn from_camera_to_valve() -> Self {
        Self { sets: LATENCIES.map(str::to_owned).to_vec(), ..Self::of(EMBEDDED.to_owned()) }
    }
}

/// True motion of the head, and the target, at one time: height in mm, pitch and roll in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Point {
    /// Time since the start of the run, s.
    pub time: f64,
    /// Motion of the tracked point and of the head since the reference was captured.
    pub moved: [f64; 3],
    /// Target relative to the pose at which the reference was captured.
    pub target: [f64; 3],
    /// Truth minus target in x, y and yaw: mm, mm, degrees; NaN if the target does not have them.
    pub across: [f64; 3],
    /// Whether the far end has the beam on.
    pub beam: bool,
}

impl Point {
    /// Truth minus target: mm, degrees, degrees.
    pub fn error(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.moved[i] - self.target[i])
    }
}

/// Figures of a run.
#[derive(Clone, Debug, Default)]
pub struct Course {
    /// Points in the order of time, from the first target on.
    pub points: Vec<Point>,
    /// Greatest true pressure in a bladder above that of the room, Pa.
    pub pressure: f64,
    /// Force of the bladder that pushed least at any time from the first target on, N; infinity before it.
    pub least_force: f64,
    /// Least distance of a contact of the rig from its friction cone since then, N.
    pub least_margin: f64,
    /// Contacts that slid, and all contacts, summed over the ticks of the rig since then.
    pub sliding: [u64; 2],
    /// Greatest duty that was sent.
    pub duty: f64,
    /// Whether a duty was sent that is below 0 or NaN.
    pub duty_broken: bool,
    /// Sum of the sent duties over valves and time: seconds of one fully open valve.
    pub effort: f64,
    /// Greatest |truth - target| while the beam was on and the target had not changed for the length of a lease: mm,
    /// degrees, degrees.
    pub astray: [f64; 3],
    /// Time in each state of actuation, s, by the name of the state.
    pub states: BTreeMap<&'static str, f64>,
    /// Names of the operators with a failed activation.
    pub failed: Vec<String>,
    /// The rules of beam and valves.
    pub monitor: Monitor,
}

impl Course {
    /// Runs a plan in simulated time.
    ///
    /// # Errors
    /// The pipeline lacks a text that the plan replaces, or it cannot run.
    pub fn of(plan: &RunSpec, registry: &Registry) -> Result<Self, Failure> {
        let mut text = plan.text.clone();
        for (from, to) in &plan.changes {
            if !text.contains(from) {
                return Err(Failure::failed(format!("the pipeline of the campaign lacks `{from}`")));
            }
            text = text.replace(from, to);
        }
        let mut files = MemoryFiles::default();
        let named = EMBEDDED_FILES.iter().chain([&NETWORK]);
        files.files.extend(named.map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec())));
        let graph = check(&text, "campaign.yaml", &plan.sets, registry, &files).map_err(Failure::wrong)?;
        let graph = Arc::new(graph);
        let mut watch = Watch::new(graph.clone());
        let mut placement = Local::new(graph.clone(), &files);
        let length = (plan.seconds * 1e9) as u64;
        Events::new(graph).run(&mut placement, 0, length, &mut watch).map_err(Failure::failed)?;
        Ok(watch.course)
    }

    /// Time of the last change of the target, s.
    pub fn step_at(&self) -> Option<f64> {
        self.points.windows(2).rev().find(|w| w[0].target != w[1].target).map(|w| w[1].time)
    }

    /// Points from this time on, s.
    pub fn since(&self, time: f64) -> &[Point] {
        &self.points[self.points.partition_point(|p| p.time < time)..]
    }
}

/// Greatest |truth - target| of the points: mm, degrees, degrees; NaN if there are none.
pub fn worst(points: &[Point]) -> [f64; 3] {
    if points.is_empty() {
        return [f64::NAN; 3];
    }
    points.iter().fold([0.0; 3], |most, p| {
        let error = p.error();
        std::array::from_fn(|i| greater(most[i], error[i].abs()))
    })
}

/// The greater of two numbers; NaN if one is NaN, which `f64::max` would ignore.
fn greater(a: f64, b: f64) -> f64 {
    if a.is_nan() || b <= a { a } else { b }
}

/// Truth minus reference model in one channel: mm or degrees. The model has the rise time `rise`, s. It starts from the
/// previous target at the time of the step, `at`, s.
pub fn from_model(point: &Point, channel: usize, at: f64, rise: f64) -> f64 {
    let left = (-(point.time - at) * 9f64.ln() / rise).exp();
    point.error()[channel] + STEP[channel] * left
}

/// The lesser of two numbers; NaN if one is NaN.
fn lesser(a: f64, b: f64) -> f64 {
    -greater(-a, -b)
}

/// The observer of a run.
struct Watch {
    graph: Arc<Graph>,
    course: Course,
    /// True poses of the head in the last ticks, with their times, ns.
    truths: VecDeque<(u64, Isometry3<f64>)>,
    /// Whether the last frame became the reference, or a part of it.
    capturing: bool,
    /// True pose of the head when the reference was captured, and pose of the tracked point at that time.
    reference: Option<(Isometry3<f64>, Isometry3<f64>)>,
    target: Option<TargetElement>,
    /// Time of the last change of the target, ns, and the target in the units of a point.
    requested: Option<(u64, [f64; 3])>,
    beam: bool,
    actuation: Option<(u64, ActuationElement)>,
    /// Time of the last kept point, ns.
    retained: Option<u64>,
}

impl Watch {
    fn new(graph: Arc<Graph>) -> Self {
        let of = |operator: usize| graph.operators[operator].params.resolved["dead_band"].as_f64();
        let monitor = Monitor::of(graph.operator("rig").and_then(of).unwrap_or(0.0));
        let course =
            Course { least_force: f64::INFINITY, least_margin: f64::INFINITY, monitor, ..Course::default() };
        Self {
            graph,
            course,
            truths: VecDeque::new(),
            capturing: false,
            reference: None,
            target: None,
            requested: None,
            beam: false,
            actuation: None,
            retained: None,
        }
    }

    fn truth(&mut self, time: u64, pose: &PoseElement) {
        let pose = isometry(pose);
        self.truths.push_back((time, pose));
        if self.truths.len() > REMEMBERED {
            self.truths.pop_front();
        }
        let (Some((start, point)), Some(target)) = (&self.reference, &self.target) else { return };
        // Motion of the head at the tracked point, along and about the axes of the couch.
        let (moved, across) = numbers(&(pose * start.inverse() * point));
        let (from, _) = numbers(point);
        let requested =
            [target.position[2] * 1e3, target.angles[0].to_degrees(), target.angles[1].to_degrees()];
        let paired_median =
            [target.position[0] * 1e3, target.position[1] * 1e3, target.angles[2].to_degrees()];
        let point = Point {
            time: time as f64 * 1e-9,
            moved: std::array::from_fn(|i| moved[i] - from[i]),
            target: std::array::from_fn(|i| requested[i] - from[i]),
            across: std::array::from_fn(|i| across[i] - paired_median[i]),
            beam: self.beam,
        };
        if point.target.iter().any(|t| t.is_nan()) {
            return;
        }
        self.course.monitor.truth(time, point.error());
        if self.requested.is_none_or(|(_, target)| target != point.target) {
            self.requested = Some((time, point.target));
        }
        if self.beam && self.requested.is_some_and(|(since, _)| time - since > LEASE) {
            let error = point.error();
            self.course.astray = std::array::from_fn(|i| greater(self.course.astray[i], error[i].abs()));
        }
        if self.retained.is_none_or(|retained| time >= retained + RETAINED_EVERY) {
            self.retained = Some(time);
            self.course.points.push(point);
        }
    }

    /// Handles a pose, with the acquisition time of its frame, ns, and the tracker's status of the frame.
    fn tracked(&mut self, origin: u64, pose: &PoseElement, report: Option<PoseStatus>) {
        self.course.monitor.measured(origin);
        // A pipeline without a camera sends no report. Its first pose is the reference.
        let captured = report.map_or(self.reference.is_none(), |r| r == PoseStatus::Captured);
        if captured && !self.capturing {
            let truth = self.truths.iter().find(|(time, _)| *time == origin);
            self.reference = truth.map(|(_, truth)| (*truth, isometry(pose)));
        }
        self.capturing = captured;
    }

    fn actuated(&mut self, time: u64, now: &ActuationElement) {
        self.course.monitor.actuation(time, now);
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
    ) -> Result<(), ObserverError> {
        let graph = self.graph.clone();
        let node = &graph.operators[operator];
        if entry.outcome().is_none_or(Outcome::is_failure) {
            self.course.failed.push(node.name.clone());
        }
        let sent = |port: &str| output(node, outputs, port);
        match node.name.as_str() {
            "rig" => {
                if let Some(state) = sent("state").and_then(first::<RigState>) {
                    self.course.monitor.pressures(&state.pressure);
                    self.course.pressure = state.pressure.iter().copied().fold(self.course.pressure, greater);
                    if self.target.is_some() {
                        let forces = state.force.iter().take(state.bladders as usize);
                        self.course.least_force = forces.copied().fold(self.course.least_force, lesser);
                    }
                }
                if let Some(contacts) = sent("contacts").and_then(first::<Contacts>)
                    && self.target.is_some()
                {
                    let margins = contacts.margin.iter().take(contacts.bladders as usize);
                    self.course.least_margin = margins.copied().fold(self.course.least_margin, lesser);
                    self.course.sliding[0] += u64::from(contacts.slides.count_ones());
                    self.course.sliding[1] += u64::from(contacts.bladders);
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
                if let Some(owned) = sent("state") {
                    let time = owned.header().stamp;
                    for state in first::<FarEnd>(owned).iter() {
                        self.course.monitor.far_end(time, state);
                        self.beam = state.beam == 1;
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// Height of a pose in mm, its pitch and roll in degrees; x and y in mm, yaw in degrees.
fn numbers(pose: &Isometry3<f64>) -> ([f64; 3], [f64; 3]) {
    let n = PoseNumbers::of(pose);
    let [x, y, z] = n.position.map(|m| m * 1e3);
    ([z, n.pitch.to_degrees(), n.roll.to_degrees()], [x, y, n.yaw.to_degrees()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_is_none_is_not_passed_over() {
        assert_eq!([greater(1.0, 2.0), greater(2.0, 1.0)], [2.0; 2]);
        assert!(greater(f64::NAN, 2.0).is_nan() && greater(2.0, f64::NAN).is_nan());
        assert_eq!([lesser(1.0, 2.0), lesser(2.0, 1.0)], [1.0; 2]);
        assert!(lesser(f64::NAN, 2.0).is_nan());
        let point = |moved| Point { moved, beam: true, ..Point::default() };
        let all = worst(&[point([f64::NAN, 1.0, 0.0]), point([0.0, -2.0, 0.0])]);
        assert!(all[0].is_nan() && all[1..] == [2.0, 0.0]);
    }
}
