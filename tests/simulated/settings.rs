//! Parameters that a script changes while a pipeline runs.

use stillpoint_samples::{DepthImage, Duties, SettingAnswer};
use stillpoint_testing::Run;
use stillpoint_testing::run;
use stillpoint_testing::run::START;

use stillpoint_operator::files::MemoryFiles;

use crate::{from_root, registry};

/// The pipeline of the whole-system test with a script.
fn text(script: &str) -> String {
    let text = std::fs::read_to_string(from_root("tests/tests/pipelines/settings.yaml")).unwrap();
    let console = "console: { use: console, every: 20 ms }";
    assert!(text.contains(console));
    let scripted = format!("console: {{ use: console, every: 20 ms, params: {{ script: [{script}] }} }}");
    text.replace(console, &scripted)
}

fn simulated(script: &str) -> Run {
    run(&text(script), &registry(), &MemoryFiles::default(), 1500).unwrap_or_else(|e| panic!("{e}"))
}

fn answers(run: &Run, operator: &str) -> Vec<(bool, u64, u64, String)> {
    let samples = run.samples::<SettingAnswer>(&format!("{operator}.settings"));
    let answers = samples.iter().filter_map(|sample| sample.first());
    answers
        .map(|a| (a.refusal().is_none(), a.generation, a.from, a.refusal().unwrap_or_default().to_owned()))
        .collect()
}

/// Orders of the law with their times, ns since the start.
fn orders(run: &Run) -> Vec<(u64, Vec<f64>)> {
    let samples = run.samples::<Duties>("law.duties");
    samples.iter().map(|s| (s.header.stamp - START, s.first().unwrap().net.to_vec())).collect()
}

#[test]
fn a_live_gain_holds_from_its_activation_on_and_changes_nothing_before() {
    let plain = simulated("");
    let changed = simulated("{ at: 600 ms, say: set, parameter: law.proportional, value: 3 1/s }");
    assert_eq!(answers(&plain, "law"), []);
    let taken = answers(&changed, "law");
    assert_eq!((taken.len(), taken[0].0, taken[0].1), (1, true, 1), "{taken:?}");
    // No other operator answers.
    assert_eq!(answers(&changed, "rig"), []);
    let (before, after) = (orders(&plain), orders(&changed));
    assert_eq!(before.len(), after.len());
    let differs = before.iter().zip(&after).position(|(a, b)| a != b).unwrap();
    assert!(before[differs].0 > 600_000_000, "{:?}", before[differs]);
    assert!(differs as u64 >= taken[0].2, "activation {differs}, answered {}", taken[0].2);
    // An operator that is not meant goes on as without the change, also what it draws at random.
    let images = |run: &Run| {
        let all = run.samples::<DepthImage>("rig.depth");
        all.iter()
            .filter(|s| s.header.stamp < START + 600_000_000)
            .map(|s| s.elements.to_vec())
            .collect::<Vec<_>>()
    };
    assert_eq!(images(&plain), images(&changed));
}

#[test]
fn a_value_that_does_not_fit_is_refused_with_its_reason_and_the_value_before_holds() {
    let run = simulated(
        "{ at: 500 ms, say: set, parameter: rig.camera.every, value: 30 ms }, \
         { at: 900 ms, say: set, parameter: rig.camera.every, value: 40 ms }",
    );
    let answers = answers(&run, "rig");
    assert_eq!((answers[0].0, answers[0].1, answers[1].0, answers[1].1), (false, 0, true, 1), "{answers:?}");
    assert!(answers[0].3.contains("multiple"), "{answers:?}");
    let times: Vec<u64> =
        run.samples::<DepthImage>("rig.depth").iter().map(|s| s.header.stamp - START).collect();
    let intervals = |from: u64, to: u64| -> Vec<u64> {
        let within: Vec<u64> = times.iter().copied().filter(|t| (from..to).contains(t)).collect();
        within.windows(2).map(|pair| (pair[1] - pair[0]) / 1_000_000).collect()
    };
    assert!(intervals(500_000_000, 900_000_000).iter().all(|ms| *ms == 100), "{times:?}");
    assert!(intervals(1_040_000_000, 1_500_000_000).iter().all(|ms| *ms == 40), "{times:?}");
}

#[test]
fn a_script_that_sets_what_cannot_be_set_is_refused_before_the_run() {
    for (parameter, value, words) in [
        ("law.proportional", "3", "unit"),
        ("law.proportional", "300 1/s", "from 0 1/s to 100 1/s"),
        ("law.propotional", "3 1/s", "did you mean `proportional`?"),
        (
            "law.stale",
            "100 ms",
            "is not live: it holds for a whole run; live are proportional, integral, rise",
        ),
        ("rig.camera", "3", "has parts: change one of them"),
        ("lwa.proportional", "3 1/s", "there is no operator"),
    ] {
        let script = format!("{{ at: 1 s, say: set, parameter: {parameter}, value: {value} }}");
        let Err(refused) = run(&text(&script), &registry(), &MemoryFiles::default(), 100) else {
            panic!("{parameter}: it ran");
        };
        assert!(refused.contains(words), "{parameter}: {refused}");
    }
    let Err(refused) =
        run(&text("{ at: 1 s, say: set, values: [1] }"), &registry(), &MemoryFiles::default(), 100)
    else {
        panic!("it ran");
    };
    assert!(refused.contains("`say: set`, which needs both"), "{refused}");
}
