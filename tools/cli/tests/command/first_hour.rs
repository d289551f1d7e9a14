//! `docs/guide/first-hour.md`: its commands in their order, in one shell and an empty folder.

use std::path::Path;
use std::process::Command;

use crate::text;

const PAGE: &str = include_str!("../../../../docs/guide/first-hour.md");

/// The commands of the page.
fn script() -> String {
    let mut script = String::new();
    let mut is_code = false;
    for line in PAGE.lines() {
        match line {
            "```sh" => is_code = true,
            "```" => is_code = false,
            line if is_code => script.extend([line, "\n"]),
            _ => {}
        }
    }
    script
}

#[test]
fn the_commands_of_the_first_hour_run_in_their_order() {
    let folder = tempfile::tempdir().unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_stillpoint")).parent().unwrap();
    let others = std::env::var("PATH").unwrap();
    let out = Command::new("sh")
        .args(["-e", "-u", "-c", &script()])
        .current_dir(folder.path())
        .env("PATH", format!("{}:{others}", program.display()))
        .env("STILLPOINT_RUNS", folder.path().join("runs"))
        .output()
        .unwrap();
    let printed = text(&out.stdout);
    assert!(out.status.success(), "{printed}\n{}", text(&out.stderr));
    let mut rest = printed.as_str();
    for expected in [
        "mine/pipeline.yaml: it has passed",
        "mine: 14 operators in 5 processes, no faults",
        "complete: the session holds everything",
        "position.z: ",
        "identical: ",
        "session: sessions/stronger",
        "sessions/mine-0001.html",
        "scans/pipeline.yaml: it has passed",
        "face: 6 of 6 frames had a face",
    ] {
        let (_, after) =
            rest.split_once(expected).unwrap_or_else(|| panic!("{expected} is missing in\n{printed}"));
        rest = after;
    }
    assert_eq!(rest.matches("position: ").count(), 6, "{rest}");
    for file in
        ["mine/sessions/mine-0001.html", "mine/sessions/stronger/part-000.mcap", "scans/sessions/scans-0001"]
    {
        assert!(folder.path().join(file).exists(), "{file}");
    }
}
