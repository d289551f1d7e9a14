//! The command as a user meets it: generated pages are current, the examples check and run, answers and exit codes hold.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod arc;
mod bench;
mod bladder;
mod browser;
mod calibrate;
mod case;
mod compose;
mod delivered;
mod dose;
mod export;
mod first_hour;
mod identified;
mod identity;
mod loops;
mod machine;
mod merge;
mod new;
#[cfg(feature = "parquet")]
mod parquet;
mod plan;
mod qa;
mod queue;
mod reach;
mod recalculate;
mod report;
mod streams;
mod what_if;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Runs the command in `folder`, with a folder of runs of its own.
fn stillpoint(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_stillpoint"))
        .args(arguments)
        .current_dir(folder)
        .env("STILLPOINT_RUNS", folder.join("runs"))
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Compares a generated page with the one in the repository; `BLESS=1` writes it anew.
fn is_current(page: &str, generated: &str) {
    let path = root().join(page);
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, generated).unwrap();
    }
    let retained = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(retained, generated, "{page} is not current: run the tests with BLESS=1");
}

#[test]
fn generated_pages_are_current() {
    let folder = tempfile::tempdir().unwrap();
    let reference = stillpoint(folder.path(), &["operators", "--all"]);
    is_current("docs/reference/operators.md", &text(&reference.stdout));
    let schema = stillpoint(folder.path(), &["schema"]);
    is_current("docs/pipeline.schema.json", &text(&schema.stdout));
    let types = stillpoint(folder.path(), &["types", "--all"]);
    is_current("docs/reference/samples.md", &text(&types.stdout));
    let page = stillpoint(folder.path(), &["manual", "page"]);
    is_current("docs/reference/cli.md", &text(&page.stdout));
}

#[test]
fn every_example_checks_and_runs_and_replays() {
    let mut examples: Vec<PathBuf> = std::fs::read_dir(root().join("examples"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "yaml"))
        .collect();
    examples.push(root().join("pipeline.yaml"));
    examples.sort();
    for example in examples {
        let folder = tempfile::tempdir().unwrap();
        let file = example.canonicalize().unwrap().display().to_string();
        let run = ["run", &file, "--clock", "simulated", "--for", "1s", "--record", "s", "--json"];
        let out = stillpoint(folder.path(), &run);
        assert!(out.status.success(), "{file}: {}{}", text(&out.stdout), text(&out.stderr));
        let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let session = report["session"].as_str().unwrap();
        let replay = stillpoint(folder.path(), &["replay", session]);
        assert!(replay.status.success(), "{file}: {}{}", text(&replay.stdout), text(&replay.stderr));
        assert!(text(&replay.stdout).contains("identical"), "{file}");
    }
}

#[test]
fn a_simulated_run_is_compressed_as_asked() {
    for compression in ["none", "lz4", "zstd"] {
        let folder = tempfile::tempdir().unwrap();
        let run =
            ["run", "--clock", "simulated", "--for", "100ms", "--record", "s", "--compression", compression];
        let out = stillpoint(folder.path(), &run);
        assert!(out.status.success(), "{}", text(&out.stderr));
        let session = stillpoint_recorder::session_parts(&folder.path().join("s/head-3dof-0001")).unwrap();
        let file = std::fs::read(&session[0]).unwrap();
        // Each chunk names its compression.
        let found =
            ["lz4", "zstd"].map(|name| file.windows(name.len()).any(|bytes| bytes == name.as_bytes()));
        assert_eq!(found, ["lz4", "zstd"].map(|name| name == compression), "{compression}");
    }
}

#[test]
fn every_example_is_in_the_list_of_examples() {
    let list = std::fs::read_to_string(root().join("examples/README.md")).unwrap();
    for example in std::fs::read_dir(root().join("examples")).unwrap() {
        let name = example.unwrap().file_name().to_string_lossy().into_owned();
        let command = format!("stillpoint run examples/{name}");
        assert!(
            !name.ends_with(".yaml") || list.contains(&command),
            "{command} is not in examples/README.md"
        );
    }
}

