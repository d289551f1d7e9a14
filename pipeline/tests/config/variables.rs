//! Variables of the environment in paths.

use stillpoint_pipeline::config::{Composed, Faults, Machine, check, compose_for};

use crate::disk::Disk;
use crate::good::FILES;
use crate::kinds::registry;

fn composed(model: &str, sets: &[&str], variables: &[(&str, &str)]) -> Result<Composed, Faults> {
    let text = FILES[0].1.replace("models/face.onnx", &format!("\"{model}\""));
    let machine = Machine::default().with_variables(variables.iter().copied());
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    compose_for(&machine, &text, "head.yaml", &sets, &registry(), &Disk)
}

fn model(composed: &Composed) -> String {
    let face = composed.graph.operator("face").unwrap();
    composed.graph.operators[face].params.resolved["model"].as_str().unwrap().to_owned()
}

#[test]
fn a_path_names_variables_and_the_text_holds_their_values() {
    let set = [("MODELS", "models"), ("EMPTY", "")];
    for written in ["${MODELS}/face.onnx", "${MODELS}/${NOT_SET:-face}.onnx", "${EMPTY:-models}/face.onnx"] {
        let composed = composed(written, &[], &set).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!(model(&composed), "models/face.onnx");
        assert_eq!(composed.text, FILES[0].1, "{written}: nothing else of the text changes");
        let named = composed.variables.keys().map(String::as_str).collect::<Vec<_>>();
        assert_eq!(named, if written.contains("MODELS") { vec!["MODELS"] } else { vec![] });
    }
}

#[test]
fn an_argument_names_variables_too_and_a_path_that_it_replaces_needs_none() {
    let sets = ["face.leaf=5 mm", "face.model=${MODELS}/face.onnx"];
    let composed =
        composed("${NOT_SET}/x", &sets, &[("MODELS", "models")]).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(model(&composed), "models/face.onnx");
    assert_eq!(composed.sets, ["face.leaf=5 mm", "face.model=models/face.onnx"]);
    // What a session keeps is checked without any variable.
    let kept = check(&composed.text, "head.yaml", &composed.sets, &registry(), &Disk);
    assert_eq!(kept.map(|graph| graph.operators.len()).ok(), Some(8));
}

#[test]
fn the_home_folder_is_a_tilde_with_a_slash() {
    let faults = composed("~/face.onnx", &[], &[("HOME", "/home/ada/")]).err().unwrap().to_string();
    assert!(faults.contains("`/home/ada/face.onnx` cannot be used"), "{faults}");
    let faults = composed("models/~/face.onnx", &[], &[("HOME", "/home/ada")]).err().unwrap().to_string();
    assert!(faults.contains("`models/~/face.onnx` cannot be used"), "{faults}");
}

#[test]
fn what_is_wrong_with_a_variable_is_reported_at_its_place() {
    for (written, message, help) in [
        ("${MODLES}/x", "the variable `MODLES` of the environment is not set", "did you mean `${MODELS}`?"),
        ("${EMPTY}/x", "the variable `EMPTY` of the environment is empty", "write `${EMPTY:-/path}`"),
        ("${MODELS/x", "`${MODELS/x` has no `}` behind `${`", "write `${NAME}`"),
        ("${MY-MODELS}/x", "`MY-MODELS` is not the name of a variable", "`${NAME:-default}`"),
        ("${OTHER}/x", "the value of the variable `OTHER` names a variable itself", "set `OTHER` to a path"),
    ] {
        let set = [("MODELS", "models"), ("EMPTY", ""), ("OTHER", "${MODELS}")];
        let faults = composed(written, &[], &set).err().unwrap();
        assert_eq!(faults.count(), 1, "{faults}");
        let text = faults.to_string();
        assert!(text.starts_with("head.yaml:10:"), "{text}");
        assert!(text.contains(message) && text.contains(help), "{text}");
    }
}

#[test]
fn a_variable_that_is_not_in_a_path_is_refused() {
    let set = [("LEAF", "5 mm"), ("DATA", "models")];
    for set_argument in ["face.leaf=${LEAF}", "face.use=segment.${LEAF}", "contracts=[\"${DATA}\"]"] {
        let faults = composed("models/face.onnx", &[set_argument], &set).err().unwrap().to_string();
        let is_said = faults.contains("names a variable of the environment, but is not a path");
        assert!(is_said || set_argument.starts_with("face.use"), "{faults}");
    }
}

#[test]
fn a_session_that_is_replayed_names_no_variables() {
    let text = FILES[0].1.replace("models/face.onnx", "\"${MODELS}/face.onnx\"");
    let faults = check(&text, "head.yaml", &[], &registry(), &Disk).err().unwrap().to_string();
    assert!(faults.contains("`${MODELS}/face.onnx` cannot be used"), "{faults}");
}

#[test]
fn a_variable_between_brackets_needs_quotes_and_elsewhere_none() {
    let text = FILES[0].1.replace("models/face.onnx", "${MODELS}/face.onnx");
    let faults = check(&text, "head.yaml", &[], &registry(), &Disk).err().unwrap().to_string();
    assert!(faults.starts_with("head.yaml:10:118: `${` is here"), "{faults}");
    assert!(faults.contains("put the path in quotes: `\"${NAME}/file\"`"), "{faults}");
    let block = FILES[2].1.replace("params: { images: captures, weights: [0.5, 2] } }", "params: { images: captures } }").replace("  images: { use: ingest.images, every: 33.3 ms, frame: camera, params: { images: captures } }", "  images:\n    use: ingest.images\n    every: 33.3 ms\n    frame: camera\n    params:\n      images: ${SHOTS}  # of the day\n");
    let machine = Machine::default().with_variables([("SHOTS", "captures")]);
    let composed = compose_for(&machine, &block, "block.yaml", &[], &registry(), &Disk)
        .unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(composed.text, block.replace("${SHOTS}", "captures"));
}
