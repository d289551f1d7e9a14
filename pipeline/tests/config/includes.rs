//! Pipelines out of several files.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_pipeline::config::{Composed, Faults, Machine, check, compose_for};
use stillpoint_pipeline::graph::{Graph, Record};

use crate::kinds::registry;

pub const OWN: &str = "\
stillpoint: 1
name: own
seed: 9
include:
  - { file: parts/tracking.yaml, with: { leaf: 5 mm, image: rig.depth } }
frames:
  camera: { parent: couch, at: [0 mm, -450 mm, 450 mm], rotation: [45 deg, 0 deg, 0 deg] }
operators:
  rig: { use: rig.three_bladders, every: 33 ms }
contracts:
  - { path: rig.depth -> head.pose, within: 300 ms }
";

pub const TRACKING: &str = "\
stillpoint: 1
seed: 3
include: ../console.yaml
parameters:
  image: cloud.inputs.image
  leaf: face.leaf
  periods: [images.every]
operators:
  cloud: { use: ingest.depth, frame: camera }
  face: { use: segment.face, inputs: { cloud: cloud.cloud }, params: { leaf: 4 mm, plane_tolerance: 8 mm, model: models/face.onnx } }
  head: { use: track.head, inputs: { face: face.face, command: console.capture }, frame: couch }
  images: { use: ingest.images, every: 33 ms, frame: camera, params: { images: ../captures, weights: [0.5, 2] } }
processes:
  perception: [cloud, face, head]
record: { topics: all }
contracts:
  - { path: rig.depth -> face.face, within: 200 ms }
";

const CONSOLE: &str = "stillpoint: 1\noperators: { console: { use: console } }\n";

pub fn files(own: &[(&str, &str)]) -> MemoryFiles {
    let all = [
        ("parts/tracking.yaml", TRACKING),
        ("console.yaml", CONSOLE),
        ("parts/models/face.onnx", ""),
        ("parts/../captures/000.png", ""),
    ];
    let mut files: MemoryFiles = MemoryFiles {
        files: all
            .iter()
            .chain(own)
            .map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec()))
            .collect(),
    };
    files.files.retain(|_, bytes| bytes != b"none");
    files
}

fn composed(own: &str, further: &[(&str, &str)], sets: &[&str]) -> Result<Composed, Faults> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    let machine = Machine::default().with_variables([("PARTS", "parts")]);
    compose_for(&machine, own, "conf/own.yaml", &sets, &registry(), &files(further))
}

fn good(own: &str, sets: &[&str]) -> Composed {
    composed(own, &[], sets).unwrap_or_else(|faults| panic!("{faults}"))
}

fn faults(own: &str, further: &[(&str, &str)]) -> String {
    composed(own, further, &[]).err().map_or_else(|| "nothing".to_owned(), |faults| faults.to_string())
}

fn param(graph: &Graph, operator: &str, name: &str) -> String {
    graph.operators[graph.operator(operator).unwrap()].params.resolved[name].to_string()
}

#[test]
fn included_sections_stand_before_the_own_ones_and_values_are_given_by_name() {
    let Composed { graph, .. } = good(OWN, &[]);
    let names: Vec<&str> = graph.operators.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["console", "images", "rig", "cloud", "face", "head"]);
    assert_eq!((graph.name.as_str(), graph.seed), ("own", 9));
    assert_eq!(param(&graph, "face", "leaf"), "0.005");
    assert_eq!(graph.processes[0].name, "perception");
    assert_eq!(graph.contracts.len(), 2);
    assert!(
        matches!(graph.record, Record::All),
        "what an included file says stays where the own file is silent"
    );
}

#[test]
fn paths_of_an_included_file_start_at_its_folder() {
    let Composed { graph, .. } = good(OWN, &[]);
    assert_eq!(param(&graph, "face", "model"), "\"parts/models/face.onnx\"");
    assert_eq!(param(&graph, "images", "images"), "\"parts/../captures/*.png\"");
    // A value that the own file gives is a path from its own folder.
    let tracking = TRACKING.replace("leaf: face.leaf", "leaf: face.leaf\n  model: face.model");
    let own = OWN.replace("leaf: 5 mm", "model: console.yaml");
    let Composed { graph, .. } = composed(&own, &[("parts/tracking.yaml", &tracking)], &[]).ok().unwrap();
    assert_eq!(param(&graph, "face", "model"), "\"console.yaml\"");
}

