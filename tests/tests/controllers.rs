//! Three laws side by side, each with a rig of its own: `examples/compare-controllers.yaml`.

use crate::bench::Bench;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/compare-controllers.yaml");

#[test]
fn simulated_and_lock_step_write_the_same_bytes() {
    crate::conformance::placements_agree(EXAMPLE);
}

#[test]
fn it_runs_live_and_the_session_replays_bit_for_bit() {
    let bench = Bench::new();
    let report = bench.call(&["run", EXAMPLE, "--for", "3 s", "--json", "--record", "s"]).good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
    assert_eq!(replay["open"], serde_json::json!([]));
}

#[test]
fn the_report_has_all_three_beside_the_truth_of_their_own_rigs() {
    let bench = Bench::new();
    let arguments = ["run", EXAMPLE, "--clock", "simulated", "--for", "4 s", "--json", "--record", "s"];
    let report = bench.call(&arguments).good();
    let compared = bench.call(&["report", report["session"].as_str().unwrap(), "--json"]).good();
    let controllers =
        compared["sections"]["controllers"]["figures"]["controllers"].as_array().unwrap().clone();
    let names: Vec<&str> = controllers.iter().map(|c| c["controller"].as_str().unwrap()).collect();
    assert_eq!(names, ["pi", "lqi", "mrac"]);
    for c in &controllers {
        assert_eq!(c["truth"], format!("{}_rig.truth", c["controller"].as_str().unwrap()));
        assert!(c["valves_open"].as_f64().unwrap() > 0.0, "{c}");
        assert_eq!(c["person"], "nods, seed 7");
    }
    // A model that began elsewhere than its head would be the height of the head away.
    for channel in controllers.iter().flat_map(|c| c["channels"].as_array().unwrap()) {
        assert!(channel["rms_model"].as_f64().unwrap() < 1.0, "{channel}");
    }
    let charts = compared["sections"]["controllers"]["charts"].as_array().unwrap();
    let height = charts.iter().find(|c| c["title"] == "z under control").unwrap();
    let series: Vec<&str> =
        height["series"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(
        series[3..],
        ["reference model of pi", "reference model of lqi", "reference model of mrac", "target"]
    );
    let gains = charts.iter().find(|c| c["title"] == "Adaptive gains of mrac").unwrap();
    assert_eq!(gains["series"].as_array().unwrap().len(), 3);
}
