//! Replay: what is the same is found the same, and what is not is named.

use serde_json::Value;
use stillpoint_samples::{Entry, HEADER_SIZE, JournalRef};

use crate::bench::{Bench, Done, figures, line, pipeline, text};
use crate::tampered::{Sample, rewrite, rewrite_all};

/// Records half a second of a pipeline and gives the session.
fn recorded(bench: &Bench, file: &str, more: &[&str]) -> String {
    let file = pipeline(file);
    let arguments = [&["run", text(&file), "--for", "500 ms", "--json", "--record", "s"], more].concat();
    bench.call(&arguments).good()["session"].as_str().unwrap().to_string()
}

fn replay(bench: &Bench, session: &str) -> Done {
    bench.call(&["replay", session, "--json"])
}

/// The first difference of a replay that must have found one, at this operator.
fn found(done: &Done, operator: &str) -> Value {
    assert_eq!(done.code(), 3, "{}\n{}", done.out, done.err);
    let first = done.json()["first_difference"].clone();
    assert_eq!(first["operator"], operator, "{first}");
    first
}

#[test]
fn a_change_of_one_ulp_is_found_and_named() {
    let bench = Bench::new();
    let sets = ["--set", "suspect.habit=ulp", "--set", "suspect.at=17"];
    let session = recorded(&bench, "wrong.yaml", &sets);
    replay(&bench, &session).good();
    let mut command = bench.command(&["replay", &session, "--json"]);
    command.env("KIT_ULP", "1");
    let first = found(&bench.begin(command).finish(), "suspect");
    assert_eq!(first["activation"], 17);
    assert_eq!(first["topic"], "suspect.value");
    assert_eq!(first["field"], "elements[1].value");
    // The number is below 1: one unit in the last place of 1 is a few of its own.
    assert!((1..=64).contains(&first["ulps"].as_u64().unwrap()), "{first}");
}

#[test]
fn a_hidden_clock_read_is_found() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &["--set", "suspect.habit=clock"]);
    let first = found(&replay(&bench, &session), "suspect");
    assert_eq!(first["activation"], 0);
}

#[test]
fn an_unordered_map_is_found() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &["--set", "suspect.habit=unordered"]);
    found(&replay(&bench, &session), "suspect");
}

#[test]
fn check_runs_a_pipeline_twice_and_names_what_no_seed_gives() {
    let bench = Bench::new();
    let file = pipeline("wrong.yaml");
    let check = |habit: &str| {
        let set = format!("suspect.habit={habit}");
        bench.call(&["check", text(&file), "--determinism", "--for", "200 ms", "--set", &set, "--json"])
    };
    let same = check("none").good();
    assert_eq!(same["deterministic"], true, "{same}");
    for habit in ["clock", "unordered"] {
        let done = check(habit);
        assert_eq!(done.code(), 3, "{habit}: {}{}", done.out, done.err);
        let found = done.json();
        let topics = found["differences"]["topics"].as_array().unwrap();
        let changed: Vec<&Value> = topics.iter().filter(|topic| topic["identical"] == false).collect();
        assert_eq!(found["deterministic"], false, "{found}");
        assert!(changed.iter().any(|topic| topic["topic"] == "suspect.value"), "{habit}: {found}");
    }
    // A run that fails is no verdict.
    let failed = bench.call(&["check", text(&file), "--determinism", "--for", "1 mile"]);
    assert!(![0, 3].contains(&failed.code()), "{}{}", failed.out, failed.err);
}

#[test]
fn another_thread_count_is_found() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &["--set", "suspect.habit=threads"]);
    replay(&bench, &session).good();
    let mut command = bench.command(&["replay", &session, "--json"]);
    command.env("KIT_THREADS", "7");
    found(&bench.begin(command).finish(), "suspect");
}

#[test]
fn a_swapped_activation_order_is_found() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &[]);
    let tampered = bench.path("swapped");
    rewrite(&bench.path(&session), &tampered, |samples| {
        let entries: Vec<usize> =
            (0..samples.len()).filter(|i| samples[*i].topic == "other.journal").collect();
        // Two neighbours in the middle consume what the other consumed.
        let (a, b) = (entries[entries.len() / 2], entries[entries.len() / 2 + 1]);
        let (first, second) = (queued(&samples[a]), queued(&samples[b]));
        assert_ne!(first, second);
        set_queued(&mut samples[a], second);
        set_queued(&mut samples[b], first);
    });
    found(&replay(&bench, text(&tampered)), "other");
}

/// Place of the first reference's first sequence number in an entry.
const QUEUED: usize = HEADER_SIZE + size_of::<stillpoint_samples::JournalBody>();

/// The sample that an entry of `other` consumed from its queue.
fn queued(entry: &Sample) -> u64 {
    assert!(size_of::<JournalRef>() > 8 && size_of::<Entry>() > 8);
    u64::from_le_bytes(entry.bytes[QUEUED..QUEUED + 8].try_into().unwrap())
}