#[test]
fn the_default_pipeline_comes_with_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let out = stillpoint(folder.path(), &["check"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("no faults"));
    // Its key comes with it: into every process, into the session, and from there into replay and report.
    let small = SMALL_CAMERA.map(|set| ["--set", set]).concat();
    for place in [&["--clock", "simulated"][..], &["--lock-step=processes"]] {
        let run = [&["run", "--for", "1s", "--record", "s", "--json"], place, &small].concat();
        let out = stillpoint(folder.path(), &run);
        assert!(out.status.success(), "{place:?}: {}{}", text(&out.stdout), text(&out.stderr));
    }
    for command in [&["replay", "s/head-3dof-0001"][..], &["report", "s/head-3dof-0002"]] {
        let out = stillpoint(folder.path(), command);
        assert!(out.status.success(), "{command:?}: {}{}", text(&out.stdout), text(&out.stderr));
    }
    // A key of one's own is looked for on disk.
    let out = stillpoint(folder.path(), &["check", "--set", "valves.key=own.key"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("own.key"), "{}", text(&out.stderr));
}

#[test]
fn ticks_that_a_busy_operator_misses_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let busy =
        "stillpoint: 1\nname: busy\noperators:\n  console: { use: console, every: 10 ms, latency: 25 ms }\n";
    std::fs::write(folder.path().join("busy.yaml"), busy).unwrap();
    let run = ["run", "busy.yaml", "--clock", "simulated", "--for", "1s", "--no-record", "--json"];
    let report: serde_json::Value = serde_json::from_slice(&stillpoint(folder.path(), &run).stdout).unwrap();
    let [ticks, missed] = ["ticks", "missed"].map(|key| report["operators"][0][key].as_u64().unwrap());
    // A step takes two and a half periods, and ticks go from 0 to 1 s.
    assert!(ticks < 45 && (99..=101).contains(&(ticks + missed)), "{ticks} {missed}");
}

/// Images that cost little.
const SMALL_CAMERA: [&str; 3] =
    ["rig.camera.width='160 px'", "rig.camera.height='120 px'", "rig.camera.focal_length='141 px'"];

#[test]
fn a_wrong_pipeline_is_refused_with_place_and_exit_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = "stillpoint: 1\nname: x\noperators:\n  face: { use: segment.fce }\n";
    std::fs::write(folder.path().join("wrong.yaml"), wrong).unwrap();
    for command in [&["check", "wrong.yaml"][..], &["run", "wrong.yaml", "--for", "1s"]] {
        let out = stillpoint(folder.path(), command);
        assert_eq!(out.status.code(), Some(2));
        let output_text = text(&out.stderr);
        assert!(
            output_text.contains("wrong.yaml:4:16") && output_text.contains("segment.face"),
            "{output_text}"
        );
    }
}

#[test]
fn faults_have_one_shape_for_programs() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("good.yaml", b"stillpoint: 1\nname: x\noperators:\n  console: { use: console, every: 20 ms }\n");
    write("wrong.yaml", b"stillpoint: 1\nname: x\noperators:\n  face: { use: segment.fce }\n");
    write("binary.yaml", b"stillpoint: 1\nname: \xc3\x28\n");
    let output_text = |command: &[&str]| {
        let out = stillpoint(folder.path(), command);
        let output_text: serde_json::Value = serde_json::from_slice(&out.stdout)
            .unwrap_or_else(|e| panic!("{command:?}: {e}: {}{}", text(&out.stdout), text(&out.stderr)));
        (out.status.code(), output_text)
    };
    let good = serde_json::json!({ "pipeline": "x", "operators": ["console"], "faults": [] });
    assert_eq!(output_text(&["check", "good.yaml", "--json"]), (Some(0), good));
    for (file, code, line, column) in [
        ("wrong.yaml", "unknown-kind", 4, 16),
        ("binary.yaml", "syntax", 2, 7),
        ("nothing.yaml", "file-missing", 1, 1),
    ] {
        let (exit, checked) = output_text(&["check", file, "--json"]);
        assert_eq!(
            (exit, &checked["pipeline"], &checked["operators"]),
            (Some(2), &().into(), &serde_json::json!([]))
        );
        let fault = &checked["faults"][0];
        let place = (fault["file"].as_str(), fault["line"].as_u64(), fault["column"].as_u64());
        assert_eq!(place, (Some(file), Some(line), Some(column)));
        assert_eq!(fault["code"], code);
        assert!(fault["message"].is_string() && fault["help"].is_string(), "{fault}");
        assert_eq!(output_text(&["run", file, "--json", "--for", "1s"]), (exit, checked));
    }
}

