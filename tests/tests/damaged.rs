//! Damaged sessions: what is harmed is named, nothing else is, and no difference is made up.

use std::path::Path;

use serde_json::Value;
use stillpoint_samples::{HEADER_SIZE, JournalBody};

use crate::bench::{Bench, pipeline, text};
use crate::tampered::{Sample, rewrite, rewrite_all};

const OWN_RECORDING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/own-recording.yaml");

/// Place of the first reference of an entry.
const REFERENCE: usize = HEADER_SIZE + size_of::<JournalBody>();

/// Replays a session that must have gaps and no difference, and gives what is open.
fn open(bench: &Bench, session: &str) -> Vec<Value> {
    let done = bench.call(&["replay", session, "--json"]);
    assert_eq!(done.code(), 4, "{}\n{}", done.out, done.err);
    let report = done.json();
    assert_eq!(report["differences"], 0, "{report}");
    report["open"].as_array().unwrap().clone()
}

/// Flips a bit in the bytes of an attachment.
fn flip(part: &Path, attachment: &str) {
    let mut bytes = std::fs::read(part).unwrap();
    let name = bytes.windows(attachment.len()).position(|w| w == attachment.as_bytes()).unwrap();
    // Behind the name stand its media type and its length.
    bytes[name + attachment.len() + 100] ^= 1;
    std::fs::write(part, bytes).unwrap();
}

#[test]
fn a_damaged_file_opens_the_operator_that_reads_it_and_is_named_also_after_mending() {
    let bench = Bench::new();
    let run = ["run", OWN_RECORDING, "--clock", "simulated", "--for", "1 s", "--json"];
    let report = bench.call(&run).good();
    let session = report["session"].as_str().unwrap();
    bench.call(&["replay", session, "--json"]).good();
    flip(&bench.path(session).join("part-000.mcap"), "files/data/depth/001.png");
    for mended in [false, true] {
        if mended {
            bench.call(&["recover", session, "--json"]).good();
            assert!(bench.path(session).join("part-000.mcap.damaged").exists());
        }
        let open = open(&bench, session);
        assert_eq!(
            (&open[0]["operator"], &open[0]["from_activation"]),
            (&"cloud".into(), &0.into()),
            "{open:?}"
        );
        assert!(open[0]["reason"].as_str().unwrap().contains("data/depth/001.png"), "{open:?}");
        let info = bench.call(&["info", session]);
        assert!(info.out.contains("data/depth/001.png: the session lacks this file"), "{}", info.out);
    }
    let output_text = bench.call(&["replay", session, "--only", "filter"]);
    assert_eq!(output_text.code(), 4);
    assert!(
        output_text.out.contains("the recorded parts match; the session is not complete"),
        "{}",
        output_text.out
    );
}

#[test]
fn another_file_in_the_place_of_the_one_that_was_read_opens_its_operator() {
    let bench = Bench::new();
    let run = ["run", OWN_RECORDING, "--clock", "simulated", "--for", "500 ms", "--json"];
    let session = bench.path(bench.call(&run).good()["session"].as_str().unwrap());
    let tampered = bench.path("tampered");
    rewrite_all(&session, &tampered, |_, attachments| {
        let bytes = |n: &str| attachments.iter().find(|a| a.name.ends_with(n)).unwrap().bytes.clone();
        let other = bytes("002.png");
        attachments.iter_mut().find(|a| a.name.ends_with("001.png")).unwrap().bytes = other;
    });
    let open = open(&bench, text(&tampered));
    assert_eq!(open[0]["operator"], "cloud", "{open:?}");
    assert!(open[0]["reason"].as_str().unwrap().contains("not those that were recorded"), "{open:?}");
    let info = bench.call(&["info", text(&tampered), "--json"]).good();
    assert_eq!(info["complete"], false);
    assert!(info["gaps"][0].as_str().unwrap().contains("data/depth/001.png"), "{}", info["gaps"]);
}

