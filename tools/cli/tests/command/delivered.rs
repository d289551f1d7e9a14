//! The dose that was delivered in a session, on the shipped example.

use std::path::Path;

use serde_json::Value;

use super::{root, stillpoint, text};

fn run(folder: &Path, arguments: &[&str]) -> String {
    let out = stillpoint(folder, arguments);
    assert!(out.status.success(), "{arguments:?}: {}", text(&out.stderr));
    text(&out.stdout)
}

fn refused(folder: &Path, arguments: &[&str]) -> String {
    let out = stillpoint(folder, arguments);
    assert!(!out.status.success(), "{arguments:?}");
    text(&out.stderr)
}

#[test]
fn the_dose_of_the_example_from_the_ct_is_told_and_other_sessions_and_cases_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let example = |name: &str| root().join("examples").join(name).display().to_string();
    let case = example("data/head.case");
    let session = |pipeline: &str, length: &str, more: &[&str]| {
        let fixed = ["run", &example(pipeline), "--clock", "simulated", "--for", length];
        run(folder, &[&fixed[..], more].concat());
    };
    session("head-from-ct.yaml", "9s", &[]);
    session("head-tracking.yaml", "1s", &[]);
    let coarse = ["--angles", "0,120,240", "--grid", "12mm", "--bixel", "20mm", "--dose-grid", "4mm"];
    run(
        folder,
        &[&["plan", &case, "--out", "plan", "--doses", "doses", "--engine", "pencil"], &coarse[..]].concat(),
    );
    run(folder, &[&["plan", "--out", "pelvis", "--doses", "doses", "--fluence-only"], &coarse[..]].concat());

    let asked = |session, plan| -> [&str; 9] {
        ["delivered", session, "--plan", plan, "--case", &case, "--grid", "8mm", "--json"]
    };
    let held = "sessions/head-from-ct-0001";
    let wide = ["--bin", "2mm", "--bin-angle", "2deg"];
    let reported: Value =
        serde_json::from_str(&run(folder, &[&asked(held, "plan")[..], &wide].concat())).unwrap();
    assert_eq!(reported["poses"], "filter.state");
    assert_eq!(
        (&reported["beam"], &reported["reference"]["is_the_case"]),
        (&"far.state".into(), &true.into())
    );
    assert!(reported["beam_on"]["seconds"].as_f64().unwrap() > 0.5, "{}", reported["beam_on"]);
    let shares = |motion: &str| -> f64 {
        let bins = reported[motion]["bins"].as_array().unwrap();
        bins.iter().map(|bin| bin["share"].as_f64().unwrap()).sum()
    };
    assert!((shares("beam_on") - 1.0).abs() < 1e-9 && (shares("after_arming") - 1.0).abs() < 1e-9);
    let d98 = |dose: usize| {
        let structures = reported["doses"][dose]["structures"].as_array().unwrap();
        structures.iter().find(|s| s["name"] == "CTV").unwrap()["d98_gy"].as_f64().unwrap()
    };
    // With the beam on the head is within the gate's tolerances; before, it was farther away.
    let largest = |motion: &str, i: usize| reported[motion]["largest_mm_deg"][i].as_f64().unwrap();
    assert!((0..3).all(|i| largest("beam_on", i) < 1.5 && largest("beam_on", i + 3) < 0.8), "{reported}");
    assert!(largest("after_arming", 0) > 3.0 * largest("beam_on", 0), "{reported}");
    // The planned dose is that of the segments of plan.json, on the grid of the plan where no other is asked for.
    let own_grid: Vec<&str> =
        asked(held, "plan").into_iter().filter(|a| !["--grid", "8mm"].contains(a)).collect();
    let on_grid: Value = serde_json::from_str(&run(
        folder,
        &[&own_grid[..], &["--bin", "10mm", "--bin-angle", "10deg"]].concat(),
    ))
    .unwrap();
    let plan: Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("plan/plan.json")).unwrap()).unwrap();
    let (planned, reported) = (&on_grid["doses"][0]["structures"], &plan["leaves"]["structures"]);
    for (planned, reported) in planned.as_array().unwrap().iter().zip(reported.as_array().unwrap()) {
        assert_eq!(planned["name"], reported["name"]);
        for figure in ["d98_gy", "d50_gy", "d2_gy", "d0_03cc_gy"] {
            let [planned, reported] = [planned, reported].map(|f| f[figure].as_f64().unwrap());
            assert!((planned - reported).abs() < 0.02, "{figure}: {planned}, {reported}");
        }
    }
    assert!((d98(1) - d98(0)).abs() < 0.03 * d98(0), "planned {}, delivered {}", d98(0), d98(1));
    let svg = std::fs::read_to_string(folder.join("delivered/head-from-ct-0001/delivered.svg")).unwrap();
    assert!(svg.contains("without gating") && svg.contains("CTV"));

    // A session delivers the beams at its own couch angle.
    let mut turned = plan.clone();
    turned["leaves"]["beams"][1]["couch_deg"] = 30.0.into();
    std::fs::create_dir(folder.join("turned")).unwrap();
    std::fs::write(folder.join("turned/plan.json"), turned.to_string()).unwrap();
    session("head-from-ct.yaml", "9s", &["--set", "gate.couch=30 deg", "--set", "gate.beam_couch=30 deg"]);
    let at_30 = "sessions/head-from-ct-0002";
    let of = |session, plan, more: &[&'static str]| -> Vec<&str> {
        [&asked(session, plan)[..], &wide, more].concat()
    };
    for (session, plan, more, words) in [
        (
            held,
            "turned",
            &[][..],
            "gantry 120 degrees is planned at the couch angle 30 degrees, and the gate of the session states the couch angle 0",
        ),
        (held, "turned", &["--beams", "0,120@30"], "choose the beams of this session with --beams"),
        (
            at_30,
            "plan",
            &[],
            "gantry 0 degrees is planned at the couch angle 0 degrees, and the gate of the session states the couch angle 30",
        ),
        (
            held,
            "turned",
            &["--beams", "0,120"],
            "--beams 0,120: the plan has no beam at 120 (it has 0, 120@30, 240)",
        ),
        (held, "turned", &["--beams", "0,360"], "--beams 0,360: the beam at 360 is there twice"),
        (held, "turned", &["--beams", "0,nan"], "invalid angles of a beam: \"nan\""),
    ] {
        let why = refused(folder, &of(session, plan, more));
        assert!(why.contains(words), "{session} {plan} {more:?}: {why}");
    }
    let wrong = ["run", &example("head-from-ct.yaml"), "--clock", "simulated", "--for", "1s", "--set"];
    for (angle, words) in [
        ("gate.couch=400 deg", "gate.couch"),
        ("gate.beam_couch=.nan deg", "gate.beam_couch"),
        ("gate.couch=30", "gate.couch"),
    ] {
        let why = refused(folder, &[&wrong[..], &[angle]].concat());
        assert!(why.contains(words), "{angle}: {why}");
    }
    let units = |beam: usize| plan["leaves"]["beams"][beam]["monitor_units"].as_f64().unwrap();
    for (session, chosen, angles, couch, expected) in [
        (held, "0,240", &["0", "240"][..], 0.0, units(0) + units(2)),
        (at_30, "120@-330", &["120@30"], 30.0, units(1)),
    ] {
        let reported: Value =
            serde_json::from_str(&run(folder, &of(session, "turned", &["--beams", chosen]))).unwrap();
        assert_eq!((&reported["beams"], &reported["couch_deg"]), (&serde_json::json!(angles), &couch.into()));
        assert!(
            (reported["monitor_units_per_fraction"].as_f64().unwrap() - expected).abs() < 1e-9,
            "{chosen}"
        );
        let mean = |dose: usize| {
            let structures = reported["doses"][dose]["structures"].as_array().unwrap();
            structures.iter().find(|s| s["name"] == "CTV").unwrap()["mean_gy"].as_f64().unwrap()
        };
        assert!(mean(0) > 1.0 && (mean(1) / mean(0) - 1.0).abs() < 0.03, "{chosen}: {} {}", mean(0), mean(1));
    }

    let why = refused(folder, &asked(held, "pelvis"));
    assert!(why.contains("this plan is of the case"), "{why}");
    let why = refused(folder, &[&asked(held, "plan")[..], &["--poses", "rig.truth"]].concat());
    assert!(why.contains("does not come from a track.head"), "{why}");
    let captured = asked("sessions/head-tracking-6dof-0001", "plan");
    let why = refused(folder, &[&captured[..], &["--poses", "filter.state"]].concat());
    assert!(why.contains("count from a capture"), "{why}");
}
