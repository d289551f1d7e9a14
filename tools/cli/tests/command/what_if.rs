//! A session with a changed pipeline, and two sessions side by side.

use std::path::{Path, PathBuf};

use serde_json::Value;
use stillpoint_recorder::Session;

use crate::{SMALL_CAMERA, root, stillpoint, text};

/// A simulated run of a pipeline with these arguments of `--set`. Gives its session.
fn simulated(folder: &Path, file: &Path, length: &str, sets: &[&str]) -> PathBuf {
    let file = file.canonicalize().unwrap().display().to_string();
    let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
    let run = ["run", &file, "--clock", "simulated", "--for", length, "--record", "s", "--json"];
    let out = stillpoint(folder, &[&run, &sets[..]].concat());
    assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    folder.join(report["session"].as_str().unwrap())
}

/// Replays a session with these arguments, and records the result. Gives what was printed, and the session.
fn what_if(folder: &Path, session: &Path, name: &str, arguments: &[&str]) -> (Value, PathBuf) {
    let made = folder.join(name);
    let command = ["replay", session.to_str().unwrap(), "--record", made.to_str().unwrap(), "--json"];
    let out = stillpoint(folder, &[&command, arguments].concat());
    assert!(out.status.success(), "{arguments:?}: {}{}", text(&out.stdout), text(&out.stderr));
    (serde_json::from_slice(&out.stdout).unwrap(), made)
}

/// Every topic that differs, by the bytes of its samples: what the command says of itself is no proof.
fn differing(first: &Path, second: &Path) -> Vec<String> {
    let [a, b] = [first, second].map(|path| Session::open(path).unwrap());
    // Laps are measured, so only a live run has them.
    let is_computed = |name: &str| !name.ends_with(".timing");
    let names = |s: &Session| {
        s.topics().iter().map(|t| t.name.clone()).filter(|n| is_computed(n)).collect::<Vec<_>>()
    };
    assert_eq!(names(&a), names(&b));
    let same = |number: usize| {
        let of_second = b.topic_number(&a.topics()[number].name).unwrap();
        a.numbers(number).eq(b.numbers(of_second))
            && a.numbers(number).all(|(incarnation, sequence)| {
                let sample = a.sample(number, incarnation, sequence).unwrap().unwrap();
                b.holds(of_second, incarnation, sequence, &sample.sample).unwrap() == Some(true)
            })
    };
    let samples: u64 = a.topics().iter().map(|t| t.samples).sum();
    assert!(samples > 10, "{samples} samples");
    let numbers =
        (0..a.topics().len()).filter(|number| is_computed(&a.topics()[*number].name) && !same(*number));
    numbers.map(|number| a.topics()[number].name.clone()).collect()
}

