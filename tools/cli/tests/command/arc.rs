//! Plans in arcs: files, what programs read in them, and what is refused.

use std::path::Path;

use serde_json::Value;

use super::plan::dciodvfy_finds_no_error;
use super::{stillpoint, text};

fn run(folder: &Path, arguments: &[&str]) -> Vec<u8> {
    let out = stillpoint(folder, arguments);
    assert!(out.status.success(), "{arguments:?}: {}", text(&out.stderr));
    out.stdout
}

/// An arc of a few control points on few points.
const COARSE: &[&str] = &[
    "plan",
    "pelvis-0.case",
    "--arc",
    "260..268cw,268..260cc",
    "--grid",
    "16mm",
    "--bixel",
    "20mm",
    "--dose-grid",
    "5mm",
    "--engine",
    "pencil",
    "--accept-check",
    "coarse",
];

#[test]
fn arcs_are_a_folder_that_recalculate_reproduces_and_other_programs_refuse() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(folder, &["case", "phantom", "--seed", "0", "--out", "."]);
    // As if a queue had made a plan of another request here.
    std::fs::create_dir(folder.join("a")).unwrap();
    std::fs::write(folder.join("a/request.json"), "{}").unwrap();
    let planned: Value =
        serde_json::from_slice(&run(folder, &[COARSE, &["--out", "a", "--threads", "1", "--json"]].concat()))
            .unwrap();
    run(folder, &[COARSE, &["--out", "b", "--threads", "2"]].concat());
    let bytes = |plan: &str, name: &str| std::fs::read(folder.join(plan).join(name)).unwrap();
    for name in ["plan.json", "plan.html", "dvh.svg", "axial.png", "rtplan.dcm", "rtdose.dcm", "rtstruct.dcm"]
    {
        assert!(bytes("a", name) == bytes("b", name), "{name} depends on threads");
    }
    assert!(!folder.join("a/request.json").exists());
    assert_eq!(planned["version"], 3);
    let arcs = &planned["arcs"];
    assert_eq!(arcs["arcs"][1]["arc"], "268..260cc");
    assert_eq!(arcs["arcs"][0]["control_points"].as_array().unwrap().len(), 3);
    let units = arcs["monitor_units"].as_f64().unwrap();
    // No faster than the dose rate, and no faster than the gantry.
    let seconds = arcs["seconds"].as_f64().unwrap();
    assert!(units > 100.0 && seconds >= units / 10.0 - 1e-6 && seconds >= 16.0 / 6.0, "{units} {seconds}");
    let objectives: Vec<f64> =
        arcs["objectives"].as_array().unwrap().iter().map(|o| o.as_f64().unwrap()).collect();
    assert!(objectives.windows(2).all(|pair| pair[1] <= pair[0]), "{objectives:?}");
    let page = String::from_utf8(bytes("a", "plan.html")).unwrap();
    assert!(page.contains("Arc 260..268cw") && page.contains("Dose rate.") && !page.contains("Modulation"));

    let recalculated = [
        &["plan", "recalculate", "a/rtplan.dcm", "--case", "pelvis-0.case", "--dose", "a/rtdose.dcm"][..],
        &["--engine", "pencil", "--grid", "8mm", "--bixel", "5mm", "--json"],
    ];
    let found: Value = serde_json::from_slice(&run(folder, &recalculated.concat())).unwrap();
    assert!((found["other"]["factor"].as_f64().unwrap() - 1.0).abs() < 0.02, "{}", found["other"]["factor"]);
    let gamma = &found["other"]["gamma"];
    assert!(gamma["passed"].as_f64().unwrap() > 0.97, "{gamma}");
    assert_eq!(found["beams"][1]["control_points"], 3);
    assert_eq!(found["beams"][1]["name"], "2 arc 268..260cc");
    let read: f64 =
        found["beams"].as_array().unwrap().iter().map(|b| b["monitor_units"].as_f64().unwrap()).sum();
    assert!((read / units - 1.0).abs() < 1e-6, "{read} {units}");

    let side_by_side = text(&run(folder, &["plan", "compare", "a", "b"]));
    assert!(
        side_by_side.contains("arc 260..268cw, arc 268..260cc") && side_by_side.contains("delivery, min")
    );
    dciodvfy_finds_no_error(&folder.join("a"));

    // Static beams are as fast as the machine of the arcs with which they are compared.
    let still = ["plan", "pelvis-0.case", "--angles", "0,180", "--out", "still", "--accept-check", "coarse"];
    run(
        folder,
        &[&still[..], &["--grid", "16mm", "--bixel", "20mm", "--dose-grid", "5mm", "--engine", "pencil"]]
            .concat(),
    );
    let mut slow: Value = serde_json::from_slice(&bytes("a", "plan.json")).unwrap();
    slow["arcs"]["limits"]["mu_per_min"] = 60.into();
    std::fs::create_dir(folder.join("slow")).unwrap();
    std::fs::write(folder.join("slow/plan.json"), slow.to_string()).unwrap();
    let seconds_beside = |arcs: &str| {
        let found: Value =
            serde_json::from_slice(&run(folder, &["plan", "compare", "still", arcs, "--json"])).unwrap();
        let still = &found["plans"][0];
        [&still["delivery_s"], &still["monitor_units"]].map(|number| number.as_f64().unwrap())
    };
    let ([fast_s, units], [slow_s, _]) = (seconds_beside("a"), seconds_beside("slow"));
    assert!((slow_s - fast_s - 0.9 * units).abs() < 1e-6 * slow_s, "{fast_s} s, {slow_s} s, {units}");

    let refused = |arguments: &[&str], why: &str| {
        let out = stillpoint(folder, arguments);
        let message = text(&out.stderr);
        assert!(!out.status.success() && message.contains(why), "{arguments:?}: {message}");
    };
    refused(&["plan", "pelvis-0.case", "--start", "a"], "this plan is of arcs");
}

#[test]
fn what_arcs_do_not_know_is_refused_before_anything_is_computed() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |arguments: &[&str], why: &str| {
        let out = stillpoint(folder.path(), &[&["plan"], arguments].concat());
        let message = text(&out.stderr);
        assert!(out.status.code() == Some(2) && message.contains(why), "{arguments:?}: {message}");
    };
    for other in [
        &["--angles", "0,90"][..],
        &["--couch", "30"],
        &["--robust"],
        &["--pool", "tcp/127.0.0.1:1"],
        &["--beams", "7"],
        &["--compare"],
        &["--fluence-only"],
        &["--doses", "doses"],
    ] {
        refused(&[&["--arc", "1"], other].concat(), "cannot be used with");
    }
    refused(&["--arc", "0..90"], "invalid arc: \"0..90\"");
    refused(&["--arc", "0..4cw"], "turns by 4 degrees (allowed: 8 to 359 degrees)");
    refused(&["--arc", "170..190cw"], "passes 180 degrees, where the gantry stops");
    refused(&["a.case", "b.case", "--arc", "0..90"], "invalid arc: \"0..90\"");
    let bare = r#"{"collimator": null}"#;
    std::fs::write(folder.path().join("bare.json"), bare).unwrap();
    refused(&["--arc", "1", "--machine", "bare.json"], "bare.json");
}
