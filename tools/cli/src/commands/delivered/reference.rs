//! The set-up that the poses of a session count from: the surface of the planning CT that its tracker follows.

use nalgebra::{Translation3, Vector3};
use serde_json::Value;
use stillpoint_operator::Registry;
use stillpoint_operator::files::Files;
use stillpoint_patient::case::{Case, content_hash, from_bytes};
use stillpoint_pipeline::graph::{Graph, OperatorNode};
use stillpoint_recorder::Session;
use stillpoint_report::pipeline_of;
use stillpoint_samples::{Pose, Sample, Track};

use crate::exit::Failure;

/// Largest distance between the isocentre of the surface and that of the case, mm.
const SAME_MM: f64 = 1e-3;

/// The reference of the poses.
pub struct Reference {
    /// Topic of the poses.
    pub poses: String,
    /// The tracker.
    pub tracker: String,
    /// File of the surface.
    pub surface: String,
    /// Whether that file is the case of the plan; `None` for a mesh, which names no case.
    pub is_case: Option<bool>,
    /// Place of the machine's isocentre in the couch frame, m.
    pub isocentre: Vector3<f64>,
    /// Couch angle of the session, degrees; 0 where it has no gate.
    pub couch_deg: f64,
    /// From the point whose pose is recorded to the isocentre of the patient.
    pub point_from_isocentre: Translation3<f64>,
}

impl Reference {
    /// Of the poses of this topic, or of those that the gate judges.
    pub fn of(
        session: &Session,
        registry: &Registry,
        poses: Option<&str>,
        case: &Case,
    ) -> Result<Self, Failure> {
        let (graph, files) = pipeline_of(session, registry).map_err(Failure::from)?;
        let recorded: Vec<&str> = session
            .topics()
            .iter()
            .filter(|t| t.kind.kind().is_some_and(|kind| *kind == *Track::KIND || *kind == *Pose::KIND))
            .map(|t| t.name.as_str())
            .collect();
        let poses = match poses {
            Some(name) if recorded.contains(&name) => name.to_owned(),
            Some(name) => {
                return Err(Failure::wrong(format!(
                    "the session has no poses of the topic {name}; it has {}",
                    list(&recorded)
                )));
            }
            None => judged(&graph).filter(|topic| recorded.contains(&topic.as_str())).ok_or_else(|| {
                Failure::wrong(format!(
                    "the session does not record the track that its gate judges; choose the poses with --poses: {}",
                    list(&recorded)
                ))
            })?,
        };
        let tracker = tracker(&graph, &poses)?;
        let params = &tracker.params.resolved;
        let given = &params["reference"];
        let Some(surface) = given["surface"].as_str() else {
            return Err(Failure::wrong(format!(
                "the poses of {poses} count from a capture of {}, not from the planning CT: they are motion since the \
                 capture, and the set-up error at the capture is not known; record the session with `reference: {{ \
                 surface: CASE, isocentre: ... }}` of track.head",
                tracker.name
            )));
        };
        let vector = |value: &Value| {
            let number = |i: usize| value.get(i).and_then(Value::as_f64);
            Some(Vector3::new(number(0)?, number(1)?, number(2)?))
        };
        let bytes = files
            .read(surface)
            .map_err(|e| Failure::failed(format!("the surface {surface} of the session: {e}")))?;
        let is_case = match from_bytes(&bytes) {
            Ok(retained) => {
                let hash = |case: &Case| content_hash(case).map_err(Failure::failed);
                Some(hash(&retained)? == hash(case)?)
            }
            // A mesh.
            Err(_) => None,
        };
        if is_case == Some(false) {
            return Err(Failure::wrong(format!(
                "the tracker {} of the session followed the surface of another case than {}: {surface}",
                tracker.name,
                case.name()
            )));
        }
        if let Some(planned) = vector(&given["planned_isocentre"]) {
            let apart_mm = (1e3 * planned - Vector3::from(case.isocentre_mm())).norm();
            if apart_mm > SAME_MM {
                return Err(Failure::wrong(format!(
                    "`planned_isocentre` of {} is {apart_mm:.3} mm from the isocentre of the case {}",
                    tracker.name,
                    case.name()
                )));
            }
        }
        Ok(Self {
            tracker: tracker.name.clone(),
            surface: surface.to_owned(),
            is_case,
            isocentre: vector(&given["isocentre"]).unwrap_or_default(),
            couch_deg: couch_deg(&graph),
            point_from_isocentre: Translation3::from(vector(&params["point"]).unwrap_or_default()).inverse(),
            poses,
        })
    }
}

/// The first gate.
fn gate(graph: &Graph) -> Option<&OperatorNode> {
    graph.operators.iter().find(|node| node.stage.kind.name == "gate.beam")
}

/// The couch angle that the first gate states, degrees.
fn couch_deg(graph: &Graph) -> f64 {
    let couch = gate(graph).and_then(|gate| gate.params.resolved["couch"].as_f64());
    couch.map_or(0.0, |rad| (rad.to_degrees() * 1e6).round() / 1e6)
}

/// The topic of the track that the first gate judges.
fn judged(graph: &Graph) -> Option<String> {
    let gate = gate(graph)?;
    let port = gate.stage.kind.inputs.iter().position(|input| input.name == "state")?;
    let edge = gate.inputs.get(port)?.edge?;
    Some(graph.operators[edge.operator].outputs[edge.output].topic.clone())
}

/// The tracker from which poses come.
fn tracker<'g>(graph: &'g Graph, poses: &str) -> Result<&'g OperatorNode, Failure> {
    let makes = |node: &OperatorNode| node.outputs.iter().any(|output| output.topic == poses);
    let mut to_visit: Vec<usize> = graph.operators.iter().position(makes).into_iter().collect();
    let mut visited = vec![false; graph.operators.len()];
    while let Some(at) = to_visit.pop() {
        let node = &graph.operators[at];
        if node.stage.kind.name == "track.head" {
            return Ok(node);
        }
        if !std::mem::replace(&mut visited[at], true) {
            // By poses and tracks alone: in a closed loop, everything is upstream of everything.
            let ports = node.inputs.iter().zip(node.stage.kind.inputs);
            let of_poses =
                ports.filter(|(_, port)| *port.sample == *Pose::KIND || *port.sample == *Track::KIND);
            to_visit.extend(of_poses.filter_map(|(input, _)| input.edge).map(|edge| edge.operator));
        }
    }
    Err(Failure::wrong(format!(
        "{poses} does not come from a track.head: its poses have no set-up that a plan knows; choose others with --poses"
    )))
}

fn list(topics: &[&str]) -> String {
    if topics.is_empty() { "none".to_owned() } else { topics.join(", ") }
}
