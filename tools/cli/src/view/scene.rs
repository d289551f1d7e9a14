//! The topics that the page shows: the first of each kind that belongs to the holding of a head.

use serde_json::{Value, json};
use stillpoint_operator::frames::Rigid;
use stillpoint_pipeline::console::KIND_NAME;
use stillpoint_pipeline::graph::Graph;
use stillpoint_samples::{
    Actuation, ActuationReason, ActuationState, Gate, GateReason, PointCloud, PoseReport, PoseStatus, Proof,
    Sample, SampleKind, SurfacePieces, Target, Track, Unproven, Verb,
};

use stillpoint_pose::{of_frame, orientation};
use stillpoint_viewer::Place;

use crate::upstream::{image_behind, input_of};

/// Number of an operator and of its output.
pub type Port = (usize, usize);

/// What a topic says of the holding of a head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Says {
    /// Where the head is.
    Estimate,
    /// Where it is to be.
    Target,
    /// Whether the beam may be on.
    Beam,
    /// What actuation is at.
    Valves,
    /// What the tracker reports.
    Tracker,
}

/// The images with the faces found in them.
#[derive(Clone, Debug)]
pub struct Camera {
    /// The images.
    pub image: Port,
    /// Their frame.
    pub frame: Option<String>,
    /// A depth image or a cloud.
    pub kind: &'static SampleKind,
    /// The faces.
    pub face: Option<Port>,
    /// The pieces of the reference, if the tracker sends them.
    pub pieces: Option<Port>,
    /// From the face's frame to that of the image, where they differ.
    pub image_from_face: Option<Rigid>,
    /// From the face's frame to that of the estimate, if it is known.
    pub couch_from_face: Option<Rigid>,
    /// From the image's frame to that of the estimate, if it is known.
    pub couch_from_image: Option<Rigid>,
}

/// What is shown of a pipeline.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The small topics, upstream first.
    pub topics: Vec<(Says, Port)>,
    /// The camera.
    pub camera: Option<Camera>,
    /// The frame of the estimate.
    pub frame: Option<String>,
}

impl Scene {
    /// What a pipeline has to show.
    pub fn of(graph: &Graph) -> Self {
        let first = |kind: &'static SampleKind| {
            (0..graph.operators.len()).find_map(|number| output_of(graph, number, kind))
        };
        let target = first(Target::KIND);
        let aimed = target.and_then(|(operator, _)| input_of(graph, operator, Track::KIND));
        let tracker = first(PoseReport::KIND);
        let found = [
            (Says::Estimate, aimed.or_else(|| first(Track::KIND))),
            (Says::Target, target),
            (Says::Beam, first(Gate::KIND)),
            (Says::Valves, first(Actuation::KIND)),
            (Says::Tracker, tracker),
        ];
        let topics: Vec<(Says, Port)> = found.into_iter().filter_map(|(says, p)| Some((says, p?))).collect();
        let estimate = topics.iter().find(|(says, _)| *says == Says::Estimate).map(|(_, port)| *port);
        let frame = estimate.or(tracker).and_then(|port| frame(graph, port));
        Self { camera: camera(graph, tracker, frame.as_deref()), topics, frame }
    }

    /// What does not change: names, words of numbers, the camera's place.
    pub fn about(&self, graph: &Graph) -> Value {
        let topic = |says: Says| self.topics.iter().find(|(s, _)| *s == says).map(|(_, p)| name(graph, *p));
        let camera = self.camera.as_ref();
        let consoles = graph.operators.iter().filter(|o| o.stage.kind.name == KIND_NAME);
        json!({
            "estimate": topic(Says::Estimate),
            "target": topic(Says::Target),
            "gate": topic(Says::Beam),
            "valves": topic(Says::Valves),
            "tracker": topic(Says::Tracker),
            "image": camera.map(|c| name(graph, c.image)),
            "face": camera.and_then(|c| c.face).map(|port| name(graph, port)),
            "camera": camera.and_then(|c| c.couch_from_image.as_ref()).map(axes),
            "camera_place": camera.and_then(|c| c.couch_from_image.as_ref()).map(placed),
            "frame": self.frame,
            "image_frame": camera.and_then(|c| c.frame.clone()),
            "consoles": consoles.map(|o| o.name.clone()).collect::<Vec<_>>(),
            "verbs": Verb::ALL.iter().map(|(word, _)| *word).collect::<Vec<_>>(),
            "words": {
                "beam": GateReason::ALL,
                "valves": ActuationReason::ALL,
                "states": ActuationState::ALL.iter().map(|(word, s)| (*word, *s as u32)).collect::<Vec<_>>(),
                "tracker": PoseStatus::ALL.iter().map(|(word, s)| (*word, *s as u32)).collect::<Vec<_>>(),
                "unproven": Unproven::ALL.iter().map(|(word, s)| (*word, *s as u32)).collect::<Vec<_>>(),
                "proof": Proof::ALL.iter().map(|(word, s)| (*word, *s as u32)).collect::<Vec<_>>(),
            },
        })
    }
}

/// The name of a topic.
pub fn name(graph: &Graph, (operator, output): Port) -> String {
    graph.operators[operator].outputs[output].topic.clone()
}

/// The first output of an operator that sends this kind.
fn output_of(graph: &Graph, operator: usize, kind: &'static SampleKind) -> Option<Port> {
    let outputs = graph.operators[operator].stage.kind.outputs;
    Some((operator, outputs.iter().position(|o| *o.sample == *kind)?))
}

/// The frame of a topic.
fn frame(graph: &Graph, (operator, output): Port) -> Option<String> {
    graph.operators[operator].outputs[output].frame.clone()
}

fn camera(graph: &Graph, tracker: Option<Port>, couch: Option<&str>) -> Option<Camera> {
    let frame = |port: Port| frame(graph, port);
    let to_couch = |port: Port| graph.frames.transform(couch?, &frame(port)?);
    let face = tracker.and_then(|(operator, _)| input_of(graph, operator, PointCloud::KIND))?;
    let (image, kind) = image_behind(graph, face)?;
    let image_from_face = match (frame(image), frame(face)) {
        (Some(to), Some(from)) if to != from => graph.frames.transform(&to, &from),
        _ => None,
    };
    Some(Camera {
        image,
        frame: frame(image),
        kind,
        face: Some(face),
        pieces: tracker.and_then(|(operator, _)| output_of(graph, operator, SurfacePieces::KIND)),
        image_from_face,
        couch_from_face: to_couch(face),
        couch_from_image: to_couch(image),
    })
}

/// A frame as a pose.
fn placed(rigid: &Rigid) -> Place {
    let pose = of_frame(rigid);
    Place { position: pose.translation.vector.into(), orientation: orientation(&pose.rotation) }
}

/// A frame as its origin and its axes.
fn axes(rigid: &Rigid) -> Value {
    json!({
        "at": rigid.apply([0.0; 3]),
        "x": rigid.rotate([1.0, 0.0, 0.0]),
        "y": rigid.rotate([0.0, 1.0, 0.0]),
        "z": rigid.rotate([0.0, 0.0, 1.0]),
    })
}
