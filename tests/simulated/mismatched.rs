//! Parameters that do not go together with those of another operator: `check` refuses them with their line.

use stillpoint_operator::files::DiskFiles;
use stillpoint_pipeline::config::{Machine, check, check_for};

use crate::{from_root, registry};

/// The faults of a file of the project in which `from` became `to`.
fn faults(file: &str, from: &str, to: &str) -> String {
    let path = from_root(file);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{file} lacks {from}");
    let (text, files) = (text.replacen(from, to, 1), DiskFiles::next_to(&path));
    let faults = check_for(&Machine::default(), &text, file, &[], &registry(), &files).err();
    faults.map(|f| f.to_string()).unwrap_or_default()
}

/// Line of a file of the project in which this text stands first, from 1.
fn line_of(file: &str, text: &str) -> usize {
    let all = std::fs::read_to_string(from_root(file)).unwrap();
    1 + all.lines().position(|line| line.contains(text)).unwrap()
}

#[test]
fn parameters_of_two_operators_that_contradict_each_other_are_refused_with_their_line() {
    const FILE: &str = "pipeline.yaml";
    for (from, to, at, why) in [
        (
            "params: { follow: pose }",
            "params: { follow: z }",
            "law: { use",
            "filter follows z, so its estimate lacks pitch, roll",
        ),
        (
            "acknowledge_every: 20 ms }",
            "acknowledge_every: 20 ms, bladders: 8 }",
            "rig: { use",
            "far is for 8 bladders, but there are 3 here",
        ),
        (
            "dead_band: 0.07 }",
            "dead_band: 0.07, bladders: 8 }",
            "command: { from: law.duties",
            "law sends duties for 3 bladders, but there are 8 here",
        ),
        ("measured: 2026-11-21", "measured: 2026-02-30", "measured:", "`2026-02-30` is not a date"),
        (
            "say: arm, repeat: 500 ms }",
            "say: arm, repeat: 500 ms }, { at: 3 s, say: fault, values: [2, 99] }",
            "rig: { use",
            "invalid number of the bladder: 99 (allowed: 0 to 2)",
        ),
        (
            "motion: breathes,",
            "motion: breathes, faults: [{ kind: stuck_valve, at: 1 s, which: 6 }],",
            "rig: { use",
            "invalid number of the valve: 6 (allowed: 0 to 5)",
        ),
    ] {
        let output_text = faults(FILE, from, to);
        assert!(output_text.contains(why), "{to}: {output_text}");
        assert!(output_text.contains(&format!("{FILE}:{}:", line_of(FILE, at))), "{to}: {output_text}");
    }
    assert_eq!(faults(FILE, "measured: 2026-11-21", "measured: 2024-02-29"), "");
}

#[test]
fn a_filter_with_a_timer_before_a_fusion_is_refused_at_the_input_of_the_fusion() {
    const FILE: &str = "examples/one-dof-tracking.yaml";
    let text = std::fs::read_to_string(from_root(FILE)).unwrap();
    let filter = text.lines().find(|l| l.contains("use: estimate.kalman")).unwrap().to_owned();
    let timed = filter.replacen("use: estimate.kalman,", "use: estimate.kalman, every: 10 ms,", 1);
    let output_text = faults(FILE, &filter, &timed);
    assert!(
        output_text.contains("has a timer (`every:`)")
            && output_text.contains("would be left out of the fusion"),
        "{output_text}"
    );
}

#[test]
fn a_session_of_contradicting_parameters_can_be_replayed() {
    let path = from_root("pipeline.yaml");
    let text = std::fs::read_to_string(&path).unwrap();
    let idle = text.replacen("params: { follow: pose }", "params: { follow: z }", 1);
    assert!(check(&idle, "pipeline.yaml", &[], &registry(), &DiskFiles::next_to(&path)).is_ok());
}