fn set_queued(entry: &mut Sample, sequence: u64) {
    entry.bytes[QUEUED..QUEUED + 8].copy_from_slice(&sequence.to_le_bytes());
}

#[test]
fn a_flipped_bit_in_a_recorded_output_is_found_where_it_is() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &[]);
    let tampered = bench.path("flipped");
    let mut sequence = 0;
    rewrite(&bench.path(&session), &tampered, |samples| {
        let outputs: Vec<usize> = (0..samples.len()).filter(|i| samples[*i].topic == "other.sum").collect();
        let sample = &mut samples[outputs[outputs.len() / 2]];
        sequence = sample.sequence;
        let last = sample.bytes.len() - 1;
        sample.bytes[last] ^= 1;
    });
    let first = found(&replay(&bench, text(&tampered)), "other");
    assert_eq!(first["topic"], "other.sum");
    assert_eq!(first["sequence"].as_u64().unwrap(), sequence);
}

#[test]
fn an_output_that_no_activation_made_is_found() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &[]);
    let tampered = bench.path("orphan");
    rewrite(&bench.path(&session), &tampered, |samples| {
        let last = samples.iter().rfind(|s| s.topic == "last.sum").unwrap();
        let mut bytes = last.bytes.clone();
        let sequence = last.sequence + 1;
        bytes[16..24].copy_from_slice(&sequence.to_le_bytes());
        let orphan = Sample { topic: last.topic.clone(), incarnation: last.incarnation, sequence, bytes };
        samples.push(orphan);
    });
    let first = found(&replay(&bench, text(&tampered)), "last");
    assert_eq!(first["topic"], "last.sum");
}

#[test]
fn a_lost_source_sample_opens_its_consumer_and_nobody_else() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &[]);
    let tampered = bench.path("gap");
    rewrite(&bench.path(&session), &tampered, |samples| {
        samples.retain(|s| s.topic != "source.value" || s.sequence != 20);
    });
    let done = replay(&bench, text(&tampered));
    assert_eq!(done.code(), 4, "{}\n{}", done.out, done.err);
    let report = done.json();
    assert_eq!(report["differences"], 0);
    let open = report["open"].as_array().unwrap();
    assert_eq!(open.len(), 1, "{open:?}");
    assert_eq!(open[0]["operator"], "other");
    assert!(open[0]["reason"].as_str().unwrap().contains("sample 20 of incarnation 0 on source.value"));
    let info = bench.call(&["info", text(&tampered), "--json"]).good();
    assert_eq!(info["complete"], false);
}

#[test]
fn a_lost_output_of_a_whole_operator_is_made_again() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &[]);
    let tampered = bench.path("again");
    rewrite(&bench.path(&session), &tampered, |samples| {
        samples.retain(|s| s.topic != "other.sum" || s.sequence % 5 != 3);
    });
    let report = replay(&bench, text(&tampered)).good();
    let repeated = report["recomputed"]["other.sum"].as_u64().unwrap();
    assert!(repeated > 5);
    assert_eq!(report["missing"], serde_json::json!({ "other.sum": repeated }));
    let output_text = bench.call(&["replay", text(&tampered)]);
    let verdict = format!("identical; {repeated} samples of recorded topics are not in the recording: ");
    assert!(output_text.out.contains(&verdict), "{}", output_text.out);
    // Also where it is made for its consumer alone.
    for chosen in ["--only", "--from"] {
        let report = bench.call(&["replay", text(&tampered), "--json", chosen, "last"]).good();
        assert!(report["identical"]["last.sum"].as_u64().unwrap() > 5, "{report}");
    }
}

#[test]
fn a_lost_journal_entry_opens_its_operator_until_its_next_incarnation() {
    let bench = Bench::new();
    let session = recorded(&bench, "crash.yaml", &[]);
    let tampered = bench.path("entry");
    rewrite(&bench.path(&session), &tampered, |samples| {
        let entries: Vec<usize> =
            (0..samples.len()).filter(|i| samples[*i].topic == "first.journal").collect();
        let lost =
            entries.into_iter().find(|i| samples[*i].incarnation == 1 && samples[*i].sequence == 3).unwrap();
        samples.remove(lost);
    });
    let done = replay(&bench, text(&tampered));
    assert_eq!(done.code(), 4, "{}\n{}", done.out, done.err);
    let report = done.json();
    let open = report["open"].as_array().unwrap();
    assert_eq!((&open[0]["operator"], &open[0]["incarnation"]), (&"first".into(), &1.into()));
    assert!(open.iter().all(|o| o["operator"] != "first" || o["incarnation"] == 1), "{open:?}");
    assert!(report["identical"]["first.sum"].as_u64().unwrap() > 0);
}

