//! What a pipeline publishes to ROS 2 and takes from there.

use stillpoint_pipeline::graph::Wire;

use crate::good::graph;

#[test]
fn each_publication_has_topic_message_and_frame() {
    let graph = graph("ros2.yaml");
    let ros2 = graph.ros2.as_ref().unwrap();
    assert_eq!((ros2.connect.as_str(), ros2.domain), ("tcp/127.0.0.1:7447", 7));
    let published: Vec<_> = ros2
        .publications
        .iter()
        .map(|p| (p.of.as_str(), p.topic.as_str(), p.message.short_name(), p.child.as_str()))
        .collect();
    assert_eq!(
        published,
        [
            ("head.pose", "/head/pose", "PoseWithCovarianceStamped", "head"),
            ("head.pose", "/tf", "TFMessage", "head"),
            ("face.face", "/head/face", "PointCloud2", ""),
            ("rig.depth", "/rig/depth/image", "Image", ""),
            ("rig.depth", "/rig/depth/camera_info", "CameraInfo", ""),
            ("rig.truth", "/tf", "TFMessage", "true_head"),
        ]
    );
}

#[test]
fn only_a_live_run_has_a_bridge_to_ros2() {
    let graph = graph("ros2.yaml");
    let camera = graph.operator("camera").unwrap();
    let links = |graph: &stillpoint_pipeline::graph::Graph, topic: &str| {
        let (operator, port) = graph.topic(topic).unwrap();
        graph.operators[operator].outputs[port].links.clone()
    };
    assert_eq!((graph.operators[camera].far_end, links(&graph, "head.pose")), (None, vec![]));
    let processes = graph.processes.len();
    let live = graph.live();
    assert_eq!(live.operators[camera].far_end, Some(Wire::Ros2));
    assert_eq!(links(&live, "head.pose"), [Wire::Ros2]);
    assert_eq!(links(&live, "filter.state"), []);
    assert_eq!(live.processes.len(), processes + 1);
    assert_eq!(live.processes.last().unwrap().name, "bridge");
    // A second time changes nothing.
    assert_eq!(live.live().processes.len(), processes + 1);
}