#[test]
fn the_text_that_a_session_keeps_needs_no_other_file_and_is_the_same_pipeline() {
    for sets in
        [&[][..], &["face.leaf=6 mm", "contracts=[]", "cloud.inputs.image={ from: rig.depth, queue: 2 }"]]
    {
        let composed = good(OWN, sets);
        let names = ["parts/models/face.onnx", "parts/../captures/000.png"];
        let kept = MemoryFiles { files: names.map(|name| (name.to_owned(), Vec::new())).into() };
        let graph = check(&composed.text, "pipeline.yaml", &composed.sets, &registry(), &kept)
            .unwrap_or_else(|faults| panic!("{faults}\n{}", composed.text));
        let resolved = |graph: &Graph| {
            let all = graph.operators.iter().map(|o| (o.name.clone(), o.params.resolved.to_string()));
            all.collect::<Vec<_>>()
        };
        assert_eq!(resolved(&graph), resolved(&composed.graph));
        assert_eq!(composed.included.keys().collect::<Vec<_>>(), ["console.yaml", "parts/tracking.yaml"]);
    }
    let text = good(OWN, &[]).text;
    assert!(
        text.starts_with("# Joined from own.yaml, parts/tracking.yaml, console.yaml.\nstillpoint: 1\n"),
        "{text}"
    );
    assert!(text.contains("\n  face:  # parts/tracking.yaml:10\n"), "{text}");
    assert!(text.contains("\n      leaf: 5 mm  # own.yaml:5\n"), "{text}");
}

#[test]
fn arguments_reach_included_operators_and_are_named_in_their_faults() {
    assert_eq!(param(&good(OWN, &["face.leaf=7 mm"]).graph, "face", "leaf"), "0.007");
    let text = composed(OWN, &[], &["face.leaf=7 ms"]).err().unwrap().to_string();
    assert!(text.starts_with("--set `face.leaf=7 ms`: "), "{text}");
}

#[test]
fn faults_name_the_file_and_line_that_they_are_in() {
    let tracking = TRACKING.replace("plane_tolerance: 8 mm", "plane_tolerance: 8");
    let text = faults(OWN, &[("parts/tracking.yaml", &tracking)]);
    assert!(text.starts_with("conf/parts/tracking.yaml:10:101: `plane_tolerance`: "), "{text}");
    assert!(text.contains(" 10 |   face: { use"), "{text}");
    let text = faults(&OWN.replace("5 mm", "5 ms"), &[]);
    assert!(text.starts_with("conf/own.yaml:5:48: `leaf`: `5 ms`"), "{text}");
    let text = faults(OWN, &[("console.yaml", "stillpoint: 1\noperators: { console: [\n")]);
    assert!(text.starts_with("conf/console.yaml:2:"), "{text}");
}

#[test]
fn a_name_of_two_files_is_refused_with_both_places() {
    let own = OWN.replace("  rig: {", "  face: { use: console }\n  rig: {");
    let text = faults(&own, &[]);
    assert!(
        text.contains("conf/own.yaml:9:3: `operators` has `face` already at conf/parts/tracking.yaml:10:3"),
        "{text}"
    );
}

#[test]
fn what_cannot_be_included_is_refused_at_its_place() {
    for (own, further, place, message) in [
        (
            "parts/nothing.yaml",
            &[][..],
            "conf/own.yaml:5:13: ",
            "`parts/nothing.yaml` cannot be included: there is no such file",
        ),
        ("parts", &[], "conf/own.yaml:5:13: ", "`parts` is not one file"),
        (
            "parts/tracking.yaml",
            &[("console.yaml", "stillpoint: 1\ninclude: parts/tracking.yaml\n")],
            "conf/console.yaml:2:10: ",
            "the file includes itself: conf/parts/tracking.yaml -> conf/console.yaml -> conf/parts/tracking.yaml",
        ),
        (
            "parts/tracking.yaml",
            &[("console.yaml", "stillpoint: 1\ninclude: ./own.yaml\n")],
            "conf/console.yaml:2:10: ",
            "the file includes itself: conf/own.yaml -> conf/parts/tracking.yaml -> conf/console.yaml -> conf/own.yaml",
        ),
        (
            "parts/tracking.yaml",
            &[("console.yaml", "\n")],
            "conf/parts/tracking.yaml:3:10: ",
            "the included file is empty",
        ),
        (
            "parts/tracking.yaml",
            &[("console.yaml", "operators: {}\n")],
            "conf/console.yaml:1:1: ",
            "an included file needs the key `stillpoint`",
        ),
        (
            "parts/tracking.yaml",
            &[("console.yaml", "stillpoint: 1\nframe: 3\n")],
            "conf/console.yaml:2:1: ",
            "a pipeline has no key `frame`",
        ),
    ] {
        let text = faults(&OWN.replace("parts/tracking.yaml", own), further);
        assert!(text.contains(&format!("{place}{message}")), "{text}");
    }
    let twice = OWN.replacen("  - {", "  - ./console.yaml\n  - {", 1);
    let text = faults(&twice, &[]);
    assert!(
        text.starts_with(
            "conf/parts/tracking.yaml:3:10: `conf/console.yaml` is included at conf/own.yaml:5:5 already"
        ),
        "{text}"
    );
    let text = faults(&OWN.replace("file: parts", "flie: parts"), &[]);
    assert!(text.contains("an included file has no key `flie`") && !text.contains("must be"), "{text}");
}

