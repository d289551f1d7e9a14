//! `--set operator.param=value` replaces what the file says, and is checked like it.

use stillpoint_pipeline::config::{Faults, check};
use stillpoint_pipeline::graph::{Graph, Record};

use crate::disk::Disk;
use crate::good::FILES;
use crate::kinds::registry;

fn head_with(sets: &[&str]) -> Result<Graph, Faults> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    check(FILES[0].1, "head.yaml", &sets, &registry(), &Disk)
}

fn resolved(graph: &Graph, name: &str) -> String {
    graph.operators[graph.operator(name).unwrap()].params.resolved.to_string()
}

#[test]
fn a_set_replaces_a_parameter_of_the_file() {
    let graph = head_with(&["face.leaf=5 mm", "face.iterations=9"]).ok().unwrap();
    assert!(resolved(&graph, "face").starts_with(r#"{"leaf":0.005,"plane_tolerance":0.008,"iterations":9,"#));
}

#[test]
fn a_set_reaches_nested_parameters_and_those_of_an_operator_without_any() {
    let graph = head_with(&["target.step.at=500ms", "filter.gate=3"]).ok().unwrap();
    assert!(resolved(&graph, "target").contains(r#""at":500000000"#));
    assert!(resolved(&graph, "filter").contains(r#""gate":3.0"#));
}

#[test]
fn a_set_reaches_the_keys_of_an_operator_and_the_seed() {
    let graph = head_with(&["mrac.every=20 ms", "seed=99"]).ok().unwrap();
    assert_eq!(graph.operators[graph.operator("mrac").unwrap()].every, Some(20_000_000));
    assert_eq!(graph.seed, 99);
}

#[test]
fn a_set_can_give_a_list() {
    let graph = head_with(&["target.step.by=[1 mm, 2 mm, 3 mm]"]).ok().unwrap();
    assert!(resolved(&graph, "target").contains(r#""by":[0.001,0.002,0.003]"#));
}

#[test]
fn a_set_that_begins_with_a_star_is_a_text() {
    let faults = head_with(&["face.model=*.net"]).err().unwrap().to_string();
    assert!(faults.contains("`*.net` cannot be used"), "{faults}");
    assert!(faults.contains("\n  | face.model=*.net\n  |            ^^^^^\n"), "{faults}");
}

#[test]
fn a_faulty_set_is_refused_at_the_argument() {
    for (set, message, help) in [
        (
            "face.leaf=80 mm",
            "`leaf`: `80 mm` is out of range: it must be from 0.5 mm to 50 mm",
            "the nearest allowed value is `50 mm`",
        ),
        (
            "cloud.near=3 m",
            "`far` is 2 m and must be greater than `near`, 3 m",
            "raise `far`, or lower `near`",
        ),
        ("face.laef=4 mm", "segment.face has no parameter `laef`", "did you mean `leaf`?"),
        ("fase.leaf=4 mm", "there is no operator `fase`", "did you mean `face`?"),
        ("face.leaf", "`face.leaf` sets nothing: `=` is missing", "write `--set operator.param=value`"),
        ("face.leaf=", "`face.leaf=` sets no value", "write `--set face.leaf=value`"),
        ("face=4", "`face` names no parameter", "write `--set operator.param=value`"),
        ("face.leaf.x=4", "`leaf` is a text and has no parts", "set the whole of it"),
        (
            "seed=x",
            "the seed `x` is not a whole number from 0 to 18446744073709551615",
            "write a whole number, for example `seed: 7`",
        ),
    ] {
        let faults = head_with(&[set]).err().unwrap();
        let fault = &faults.list()[0];
        assert_eq!((fault.message.as_str(), fault.help.as_str()), (message, help), "{set}");
        assert!(faults.to_string().starts_with(&format!("--set `{set}`: {message}")), "{faults}");
        assert_eq!(faults.to_json()[0]["file"], "--set");
    }
}

fn apart_with(sets: &[&str]) -> Result<Graph, Faults> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    let text = FILES.iter().find(|(name, _)| *name == "apart.yaml").unwrap().1;
    check(text, "apart.yaml", &sets, &registry(), &Disk)
}

#[test]
fn a_set_reaches_links_contracts_frames_processes_and_the_record() {
    let before = apart_with(&[]).ok().unwrap();
    let graph = apart_with(&["links.valves.datagram.delay=9 ms", "links.valves.datagram.udp=127.0.0.1:6001"])
        .ok()
        .unwrap();
    let delays = |graph: &Graph| {
        let edges = graph.operators.iter().flat_map(|o| o.inputs.iter().filter_map(|i| i.edge));
        edges.map(|edge| edge.delay).collect::<Vec<_>>()
    };
    assert_ne!(delays(&before), delays(&graph));
    assert!(delays(&graph).contains(&9_000_000));

    let head = head_with(&["record.topics=all", "frames.camera.at=[1 m, 0 m, 0 m]"]).ok().unwrap();
    assert_eq!(head.record, Record::All);
    assert_eq!(head.frames.placed["camera"].parent_from_frame.translation[0], 1.0);
    let head = head_with(&["contracts=[{ path: rig.depth -> face.face, within: 80 ms }]"]).ok().unwrap();
    assert_eq!(head.contracts.len(), 1);
}

#[test]
fn a_faulty_set_of_a_section_is_refused_at_the_argument() {
    for (set, message) in [
        ("links.valves.datagram.dealy=9 ms", "has no key `dealy`"),
        ("links.valves.datagarm.udp=127.0.0.1:6001", "`datagarm`"),
        ("record.topics=[rig.nothing]", "rig.nothing"),
        ("contracts.within=80 ms", "`contracts`"),
    ] {
        let faults = apart_with(&[set]).err().unwrap().to_string();
        assert!(faults.starts_with("--set `") && faults.contains(message), "{set}: {faults}");
    }
}
