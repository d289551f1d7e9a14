//! A pipeline in parts.

use std::net::SocketAddr;

use serde_json::{Value, json};
use stillpoint_pipeline::config::{Faults, Machine, check, check_for};
use stillpoint_pipeline::graph::{Graph, Record, Wire};
use stillpoint_pipeline::ledger::Ledger;
use stillpoint_pipeline::live::bridge::{BridgeAccounts, BridgeReport};
use stillpoint_samples::{DepthImage, Entry, Header, JournalBody, JournalRef, RefKind, Sample};

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
    Wire::Udp(SocketAddr::from(([127, 0, 0, 1], 5005)))
}

#[test]
fn a_part_has_the_operators_of_its_host_and_the_wires_to_the_others() {
    let main = part("main").ok().unwrap();
    assert_eq!((main.name.as_str(), names(&main)), ("apart", vec!["console", "valves"]));
    assert_eq!(main.operators[1].outputs[0].links, [wire()]);
    assert_eq!(main.record, Record::Topics(vec!["valves.datagram".to_owned()]));

    let rig = part("rig").ok().unwrap();
    assert_eq!((rig.name.as_str(), names(&rig)), ("apart-rig", vec!["rig", "valves_datagram", "far"]));
    let far = &rig.operators[1];
    assert_eq!((far.far_end, far.inputs[0].edge.is_some()), (Some(wire()), false));
    for (number, process) in rig.processes.iter().enumerate() {
        assert!(process.operators.iter().all(|o| rig.operators[*o].process == number));
    }
    assert_eq!(rig.operators[2].inputs[0].edge.unwrap().operator, 1);
}

