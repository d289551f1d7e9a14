//! All values of a pipeline, and where each came from.

use stillpoint_pipeline::config::{Machine, Resolved, resolve_for};

use crate::disk::Disk;
use crate::good::FILES;
use crate::kinds::registry;

fn resolved(text: &str, sets: &[&str]) -> Resolved {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    let machine = Machine::default().with_variables([("MODELS", "models")]);
    resolve_for(&machine, text, "head.yaml", &sets, &registry(), &Disk)
        .unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn each_value_has_the_place_that_it_came_from() {
    let text = FILES[0].1.replace("models/face.onnx", "\"${MODELS}/face.onnx\"");
    let yaml = resolved(&text, &["face.plane_tolerance=9 mm", "seed=3"]).to_yaml();
    for line in [
        "name: head-3dof  # head.yaml:2",
        "seed: 3  # --set seed=3",
        "    at: [0 mm, -450 mm, 450 mm]  # head.yaml:5",
        "      leaf: 4 mm  # head.yaml:10",
        "      plane_tolerance: 9 mm  # --set face.plane_tolerance=9 mm",
        "      iterations: 500  # default",
        "      model: models/face.onnx  # head.yaml:10, \"${MODELS}/face.onnx\"",
        "        from: head.pose  # head.yaml:12",
        "        queue: 2  # head.yaml:12",
        "    latency: 4 ms  # head.yaml:11",
        "    latency: 0 s  # default",
        "      backoff: 100 ms  # default",
        "      limit: 3  # head.yaml:17",
    ] {
        assert!(yaml.contains(&format!("{line}\n")), "{line}\n{yaml}");
    }
}

#[test]
fn all_values_are_the_same_pipeline_and_nothing_is_left_to_add() {
    for (name, text) in FILES {
        let first = resolved(text, &[]);
        let second = resolved(&first.to_yaml(), &[]);
        let (a, b) = (&first.graph, &second.graph);
        assert_eq!((&a.name, a.seed, &a.frames), (&b.name, b.seed, &b.frames), "{name}");
        assert_eq!(
            (&a.record, &a.contracts, &a.hosts, &a.ros2),
            (&b.record, &b.contracts, &b.hosts, &b.ros2),
            "{name}"
        );
        assert_eq!(format!("{:?}", a.processes), format!("{:?}", b.processes), "{name}");
        for (a, b) in a.operators.iter().zip(&b.operators) {
            assert_eq!(
                (&a.name, a.stage.kind.name, &a.params.resolved),
                (&b.name, b.stage.kind.name, &b.params.resolved),
                "{name}"
            );
            let parts = |o: &stillpoint_pipeline::graph::OperatorNode| {
                format!(
                    "{:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}",
                    o.every, o.latency, o.deadline, o.start_within, o.inputs, o.outputs, o.far_end, o.files
                )
            };
            assert_eq!(parts(a), parts(b), "{name}: {}", a.stage.kind.name);
        }
        assert_eq!(a.operators.len(), b.operators.len());
        assert!(!second.to_yaml().contains("# default"), "{name}: {}", second.to_yaml());
    }
}

#[test]
fn programs_get_the_values_as_a_list() {
    let json = resolved(FILES[0].1, &["face.leaf=5 mm"]).to_json();
    let of = |path: &[&str]| {
        let all = json.as_array().unwrap();
        all.iter().find(|value| value["path"] == serde_json::json!(path)).cloned().unwrap_or_default()
    };
    let leaf = of(&["operators", "face", "params", "leaf"]);
    assert_eq!(
        leaf,
        serde_json::json!({
            "path": ["operators", "face", "params", "leaf"], "value": "5 mm", "from": "argument", "argument": "face.leaf=5 mm",
        })
    );
    assert_eq!(of(&["operators", "face", "params", "iterations"])["from"], "default");
    let at = of(&["frames", "camera", "at"]);
    assert_eq!(
        (&at["from"], &at["file"], at["line"].as_u64()),
        (&"file".into(), &"head.yaml".into(), Some(5))
    );
    assert_eq!(at["value"], serde_json::json!(["0 mm", "-450 mm", "450 mm"]));
}
