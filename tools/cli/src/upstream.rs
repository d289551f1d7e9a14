//! What feeds an operator: the images behind a face.

use stillpoint_pipeline::graph::Graph;
use stillpoint_samples::{DepthImage, PointCloud, Sample, SampleKind};

/// The output that feeds the first connected input of a kind.
pub fn input_of(graph: &Graph, operator: usize, kind: &SampleKind) -> Option<(usize, usize)> {
    let node = &graph.operators[operator];
    let ports = node.stage.kind.inputs.iter().zip(&node.inputs);
    let edge = ports.filter(|(port, _)| *port.sample == *kind).find_map(|(_, input)| input.edge)?;
    Some((edge.operator, edge.output))
}

/// The nearest depth image upstream of a face; if there is none, the nearest cloud.
pub fn image_behind(graph: &Graph, face: (usize, usize)) -> Option<((usize, usize), &'static SampleKind)> {
    let mut clouds = None;
    let mut at = face.0;
    // Each step goes upstream, and a cycle ends at the number of operators.
    for _ in 0..graph.operators.len() {
        if let Some(image) = input_of(graph, at, DepthImage::KIND) {
            return Some((image, DepthImage::KIND));
        }
        let Some(cloud) = input_of(graph, at, PointCloud::KIND) else { break };
        clouds = Some((cloud, PointCloud::KIND));
        at = cloud.0;
    }
    clouds
}
