//! A session as traces: where the phantom truly was, where the tracker saw it, and whether the beam was on.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pose::checked_isometry;
use stillpoint_recorder::Session;
use stillpoint_samples::{
    FarEnd, Gate, GateReason, Pieces, Pose, PoseReport, PoseStatus, Sample, SampleKind, Standing, Track, View,
};

use super::figures::Trace;
use crate::exit::Failure;

/// The topics that are read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Topics {
    /// Operator of the rig, where there is one.
    pub rig: Option<String>,
    /// Pose of the phantom by the rig.
    pub truth: Option<String>,
    /// The estimate that the gate judges; without a gate, the first estimate.
    pub track: String,
    /// What the tracker reports.
    pub report: Option<String>,
    /// What the gate says.
    pub gate: Option<String>,
    /// What the far end does.
    pub far: Option<String>,
}

impl Topics {
    /// Those of a pipeline.
    pub fn of(graph: &Graph) -> Result<Self, Failure> {
        let sent = |kind: &'static SampleKind| {
            graph.operators.iter().find_map(|node| {
                let mut ports = node.outputs.iter().zip(node.stage.kind.outputs);
                ports.find(|(_, port)| *port.sample == *kind).map(|(output, _)| output.topic.clone())
            })
        };
        let gate = graph.operators.iter().find(|node| node.stage.kind.name == "gate.beam");
        let judged = gate.and_then(|node| {
            let mut ports = node.inputs.iter().zip(node.stage.kind.inputs);
            let edge =
                ports.find(|(_, port)| *port.sample == *Track::KIND).and_then(|(input, _)| input.edge)?;
            Some(graph.operators[edge.operator].outputs[edge.output].topic.clone())
        });
        let track = judged.or_else(|| sent(Track::KIND)).ok_or_else(|| {
            Failure::wrong("the pipeline has no estimate of a pose: add a tracker and `estimate.kalman`")
        })?;
        let rigs: Vec<_> = graph.operators.iter().filter(|node| is_rig(node.stage.kind.name)).collect();
        if let [first, second, ..] = rigs.as_slice() {
            return Err(Failure::wrong(format!(
                "the pipeline has several rigs ({}, {}): give a pipeline with one",
                first.name, second.name
            )));
        }
        let rig = rigs.first().map(|node| node.name.clone());
        Ok(Self {
            truth: rig.as_ref().map(|name| format!("{name}.truth")),
            rig,
            track,
            report: sent(PoseReport::KIND),
            gate: gate.map(|node| format!("{}.state", node.name)),
            far: sent(FarEnd::KIND),
        })
    }

    /// All of them.
    pub fn all(&self) -> Vec<&str> {
        let some = [&self.truth, &self.report, &self.gate, &self.far].into_iter().flatten();
        some.map(String::as_str).chain([self.track.as_str()]).collect()
    }
}

/// Whether a kind is a rig that can have a phantom.
pub fn is_rig(kind: &str) -> bool {
    kind == "rig.camera" || stillpoint_mechanics::plant::rigs::RigSpec::of_kind(kind).is_some()
}

/// What a session holds of a phantom.
#[derive(Debug, Default)]
pub struct Readings {
    /// Where the phantom was; empty without a rig.
    pub truth: Trace,
    /// Where the tracker saw it.
    pub track: Trace,
    /// Stamps, ns, and whether the beam was on: by the far end, else by the gate.
    pub beam: Vec<(u64, bool)>,
    /// Whether the target holds x, y and z, and pitch, roll and yaw, as the gate judges them.
    pub held: [bool; 6],
    /// Acquisition of the frame that became the reference last, ns.
    pub captured: Option<u64>,
    /// Reasons against the beam after that, each with the number of samples of the gate that have it.
    pub against: BTreeMap<&'static str, u64>,
}

impl Readings {
    /// Reads the topics of a session.
    pub fn of(session: &Session, topics: &Topics) -> Result<Self, Failure> {
        let mut readings = Self::default();
        let (mut gate, mut far) = (Vec::new(), Vec::new());
        let names = topics.all();
        let is = |topic: &Option<String>, name: &str| topic.as_deref() == Some(name);
        for recorded in session.samples_where(|t| names.contains(&t.name.as_str())) {
            let recorded = recorded.map_err(Failure::failed)?;
            let (name, bytes) = (session.topics()[recorded.topic].name.as_str(), &recorded.sample);
            if is(&topics.truth, name) {
                let pose = view::<Pose>(bytes)?;
                readings
                    .truth
                    .extend(pose.header.origin, pose.first().and_then(|p| placed(p.position, p.orientation)));
            } else if name == topics.track {
                let track = view::<Track>(bytes)?;
                let measured = track.first().filter(|t| t.standing() == Standing::Measured);
                let pose = measured.and_then(|t| placed(t.position, t.orientation));
                readings.track.extend(track.header.origin, pose);
            } else if is(&topics.report, name) {
                let report = view::<PoseReport>(bytes)?;
                if report.first().is_some_and(|r| r.status == PoseStatus::Captured as u32) {
                    readings.captured = Some(report.header.origin);
                }
            } else if is(&topics.gate, name) {
                let view = view::<Gate>(bytes)?;
                let Some(element) = view.first() else { continue };
                gate.push((view.header.stamp, element.beam == 1));
                // The reasons before a capture say nothing of it.
                for reason in GateReason::words(element.reasons).filter(|_| readings.captured.is_some()) {
                    *readings.against.entry(reason).or_default() += 1;
                }
                for (held, error) in
                    readings.held.iter_mut().zip(element.position_error.iter().chain(&element.angle_error))
                {
                    *held |= error.is_finite();
                }
            } else {
                let view = view::<FarEnd>(bytes)?;
                far.extend(view.first().map(|state| (view.header.stamp, state.beam == 1)));
            }
        }
        readings.beam = if far.is_empty() { gate } else { far };
        Ok(readings)
    }
}

fn placed(position: [f64; 3], orientation: [f64; 4]) -> Option<Isometry3<f64>> {
    checked_isometry(position, orientation).filter(|_| position.iter().all(|p| p.is_finite()))
}

fn view<S: Sample>(bytes: &[u8]) -> Result<View<'_, S>, Failure> {
    Pieces::split(S::KIND, bytes).and_then(|p| p.view::<S>()).map_err(Failure::failed)
}
