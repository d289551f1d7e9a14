//! `docs/guide/first-hour.md`: its commands in their order, in one shell and an empty folder.

use std::path::Path;
use std::process::Command;

use crate::text;

const PAGE: &str = include_str!("../../../../docs/guide/first-hour.md");

/// The blocks of a page in a language.
pub fn blocks(page: &str, language: &str) -> Vec<String> {
    let mut blocks = Vec::new();
    let mut open: Option<String> = None;
    for line in page.lines() {
        match &mut open {
            Some(_) if line == "```" => blocks.extend(open.take()),
            Some(block) => block.extend([line, "\n"]),
            None if line == format!("```{language}") => open = Some(String::new()),
            None => {}
        }
    }
    blocks
}

/// Runs commands in one shell that finds the command; gives what they printed.
pub fn printed_by(script: &str, folder: &Path) -> String {
    let program = Path::new(env!("CARGO_BIN_EXE_stillpoint")).parent().unwrap();
    let others = std::env::var("PATH").unwrap();
    let out = Command::new("sh")
        .args(["-e", "-u", "-c", script])
        .current_dir(folder)
        .env("PATH", format!("{}:{others}", program.display()))
        .env("STILLPOINT_RUNS", folder.join("runs"))
        .output()
        .unwrap();
    let printed = text(&out.stdout);
    assert!(out.status.success(), "{printed}\n{}", text(&out.stderr));
    printed
}

#[test]
fn the_commands_of_the_first_hour_run_in_their_order() {
    let folder = tempfile::tempdir().unwrap();
    let printed = printed_by(&blocks(PAGE, "sh").concat(), folder.path());
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
