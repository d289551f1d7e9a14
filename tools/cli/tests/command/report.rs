//! `stillpoint report`: its figures against those computed here, its page, and sessions that lack or lost something.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use serde_json::Value;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pieces, Pose, Sample, Track};

use crate::{SMALL_CAMERA, root, stillpoint, text};

/// Runs a pipeline with a small camera, simulated; the session's path and what the run said of it.
fn run(folder: &Path, file: &str, seconds: &str, sets: &[&str]) -> (PathBuf, Value) {
    let file = root().join(file).canonicalize().unwrap().display().to_string();
    let mut arguments =
        vec!["run", &file, "--clock", "simulated", "--for", seconds, "--record", "s", "--json"];
    for set in sets {
        arguments.extend(["--set", set]);
    }
    let out = stillpoint(folder, &arguments);
    assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
    let output_text: Value = serde_json::from_slice(&out.stdout).unwrap();
    (folder.join(output_text["session"].as_str().unwrap()), output_text)
}

const SMALL: [&str; 3] = ["rig.width='160 px'", "rig.height='120 px'", "rig.focal_length='141 px'"];

fn report(folder: &Path, session: &Path) -> (Value, String) {
    let page = folder.join("page.html");
    let [session, out_file] = [session, &page].map(|p| p.display().to_string());
    let out = stillpoint(folder, &["report", &session, "--json", "--out", &out_file, "--pictures", "3"]);
    assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
    (serde_json::from_slice(&out.stdout).unwrap(), std::fs::read_to_string(page).unwrap())
}

/// Nothing of the page comes from elsewhere.
fn stands_alone(page: &str) {
    // Any letters may stand in the bytes of a picture.
    let written: String =
        page.split('"').filter(|part| !part.starts_with("data:image/png;base64,")).collect();
    for word in ["http:", "https:", "<script", "<link", "@import", "url(", "NaN"] {
        assert!(!written.contains(word), "{word}");
    }
    assert_eq!(page.matches("src=").count(), page.matches("src=\"data:image/png;base64,").count());
    assert!(page.starts_with("<!DOCTYPE html>") && page.trim_end().ends_with("</html>"));
    for word in ["section", "figure", "table", "svg", "div", "details", "td", "tr", "p"] {
        let opened = page.matches(&format!("<{word}>")).count() + page.matches(&format!("<{word} ")).count();
        assert_eq!(opened, page.matches(&format!("</{word}>")).count(), "<{word}>");
    }
}

