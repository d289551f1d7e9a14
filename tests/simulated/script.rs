//! A console that speaks for a person.

use stillpoint_pipeline::config::{Machine, check, check_for};
use stillpoint_samples::{ConsoleCommand, Rejection};
use stillpoint_testing::run;
use stillpoint_testing::run::START;

use stillpoint_operator::files::MemoryFiles;

use crate::default_pipeline::default_pipeline;
use crate::registry;

const KEY: &[u8] = include_bytes!("../../examples/data/rig.key");
const IMAGE: &[u8] = include_bytes!("../../examples/data/depth/000.png");
const CLOUD: &[u8] = include_bytes!("../../examples/data/clouds/000.pcd");

const CONSOLE: &str = "stillpoint: 1
name: script
operators:
  console: { use: console, every: 20 ms, params: { script: [SCRIPT] } }
";

#[test]
fn a_script_is_said_once_at_its_times_in_the_order_of_its_times() {
    let script = "{ at: 110 ms, say: target, values: [0.01, -0.002] }, { at: 0 s, say: capture }, \
                  { at: 40 ms, say: arm }, { at: 41 ms, say: disarm }";
    let run = run(&CONSOLE.replace("SCRIPT", script), &registry(), &MemoryFiles::default(), 500).unwrap();
    let output_text = |verb: &str| -> Vec<(u64, Vec<f64>)> {
        let samples = run.samples::<ConsoleCommand>(&format!("console.{verb}"));
        let at = |s: &stillpoint_samples::View<'_, ConsoleCommand>| (s.header.stamp - START) / 1_000_000;
        samples
            .iter()
            .map(|s| (at(s), s.first().map(|c| c.values[..c.given as usize].to_vec()).unwrap()))
            .collect()
    };
    assert_eq!(output_text("capture"), [(0, vec![])]);
    assert_eq!(output_text("arm"), [(40, vec![])]);
    assert_eq!(output_text("disarm"), [(60, vec![])]);
    assert_eq!(output_text("target"), [(120, vec![0.01, -0.002])]);
}

#[test]
fn a_command_with_too_many_values_is_refused() {
    let script = "{ at: 1 s, say: target, values: [1, 2, 3, 4, 5, 6, 7] }";
    let Err(output_text) = run(&CONSOLE.replace("SCRIPT", script), &registry(), &MemoryFiles::default(), 500)
    else {
        panic!("it ran");
    };
    assert!(output_text.contains("up to 6"), "{output_text}");
}

/// The default pipeline with images from files in the place of the rig's.
const FROM_FILES: (&str, &str) = (
    "cloud: { use: ingest.depth, inputs: { image: rig.depth }, frame: camera }",
    "cloud: { use: ingest.depth, every: 100 ms, frame: camera, params: { files: images, camera: { fx: 283 px, fy: 283 px, cx: 159.5 px, cy: 119.5 px, depth_unit: 0.1 mm } } }",
);

#[test]
fn a_head_is_told_from_all_else_wherever_valves_and_beam_follow_a_real_camera() {
    let default = std::fs::read_to_string(crate::from_root("pipeline.yaml")).unwrap();
    let mut files = MemoryFiles::default();
    files.files.insert("examples/data/rig.key".into(), KEY.to_vec());
    files.files.insert("images/1.png".into(), IMAGE.to_vec());
    let here = Machine::here();
    let faults = |text: &str| {
        let faults = check_for(&here, text, "x.yaml", &[], &registry(), &files).err();
        faults.map(|f| f.to_string()).unwrap_or_default()
    };
    assert_eq!(faults(&default), "");
    let real = default.replacen(FROM_FILES.0, FROM_FILES.1, 1).replacen(
        "{ at: 1 s, say: confirm, repeat: 500 ms }, ",
        "",
        1,
    );
    for waived in ["body: waived", "rule: largest", "region: { need: waived }"] {
        let text = real.replacen("body: waived", waived, 1);
        let output_text = faults(&text);
        let acts = "acts on it, and `cloud`, which `face` sees through, is not a simulated rig";
        assert!(output_text.contains(acts), "{waived}: {output_text}");
        // A session of it can be replayed.
        assert!(check(&text, "x.yaml", &[], &registry(), &files).is_ok(), "{waived}");
    }
    assert_eq!(faults(&real.replacen("body: waived, ", "", 1)), "");
}

#[test]
fn a_search_that_cannot_check_what_it_finds_has_to_say_so() {
    let pipeline = |frame: &str, params: &str| {
        format!(
            "stillpoint: 1\nname: apart\nframes: {{ camera: {{ parent: {frame}, at: [0 m, 0 m, 1 m] }} }}\n\
             operators:\n  rig: {{ use: ingest.pcd, every: 1 s, frame: camera, params: {{ files: clouds }} }}\n  \
             face: {{ use: segment.face, inputs: {{ cloud: rig.cloud }}{params} }}\n"
        )
    };
    let mut files = MemoryFiles::default();
    files.files.insert("clouds/1.pcd".into(), CLOUD.to_vec());
    let faults = |text: &str| {
        let faults = check_for(&Machine::here(), text, "x.yaml", &[], &registry(), &files).err();
        faults.map(|f| f.to_string()).unwrap_or_default()
    };
    let output_text = faults(&pipeline("world", ""));
    let apart = "cannot check that what it finds is the head: the frame `camera` is not connected to `couch`";
    assert!(output_text.contains(apart), "{output_text}");
    assert!(faults(&pipeline("world", ", params: { body: waived }")).contains(apart));
    for params in ["body: waived, region: { need: waived }", "rule: largest"] {
        assert_eq!(faults(&pipeline("world", &format!(", params: {{ {params} }}"))), "");
    }
    assert_eq!(faults(&pipeline("couch", "")), "");
}

