//! Many patients with one command: each plan as if it were alone, none made twice, and one fault that stops no other.

use std::path::Path;
use std::process::Output;

use serde_json::Value;
use stillpoint_patient::case::{phantom, write};

use super::{stillpoint, text};

/// Coarse and with given beams, so that a plan takes seconds.
const ASKED: [&str; 7] = ["--angles", "0,120,240", "--fluence-only", "--grid", "12mm", "--bixel", "20mm"];

fn plan(folder: &Path, arguments: &[&str]) -> Output {
    stillpoint(folder, &[&["plan"][..], arguments, &ASKED, &["--doses", "doses"]].concat())
}

/// The state of each patient.
fn states(out: &Output) -> Vec<String> {
    let rows: Value =
        serde_json::from_slice(&out.stdout).map_err(|e| format!("{e}: {}", text(&out.stderr))).unwrap();
    rows.as_array().unwrap().iter().map(|row| row["state"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn plans_of_a_queue_are_those_of_each_patient_alone_and_are_made_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for seed in [1, 2] {
        write(&phantom(seed).unwrap(), &at.join(format!("{seed}.case"))).unwrap();
    }
    std::fs::write(at.join("broken.case"), "no case").unwrap();
    let all = ["1.case", "broken.case", "2.case", "--jobs", "2"];
    let out = plan(at, &[&all[..], &["--json"]].concat());
    assert_eq!(out.status.code(), Some(1), "{}", text(&out.stderr));
    assert_eq!(states(&out), ["planned", "failed", "planned"]);
    let rows: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(rows[1]["reason"].as_str().unwrap().contains("broken.case"), "{rows}");
    let queued = |place: usize| at.join(rows[place]["folder"].as_str().unwrap());
    // A plan that is made alone is of no request of a queue.
    std::fs::create_dir(at.join("alone")).unwrap();
    std::fs::write(at.join("alone/request.json"), "{}").unwrap();
    assert_eq!(plan(at, &["2.case", "--out", "alone"]).status.code(), Some(0));
    assert!(!at.join("alone/request.json").exists());
    for name in ["plan.json", "plan.html", "dvh.svg", "axial.png"] {
        let read = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
        assert!(read(&queued(2)) == read(&at.join("alone")), "{name}");
    }
    // Nothing is made again for the same request, and all for another one.
    let good = ["1.case", "2.case", "--json"];
    let again = plan(at, &good);
    assert_eq!((again.status.code(), states(&again)), (Some(0), vec!["was there".to_owned(); 2]));
    // The plan of a patient is made again where it is of another request; a case of the same name has no folder of its own.
    std::fs::write(queued(0).join("request.json"), r#"{"case":"another"}"#).unwrap();
    write(&phantom(1).unwrap(), &at.join("2.case")).unwrap();
    let table = plan(at, &["1.case", "2.case", "--jobs", "1"]);
    let printed = text(&table.stdout);
    assert!(table.status.code() == Some(1) && text(&table.stderr).contains("1.case: planned"), "{printed}");
    assert!(printed.contains("2.case: its plan would go into plans/"), "{printed}");
}

#[test]
fn options_for_one_patient_are_refused_for_many() {
    let folder = tempfile::tempdir().unwrap();
    let out = plan(folder.path(), &["1.case", "2.case", "--accept-check", "looked at"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("--accept-check is for one patient"), "{}", text(&out.stderr));
}