#[test]
fn the_report_of_a_session_has_the_figures_of_its_samples_on_a_page_that_stands_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (session, output_text) = run(
        folder.path(),
        "tools/cli/tests/command/centroid.yaml",
        "8s",
        &[&SMALL[..], &["rig.motion=raise"]].concat(),
    );
    let (json, page) = report(folder.path(), &session);
    let figures = |id: &str| json["sections"][id]["figures"].clone();

    // Errors: those that the run itself states, and those of the samples, read here once more.
    let errors = figures("errors")["errors"].as_array().unwrap().clone();
    let of = |topic: &str, channel: &str| {
        errors.iter().find(|e| e["topic"] == topic && e["channel"] == channel).unwrap().clone()
    };
    for (i, channel) in ["x", "y", "z"].into_iter().enumerate() {
        let stated = output_text["accuracy"]["rms_mm"][i].as_f64().unwrap();
        let found = of("filter.state", channel)["rms"].as_f64().unwrap();
        assert!((stated - found).abs() < 1e-9, "{channel}: {stated} {found}");
    }
    let opened = Session::open(&session).unwrap();
    let read = |topic: &str, number: fn(&[u8]) -> f64| -> Vec<f64> {
        opened.samples_where(|t| t.name == topic).map(|r| number(&r.unwrap().sample)).collect()
    };
    let truth = read("rig.truth", |b| {
        Pieces::split(Pose::KIND, b).unwrap().view::<Pose>().unwrap().first().unwrap().position[2]
    });
    let raw = read("head.position", |b| {
        Pieces::split(Pose::KIND, b).unwrap().view::<Pose>().unwrap().first().unwrap().position[2]
    });
    let nis = read("filter.state", |b| {
        Pieces::split(Track::KIND, b).unwrap().view::<Track>().unwrap().first().unwrap().nis
    });
    assert_eq!((truth.len(), raw.len()), (80, 80));
    let errors: Vec<f64> = raw.iter().zip(&truth).map(|(r, t)| (r - t) * 1e3).collect();
    let mean = errors.iter().sum::<f64>() / 80.0;
    let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / 80.0;
    let raw_z = of("head.position", "z");
    assert!((raw_z["offset"].as_f64().unwrap() - mean).abs() < 1e-9);
    assert!((raw_z["variance"].as_f64().unwrap() - variance).abs() < 1e-9);
    let measured: Vec<f64> = nis.into_iter().filter(|n| n.is_finite()).collect();
    let nis_mean = measured.iter().sum::<f64>() / measured.len() as f64;
    let estimates = figures("consistency")["estimates"].as_array().unwrap().clone();
    let of_filter = estimates.iter().find(|e| e["topic"] == "filter.state").unwrap();
    let stated = &of_filter["nis"];
    assert!((stated["mean"].as_f64().unwrap() - nis_mean).abs() < 1e-9 && stated["expected"] == 3.0);
    let nees = &of_filter["nees"];
    assert!(
        nees["mean"].as_f64().unwrap() > 0.0 && nees["expected"] == 3.0 && nees["samples"] == 80,
        "{nees}"
    );

    // The ledger is the run's own; rates are those of the pipeline; nothing failed.
    let lines = figures("ledger")["lines"].as_array().unwrap().clone();
    assert_eq!(lines.len(), output_text["ledger"].as_array().unwrap().len());
    assert_eq!(lines[0]["sent"], output_text["ledger"][0]["sent"]);
    let operators = figures("operators")["operators"].as_array().unwrap().clone();
    let rig = operators.iter().find(|o| o["operator"] == "rig").unwrap();
    assert!(rig["activations"] == 80 && (rig["rate_hz"].as_f64().unwrap() - 10.0).abs() < 0.2);
    assert_eq!(figures("summary")["complete"], true);
    assert_eq!(figures("faults")["events"].as_array().unwrap().len(), 0);

    // The pictures are made again from the recorded images, and have faces.
    let camera = figures("segmentation")["cameras"][0].clone();
    assert_eq!((camera["made_again"].clone(), camera["images"].clone()), (true.into(), 80.into()));
    let shown = camera["shown"].as_array().unwrap();
    assert!(shown.len() == 3 && shown.iter().all(|s| s["face_points"].as_u64().unwrap() > 100), "{shown:?}");

    stands_alone(&page);
    assert_eq!(page.matches("<img ").count(), 3);
    for word in ["Tracks", "Errors", "filter.state", "rig.truth", "Ledger", "segment.face", "balances"] {
        assert!(page.contains(word), "{word}");
    }
    let mode = std::fs::metadata(folder.path().join("page.html")).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600, "a page can hold a face");
    // Every chart of the page stands in the JSON with its points.
    let charts: usize =
        json["sections"].as_object().unwrap().values().map(|s| s["charts"].as_array().unwrap().len()).sum();
    assert_eq!(page.matches("class=\"legend\"").count(), charts);
}