#[test]
fn kinds_are_described_for_programs() {
    let folder = tempfile::tempdir().unwrap();
    let output_text = |command: &[&str]| -> serde_json::Value {
        serde_json::from_slice(&stillpoint(folder.path(), command).stdout).unwrap()
    };
    let all = output_text(&["operators", "--json"]);
    let depth = output_text(&["operators", "ingest.depth", "--json"]);
    assert!(all.as_array().unwrap().contains(&depth));
    assert_eq!((&depth["role"], &depth["timer"]), (&"operator".into(), &"optional".into()));
    assert_eq!(
        (&depth["inputs"][0]["takes"], &depth["inputs"][0]["required"]),
        (&"DepthImage".into(), &false.into())
    );
    assert_eq!(depth["outputs"][0]["sends"], "PointCloud");
    let param = |name: &str| depth["params"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
    assert_eq!((&param("at_end")["default"], &param("at_end")["required"]), (&"stop".into(), &false.into()));
    assert_eq!(param("at_end")["choices"], serde_json::json!(["stop", "repeat"]));
    assert_eq!(
        (&param("camera")["params"][0]["name"], &param("camera")["params"][0]["unit"]),
        (&"fx".into(), &"px".into())
    );
}

#[test]
fn echo_refuses_what_it_cannot_show() {
    let folder = tempfile::tempdir().unwrap();
    let foreign = std::fs::File::create(folder.path().join("foreign.mcap")).unwrap();
    let mut writer = mcap::Writer::new(foreign).unwrap();
    let schema = writer.add_schema("sensor_msgs/msg/Imu", "ros2msg", b"float64 x").unwrap();
    let channel = writer.add_channel(schema, "imu", "cdr", &Default::default()).unwrap();
    let header =
        mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, &[0; 12]).unwrap();
    writer.finish().unwrap();
    let empty = std::fs::File::create(folder.path().join("empty.mcap")).unwrap();
    mcap::Writer::new(empty).unwrap().finish().unwrap();
    std::fs::write(folder.path().join("none.mcap"), b"").unwrap();
    for (command, code, word) in [
        (&["echo", "imu", "--session", "foreign.mcap"][..], 1, "`imu` has messages of another program"),
        (&["echo", "imo", "--session", "foreign.mcap"], 2, "did you mean imu?"),
        (&["echo", "imu", "--session", "empty.mcap"], 1, "empty.mcap: it holds no topic"),
        (&["report", "empty.mcap"], 1, "empty.mcap: it holds no topic"),
        (&["info", "empty.mcap"], 1, "empty.mcap: it holds no topic"),
        (&["replay", "empty.mcap"], 1, "empty.mcap: it holds no topic"),
        (&["echo", "imu", "--session", "none.mcap"], 1, "this is not an MCAP file"),
        (&["echo", "imu", "--count", "0"], 2, "0 is not in 1.."),
    ] {
        let out = stillpoint(folder.path(), command);
        assert_eq!(out.status.code(), Some(code), "{command:?}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(word), "{command:?}: {}", text(&out.stderr));
        assert!(out.stdout.is_empty());
    }
}

#[test]
fn a_run_over_a_folder_of_images_ends_when_they_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let file = root().join("examples/own-recording.yaml").canonicalize().unwrap().display().to_string();
    for how in [&[][..], &["--clock", "simulated"], &["--lock-step=threads"]] {
        let out = stillpoint(folder.path(), &[&["run", &file, "--json", "--record", "s"], how].concat());
        assert!(out.status.success(), "{how:?}: {}{}", text(&out.stdout), text(&out.stderr));
        let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!((&report["ended_early"], &report["balanced"]), (&().into(), &true.into()));
        let cloud =
            report["operators"].as_array().unwrap().iter().find(|o| o["operator"] == "cloud").unwrap();
        assert_eq!(cloud["sent"], 6, "{how:?}");
        let replay = stillpoint(folder.path(), &["replay", report["session"].as_str().unwrap()]);
        assert!(
            replay.status.success() && text(&replay.stdout).contains("identical"),
            "{}",
            text(&replay.stdout)
        );
    }
}