#[test]
fn operators_that_run_again_unchanged_send_the_recorded_bytes() {
    // By example: an operator in the middle, with all that is downstream of it.
    for (file, operator) in [
        ("examples/one-dof-tracking.yaml", "xbox_filter"),
        ("examples/one-dof-lqg.yaml", "law"),
        ("examples/own-cloud.yaml", "files_head"),
        ("examples/head-tracking.yaml", "filter"),
        ("pipeline.yaml", "law"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let sets = if file == "pipeline.yaml" { &SMALL_CAMERA[..] } else { &[] };
        let session = simulated(folder.path(), &root().join(file), "700 ms", sets);
        let (report, again) = what_if(folder.path(), &session, "again", &["--rerun", operator]);
        assert_eq!(report["identical_all"], true, "{file}: {}", report["comparison"]["first"]);
        assert!(report["computed"].as_array().unwrap().iter().any(|o| o == operator), "{file}");
        assert_eq!(differing(&session, &again), [] as [&str; 0], "{file}");
        // What was computed is a session like any other.
        let replay = stillpoint(folder.path(), &["replay", again.to_str().unwrap(), "--json"]);
        assert!(replay.status.success(), "{file}: {}{}", text(&replay.stdout), text(&replay.stderr));
        assert!(again.join("metadata.yaml").is_file());
    }
}

#[test]
fn every_operator_of_a_pipeline_may_be_the_first_that_runs_again() {
    let folder = tempfile::tempdir().unwrap();
    let session = simulated(folder.path(), &root().join("examples/one-dof-tracking.yaml"), "400 ms", &[]);
    for operator in ["xbox", "v2_cloud", "xbox_face", "v2_height", "fused"] {
        let (_, again) = what_if(folder.path(), &session, operator, &["--rerun", operator]);
        assert_eq!(differing(&session, &again), [] as [&str; 0], "{operator}");
    }
}

#[test]
fn a_closed_loop_with_another_gain_is_the_run_with_that_gain() {
    let folder = tempfile::tempdir().unwrap();
    let file = root().join("pipeline.yaml");
    let early = ["target.moves=[{ at: 1.8 s, z: 5 mm }]"];
    let sets = [&SMALL_CAMERA[..], &early].concat();
    let recorded = simulated(folder.path(), &file, "2400 ms", &sets);
    let gain = "law.proportional=3 1/s";
    let fresh = simulated(folder.path(), &file, "2400 ms", &[&sets[..], &[gain]].concat());
    let changed = differing(&recorded, &fresh);
    assert!(changed.iter().any(|topic| topic == "law.duties"), "{changed:?}");

    let (report, computed) = what_if(folder.path(), &recorded, "w", &["--set", gain]);
    assert_eq!(differing(&fresh, &computed), [] as [&str; 0]);
    assert_eq!(report["closed_loop"], serde_json::json!(["rig"]));
    assert_eq!(report["changes"][0]["what"], "proportional");
    let topics = report["comparison"]["topics"].as_array().unwrap();
    let duties = topics.iter().find(|t| t["topic"] == "law.duties").unwrap();
    let since = duties["since_s"].as_f64().unwrap();
    // The first sample that the two runs do not share, by hand.
    let [old, new] = [&recorded, &fresh].map(|path| Session::open(path).unwrap());
    let [number, other] = [&old, &new].map(|s| s.topic_number("law.duties").unwrap());
    let first = old.numbers(number).find_map(|(incarnation, sequence)| {
        let sample = old.sample(number, incarnation, sequence).unwrap().unwrap().sample;
        let is_same = new.holds(other, incarnation, sequence, &sample).unwrap() == Some(true);
        (!is_same).then(|| u64::from_le_bytes(sample[..8].try_into().unwrap()))
    });
    assert_eq!(first.unwrap() as f64 * 1e-9, since, "{duties}");
    assert!(
        duties["fields"].as_array().unwrap().iter().any(|f| f["rms"].as_f64().is_some_and(|rms| rms > 0.0))
    );
    // The recorded value is no change.
    let (none, same) = what_if(folder.path(), &recorded, "same", &["--set", "law.proportional=2.37 1/s"]);
    assert_eq!((&none["changes"], &none["computed"]), (&serde_json::json!([]), &serde_json::json!([])));
    assert_eq!(differing(&recorded, &same), [] as [&str; 0]);
}

#[test]
fn what_is_upstream_of_a_change_is_recorded_and_what_is_downstream_is_the_run_with_the_change() {
    let folder = tempfile::tempdir().unwrap();
    let file = root().join("examples/one-dof-tracking.yaml");
    let recorded = simulated(folder.path(), &file, "1 s", &[]);
    for (number, change) in [
        "fused.every=30 ms",
        "xbox_face.leaf=6 mm",
        "xbox_filter.inputs.measurement={ from: xbox_height.position, queue: 1 }",
        "fused.latency=7 ms",
    ]
    .into_iter()
    .enumerate()
    {
        let fresh = simulated(folder.path(), &file, "1 s", &[change]);
        let (report, computed) = what_if(folder.path(), &recorded, &number.to_string(), &["--set", change]);
        // A step that takes longer ends the run later, which the recorded operators do not see.
        let is_later = change.contains("latency");
        let differing = differing(&fresh, &computed);
        let differing: Vec<_> = differing.iter().filter(|t| !is_later || !t.ends_with(".journal")).collect();
        assert!(differing.is_empty(), "{change}: {differing:?}");
        assert_eq!(report["closed_loop"], serde_json::json!([]), "{change}");
        for topic in report["comparison"]["topics"].as_array().unwrap() {
            let is_upstream = !["fused.", "xbox_f", "xbox_h"]
                .iter()
                .any(|n| topic["topic"].as_str().unwrap().starts_with(n));
            assert!(!is_upstream || topic["identical"] == true, "{change}: {topic}");
        }
    }
}

#[test]
fn another_kind_another_file_and_a_held_operator_are_changes_too() {
    let folder = tempfile::tempdir().unwrap();
    let file = root().join("examples/head-tracking.yaml");
    let recorded = simulated(folder.path(), &file, "500 ms", &[]);
    // A second filter behind the same poses, and none of its own.
    let pipeline = std::fs::read_to_string(&file).unwrap();
    let added = "  slow: { use: estimate.kalman, inputs: { measurement: head.pose, report: head.report }, params: { follow: pose } }\n\nprocesses:";
    let with = folder.path().join("with.yaml");
    std::fs::write(
        &with,
        pipeline.replacen("\nprocesses:", added, 1).replacen("filter.state,", "filter.state, slow.state,", 1),
    )
    .unwrap();
    let (report, computed) = what_if(folder.path(), &recorded, "added", &["--with", with.to_str().unwrap()]);
    assert_eq!(report["computed"], serde_json::json!(["slow"]));
    assert_eq!(report["changes"][0]["operator"], "slow");
    assert_eq!(report["comparison"]["only"][1], serde_json::json!(["slow.journal", "slow.state"]));
    let found = Session::open(&computed).unwrap();
    assert!(found.topics().iter().any(|t| t.name == "slow.state" && t.samples > 0));
    // A change that reaches the head stops at an operator that is held.
    let hold = ["--set", "face.leaf=6 mm", "--hold", "filter"];
    let (held, _) = what_if(folder.path(), &recorded, "held", &hold);
    assert_eq!(
        (&held["computed"], &held["held"]),
        (&serde_json::json!(["face", "head"]), &serde_json::json!(["filter"]))
    );
}

#[test]
fn a_sweep_gives_the_figures_of_each_value_as_single_changes_do() {
    let folder = tempfile::tempdir().unwrap();
    let session = simulated(folder.path(), &root().join("pipeline.yaml"), "2.5 s", &SMALL_CAMERA);
    let command = ["replay", session.to_str().unwrap(), "--sweep"];
    let sweep = ["law.proportional=2.37..4.37 1/s/3", "--page", "sweep.html", "--json"];
    let out = stillpoint(folder.path(), &[&command[..], &sweep].concat());
    assert!(out.status.success(), "{}", text(&out.stderr));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let runs = report["runs"].as_array().unwrap();
    let values: Vec<f64> = runs.iter().map(|run| run["value"].as_f64().unwrap()).collect();
    assert_eq!((values.len(), values[0], values[2]), (3, 2.37, 4.37));
    assert_eq!(runs[0]["identical_all"], true, "the recorded value");
    assert_eq!(runs[2]["identical_all"], false, "another value");
    let (single, _) = what_if(folder.path(), &session, "single", &["--set", "law.proportional=4.37 1/s"]);
    let figures = single["comparison"]["figures"].as_array().unwrap();
    assert!(!figures.is_empty());
    assert_eq!(&runs[2]["figures"], &single["comparison"]["figures"]);
    let page = std::fs::read_to_string(folder.path().join("sweep.html")).unwrap();
    let is_drawn = |figure: &Value| page.contains(&format!(">{}", figure["name"].as_str().unwrap()));
    assert!(figures.iter().all(is_drawn) && page.contains("recorded"), "a curve for each figure");

    let refused = |arguments: &[&str]| {
        let out = stillpoint(folder.path(), &[&command[..], arguments].concat());
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stdout));
        text(&out.stderr)
    };
    assert!(refused(&["law.proportional=1..5"]).contains("OPERATOR.PARAM=FROM..TO/COUNT"));
    // Refused before anything runs.
    assert!(refused(&["law.proportional=1..-5 1/s/3"]).contains("out of range"));
    assert!(refused(&["law.none=1..5/3"]).contains("none"));
    assert!(refused(&["law.integral=1..5/3", "--record", "all"]).contains("--record"));
}