#[test]
fn a_run_states_the_accuracy_of_its_report_also_over_several_captures() {
    let folder = tempfile::tempdir().unwrap();
    let (session, output_text) = run(folder.path(), "pipeline.yaml", "4s", &SMALL_CAMERA);
    let (json, _) = report(folder.path(), &session);
    let statuses = &json["sections"]["alignment"]["figures"]["trackers"][0]["statuses"];
    let captured = statuses.as_array().unwrap().iter().find(|s| s[0] == "captured").unwrap();
    assert!(captured[1].as_u64().unwrap() > 1, "{statuses}");
    let errors = json["sections"]["errors"]["figures"]["errors"].as_array().unwrap().clone();
    let accuracy = &output_text["accuracy"];
    let [rms_mm, rms_deg] = [&accuracy["rms_mm"], &accuracy["turns"]["rms_deg"]];
    for (place, channel) in ["x", "y", "z", "pitch", "roll", "yaw"].into_iter().enumerate() {
        let stated = if place < 3 { &rms_mm[place] } else { &rms_deg[place - 3] };
        let of_report = errors.iter().find(|e| e["topic"] == accuracy["topic"] && e["channel"] == channel);
        assert_eq!(stated, &of_report.unwrap()["rms"], "{channel}: {accuracy}");
    }
}

#[test]
fn two_sensors_are_judged_by_the_filter_that_has_both() {
    let folder = tempfile::tempdir().unwrap();
    let sizes = ["xbox", "v2"].map(|c| {
        [format!("{c}.width='160 px'"), format!("{c}.height='120 px'"), format!("{c}.focal_length='141 px'")]
    });
    let sets: Vec<&str> = sizes.iter().flatten().map(String::as_str).collect();
    let (session, output_text) = run(folder.path(), "examples/one-dof-tracking.yaml", "8s", &sets);
    // Of three tracks the run states the accuracy of the one that is made of the others.
    assert_eq!(output_text["accuracy"]["topic"], "fused.state");
    let (json, page) = report(folder.path(), &session);
    stands_alone(&page);
    let figures = &json["sections"]["filters"]["figures"];
    let filters = figures["filters"].as_array().unwrap();
    assert_eq!(filters.len(), 2);
    for filter in filters {
        assert_eq!((filter["channel"].clone(), filter["unit"].clone()), ("z".into(), "mm".into()));
        let reduction = filter["reduction"].as_f64().unwrap();
        let stated =
            1.0 - filter["filtered_variance"].as_f64().unwrap() / filter["raw_variance"].as_f64().unwrap();
        assert!((reduction - stated).abs() < 1e-12 && reduction < 1.0);
        assert!((0.0..1.0).contains(&filter["reduction_of_white_noise"].as_f64().unwrap()));
        assert!(filter["lag_mm"][0].as_f64().unwrap() > filter["lag_mm"][2].as_f64().unwrap().abs());
    }
    let intervals: Vec<f64> = filters.iter().map(|f| f["interval_ms"].as_f64().unwrap().round()).collect();
    assert_eq!(intervals, [33.0, 67.0]);
    assert!(page.contains("lag in second 1, mm"));
    let fused = &figures["fused"][0];
    assert_eq!(fused["topic"], "fused.state");
    let ratio = fused["over_centralised"].as_f64().unwrap();
    assert!((0.8..1.2).contains(&ratio), "{fused}");
    assert_eq!(json["sections"]["sensors"]["figures"]["sensors"].as_array().unwrap().len(), 2);
    // NEES stands beside NIS: of both heights, both filters and what is made of them.
    let estimates = json["sections"]["consistency"]["figures"]["estimates"].as_array().unwrap();
    assert_eq!(estimates.len(), 5);
    for estimate in estimates {
        assert!(estimate["nees"]["expected"] == 1.0 && estimate["nees"]["mean"].as_f64().unwrap() > 0.0);
        let is_filter = estimate["topic"].as_str().unwrap().contains("filter");
        assert_eq!(estimate["nis"].is_object(), is_filter, "{estimate}");
    }
    assert!(page.contains("NEES of fused.state"));
    assert_eq!(json["sections"]["segmentation"]["figures"]["cameras"].as_array().unwrap().len(), 2);
}

