//! Loops that are closed over a rig, the default pipeline first of all: the same bytes wherever they run, and live what a
//! replay makes again.

use std::net::UdpSocket;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{root, stillpoint, text};

/// The files of pipelines that have a head on bladders.
fn closed_loops() -> Vec<PathBuf> {
    let examples = std::fs::read_dir(root().join("examples")).unwrap().map(|e| e.unwrap().path());
    let yaml = examples.filter(|p| p.extension().is_some_and(|e| e == "yaml"));
    let closed = yaml.filter(|p| std::fs::read_to_string(p).unwrap().contains("_bladder"));
    let mut all: Vec<PathBuf> = closed.chain([root().join("pipeline.yaml")]).collect();
    all.sort();
    assert!(all.len() > 2);
    all
}

/// Runs a pipeline and gives its report and its session.
fn run(folder: &Path, file: &Path, more: &[&str]) -> (Value, PathBuf) {
    let file = file.canonicalize().unwrap().display().to_string();
    let out = stillpoint(folder, &[&["run", &file, "--record", "s", "--json"], more].concat());
    assert!(out.status.success(), "{file}: {}{}", text(&out.stdout), text(&out.stderr));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let session = folder.join(report["session"].as_str().unwrap());
    (report, session)
}

#[test]
fn closed_loops_write_the_same_bytes_simulated_and_in_lock_step() {
    for file in closed_loops() {
        let folder = tempfile::tempdir().unwrap();
        let places = [&["--clock", "simulated"][..], &["--lock-step=threads"], &["--lock-step=processes"]];
        let recordings = places.map(|place| {
            let (_, session) = run(folder.path(), &file, &[&["--for", "1200 ms"], place].concat());
            std::fs::read(session.join("part-000.mcap")).unwrap()
        });
        assert!(recordings[0] == recordings[1], "{}: threads differ from the simulation", file.display());
        assert!(recordings[0] == recordings[2], "{}: processes differ from the simulation", file.display());
    }
}

/// The text of a pipeline whose datagrams go to ports that nobody has.
pub fn elsewhere(text: &str) -> String {
    let mut parts = text.split("127.0.0.1:");
    let mut moved = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        moved += &format!("127.0.0.1:{port}{}", part.trim_start_matches(|c: char| c.is_ascii_digit()));
    }
    moved
}

#[test]
fn closed_loops_replay_bit_for_bit_what_they_did_live() {
    for file in closed_loops() {
        let folder = tempfile::tempdir().unwrap();
        for key in ["data", "examples/data"] {
            std::fs::create_dir_all(folder.path().join(key)).unwrap();
            for name in ["rig.key", "head.case"] {
                std::fs::copy(root().join("examples/data").join(name), folder.path().join(key).join(name))
                    .unwrap();
            }
        }
        let live = folder.path().join("live.yaml");
        std::fs::write(&live, elsewhere(&std::fs::read_to_string(&file).unwrap())).unwrap();
        let (report, session) = run(folder.path(), &live, &["--for", "3 s"]);
        assert_eq!(report["balanced"], true, "{}: {}", file.display(), report["ledger"]);
        let session = session.display().to_string();
        let replay = stillpoint(folder.path(), &["replay", &session, "--json"]);
        let output_text = text(&replay.stdout);
        assert!(replay.status.success(), "{}: {output_text}{}", file.display(), text(&replay.stderr));
        let replay: Value = serde_json::from_str(&output_text).unwrap();
        assert_eq!((&replay["identical_all"], &replay["open"]), (&true.into(), &serde_json::json!([])));
        assert!(replay["activations"].as_u64().unwrap() > 100, "{}", file.display());
    }
}

