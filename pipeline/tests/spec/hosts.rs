//! A pipeline in parts.

use std::net::SocketAddr;

use stillpoint_pipeline::graph::{Graph, Record, Wire};
use stillpoint_pipeline::spec::{Faults, Machine, check, check_for};
use stillpoint_samples::{DepthImage, Sample};

use crate::disk::Disk;
use crate::kinds::registry;

const TEXT: &str = include_str!("../good/apart.yaml");

fn part(host: &str) -> Result<Graph, Faults> {
    check(TEXT, "apart.yaml", &[format!("host={host}")], &registry(), &Disk)
}

fn names(graph: &Graph) -> Vec<&str> {
    graph.operators.iter().map(|o| o.name.as_str()).collect()
}

fn wire() -> Wire {
    Wire::Tcp(SocketAddr::from(([127, 0, 0, 1], 5007)))
}

#[test]
fn a_part_has_the_operators_of_its_host_and_the_wires_to_the_others() {
    let rig = part("rig").ok().unwrap();
    assert_eq!((rig.name.as_str(), names(&rig)), ("apart-rig", vec!["rig"]));
    assert_eq!(rig.operators[0].outputs[0].links, [wire()]);
    assert_eq!(rig.record, Record::Topics(vec!["rig.truth".to_owned()]));

    let main = part("main").ok().unwrap();
    assert_eq!((main.name.as_str(), names(&main)), ("apart", vec!["console", "rig_depth", "cloud", "face"]));
    let far = &main.operators[1];
    assert_eq!((far.far_end, far.inputs[0].edge.is_some()), (Some(wire()), false));
    for (number, process) in main.processes.iter().enumerate() {
        assert!(process.operators.iter().all(|o| main.operators[*o].process == number));
    }
    let cloud = main.operator("cloud").unwrap();
    assert_eq!(main.operators[cloud].inputs[0].edge.unwrap().operator, 1);
}

#[test]
fn a_far_end_of_a_stream_has_type_frame_and_room_of_what_is_sent() {
    for graph in [check(TEXT, "apart.yaml", &[], &registry(), &Disk), part("main")] {
        let graph = graph.ok().unwrap();
        let far = &graph.operators[graph.operator("rig_depth").unwrap()];
        assert_eq!(*far.stage.kind.outputs[0].sample, *DepthImage::KIND);
        assert_eq!(far.outputs[0].frame.as_deref(), Some("camera"));
        let whole = check(TEXT, "apart.yaml", &[], &registry(), &Disk).ok().unwrap();
        let room = whole.operators[whole.operator("rig").unwrap()].outputs[0].capacity;
        assert_eq!(far.outputs[0].capacity, room);
    }
}

#[test]
fn a_part_asks_its_machine_only_for_what_it_needs_itself() {
    let machine = Machine::with_cores([0, 1]);
    let on = |host: &str| {
        check_for(&machine, TEXT, "apart.yaml", &[format!("host={host}")], &registry(), &Disk).is_ok()
    };
    assert!(on("main"));
    assert!(!on("rig"));
}

#[test]
fn a_host_that_nothing_runs_on_is_refused_with_the_nearest_name() {
    let said = part("rigg").err().unwrap().to_string();
    assert!(said.contains("host=rigg") && said.contains("did you mean `rig`?"), "{said}");
}