#[test]
fn poses_claim_what_their_errors_are_and_a_filter_that_allows_for_coughs_expects_more() {
    let folder = tempfile::tempdir().unwrap();
    let sets = [&SMALL[..], &["rig.noise=kinect_v1", "head.min_points=200"]].concat();
    let (session, _) = run(folder.path(), "examples/head-tracking.yaml", "10s", &sets);
    let (json, page) = report(folder.path(), &session);
    stands_alone(&page);
    let estimates = json["sections"]["consistency"]["figures"]["estimates"].as_array().unwrap();
    let of = |topic: &str| estimates.iter().find(|e| e["topic"] == topic).unwrap();
    for topic in ["head.pose", "filter.state"] {
        let nees = &of(topic)["nees"];
        let [mean, within] = ["mean", "within"].map(|k| nees[k].as_f64().unwrap());
        // In an image this small and noisy, some frames of the face are doubted.
        assert!((90..=100).contains(&nees["samples"].as_u64().unwrap()), "{nees}");
        assert!(nees["expected"] == 6.0, "{nees}");
        // The mean of a hundred squares of six numbers has a deviation of 0.35.
        assert!((4.0..8.0).contains(&mean) && within > 0.85, "{topic}: {nees}");
    }
    assert!(of("filter.state")["nis"]["mean"].as_f64().unwrap() < 1.5);
}

#[test]
fn a_tracker_that_waits_for_a_capture_until_the_end_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let waits = [&SMALL[..], &["head.capture=command"]].concat();
    let (session, output_text) = run(folder.path(), "examples/head-tracking.yaml", "1s", &waits);
    let uncaptured = &output_text["uncaptured"][0];
    assert_eq!(
        (&uncaptured["operator"], &uncaptured["command"]),
        (&"head".into(), &"console.capture".into())
    );
    assert_eq!(uncaptured["frames"], 10);
    let (json, page) = report(folder.path(), &session);
    stands_alone(&page);
    assert_eq!(json["sections"]["summary"]["figures"]["uncaptured"][0], "head.report");
    assert_eq!(json["sections"]["alignment"]["figures"]["trackers"][0]["uncaptured"], true);
    assert!(page.contains("none captured: no pose") && page.contains("no reference was captured"));
    // What people read; and with a reference, nothing is said.
    let file = root().join("examples/head-tracking.yaml").canonicalize().unwrap().display().to_string();
    for (capture, is_reported) in [("command", true), ("first", false)] {
        let set = format!("head.capture={capture}");
        let mut arguments =
            vec!["run", &file, "--clock", "simulated", "--for", "1s", "--record", "t", "--set", &set];
        arguments.extend(SMALL.iter().flat_map(|set| ["--set", set]));
        let out = stillpoint(folder.path(), &arguments);
        let line = "head: NO REFERENCE was captured, so none of 10 frames has a pose: stillpoint send console.capture \
                    takes the next face\n";
        assert_eq!(
            text(&out.stdout).contains(line),
            is_reported,
            "{}{}",
            text(&out.stdout),
            text(&out.stderr)
        );
    }
}

