//! Topics of a session for other tools.

use std::path::{Path, PathBuf};

use serde_json::Value;
use stillpoint_recorder::Session;
use stillpoint_samples::{Pieces, Sample, Track};

use crate::{root, stillpoint, text};

pub fn recorded(folder: &Path) -> PathBuf {
    let file = root().join("examples/one-dof-tracking.yaml").canonicalize().unwrap().display().to_string();
    let run = ["run", &file, "--clock", "simulated", "--for", "700 ms", "--record", "s", "--json"];
    let out = stillpoint(folder, &run);
    assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    folder.join(report["session"].as_str().unwrap())
}

pub fn export(folder: &Path, session: &Path, arguments: &[&str]) -> Value {
    let out = stillpoint(folder, &[&["export", session.to_str().unwrap(), "--json"], arguments].concat());
    assert!(out.status.success(), "{arguments:?}: {}{}", text(&out.stdout), text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn a_table_has_the_bits_of_every_sample() {
    let folder = tempfile::tempdir().unwrap();
    let session = recorded(folder.path());
    let report = export(folder.path(), &session, &["--out", "tables"]);
    assert!(report["files"].as_array().unwrap().len() > 5, "{report}");
    let table = std::fs::read_to_string(folder.path().join("tables/fused.state.csv")).unwrap();
    let mut lines = table.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = head.iter().position(|name| *name == "position.z [m]").unwrap();
    let opened = Session::open(&session).unwrap();
    let mut count = 0;
    for recorded in opened.samples_where(|t| t.name == "fused.state").map(Result::unwrap) {
        let pieces = Pieces::split(Track::KIND, &recorded.sample).unwrap();
        let header = pieces.header();
        let cells: Vec<&str> = lines.next().unwrap().split(',').collect();
        assert_eq!(cells.len(), head.len());
        let whole = [cells[1], cells[2], cells[3]].map(|cell| cell.parse::<u64>().unwrap());
        assert_eq!(whole, [header.sequence, header.stamp, header.origin]);
        let height = pieces.view::<Track>().unwrap().first().unwrap().position[2];
        assert_eq!(cells[column].parse::<f64>().unwrap().to_bits(), height.to_bits());
        count += 1;
    }
    assert!(count > 20 && lines.next().is_none(), "{count} lines");
    // A table can show a face: only its owner may read it.
    let mode = std::os::unix::fs::PermissionsExt::mode(
        &std::fs::metadata(folder.path().join("tables/fused.state.csv")).unwrap().permissions(),
    );
    assert_eq!(mode & 0o777, 0o600);
}

#[test]
fn chosen_fields_and_times_are_exported_alone() {
    let folder = tempfile::tempdir().unwrap();
    let session = recorded(folder.path());
    let arguments =
        ["fused.state", "--field", "pose.z", "--after", "200 ms", "--until", "400ms", "--out", "one"];
    let report = export(folder.path(), &session, &arguments);
    let opened = Session::open(&session).unwrap();
    let stamps = opened.samples_where(|t| t.name == "fused.state").map(|s| {
        let sample = s.unwrap().sample;
        Pieces::split(Track::KIND, &sample).unwrap().header().stamp
    });
    let expected = stamps.filter(|stamp| (200_000_000..400_000_000).contains(stamp)).count();
    assert!(expected > 5 && report["files"][0]["lines"] == expected, "{expected}: {report}");
    let table = std::fs::read_to_string(folder.path().join("one/fused.state.csv")).unwrap();
    assert!(table.starts_with("incarnation,sequence,stamp_ns,origin_ns,pose.z\n"), "{table}");
}

#[test]
fn a_smaller_recording_has_the_same_bytes_and_is_no_damaged_session() {
    let folder = tempfile::tempdir().unwrap();
    let session = recorded(folder.path());
    let topics = ["xbox_filter.state", "xbox.truth"];
    let arguments = [&topics[..], &["--format", "mcap", "--until", "500 ms", "--out", "small"]].concat();
    export(folder.path(), &session, &arguments);
    let [whole, small] = [&session, &folder.path().join("small")].map(|path| Session::open(path).unwrap());
    assert_eq!(small.topics().len(), 2);
    for (number, topic) in small.topics().iter().enumerate() {
        let of_whole = whole.topic_number(&topic.name).unwrap();
        assert!(topic.samples > 3, "{}", topic.name);
        for (incarnation, sequence) in small.numbers(number) {
            let sample = small.sample(number, incarnation, sequence).unwrap().unwrap().sample;
            assert_eq!(whole.holds(of_whole, incarnation, sequence, &sample).unwrap(), Some(true));
        }
    }
    assert!(folder.path().join("small/metadata.yaml").is_file());
    let echo = stillpoint(folder.path(), &["echo", "xbox.truth", "--session", "small", "--count", "1"]);
    assert!(echo.status.success(), "{}", text(&echo.stderr));
}

#[test]
fn wrong_exports_are_refused_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let session = recorded(folder.path());
    let session = session.to_str().unwrap();
    std::fs::create_dir(folder.path().join("there")).unwrap();
    for (arguments, code, says) in [
        (&["fused.stat", "--out", "x"][..], 2, "did you mean fused.state?"),
        (&["fused.state", "--field", "positoin", "--out", "x"], 2, "did you mean position?"),
        (&["--field", "pose.z", "--out", "x"], 2, "--field needs exactly one topic"),
        (&["--after", "2", "--out", "x"], 2, "--after 2"),
        (&["--after", "2s", "--until", "1s", "--out", "x"], 2, "--after is not before --until"),
        (
            &["fused.state", "--field", "pose.z", "--format", "mcap", "--out", "x"],
            2,
            "--field chooses columns",
        ),
        #[cfg(not(feature = "parquet"))]
        (&["--format", "parquet", "--out", "x"], 2, "--features stillpoint/parquet"),
        (&["--out", "there"], 1, "it is there already"),
    ] {
        let out = stillpoint(folder.path(), &[&["export", session], arguments].concat());
        let message = text(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{arguments:?}: {message}");
        assert!(message.contains(says), "{arguments:?}: {message}");
        assert!(!folder.path().join("x").exists(), "{arguments:?}");
    }
}

#[test]
fn one_sample_becomes_a_file_that_the_project_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let session = recorded(folder.path());
    // The session keeps neither images nor clouds: a replay makes them.
    let replay = stillpoint(folder.path(), &["replay", session.to_str().unwrap(), "--record", "all"]);
    assert!(replay.status.success(), "{}", text(&replay.stderr));
    assert!(
        folder.path().join("all/metadata.yaml").is_file(),
        "a replay writes the folder that a run writes"
    );
    let all = folder.path().join("all");
    for (topic, format) in [("v2.depth", "png"), ("v2_face.face", "ply"), ("v2_face.face", "pcd")] {
        let arguments = [topic, "--format", format, "--sample", "2", "--out", format];
        let report = export(folder.path(), &all, &arguments);
        let file = PathBuf::from(report["files"][0]["file"].as_str().unwrap());
        assert!(std::fs::metadata(folder.path().join(file)).unwrap().len() > 1000, "{report}");
    }
    let points = |topic: &str| {
        let opened = Session::open(&all).unwrap();
        let sample = opened.sample(opened.topic_number(topic).unwrap(), 0, 2).unwrap().unwrap().sample;
        let pieces = Pieces::split(stillpoint_samples::PointCloud::KIND, &sample).unwrap();
        let view = pieces.view::<stillpoint_samples::PointCloud>().unwrap();
        view.elements.iter().map(|p| p.xyz).collect::<Vec<_>>()
    };
    let read = stillpoint_ingest::pcd::read(
        &std::fs::read(folder.path().join("pcd/v2_face.face.000002.pcd")).unwrap(),
    );
    assert_eq!(read.unwrap().points, points("v2_face.face"));
    let refused = stillpoint(
        folder.path(),
        &["export", "all", "v2.depth", "--format", "ply", "--sample", "2", "--out", "x"],
    );
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
    assert!(!folder.path().join("x").exists());
}