#[test]
fn two_replays_write_identical_files() {
    let bench = Bench::new();
    let session = recorded(&bench, "crash.yaml", &[]);
    let files = ["a", "b"].map(|folder| {
        bench.call(&["replay", &session, "--json", "--record", folder]).good();
        std::fs::read(bench.path(folder).join("part-000.mcap")).unwrap()
    });
    assert!(files[0] == files[1]);
    // The replay's own session is whole, and replays.
    bench.call(&["replay", "a", "--json"]).good();
}

#[test]
fn overwritten_samples_replay_bit_for_bit_under_load() {
    let bench = Bench::new();
    let report =
        bench.call(&["run", text(&pipeline("slow.yaml")), "--for", "3 s", "--json", "--record", "s"]).good();
    assert!(line(&report, "slow.queue")["overwritten"].as_u64().unwrap() > 100, "{}", report["ledger"]);
    assert!(figures(&report, "slow")["lost"].as_u64().unwrap() > 100);
    // The user is told that the machine, or the pipeline, does not keep up.
    let slow = report["too_slow"].as_array().unwrap();
    assert!(slow.iter().any(|s| s.as_str().unwrap().starts_with("slow.queue skipped samples")), "{slow:?}");
    let session = report["session"].as_str().unwrap();
    // Four at once on few cores: order and timing of a replay are nobody's input.
    let replays = [(); 4].map(|()| bench.start(&["replay", session, "--json"]));
    for replay in replays {
        assert_eq!(replay.finish().good()["identical_all"], true);
    }
}

#[test]
fn one_operator_is_compared_alone_or_with_all_downstream() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &["--set", "suspect.habit=clock"]);
    let only = bench.call(&["replay", &session, "--json", "--only", "other"]).good();
    let topics = |v: &Value| v["identical"].as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(topics(&only), ["other.sum"]);
    let from = bench.call(&["replay", &session, "--json", "--from", "other"]).good();
    assert_eq!(topics(&from), ["last.sum", "other.sum"]);
    found(&bench.call(&["replay", &session, "--json", "--from", "suspect"]), "suspect");
    let unknown = bench.call(&["replay", &session, "--only", "nobody"]);
    assert_eq!(unknown.code(), 2);
    assert!(unknown.err.contains("no operator `nobody`"), "{}", unknown.err);
}

#[test]
fn a_replay_that_compares_nothing_says_so_and_exits_5() {
    let bench = Bench::new();
    let session = recorded(&bench, "wrong.yaml", &[]);
    // A source is not done again.
    let done = bench.call(&["replay", &session, "--json", "--only", "source"]);
    assert_eq!((done.code(), done.json()["identical_all"].as_bool()), (5, Some(false)), "{}", done.err);
    let output_text = bench.call(&["replay", &session, "--only", "source"]);
    assert!(
        output_text.code() == 5 && output_text.out.contains("nothing could be compared"),
        "{}",
        output_text.out
    );
    // Where no sample is kept the journals are compared.
    let session = recorded(&bench, "sources.yaml", &["--clock", "simulated"]);
    let output_text = bench.call(&["replay", &session]);
    assert!(output_text.code() == 0 && output_text.out.contains("the journals match"), "{}", output_text.out);
}

#[test]
fn a_session_is_never_written_over_and_the_message_says_what_to_do() {
    let bench = Bench::new();
    let file = pipeline("chain.yaml");
    let arguments = ["run", text(&file), "--clock", "simulated", "--for", "200 ms", "--json"];
    let report = bench.call(&arguments).good();
    let session = report["session"].as_str().unwrap();
    let before = std::fs::read(bench.path(session).join("part-000.mcap")).unwrap();
    let done = bench.call(&["replay", session, "--record", session]);
    assert_eq!(done.code(), 1);
    assert!(done.err.contains(&format!("{session}: it is there already")), "{}", done.err);
    assert!(done.err.contains("name a folder that is not there"), "{}", done.err);
    assert_eq!(std::fs::read(bench.path(session).join("part-000.mcap")).unwrap(), before);
    std::fs::write(bench.path("file"), "").unwrap();
    let done = bench.call(&["replay", session, "--record", "file/again"]);
    assert!(done.err.contains("file/again") && done.err.contains("choose another folder"), "{}", done.err);
}

#[test]
fn an_operator_that_this_build_cannot_make_is_no_gap_of_the_session() {
    let bench = Bench::new();
    let session = bench.path(&recorded(
        &bench,
        "fragile.yaml",
        &["--clock", "simulated", "--set", "fragile.interruption=never"],
    ));
    let tampered = bench.path("tampered");
    rewrite_all(&session, &tampered, |_, attachments| {
        let sets = attachments.iter_mut().find(|a| a.name == "sets.json").unwrap();
        sets.bytes = br#"["fragile.interruption=error"]"#.to_vec();
    });
    let done = bench.call(&["replay", text(&tampered)]);
    assert_eq!(done.code(), 1, "{}", done.out);
    assert!(done.err.contains("the kit's model has 3 layers, but 4 are expected"), "{}", done.err);
}
