//! Bounds of time in the file: counted, with the operator to blame, and decided alike in a replay.

use serde_json::Value;

use crate::bench::{Bench, figures, pipeline, text};

/// The contract that begins with these words.
fn contract<'v>(value: &'v Value, words: &str) -> &'v Value {
    let all = value["contracts"].as_array().unwrap();
    all.iter()
        .find(|c| c["contract"].as_str().unwrap().starts_with(words))
        .unwrap_or_else(|| panic!("{words}: {value}"))
}

#[test]
fn a_late_sample_is_counted_skipped_held_or_a_fault_and_a_replay_decides_the_same() {
    let bench = Bench::new();
    let file = pipeline("late.yaml");
    let run = ["run", text(&file), "--clock", "simulated", "--for", "200 ms", "--json"];
    let report = bench.call(&run).json();
    let of = |name: &str, key: &str| figures(&report, name)[key].as_u64().unwrap();
    // The source ends; from then on its last sample ages: 20 ms are allowed, 5 ms pass from tick to tick.
    let late = contract(&report, "counts.latest at most 20 ms old")["broken"].as_u64().unwrap();
    assert!(late > 10, "{report}");
    for name in ["skips", "holds", "fails"] {
        let figures = contract(&report, &format!("{name}.latest at most"));
        assert_eq!(figures["broken"], late, "{name}: {report}");
        assert_eq!(figures["blame"][0]["operator"], "source", "{figures}");
        assert_eq!(figures["blame"][0]["part"], "hold", "{figures}");
        assert_eq!(of(name, "activations"), of("counts", "activations"), "{name}");
    }
    assert_eq!((of("counts", "sent"), of("counts", "errors")), (of("counts", "activations"), 0));
    assert_eq!((of("skips", "sent"), of("skips", "errors")), (of("counts", "activations"), 0));
    assert_eq!((of("holds", "sent"), of("holds", "errors")), (of("counts", "activations") - late, 0));
    assert_eq!((of("fails", "sent"), of("fails", "errors")), (of("counts", "activations") - late, late));
    let session = report["session"].as_str().unwrap();
    // What skips does not see changes what it makes: it is not the same as what counts makes.
    let last = |topic: &str| {
        let all = bench.call(&["echo", topic, "--json", "--session", session]);
        all.out.lines().last().map(str::to_owned)
    };
    assert_ne!(last("skips.sum"), last("counts.sum"));
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
}

#[test]
fn a_contract_that_is_broken_live_fails_the_run_and_names_the_operator() {
    let bench = Bench::new();
    let file = pipeline("contract.yaml");
    let done = bench.call(&["run", text(&file), "--for", "1 s", "--json"]);
    assert_eq!(done.code(), 1, "{}{}", done.out, done.err);
    let report = done.json();
    assert_eq!((&report["balanced"], &report["complete"]), (&true.into(), &true.into()), "{report}");
    let broken = contract(&report, "source.value -> sink.sum");
    let broken_in_session = broken.clone();
    assert!(broken["is_broken"] == true && broken["broken"].as_u64().unwrap() > 10, "{broken}");
    // A step of 5 ms within a bound of 2 ms: on a busy machine something else may take longer now and then.
    assert!(broken["blame"].as_array().unwrap().iter().any(|b| b["operator"] == "slow"), "{broken}");
    assert!(broken["worst_ms"].as_f64().unwrap() > 5.0, "{broken}");
    let retained = contract(&report, "source.value -> slow.sum");
    assert!(retained["is_broken"] == false && retained["judged"].as_u64().unwrap() > 10, "{retained}");
    assert!(contract(&report, "source starts within 20 ms")["judged"].as_u64().unwrap() > 10, "{report}");

    // Without a recording, too.
    let unrecorded = bench.call(&["run", text(&file), "--for", "1 s", "--no-record", "--json"]);
    let broken = contract(&unrecorded.json(), "source.value -> sink.sum").clone();
    assert!(unrecorded.code() == 1 && broken["broken"].as_u64().unwrap() > 10, "{broken}");

    let session = report["session"].as_str().unwrap();
    let against = bench.call(&["check", text(&file), "--against", session]);
    assert_eq!(against.code(), 1, "{}{}", against.out, against.err);
    assert!(against.out.contains("BROKEN: source.value -> sink.sum within 2 ms"), "{}", against.out);
    assert!(against.out.contains("kept: source.value -> slow.sum"), "{}", against.out);
    assert!(
        against.out.contains("slow steps longer") || against.out.contains("slow is busy"),
        "{}",
        against.out
    );
    // With a longer bound the same session keeps it.
    let loose = bench.path("loose.yaml");
    let written = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&loose, written.replace("within: 2 ms", "within: 60 s")).unwrap();
    let held = bench.call(&["check", text(&loose), "--against", session, "--json"]).good();
    assert_eq!(contract(&held, "source.value -> sink.sum")["is_broken"], false, "{held}");
    let page = bench.call(&["report", session, "--json"]).good();
    let figures = &page["sections"]["contracts"]["figures"]["contracts"][0];
    assert_eq!(
        (&figures["contract"], &figures["broken"]),
        (&broken_in_session["contract"], &broken_in_session["broken"])
    );
    let top = bench.call(&["top", session, "--once", "--json"]).good();
    let troubles = top["troubles"].as_array().unwrap();
    assert!(
        troubles.iter().any(|t| t.as_str().unwrap().starts_with("contract broken: source.value -> sink.sum")),
        "{troubles:?}"
    );
}