#[test]
fn the_end_of_a_run_names_every_vent_and_every_fault_also_without_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    // A person asks twice to vent, and resumes once.
    let script = "console.script=[{ at: 500 ms, say: capture }, { at: 1 s, say: confirm }, { at: 2 s, say: arm }, \
                  { at: 2500 ms, say: vent }, { at: 3 s, say: resume }, { at: 3500 ms, say: vent }]";
    let sets = [&SMALL_CAMERA[..], &[script]].concat();
    let (_, recorded) = run(folder.path(), "pipeline.yaml", "4s", &sets);
    let vents = &recorded["held"]["valves"][0]["vents"];
    assert_eq!(vents["times"], 2, "{vents}");
    assert!(vents["reasons"].to_string().contains("asked"), "{vents}");
    assert_eq!(recorded["held"]["far_ends"][0]["vents"]["times"], 2, "{}", recorded["held"]["far_ends"]);
    assert_eq!(recorded["held"]["valves"][0]["fault_times"]["times"], 0);
    let file = root().join("pipeline.yaml").canonicalize().unwrap().display().to_string();
    let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
    let unrecorded =
        |how: &[&str]| stillpoint(folder.path(), &[&["run", &file, "--no-record"], how, &sets[..]].concat());
    // Simulated, in processes, and live: nothing is recorded, and the end is the same.
    let out = unrecorded(&["--clock", "simulated", "--for", "4s", "--json"]);
    let output_text: Value = serde_json::from_slice(&out.stdout).unwrap();
    for part in ["valves", "far_ends"] {
        assert_eq!(output_text["held"][part], recorded["held"][part]);
    }
    let out = unrecorded(&["--lock-step=processes", "--for", "4s"]);
    assert!(text(&out.stdout).contains("vented 2 times, "), "{}{}", text(&out.stdout), text(&out.stderr));
    let out = unrecorded(&["--for", "4s", "--verbose"]);
    assert!(text(&out.stdout).contains("asked"), "{}{}", text(&out.stdout), text(&out.stderr));
    // The tables fit a terminal, and inputs to which nothing was sent are counted.
    let ledger =
        text(&out.stdout).split("\nledger:").nth(1).unwrap().split("balance").next().unwrap().to_owned();
    assert!(ledger.lines().all(|line| line.chars().count() <= 100), "{ledger}");
    assert!(ledger.contains("inputs to which nothing was sent"), "{ledger}");
}

#[test]
fn a_closed_loop_shows_its_targets_duties_pressures_and_gate() {
    let folder = tempfile::tempdir().unwrap();
    // The first beam comes before the step: the breath proves the head within 4 s.
    let later = "target.moves=[{ at: 4 s, z: 11.5 mm, pitch: 1.35 deg, roll: 10 deg }]";
    let (session, output_text) = run(folder.path(), "pipeline.yaml", "7500ms", &[later]);
    let (json, page) = report(folder.path(), &session);
    stands_alone(&page);
    let figures = |id: &str| json["sections"][id]["figures"].clone();
    // The run itself says how the head was held at its end.
    let held = &output_text["held"];
    let off = held["targets"][0]["channels"].as_array().unwrap();
    let names: Vec<&str> = off.iter().map(|c| c["channel"].as_str().unwrap()).collect();
    assert_eq!(names, ["z", "pitch", "roll"]);
    // Half of its way: the step was asked for at 5 s.
    let [now, worst] = ["now", "worst"].map(|k| off[0][k].as_f64().unwrap());
    assert!(now < -1.0 && now > -11.0 && (11.0..12.0).contains(&worst), "{off:?}");
    assert_eq!((&held["valves"][0]["state"], &held["valves"][0]["faults"]), (&"armed".into(), &0.into()));
    assert_eq!((&held["gates"][0]["on"], &held["gates"][0]["leases"]), (&false.into(), &1.into()));
    let channels = figures("targets")["channels"].as_array().unwrap().clone();
    let names: Vec<&str> = channels.iter().map(|c| c["channel"].as_str().unwrap()).collect();
    assert_eq!(names, ["z", "pitch", "roll"]);
    let step = &channels[0]["steps"][0];
    let height = step["to"].as_f64().unwrap() - step["from"].as_f64().unwrap();
    assert!((height - 11.5).abs() < 0.01, "{step}");
    assert!(!figures("duties")["topics"][0]["valves"].as_array().unwrap().is_empty());
    let bladders = figures("actuation")["bladders"].as_array().unwrap().clone();
    let numbers: Vec<u64> = bladders.iter().map(|b| b["bladder"].as_u64().unwrap()).collect();
    assert_eq!(numbers, [0, 1, 2, 0, 1, 2], "as `send`, `reach` and the parameters of a rig count them");
    let valve = figures("duties")["topics"][0]["valves"][0]["valve"].clone();
    assert_eq!(valve, "bladder 0 in");
    assert!(bladders.iter().all(|b| (0.0..100.0).contains(&b["pressure_kpa"]["p50"].as_f64().unwrap())));
    let states = figures("actuation")["changes"].as_array().unwrap().clone();
    assert!(states.iter().any(|c| c["state"] == "armed"), "{states:?}");
    let gate = figures("gate")["gates"][0].clone();
    assert_eq!(gate["open"], held["gates"][0]["duty"]);
    assert!((0.0..=1.0).contains(&gate["open"].as_f64().unwrap()) && gate["leases"].as_u64().unwrap() > 0);
    // What is not recorded is named.
    assert!(json["sections"]["sensors"]["missing"].is_string() && page.contains("Not in this session"));
}