#[test]
fn wrong_changes_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let session = simulated(folder.path(), &root().join("examples/own-cloud.yaml"), "200 ms", &[]);
    let session = session.to_str().unwrap();
    for (arguments, code, says) in [
        (&["--set", "files_heat.leaf=1 mm"][..], 2, "there is no operator"),
        (&["--set", "files_head.nonsense=1"], 2, "nonsense"),
        (&["--set", "files_head.use=track.nothing"], 2, "track.nothing"),
        (&["--rerun", "nobody"], 2, "the pipeline has no operator `nobody`"),
        (&["--rerun", "files_head", "--hold", "nobody"], 2, "the pipeline has no operator `nobody`"),
        (&["--hold", "files_head"], 2, "--hold needs a change"),
        (&["--latencies", "declared"], 2, "--latencies needs a change"),
        (&["--with", "missing.yaml"], 2, "missing.yaml"),
        (&["--set", "files_head.leaf=1 mm", "--only", "files_head"], 2, "cannot be used with"),
        (&["--rerun", "files_head", "--record", session], 1, "it is there already"),
    ] {
        let out = stillpoint(folder.path(), &[&["replay", session], arguments].concat());
        let message = text(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{arguments:?}: {message}");
        assert!(message.contains(says), "{arguments:?}: {message}");
    }
}