#[test]
fn a_simulated_run_without_a_length_needs_sources_that_finish() {
    let folder = tempfile::tempdir().unwrap();
    let images = root().join("examples/own-recording.yaml").canonicalize().unwrap().display().to_string();
    let rig = root().join("pipeline.yaml").canonicalize().unwrap().display().to_string();
    for arguments in [vec![rig.as_str()], vec![images.as_str(), "--set", "cloud.at_end=repeat"]] {
        let out = stillpoint(
            folder.path(),
            &[&["run", "--clock", "simulated", "--no-record"], &arguments[..]].concat(),
        );
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        assert!(
            text(&out.stderr).contains("not every source of this pipeline finishes"),
            "{}",
            text(&out.stderr)
        );
    }
}

#[test]
fn what_is_not_there_is_named_and_nothing_panics() {
    let folder = tempfile::tempdir().unwrap();
    for (command, code, word) in [
        (&["run", "nothing.yaml"][..], 2, "nothing.yaml"),
        (&["replay", "nothing"], 1, "nothing"),
        (&["info", "nothing"], 1, "nothing"),
        (&["recover", "nothing"], 1, "nothing"),
        (&["operators", "segment.fac"], 2, "segment.face"),
        (&["echo", "filter.state"], 1, "no pipeline is running"),
        (&["send", "console.arm"], 1, "no pipeline is running"),
        (&["send", "console.amr"], 2, "arm"),
        (&["send", "console.target", "5 kg"], 2, "`5 kg` is not a number, nor a quantity in m, rad"),
        (&["send", "console.fault", "leak", "0", "1 deg"], 2, "`1 deg` is not a number"),
        (&["send", "console.fault", "leak", "0", "-1mm", "5s"], 1, "no pipeline is running"),
        (&["run", "--for", "10"], 2, "unit"),
        (&["run", "--for", "-5s"], 2, "negative"),
    ] {
        let out = stillpoint(folder.path(), command);
        let output_text = text(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{command:?}: {output_text}");
        assert!(output_text.contains(word), "{command:?}: {output_text}");
        assert!(
            !output_text.contains("panicked") && !output_text.contains("RUST_BACKTRACE"),
            "{command:?}: {output_text}"
        );
    }
}

#[test]
fn worker_pool_router_and_pki_show_their_help_and_their_faults_without_the_program_of_the_network() {
    let call = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_stillpoint"))
            .args(arguments)
            .env("STILLPOINT_BRIDGE", "/nowhere/stillpoint-bridge")
            .output()
            .unwrap()
    };
    for (subcommand, option) in
        [("worker", "--cache-mb"), ("pool", "--seconds"), ("router", "--listen"), ("pki", "certificate")]
    {
        let help = call(&[subcommand, "--help"]);
        assert_eq!(help.status.code(), Some(0), "{subcommand}");
        assert!(text(&help.stdout).contains(option), "{subcommand}: {}", text(&help.stdout));
        let misspelled = call(&[subcommand, "--lissten", "tcp/0.0.0.0:7447"]);
        assert_eq!(misspelled.status.code(), Some(2), "{subcommand}: {}", text(&misspelled.stderr));
        assert!(text(&misspelled.stderr).contains("--lissten"), "{subcommand}");
    }
    let missing = call(&["router", "--listen", "tcp/0.0.0.0:7447"]);
    assert_eq!(missing.status.code(), Some(1), "{}", text(&missing.stderr));
    assert!(text(&missing.stderr).contains("/nowhere/stillpoint-bridge is not there"));
}

#[test]
fn a_bedside_without_the_program_of_the_network_is_refused_with_the_command_that_builds_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = Command::new(env!("CARGO_BIN_EXE_stillpoint"))
        .arg("rig")
        .current_dir(folder.path())
        .env("STILLPOINT_RUNS", folder.path().join("runs"))
        .env("STILLPOINT_BRIDGE", "/nowhere/stillpoint-bridge")
        .output()
        .unwrap();
    let output_text = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{output_text}");
    for words in ["/nowhere/stillpoint-bridge", "cargo build", "--manifest-path tools/bridge/Cargo.toml"] {
        assert!(output_text.contains(words), "{output_text}");
    }
    // Nothing of a run that did not begin is left.
    assert_eq!(std::fs::read_dir(folder.path().join("sessions")).unwrap().count(), 0);
}

