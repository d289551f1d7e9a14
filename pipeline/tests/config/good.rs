//! Good files become graphs.

use stillpoint_operator::Policy;
use stillpoint_pipeline::config::check;
use stillpoint_pipeline::graph::{Graph, Priority, Record, Restart};

use crate::disk::Disk;
use crate::kinds::registry;

/// The good files, by name.
pub const FILES: &[(&str, &str)] = &[
    ("head.yaml", include_str!("../good/head.yaml")),
    ("fusion.yaml", include_str!("../good/fusion.yaml")),
    ("images.yaml", include_str!("../good/images.yaml")),
    ("apart.yaml", include_str!("../good/apart.yaml")),
    ("hosts.yaml", include_str!("../good/hosts.yaml")),
    ("ros2.yaml", include_str!("../good/ros2.yaml")),
];

/// The graph of a good file.
pub fn graph(name: &str) -> Graph {
    let text = FILES.iter().find(|(n, _)| *n == name).unwrap().1;
    match check(text, name, &[], &registry(), &Disk) {
        Ok(graph) => graph,
        Err(faults) => panic!("{faults}"),
    }
}

#[test]
fn good_files_become_graphs() {
    for (name, _) in FILES {
        graph(name);
    }
}

#[test]
fn operators_stand_upstream_first_and_ties_in_the_order_of_the_file() {
    let graph = graph("head.yaml");
    let names: Vec<&str> = graph.operators.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["rig", "console", "cloud", "face", "head", "filter", "target", "mrac"]);
}

#[test]
fn an_edge_with_a_delay_closes_a_cycle() {
    let graph = graph("head.yaml");
    let edge = graph.operators[graph.operator("rig").unwrap()].inputs[0].edge.unwrap();
    assert_eq!(edge.operator, graph.operator("mrac").unwrap());
    assert_eq!(edge.delay, 2_000_000);
}

#[test]
fn each_operator_is_in_one_process_and_members_stand_upstream_first() {
    let graph = graph("head.yaml");
    let names: Vec<&str> = graph.processes.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["perception", "control", "rig", "console"]);
    let perception: Vec<&str> =
        graph.processes[0].operators.iter().map(|i| graph.operators[*i].name.as_str()).collect();
    assert_eq!(perception, ["cloud", "face", "head", "filter"]);
    for (number, process) in graph.processes.iter().enumerate() {
        assert!(process.operators.iter().all(|o| graph.operators[*o].process == number));
    }
    let control = &graph.processes[1];
    assert_eq!(control.restart, Restart::OnFault { limit: 3, backoff: 50_000_000 });
    assert_eq!((control.core, control.priority), (Some(1), Priority::Fifo(50)));
    assert_eq!(graph.processes[0].priority, Priority::FifoIfAllowed(20));
}

#[test]
fn frames_pass_through_and_a_key_names_another() {
    let graph = graph("head.yaml");
    let frame = |topic: &str| {
        let (o, p) = graph.topic(topic).unwrap();
        graph.operators[o].outputs[p].frame.clone()
    };
    assert_eq!(frame("face.face").as_deref(), Some("camera"));
    assert_eq!(frame("face.diagnostics"), None);
    assert_eq!(frame("head.pose").as_deref(), Some("couch"));
    assert_eq!(frame("filter.state").as_deref(), Some("couch"));
    let head = &graph.operators[graph.operator("head").unwrap()];
    assert_eq!(head.inputs[0].frame.as_deref(), Some("camera"));
}

#[test]
fn policies_come_from_the_config_else_from_the_kind() {
    let head = graph("head.yaml");
    let filter = &head.operators[head.operator("filter").unwrap()];
    assert_eq!(filter.inputs[0].policy, Policy::Queue(2));
    let fusion = graph("fusion.yaml");
    let fused = &fusion.operators[fusion.operator("fused").unwrap()].inputs;
    let sync = |within| Policy::Sync { within };
    assert_eq!((fused[1].policy, fused[1].sync_leader), (sync(5_000_000), Some(0)));
    assert_eq!((fused[2].policy, fused[2].edge), (Policy::Latest, None));
    let checked = &fusion.operators[fusion.operator("checked").unwrap()].inputs;
    for input in checked {
        assert_eq!((input.policy, input.sync_leader), (sync(2_000_000), Some(0)));
    }
}

#[test]
fn times_latencies_seed_and_record_are_read() {
    let graph = graph("head.yaml");
    let head = &graph.operators[graph.operator("head").unwrap()];
    assert_eq!((head.latency, head.deadline), (4_000_000, Some(30_000_000)));
    assert_eq!(graph.seed, 7);
    assert_eq!(graph.record, Record::Topics(vec!["filter.state".into(), "head.pose".into()]));
}

#[test]
fn files_that_parameters_name_are_listed() {
    let head = graph("head.yaml");
    assert_eq!(head.operators[head.operator("face").unwrap()].files, ["models/face.onnx"]);
    let images = graph("images.yaml");
    assert_eq!(images.operators[0].files, ["captures/*.png"]);
}

#[test]
fn a_file_of_windows_lines_and_other_letters_is_read() {
    let text = "stillpoint: 1\r\nname: caf\u{e9}\r\noperators: { c: { use: console } }\r\n";
    let faults = check(text, "a.yaml", &[], &registry(), &Disk).err().unwrap();
    assert_eq!(faults.list().len(), 1, "{faults}");
    assert_eq!((faults.list()[0].span.line, faults.list()[0].span.column), (2, 7));
}