#[test]
fn with_gives_values_for_the_parameters_of_the_file_alone() {
    let text = faults(&OWN.replace("leaf: 5 mm", "leef: 5 mm"), &[]);
    assert!(
        text.contains("conf/own.yaml:5:42: `conf/parts/tracking.yaml` has no parameter `leef`"),
        "{text}"
    );
    assert!(text.contains("did you mean `leaf`?"), "{text}");
    let text = faults(&OWN.replace("leaf: 5 mm", "leaf: "), &[]);
    assert!(text.contains("conf/own.yaml:5:") && text.contains("`leaf` is nothing"), "{text}");
    let text = faults(OWN, &[("parts/tracking.yaml", &TRACKING.replace("face.leaf", "fase.leaf"))]);
    assert!(text.contains("conf/parts/tracking.yaml:6:9: there is no operator `fase`"), "{text}");
    assert!(text.contains("did you mean `face`?"), "{text}");
    let text = faults(OWN, &[("parts/tracking.yaml", &TRACKING.replace("face.leaf", "face.laef"))]);
    assert!(text.contains("conf/parts/tracking.yaml:6:14: segment.face has no parameter `laef`"), "{text}");
    // An input that the including file has to connect is missed where it is.
    let text = faults(&OWN.replace(", image: rig.depth", ""), &[]);
    assert!(
        text.contains("conf/parts/tracking.yaml:9:3: `cloud` (ingest.depth) needs the input `image`"),
        "{text}"
    );
}

#[test]
fn the_path_of_an_included_file_may_name_variables() {
    let composed = good(&OWN.replace("parts/tracking.yaml", "\"${PARTS}/tracking.yaml\""), &[]);
    assert_eq!(
        composed.variables.into_iter().collect::<Vec<_>>(),
        [("PARTS".to_owned(), "parts".to_owned())]
    );
}

#[test]
fn one_file_may_be_included_by_its_path_alone_and_a_whole_pipeline_may_be_varied() {
    let whole = format!("{}parameters: {{ period: rig.every }}\n", OWN);
    let own = "stillpoint: 1\nname: variant\ninclude: { file: whole.yaml, with: { period: 50 ms } }\n";
    let Composed { graph, .. } =
        composed(own, &[("whole.yaml", &whole)], &[]).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!((graph.name.as_str(), graph.seed), ("variant", 9));
    assert_eq!(graph.operators[graph.operator("rig").unwrap()].every, Some(50_000_000));
    let Composed { graph, .. } =
        composed("stillpoint: 1\nname: bare\ninclude: whole.yaml\nseed: 4\n", &[("whole.yaml", &whole)], &[])
            .ok()
            .unwrap();
    assert_eq!(graph.seed, 4);
}

#[test]
fn a_value_for_very_many_places_is_refused() {
    let places: Vec<String> = (0..5000).map(|n| format!("face.leaf.x{n}")).collect();
    let tracking = TRACKING.replace("leaf: face.leaf", &format!("leaf: [{}]", places.join(", ")));
    let own = OWN.replace("leaf: 5 mm", &format!("leaf: [{}]", ["1"; 1000].join(", ")));
    let text = faults(&own, &[("parts/tracking.yaml", &tracking)]);
    assert!(text.contains("`with` gives more values than a pipeline may have"), "{text}");
}