#[test]
fn a_far_end_of_another_host_has_type_frame_and_room_of_what_is_sent() {
    for graph in [of_hosts(&[]), of_hosts(&["host=cluster"])] {
        let far = &graph.operators[graph.operator("rig_depth_cluster").unwrap()];
        assert_eq!(*far.stage.kind.outputs[0].sample, *DepthImage::KIND);
        assert_eq!(far.outputs[0].frame.as_deref(), Some("camera"));
        let whole = of_hosts(&[]);
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
    let message = part("rigg").err().unwrap().to_string();
    assert!(message.contains("host=rigg") && message.contains("did you mean `rig`?"), "{message}");
}

const HOSTS: &str = include_str!("../good/hosts.yaml");

fn of_hosts(sets: &[&str]) -> Graph {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    check(HOSTS, "hosts.yaml", &sets, &registry(), &Disk).ok().unwrap()
}

#[test]
fn an_edge_between_hosts_is_an_operator_of_the_host_that_takes_it() {
    let whole = of_hosts(&[]);
    let far = whole.operator("rig_depth_cluster").unwrap();
    assert_eq!(*whole.operators[far].stage.kind.outputs[0].sample, *DepthImage::KIND);
    assert_eq!(whole.operators[far].outputs[0].frame.as_deref(), Some("camera"));
    let cloud = whole.operator("cloud").unwrap();
    assert_eq!(whole.operators[cloud].inputs[0].edge.unwrap().operator, far);
    assert_eq!(whole.operators[far].process, whole.operators[cloud].process);
    // One program runs both hosts: the edge stays, and no bridge is needed.
    let live = whole.live();
    assert!(live.operators[far].inputs[0].edge.is_some());
    assert!(!live.has_bridge());
}

#[test]
fn a_part_has_a_bridge_and_knows_what_leaves_and_what_arrives() {
    let bedside = of_hosts(&["host=bedside"]);
    assert_eq!(
        (bedside.name.as_str(), names(&bedside)),
        ("two-hosts-bedside", vec!["rig", "face_face_bedside"])
    );
    let left: Vec<(usize, String)> = bedside.leaves().map(|(operator, _, edge)| (operator, edge)).collect();
    assert_eq!(left, [(0, "rig_depth_cluster".to_owned())]);
    assert_eq!(bedside.arrives().collect::<Vec<_>>(), [1]);
    assert_eq!(bedside.operators[1].outputs[0].capacity, {
        let cluster = of_hosts(&["host=cluster"]);
        cluster.operators[cluster.operator("face").unwrap()].outputs[0].capacity
    });
    let bridge = bedside.processes.last().unwrap();
    assert_eq!((bridge.name.as_str(), bridge.operators.len()), ("bridge", 0));
    let part = bedside.part.as_ref().unwrap();
    assert_eq!((part.host.as_str(), part.pipeline.as_str()), ("bedside", "two-hosts"));
    assert_eq!(bedside.hosts[0].connect, ["tcp/127.0.0.1:7447"]);
    let cluster = of_hosts(&["host=cluster"]);
    assert_eq!(names(&cluster), ["rig_depth_cluster", "cloud", "face"]);
}

/// An entry of an operator that has sent so many samples on its first output.
fn entry_of(sent: u64) -> Entry {
    let header = Header { stamp: 1, origin: 1, sequence: 0, incarnation: 0, count: 1 };
    let output = JournalRef { total: sent, kind: RefKind::Output as u32, ..JournalRef::default() };
    Entry { header, body: JournalBody::default(), refs: vec![output] }
}

#[test]
fn the_ledger_accounts_for_every_sample_over_the_death_of_a_bridge() {
    let graph = of_hosts(&["host=bedside"]);
    let mut ledger = Ledger::default();
    // The camera sent 100 images, and 7 answers came to the operator that takes them.
    ledger.enter(0, &entry_of(100));
    ledger.enter(1, &entry_of(7));
    let mut bridge = BridgeAccounts::default();
    let life = |taken: Value, sent: Value, arrived: u64, landed: u64| -> BridgeReport {
        let depth = (0..graph.operators[0].outputs.len()).find(|p| graph.leaves().any(|(_, q, _)| q == *p));
        serde_json::from_value(json!({
            "leaves": [{ "operator": 0, "port": depth, "taken": [[0, taken]], "edges": [["rig_depth_cluster", sent]] }],
            "is_last": landed == 3,
            "arrives": [{
                "operator": 1, "edge": "face_face_bedside", "landed": landed, "pool_exhausted": 0,
                "network": { "received": arrived, "refused": 1, "lost": 2 },
            }],
        }))
        .unwrap()
    };
    let first = json!({ "offered": 40, "replaced": 5, "unheard": 4, "put": 31, "waiting": 0, "received": 28, "refused": 1 });
    let second = json!({ "offered": 30, "replaced": 0, "unheard": 0, "put": 30, "waiting": 0, "received": 30, "refused": 0 });
    bridge.begin();
    // Numbers 0 to 44, of which 5 were pushed out.
    bridge.enter(life(json!({ "last": 44, "total": 40, "lost": 5 }), first, 5, 5));
    bridge.begin();
    bridge.enter(life(json!({ "last": 89, "total": 30, "lost": 0 }), second, 3, 3));
    let lines = bridge.lines(&graph, &mut ledger);
    assert!(lines.iter().all(|line| line.balances()), "{lines:?}");
    let [memory, network, back] = lines.as_slice() else { panic!("{lines:?}") };
    assert_eq!((memory.topic.as_str(), memory.consumer.as_str()), ("rig.depth", "bridge"));
    assert_eq!(
        (memory.sent, memory.received, memory.overwritten, memory.down, memory.left),
        (100, 70, 5, 15, 10)
    );
    assert_eq!(network.consumer, "bridge.rig_depth_cluster");
    assert_eq!((network.sent, network.received, network.refused, network.lost), (70, 58, 1, 2));
    assert_eq!((network.overwritten, network.unheard), (5, 4));
    assert_eq!(back.consumer, "face_face_bedside.sample");
    assert_eq!((back.sent, back.received, back.overwritten, back.refused, back.lost), (14, 7, 1, 2, 4));

    // A bridge that gave away another number than it took is seen.
    let more = json!({ "offered": 31, "replaced": 0, "unheard": 0, "put": 31, "waiting": 0, "received": 31, "refused": 0 });
    bridge.enter(life(json!({ "last": 89, "total": 30, "lost": 0 }), more, 3, 3));
    let lines = bridge.lines(&graph, &mut ledger);
    assert_eq!(lines.iter().map(|line| line.balances()).collect::<Vec<_>>(), [true, false, true]);
}
