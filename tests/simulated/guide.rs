//! `docs/guide/own-operator.md`: the operator that the page shows, in a running pipeline.

use stillpoint_operator::Registry;
use stillpoint_operator::files::DiskFiles;
use stillpoint_samples::Diagnostics;
use stillpoint_testing::run;

use crate::own_operator::MY_STAGES;
use crate::{FAMILIES, from_root};

const PAGE: &str = include_str!("../../docs/guide/own-operator.md");
const CODE: &str = include_str!("../../examples/own_operator.rs");

#[test]
fn the_page_shows_the_code_that_is_run() {
    assert!(
        PAGE.contains(&format!("```rust\n{CODE}```\n")),
        "copy examples/own_operator.rs into docs/guide/own-operator.md"
    );
    assert!(CODE.lines().count() < 60, "{} lines", CODE.lines().count());
}

#[test]
fn the_pages_operator_runs_behind_the_default_pipeline() {
    let path = from_root("pipeline.yaml");
    let text = std::fs::read_to_string(&path).unwrap();
    // The line of the page, under the operators of the default pipeline.
    let line = PAGE.lines().find(|l| l.contains("use: my.speed")).unwrap();
    let text = text.replacen("operators:\n", &format!("operators:\n{line}\n"), 1);
    let registry = Registry::new(&[FAMILIES.concat().as_slice(), MY_STAGES]);
    let run = run(&text, &registry, &DiskFiles::next_to(&path), 2000).unwrap();
    let speeds = run.samples::<Diagnostics>("speed.speed");
    assert_eq!(speeds.len(), 19);
    assert!(speeds.iter().all(|s| s.elements[0].name() == "speed_m_s" && s.elements[0].value < 0.1));
}