#[test]
fn a_reference_is_confirmed_unseen_only_where_the_camera_is_a_rig() {
    let default = std::fs::read_to_string(crate::from_root("pipeline.yaml")).unwrap();
    let mut files = MemoryFiles::default();
    files.files.insert("examples/data/rig.key".into(), KEY.to_vec());
    files.files.insert("images/1.png".into(), IMAGE.to_vec());
    let faults = |text: &str| {
        let faults = check(text, "x.yaml", &[], &registry(), &files).err();
        faults.map(|f| f.to_string()).unwrap_or_default()
    };
    assert_eq!(faults(&default), "");
    let real = default.replacen(FROM_FILES.0, FROM_FILES.1, 1);
    assert_ne!(real, default);
    let output_text = faults(&real);
    assert!(
        output_text.contains(
            "`head` sees through `cloud`, which is not a simulated rig, and a script confirms its reference"
        ),
        "{output_text}"
    );
    let plans = "  watch: { use: plan.watch, inputs: { pose: head.pose } }\n  \
                 plans: { use: plan.optimizer, every: 1 s, inputs: { request: watch.request, accept: console.accept } }\n";
    let accepting = |text: &str| {
        let script = "{ at: 1 s, say: accept, values: [0] }, { at: 1.5 s, say: arm }";
        let text = text.replacen("  console:\n", &format!("{plans}  console:\n"), 1);
        text.replacen("{ at: 1.5 s, say: arm, repeat: 500 ms }", script, 1)
    };
    assert_eq!(faults(&accepting(&default)), "");
    let output_text = faults(&accepting(&real));
    let unseen = "`plans` sees through `cloud`, which is not a simulated rig, and a script accepts its plan";
    assert!(output_text.contains(unseen), "{output_text}");
    let person = real.replacen("{ at: 1 s, say: confirm, repeat: 500 ms }, ", "", 1);
    assert!(!faults(&person).contains("simulated rig"), "{}", faults(&person));
    let waived = person.replacen(
        "params: { origin: centre, max_points: 50000 }\n\n",
        "params: { confirm: waived }\n\n",
        1,
    );
    assert_ne!(waived, person);
    assert!(faults(&waived).contains("`confirm: waived` takes its reference unseen"), "{}", faults(&waived));
}

#[test]
fn a_script_says_a_command_again_until_it_is_accepted_with_its_reason_each_time() {
    // Nothing is armed on a reference that nobody confirms.
    let changes = [
        ("{ at: 1 s, say: confirm, repeat: 500 ms }, ", ""),
        ("say: arm, repeat: 500 ms }", "say: arm, repeat: 500 ms }, { at: 2 s, say: vent }"),
    ];
    let run = default_pipeline(&changes, 2_800);
    let times = |topic: &str| -> Vec<u64> {
        run.samples::<ConsoleCommand>(topic).iter().map(|s| (s.header.stamp - START) / 1_000_000).collect()
    };
    assert_eq!(times("console.arm"), [1500, 2000, 2500]);
    let refused = run.samples::<Rejection>("console.refused");
    let reasons: Vec<String> = refused.iter().map(|r| r.first().unwrap().reason().to_owned()).collect();
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    assert!(
        reasons.iter().all(|r| r.starts_with("arm repeated: ") && r.contains("unconfirmed")),
        "{reasons:?}"
    );
    // What follows in the script waits.
    assert!(times("console.vent").is_empty());
}

#[test]
fn a_command_that_is_accepted_is_said_once() {
    let run = default_pipeline(&[], 2_800);
    for topic in ["console.capture", "console.confirm", "console.arm"] {
        assert_eq!(run.samples::<ConsoleCommand>(topic).len(), 1, "{topic}");
    }
    assert!(run.samples::<Rejection>("console.refused").is_empty());
}

#[test]
fn a_repeated_command_without_an_answer_is_refused_by_the_check() {
    let output_text = |script: &str| {
        let text = CONSOLE.replace("SCRIPT", script);
        let faults = check(&text, "x.yaml", &[], &registry(), &MemoryFiles::default()).err();
        faults.map(|f| f.to_string()).unwrap_or_default()
    };
    assert!(output_text("{ at: 0 s, say: arm, repeat: 1 s }").contains("needs the input `actuation`"));
    assert!(output_text("{ at: 0 s, say: confirm, repeat: 1 s }").contains("needs the input `report`"));
    assert!(output_text("{ at: 0 s, say: vent, repeat: 1 s }").contains("no operator answers `vent`"));
}