#[test]
fn a_cut_session_is_mended_once_and_replays_up_to_where_it_was_cut() {
    let folder = tempfile::tempdir().unwrap();
    let pipeline =
        root().join("examples/one-dof-tracking.yaml").canonicalize().unwrap().display().to_string();
    let run = ["run", &pipeline, "--clock", "simulated", "--for", "2s", "--record", "s", "--json"];
    let out = stillpoint(folder.path(), &run);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let part = folder.path().join("s/one-dof-tracking-0001/part-000.mcap");
    let bytes = std::fs::read(&part).unwrap();
    std::fs::write(&part, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let call = |command: &[&str]| {
        let out = stillpoint(folder.path(), &[command, &["s/one-dof-tracking-0001"]].concat());
        (out.status.code(), text(&out.stdout))
    };
    let (code, output_text) = call(&["info"]);
    assert!(code == Some(0) && output_text.contains("repair it with `stillpoint recover`"), "{output_text}");
    let (code, output_text) = call(&["recover", "--json"]);
    let mended: serde_json::Value = serde_json::from_str(&output_text).unwrap();
    assert_eq!((code, mended.as_array().unwrap().len()), (Some(0), 1), "{output_text}");
    assert!(
        mended[0]["messages"].as_u64().unwrap() > 0 && mended[0]["bytes_cut"].as_u64().unwrap() > 0,
        "{output_text}"
    );
    assert_eq!(call(&["recover", "--json"]), (Some(0), "[]\n".to_owned()), "it is whole now");
    // A supervisor that died wrote no metadata.yaml, though the parts are whole.
    let metadata = folder.path().join("s/one-dof-tracking-0001/metadata.yaml");
    std::fs::remove_file(&metadata).unwrap();
    let (code, output_text) = call(&["recover"]);
    assert!(
        code == Some(0) && output_text.contains("metadata.yaml was missing and has been written"),
        "{output_text}"
    );
    assert!(metadata.exists());
    let (_, output_text) = call(&["info"]);
    assert!(output_text.contains("ended cut, and ") && output_text.contains(" is mended"), "{output_text}");
    assert!(!output_text.contains("stillpoint recover"), "{output_text}");
    let (code, output_text) = call(&["replay", "--json"]);
    let replay: serde_json::Value = serde_json::from_str(&output_text).unwrap();
    assert_eq!((code, replay["differences"].as_u64()), (Some(4), Some(0)), "{output_text}");
    assert!(replay["activations"].as_u64().unwrap() > 0);
}

#[test]
fn a_model_is_fitted_to_a_session_and_comes_with_what_it_was_made_from() {
    let folder = tempfile::tempdir().unwrap();
    let pipeline = root().join("examples/head-tracking.yaml").canonicalize().unwrap().display().to_string();
    let small =
        ["--set", "rig.width='160 px'", "--set", "rig.height='120 px'", "--set", "rig.focal_length='141 px'"];
    let run = [
        "run",
        &pipeline,
        "--clock",
        "simulated",
        "--for",
        "20s",
        "--record",
        "s",
        "--set",
        "rig.motion=steps",
    ];
    let out = stillpoint(folder.path(), &[&run[..], &small[..]].concat());
    assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
    let fit = |output: &str| {
        let from =
            ["identify", "s/head-tracking-6dof-0001", "--input", "rig.truth:position.2", "--output", output];
        stillpoint(folder.path(), &[&from[..], &["--order", "1", "--json", "--model", "m.json"]].concat())
    };
    // How the filtered height follows the true one: by about as much, and settled within seconds.
    let out = fit("filter.state:position.2");
    assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
    let output_text: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(output_text["record"]["grid"]["count"], 200);
    let gain = output_text["found"]["dc_gain"]["value"].as_f64().unwrap();
    assert!((0.5..1.5).contains(&gain), "{gain}");
    let model = stillpoint_identify::InnovationModel::from_json(
        &std::fs::read(folder.path().join("m.json")).unwrap(),
    )
    .unwrap();
    assert_eq!((model.order(), model.output().unit.as_str(), model.provenance().sha256.len()), (1, "m", 64));
    // What is misspelled is named.
    let out = fit("filter.state:positon.2");
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("position.0 to .2"), "{}", text(&out.stderr));
}