#[test]
fn a_bad_journal_entry_harms_its_incarnation_alone_and_the_session_is_not_complete() {
    let bench = Bench::new();
    let report = bench
        .call(&["run", text(&pipeline("wrong.yaml")), "--for", "500 ms", "--json", "--record", "s"])
        .good();
    let session = bench.path(report["session"].as_str().unwrap());
    // Count and port of the reference, and the stamp of the head.
    let broken: [(&str, usize, &[u8], u64); 4] = [
        ("count", REFERENCE + 32, &[255; 4], 20),
        ("port", REFERENCE + 40, &[77, 0, 0, 0], 20),
        ("late", 0, &[255; 8], 19),
        ("early", 0, &[0; 8], 19),
    ];
    for (name, at, value, from) in broken {
        let tampered = bench.path(name);
        rewrite(&session, &tampered, |samples| {
            let of_other = |s: &&mut Sample| s.topic == "other.journal" && s.sequence == 20;
            let entry = samples.iter_mut().find(of_other).unwrap();
            entry.bytes[at..at + value.len()].copy_from_slice(value);
        });
        let open = open(&bench, text(&tampered));
        assert!(open.len() == 1 && open[0]["operator"] == "other", "{name}: {open:?}");
        assert_eq!(open[0]["from_activation"], from, "{name}: {open:?}");
        let complete = &bench.call(&["info", text(&tampered), "--json"]).good()["complete"];
        assert!(*complete == false, "{name}");
    }
}

#[test]
fn a_restart_whose_time_is_wrong_harms_its_incarnation_alone() {
    let bench = Bench::new();
    let file = pipeline("crash.yaml");
    let run = ["run", text(&file), "--clock", "simulated", "--for", "1 s", "--record", "s", "--json"];
    let report = bench.call(&run).good();
    let session = bench.path(report["session"].as_str().unwrap());
    let whole = bench.call(&["replay", text(&session), "--json"]).good();
    for stamp in [0_u64, 1, u64::MAX] {
        let tampered = bench.path(&format!("at-{stamp}"));
        rewrite(&session, &tampered, |samples| {
            let of_first =
                |s: &&mut Sample| s.topic == "first.journal" && (s.incarnation, s.sequence) == (1, 0);
            samples.iter_mut().find(of_first).unwrap().bytes[..8].copy_from_slice(&stamp.to_le_bytes());
        });
        let open = open(&bench, text(&tampered));
        assert!(open.len() == 1 && open[0]["operator"] == "first" && open[0]["incarnation"] == 1, "{open:?}");
        let replay = bench.call(&["replay", text(&tampered), "--json"]).json();
        let exact = |replay: &Value| replay["exact_incarnations"].as_u64().unwrap();
        assert_eq!(exact(&replay), exact(&whole) - 1, "{replay}");
    }
}

#[test]
fn a_session_without_a_pipeline_is_never_called_complete() {
    let bench = Bench::new();
    let file = pipeline("wrong.yaml");
    let run = ["run", text(&file), "--clock", "simulated", "--for", "200 ms", "--record", "s", "--json"];
    let session = bench.path(bench.call(&run).good()["session"].as_str().unwrap());
    for (name, missing) in [("without", true), ("empty", false)] {
        let tampered = bench.path(name);
        rewrite_all(&session, &tampered, |_, attachments| {
            if missing {
                attachments.retain(|a| a.name != "pipeline.yaml");
            } else {
                attachments.iter_mut().find(|a| a.name == "pipeline.yaml").unwrap().bytes.clear();
            }
        });
        let replay = bench.call(&["replay", text(&tampered)]);
        assert_ne!(replay.code(), 0, "{name}: {}", replay.out);
        let info = bench.call(&["info", text(&tampered), "--json"]).good();
        assert!(info["complete"] == false, "{name}: {}", info["gaps"]);
        assert!(info["gaps"].to_string().contains("it cannot be replayed: "), "{name}: {}", info["gaps"]);
        let output_text = bench.call(&["info", text(&tampered)]);
        assert!(!output_text.out.contains("everything that a replay needs"), "{name}: {}", output_text.out);
    }
}