#[test]
fn a_session_without_truth_and_without_images_shows_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let (session, _) = run(folder.path(), "examples/own-recording.yaml", "1s", &[]);
    let (json, page) = report(folder.path(), &session);
    stands_alone(&page);
    assert!(page.contains("no truth in this frame") && page.contains("so there are no errors"));
    // The camera is found from the cloud that is made again from the files in the session.
    let camera = &json["sections"]["segmentation"]["figures"]["cameras"][0];
    assert_eq!(camera["shown"].as_array().unwrap().len(), 3, "{camera}");
    let without = json["sections"]["errors"]["figures"]["without_truth"].as_array().unwrap();
    assert!(without.contains(&"filter.state".into()));
}

#[test]
fn what_is_broken_is_said_and_what_is_left_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let (session, _) = run(folder.path(), "examples/head-tracking.yaml", "3s", &SMALL);
    let part = session.join("part-000.mcap");
    let whole = std::fs::read(&part).unwrap();
    // Cut in the middle, and a name that is no HTML.
    std::fs::write(&part, &whole[..whole.len() * 2 / 3]).unwrap();
    let odd = session.with_file_name("a<b>&\"'");
    std::fs::rename(&session, &odd).unwrap();
    let (json, page) = report(folder.path(), &odd);
    stands_alone(&page);
    assert!(page.contains("a&lt;b&gt;&amp;&quot;&#39;") && !page.contains("a<b>"));
    let summary = &json["sections"]["summary"]["figures"];
    assert_eq!(
        (summary["complete"].clone(), summary["ended_in_order"].clone()),
        (false.into(), false.into())
    );
    assert!(json["sections"]["faults"]["figures"]["ended"].as_str().unwrap().contains("recover"));
    assert_eq!(json["sections"]["ledger"]["figures"]["from"], "journals");
    assert!(!json["sections"]["errors"]["figures"]["errors"].as_array().unwrap().is_empty());
    // Bytes in the middle are not what was written.
    let mut damaged = whole.clone();
    let middle = whole.len() / 2;
    damaged[middle..middle + 200].fill(0x5a);
    std::fs::write(odd.join("part-000.mcap"), damaged).unwrap();
    let (json, page) = report(folder.path(), &odd);
    stands_alone(&page);
    assert_eq!(json["sections"]["summary"]["figures"]["complete"], false);

    for (file, bytes) in [("none.mcap", &b"no session at all"[..]), ("empty.mcap", b"")] {
        std::fs::write(folder.path().join(file), bytes).unwrap();
        let out = stillpoint(folder.path(), &["report", file]);
        assert_eq!(out.status.code(), Some(1), "{file}");
        assert!(text(&out.stderr).contains(file), "{}", text(&out.stderr));
    }
    let out = stillpoint(folder.path(), &["report", "nothing"]);
    assert!(out.status.code() == Some(1) && text(&out.stderr).contains("nothing"));
    let odd = odd.display().to_string();
    let out = stillpoint(folder.path(), &["report", &odd, "--out", "no/such/folder.html"]);
    assert!(out.status.code() == Some(1) && text(&out.stderr).contains("--out"), "{}", text(&out.stderr));
}