#[test]
fn a_run_says_how_many_frames_had_no_face_and_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = root().join("examples/own-recording.yaml").canonicalize().unwrap().display().to_string();
    let run = ["run", &file, "--clock", "simulated", "--for", "1s", "--record", "s"];
    let sound = stillpoint(folder.path(), &run);
    assert!(sound.status.success() && !text(&sound.stdout).contains("NO ANSWER"), "{}", text(&sound.stdout));
    // Nothing stands so high over the couch.
    let high = ["--set", "face.height_min=350 mm"];
    let none = stillpoint(folder.path(), &[&run[..], &high].concat());
    assert!(
        text(&none.stdout).contains("\nNO ANSWER: face: 0 of 6 frames had a face: "),
        "{}",
        text(&none.stdout)
    );
    let none = stillpoint(folder.path(), &[&run[..], &high, &["--json"]].concat());
    let output_text: serde_json::Value = serde_json::from_slice(&none.stdout).unwrap();
    assert_eq!(
        (&output_text["refused"][0]["operator"], &output_text["refused"][0]["refused"]),
        (&"face".into(), &6.into())
    );
    // Without the reasons in the session the run has seen them.
    let data = root().join("examples/data").canonicalize().unwrap();
    let unsaid = std::fs::read_to_string(&file).unwrap().replace("face.rejection, ", "");
    let unsaid = unsaid.replace("files: data", &format!("files: {}", data.display()));
    std::fs::write(folder.path().join("unsaid.yaml"), unsaid).unwrap();
    let run = ["run", "unsaid.yaml", "--clock", "simulated", "--for", "1s", "--record", "s"];
    let none = stillpoint(folder.path(), &[&run[..], &high].concat());
    let reported = "\nNO ANSWER: face: 0 of 6 frames had a face: ";
    assert!(text(&none.stdout).contains(reported), "{}", text(&none.stdout));
}

#[test]
fn parameters_that_do_not_go_together_are_found_before_a_run() {
    let folder = tempfile::tempdir().unwrap();
    for (example, set, message) in [
        (
            "own-recording",
            "face.height_min=400 mm",
            "`height_max` is 360 mm and must be greater than `height_min`, 400 mm",
        ),
        ("one-dof-lqg", "law.plant.bladders=[]", "`plant.bladders`"),
    ] {
        let file =
            root().join(format!("examples/{example}.yaml")).canonicalize().unwrap().display().to_string();
        let out = stillpoint(folder.path(), &["check", &file, "--set", set]);
        let output_text = format!("{}{}", text(&out.stdout), text(&out.stderr));
        assert_eq!(out.status.code(), Some(2), "{output_text}");
        assert!(
            output_text.contains(message) && output_text.contains(&format!("--set `{set}`")),
            "{output_text}"
        );
    }
}

#[test]
fn a_model_is_fitted_to_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let (mut y, mut table) = (0.0, "u,y\n".to_string());
    for k in 0..400 {
        let u = if (k / 23) % 2 == 0 { 1.0 } else { -1.0 };
        let e = 0.01 * (f64::from(k * 7919 % 101) / 50.0 - 1.0);
        table.push_str(&format!("{u},{}\n", y + e));
        y = 0.9 * y + 0.3 * u;
    }
    std::fs::write(folder.path().join("t.csv"), table).unwrap();
    let arguments =
        ["identify", "t.csv", "--input", "u", "--output", "y", "--order", "1", "--offset", "none"];
    let refused = stillpoint(folder.path(), &arguments);
    assert!(text(&refused.stderr).contains("add --sample-time"));
    let out = stillpoint(folder.path(), &[&arguments[..], &["--sample-time", "10 ms"]].concat());
    let output_text = text(&out.stdout);
    assert!(
        out.status.success() && output_text.contains("DC gain 3.0") && output_text.contains("10.000 ms"),
        "{output_text}"
    );
}
