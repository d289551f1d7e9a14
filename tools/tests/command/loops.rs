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
fn elsewhere(text: &str) -> String {
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
            let own = folder.path().join(key).join("rig.key");
            std::fs::copy(root().join("examples/data/rig.key"), own).unwrap();
        }
        let live = folder.path().join("live.yaml");
        std::fs::write(&live, elsewhere(&std::fs::read_to_string(&file).unwrap())).unwrap();
        let (report, session) = run(folder.path(), &live, &["--for", "3 s"]);
        assert_eq!(report["balanced"], true, "{}: {}", file.display(), report["ledger"]);
        let session = session.display().to_string();
        let replay = stillpoint(folder.path(), &["replay", &session, "--json"]);
        let said = text(&replay.stdout);
        assert!(replay.status.success(), "{}: {said}{}", file.display(), text(&replay.stderr));
        let replay: Value = serde_json::from_str(&said).unwrap();
        assert_eq!((&replay["identical_all"], &replay["open"]), (&true.into(), &serde_json::json!([])));
        assert!(replay["activations"].as_u64().unwrap() > 100, "{}", file.display());
    }
}