#[test]
fn a_session_differs_from_itself_in_nothing_and_from_another_run_in_what_was_changed() {
    let folder = tempfile::tempdir().unwrap();
    let file = root().join("examples/one-dof-tracking.yaml");
    let first = simulated(folder.path(), &file, "1 s", &[]);
    let second = simulated(
        folder.path(),
        &file,
        "1 s",
        &["fused.tolerance=1 mm", "xbox_filter.acceleration_sd=9 mm/s2"],
    );
    let [a, b] = [&first, &second].map(|path| path.to_str().unwrap());
    let same = stillpoint(folder.path(), &["diff", a, a]);
    assert_eq!(same.status.code(), Some(0), "{}", text(&same.stdout));
    assert!(text(&same.stdout).contains("the sessions are the same, to the bit"));

    let out = stillpoint(folder.path(), &["diff", a, b, "--json", "--page", "page.html"]);
    assert_eq!(out.status.code(), Some(3), "{}{}", text(&out.stdout), text(&out.stderr));
    let found: Value = serde_json::from_slice(&out.stdout).unwrap();
    let differing: Vec<&str> = found["topics"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|t| t["identical"] == false)
        .map(|t| t["topic"].as_str().unwrap())
        .collect();
    assert!(differing.contains(&"xbox_filter.state"), "{differing:?}");
    assert!(!differing.iter().any(|t| t.starts_with("v2_") || t.starts_with("xbox_height")), "{differing:?}");
    assert_eq!(found["first"]["topic"], "xbox_filter.state", "{}", found["first"]);

    // The root mean square by hand, over the samples since the first difference.
    let topic =
        found["topics"].as_array().unwrap().iter().find(|t| t["topic"] == "xbox_filter.state").unwrap();
    let field = topic["fields"].as_array().unwrap().iter().find(|f| f["field"] == "position.z").unwrap();
    let heights = |path: &Path| -> Vec<f64> {
        let session = Session::open(path).unwrap();
        let samples = session.samples_where(|t| t.name == "xbox_filter.state").map(Result::unwrap);
        samples
            .map(|s| {
                let pieces = stillpoint_samples::Pieces::split(
                    <stillpoint_samples::Track as stillpoint_samples::Sample>::KIND,
                    &s.sample,
                )
                .unwrap();
                pieces.view::<stillpoint_samples::Track>().unwrap().first().unwrap().position[2]
            })
            .collect()
    };
    let off: Vec<f64> = heights(&first).iter().zip(heights(&second)).map(|(a, b)| b - a).collect();
    let since: Vec<f64> = off.iter().copied().skip_while(|d| *d == 0.0).collect();
    let rms = (since.iter().map(|d| d * d).sum::<f64>() / since.len() as f64).sqrt();
    let worst = off.iter().fold(0.0f64, |w, d| w.max(d.abs()));
    assert!((field["rms"].as_f64().unwrap() - rms).abs() < 1e-12, "{field} {rms}");
    assert!((field["worst"].as_f64().unwrap().abs() - worst).abs() < 1e-15, "{field} {worst}");

    let page = std::fs::read_to_string(folder.path().join("page.html")).unwrap();
    assert!(page.contains("xbox_filter.state position.z") && page.contains("<svg"), "no chart of both runs");
    let text = text(&stillpoint(folder.path(), &["diff", a, b]).stdout);
    assert!(text.contains("the first difference: xbox_filter.state"), "{text}");
}