#[test]
fn what_was_refused_stands_at_the_end_of_a_run_and_in_the_report() {
    let folder = tempfile::tempdir().unwrap();
    // The far end has another key than the valves, and half a metre is more than any bladder lifts.
    let key = folder.path().join("own.key");
    std::fs::write(&key, "0123456789abcdef0123456789abcdef".repeat(2)).unwrap();
    std::fs::set_permissions(&key, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    std::fs::create_dir_all(folder.path().join("examples/data")).unwrap();
    std::fs::copy(root().join("examples/data/rig.key"), folder.path().join("examples/data/rig.key")).unwrap();
    let file = folder.path().join("pipeline.yaml");
    let script = "{ at: 1.5 s, say: arm }, { at: 2.2 s, say: target, values: [0.5, 0, 0] }]";
    let whole = std::fs::read_to_string(root().join("pipeline.yaml")).unwrap();
    std::fs::write(&file, whole.replacen("{ at: 1.5 s, say: arm, repeat: 500 ms }]", script, 1)).unwrap();
    let small =
        ["width='320 px'", "height='240 px'", "focal_length='283 px'"].map(|s| format!("rig.camera.{s}"));
    let mut sets = vec!["--clock", "simulated", "--for", "2400 ms", "--set", "valves.key=own.key"];
    sets.extend(small.iter().flat_map(|s| ["--set", s.as_str()]));
    let (json, session) = run(folder.path(), &file, &sets);

    let far = &json["held"]["far_ends"][0];
    assert_eq!((&far["doing"], &far["accepted"], &far["on_s"]), (&"venting".into(), &0.into(), &0.0.into()));
    let refused = far["refused"].as_u64().unwrap();
    assert!(refused > 100 && far["reasons"][0]["reason"] == "forged", "{far}");
    let target = &json["held"]["targets"][0]["refusals"];
    assert_eq!((&target["asked"], &target["refused"]), (&1.into(), &1.into()), "{target}");
    assert_eq!(target["why"], "it cannot be reached (z)");

    let output_text = stillpoint(folder.path(), &["report", &session.display().to_string(), "--json"]);
    let report: Value = serde_json::from_slice(&output_text.stdout).unwrap();
    let figures = |section: &str| report["sections"][section]["figures"].clone();
    assert_eq!(figures("actuation")["far_ends"][0]["refused"], refused);
    assert_eq!(figures("actuation")["far_ends"][0]["reasons"][0]["reason"], "forged");
    assert_eq!(figures("gate")["far_ends"][0]["on"], 0.0);
    assert_eq!(figures("targets")["refused"][0]["why"], "it cannot be reached (z)");

    let out = stillpoint(
        folder.path(),
        &[&["run", &file.display().to_string(), "--record", "t"], &sets[..]].concat(),
    );
    for line in [
        "far.state: venting, beam off; on 0 % (0.0 s)",
        "0 for the beam (forged",
        "target.reference: 1 of 1 targets were refused, the last because it cannot be reached (z)",
    ] {
        assert!(text(&out.stdout).contains(line), "{line}: {}", text(&out.stdout));
    }
}

#[test]
fn the_end_of_a_run_begins_with_what_was_found_and_a_law_that_was_idle_to_the_end_is_strictly_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let file = root().join("pipeline.yaml").canonicalize().unwrap().display().to_string();
    let small =
        ["width='320 px'", "height='240 px'", "focal_length='283 px'"].map(|s| format!("rig.camera.{s}"));
    let mut call = vec!["run", &file, "--clock", "simulated", "--for", "2 s", "--no-record"];
    call.extend(small.iter().flat_map(|s| ["--set", s.as_str()]));
    let out = stillpoint(folder.path(), &call);
    let output_text = text(&out.stdout);
    assert!(out.status.success() && !output_text.contains("NO ANSWER"), "{output_text}{}", text(&out.stderr));
    let lines: Vec<&str> = output_text.lines().collect();
    assert!(lines[1].starts_with("face: ") && lines[1].contains("frames had a face"), "{output_text}");
    let beam = lines.iter().find(|l| l.starts_with("gate.state: beam off")).unwrap();
    assert!(beam.contains("; without beam: "), "{beam}");
    assert!(output_text.contains("losses: ") && output_text.contains("the ledger balances"), "{output_text}");
    assert!(
        !output_text.contains("ledger: topic"),
        "the table is printed where it is asked for: {output_text}"
    );
    // Nothing stands so high over the couch: no face, no estimate, a law that is idle to the end.
    call.extend(["--set", "face.height_min=350 mm"]);
    let out = stillpoint(folder.path(), &call);
    let output_text = text(&out.stdout);
    let lines: Vec<&str> = output_text.lines().collect();
    assert!(out.status.success() && lines[1].starts_with("NO ANSWER: face: 0 of "), "{output_text}");
    assert!(output_text.contains("NO ANSWER: law.duties: the law was idle to the end: "), "{output_text}");
    call.push("--strict");
    assert_eq!(stillpoint(folder.path(), &call).status.code(), Some(1));
    call.push("--json");
    let json: Value = serde_json::from_slice(&stillpoint(folder.path(), &call).stdout).unwrap();
    assert_eq!(json["unanswered"].as_array().map(Vec::len), Some(2), "{}", json["unanswered"]);
}
