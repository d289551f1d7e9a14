//! `docs/guide/own-operator.md`: the page's operator in a program of its own, behind the default pipeline, live.

use crate::bench::{Bench, text};

const PAGE: &str = include_str!("../../docs/guide/own-operator.md");
const DEFAULT: &str = include_str!("../../pipeline.yaml");
const KEY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/data/rig.key");

#[test]
fn the_pages_operator_runs_live_and_replays() {
    let bench = Bench::new();
    let line = PAGE.lines().find(|line| line.contains("use: my.speed")).unwrap();
    let file = bench.path("own.yaml");
    let with = DEFAULT.replacen("operators:\n", &format!("operators:\n{line}\n"), 1);
    std::fs::write(&file, with.replacen("[rig.truth,", "[speed.speed, rig.truth,", 1)).unwrap();
    std::fs::create_dir_all(bench.path("examples/data")).unwrap();
    std::fs::copy(KEY, bench.path("examples/data/rig.key")).unwrap();
    let report = bench.call(&["run", text(&file), "--for", "2 s", "--json"]).good();
    assert_eq!(report["balanced"], true, "{report}");
    let replay = bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
    assert!(replay["identical"]["speed.speed"].as_u64().unwrap() > 0, "{replay}");
}