#[test]
fn the_commands_of_the_guide_do_what_it_says() {
    const PAGE: &str = include_str!("../../../../docs/guide/what-if.md");
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("examples/data")).unwrap();
    for file in ["pipeline.yaml", "examples/data/rig.key"] {
        std::fs::copy(root().join(file), folder.path().join(file)).unwrap();
    }
    let blocks = PAGE.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let commands: Vec<&str> = blocks.flat_map(str::lines).collect();
    assert!(commands.len() >= 8, "{commands:?}");
    for command in commands {
        // The camera of the page is four times as large in each direction.
        let small: String = SMALL_CAMERA.iter().map(|set| format!(" --set \"{set}\"")).collect();
        let small = if command.starts_with("stillpoint run") { small } else { String::new() };
        let line = format!(
            "'{}'{}{small}",
            env!("CARGO_BIN_EXE_stillpoint"),
            command.trim_start_matches("stillpoint")
        );
        let done =
            std::process::Command::new("sh").args(["-c", &line]).current_dir(folder.path()).output().unwrap();
        let expected = if command.starts_with("stillpoint diff") { 3 } else { 0 };
        let (out, err) = (text(&done.stdout), text(&done.stderr));
        assert_eq!(done.status.code(), Some(expected), "{command}: {out}{err}");
        assert!(!out.is_empty(), "{command}");
        if command.contains("--set law.proportional=\"3 1/s\"") {
            assert!(
                out.contains("change: law.proportional: 2.37 -> 3") && out.contains("closed loop"),
                "{out}"
            );
        }
        if command.contains("--rerun") {
            assert!(out.contains("identical to the bit") && !out.contains("the first difference"), "{out}");
        }
    }
}

#[test]
fn of_a_live_session_what_is_upstream_stays_and_people_and_held_sensors_do_not_react() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("examples/data")).unwrap();
    std::fs::copy(root().join("examples/data/rig.key"), folder.path().join("examples/data/rig.key")).unwrap();
    let pipeline = std::fs::read_to_string(root().join("pipeline.yaml")).unwrap();
    std::fs::write(folder.path().join("live.yaml"), crate::loops::elsewhere(&pipeline)).unwrap();
    let small = SMALL_CAMERA.map(|set| ["--set", set]).concat();
    let run = [&["run", "live.yaml", "--for", "3 s", "--record", "s", "--json"][..], &small].concat();
    let out = stillpoint(folder.path(), &run);
    let report: Value =
        serde_json::from_slice(&out.stdout).unwrap_or_else(|_| panic!("{}", text(&out.stderr)));
    let session = folder.path().join(report["session"].as_str().unwrap());

    // Without a change nothing runs again, and the recording is what it was.
    let (same, copy) = what_if(folder.path(), &session, "same", &["--set", "law.proportional=2.37 1/s"]);
    assert_eq!(same["computed"], serde_json::json!([]));
    assert_eq!(differing(&session, &copy), [] as [&str; 0]);

    let is_identical = |report: &Value, topic: &str| {
        let topics = report["comparison"]["topics"].as_array().unwrap();
        topics.iter().find(|t| t["topic"] == topic).unwrap_or_else(|| panic!("{topic}"))["identical"] == true
    };
    // A loop that is closed over the rig: only the console is recorded.
    let (closed, computed) = what_if(folder.path(), &session, "closed", &["--set", "law.proportional=3 1/s"]);
    assert_eq!(
        (&closed["held"], &closed["closed_loop"]),
        (&serde_json::json!(["console"]), &serde_json::json!(["rig"]))
    );
    assert!(is_identical(&closed, "console.capture") && is_identical(&closed, "console.journal"));
    assert!(!closed["measured_steps"].as_array().unwrap().is_empty());
    assert!(!is_identical(&closed, "law.duties"));
    let replay = stillpoint(folder.path(), &["replay", computed.to_str().unwrap()]);
    assert!(replay.status.success(), "{}{}", text(&replay.stdout), text(&replay.stderr));

    // A loop that is opened at the rig. Its images are not in the session: they are computed on the way.
    let hold = ["--set", "face.leaf=6 mm", "--hold", "rig"];
    let (open, _) = what_if(folder.path(), &session, "open", &hold);
    assert_eq!(
        (&open["closed_loop"], &open["differences_of_recording"]),
        (&serde_json::json!([]), &0.into())
    );
    assert!(open["held"].as_array().unwrap().contains(&"rig".into()), "{}", open["held"]);
    assert!(is_identical(&open, "rig.truth") && is_identical(&open, "rig.journal"));
    assert!(!is_identical(&open, "head.pose"));
}
