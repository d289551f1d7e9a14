//! Parameters: typed, in SI, with defaults and every fault.

use stillpoint_operator::Params;
use stillpoint_operator::params::verify;
use stillpoint_pipeline::config::check;

use crate::disk::Disk;
use crate::good::graph;
use crate::kinds::registry;
use crate::others;

#[test]
fn resolved_parameters_are_complete_ordered_and_in_si() {
    let graph = graph("head.yaml");
    let resolved = |name: &str| graph.operators[graph.operator(name).unwrap()].params.resolved.to_string();
    assert_eq!(
        resolved("face"),
        r#"{"leaf":0.004,"plane_tolerance":0.008,"iterations":500,"model":"models/face.onnx","crop":true}"#
    );
    assert_eq!(
        resolved("target"),
        r#"{"step":{"by":[0.0115,0.0,0.01],"at":2000000000},"path":[],"goal":"rest"}"#
    );
    assert_eq!(
        resolved("rig"),
        r#"{"motion":"slow_sweep","noise":0.001,"rate":30.0,"supply":103421.3593975254}"#
    );
    assert_eq!(resolved("cloud"), r#"{"near":0.2,"far":2.0,"stride":1}"#);
    assert_eq!(resolved("console"), "{}");
}

#[test]
fn the_typed_struct_holds_what_the_config_says() {
    let graph = graph("images.yaml");
    let params = graph.operators[0].params.value.downcast_ref::<others::ReplayParams>().unwrap();
    assert_eq!((params.weights, params.shift), ([0.5, 2.0], -3));
}

#[test]
fn all_faults_of_one_operator_come_at_once() {
    let text = "stillpoint: 1\nname: a\noperators:\n  f:\n    use: control.mrac\n    params:\n      gian: 11\n      \
                watchdog: 2\n      extra: 1\n";
    let faults = check(text, "a.yaml", &[], &registry(), &Disk).err().unwrap();
    let lines: Vec<(usize, String)> = faults.list().iter().map(|f| (f.span.line, f.code.name())).collect();
    let expected = [
        (4, "missing-input"),
        (4, "missing-input"),
        (7, "unknown-key"),
        (7, "out-of-range"),
        (8, "missing-unit"),
        (9, "unknown-key"),
    ];
    assert_eq!(lines, expected.map(|(l, c)| (l, c.to_owned())), "{faults}");
}

#[test]
fn declarations_of_the_kinds_can_be_read() {
    for stage in registry().iter() {
        verify(stage).unwrap();
    }
}

#[derive(Clone, Params)]
struct Wrong {
    /// A default beyond the range.
    #[param(unit = "m", default = "[1 mm, 9 mm]", max = "5 mm")]
    _lengths: [f64; 2],
}

#[test]
fn a_default_out_of_range_is_found_by_verify() {
    let mut stage = *registry().get("console").unwrap();
    stage.fields = Wrong::FIELDS;
    stage.read = |_, reader| Wrong::read(reader).map(|_| unreachable!("it has a fault"));
    let reason = verify(&stage).unwrap_err().to_string();
    assert_eq!(
        reason,
        "console: the default of `_lengths` cannot be read: `9 mm` is out of range: it must be at most 5 mm"
    );
}
