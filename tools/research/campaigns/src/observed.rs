//! Access to the outputs of an activation, for the observers of simulated runs.

use nalgebra::Isometry3;
use stillpoint_pipeline::graph::OperatorNode;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_samples::{PoseElement, Sample};

/// The sample that an activation sent on the port of this name.
pub fn output<'a>(
    node: &OperatorNode,
    outputs: &'a [(usize, OwnedSample)],
    port: &str,
) -> Option<&'a OwnedSample> {
    let place = node.stage.kind.outputs.iter().position(|o| o.name == port);
    outputs.iter().find(|(output, _)| Some(*output) == place).map(|(_, owned)| owned)
}

/// The first element of a sample; `None` if the sample is of another type or empty.
pub fn first<S: Sample>(owned: &OwnedSample) -> Option<S::Element> {
    owned.pieces().view::<S>().ok()?.first().copied()
}

/// The transform of a pose.
pub fn isometry(pose: &PoseElement) -> Isometry3<f64> {
    stillpoint_pose::isometry(pose.position, pose.orientation)
}
