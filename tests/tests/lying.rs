//! Programs of operators that break their word, and sessions with damaged bytes: whatever comes, the command ends in order
//! and says why. `PROPTEST_CASES` sets how many are drawn.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;

use chacha20::ChaCha8Rng;
use rand::{Rng, RngExt, SeedableRng};
use stillpoint_recorder::Session;
use stillpoint_samples::Pieces;

use crate::bench::{Bench, Done, pipeline, text};
use crate::tampered::rewrite_all;

const PROGRAM: &str = env!("CARGO_BIN_EXE_kit-program");
const GARBLING: &str = env!("CARGO_BIN_EXE_garbling-program");

/// The number of cases, and the seed of the first.
fn cases(few: u64) -> impl Iterator<Item = u64> {
    let setting = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let first = setting("PROPTEST_RNG_SEED").unwrap_or(1) * 1_000_000;
    first..first + setting("PROPTEST_CASES").unwrap_or(few)
}

/// What holds of every command on any input.
fn ends_in_order(done: &Done, case: &str) {
    let printed = format!("{case}: {}\n{}", done.out, done.err);
    assert!(done.status.signal().is_none() && (0..=6).contains(&done.code()), "{printed}");
    assert!(!done.err.contains("panicked at") && printed.len() < 1 << 20, "{printed}");
    assert!(done.code() == 0 || done.err.len() + done.out.len() > 20, "it prints no reason: {printed}");
}

#[test]
fn broken_messages_of_a_program_end_a_run_in_order() {
    let bench = Bench::new();
    let file = bench.path("own.yaml");
    std::fs::write(
        &file,
        format!(
            "stillpoint: 1\nname: own\noperators:\n  own: {{ use: {{ program: {GARBLING}, kind: kit.counter }}, every: 20 ms }}\n  \
             sum: {{ use: {{ program: {GARBLING}, kind: kit.drain }}, inputs: {{ cloud: bulk.cloud }} }}\n  bulk: {{ use: {{ program: \
             {GARBLING}, kind: kit.bulk }}, every: 50 ms, params: {{ points: 100 }} }}\n"
        ),
    )
    .unwrap();
    let (mut refused, mut ran) = (0, 0);
    for seed in cases(24) {
        let mut command = bench.command(&["run", text(&file), "--clock", "simulated", "--for", "120 ms"]);
        command.env("GARBLE_SEED", seed.to_string()).env("GARBLE_PROGRAM", PROGRAM);
        let done = bench.begin(command).finish();
        ends_in_order(&done, &format!("seed {seed}"));
        *(if done.code() == 0 { &mut ran } else { &mut refused }) += 1;
    }
    println!("{refused} refused, {ran} ran");
    assert!(refused > ran / 20 && ran > refused / 20, "{refused} refused, {ran} ran: the harm is one-sided");
}

/// Writes `from` as `to`: with some bytes of the file changed or its end cut, or well-formed with other samples or attachments.
fn damage(from: &Path, to: &Path, draws: &mut impl Rng) {
    let part = "part-000.mcap";
    if draws.random_bool(0.3) {
        let mut bytes = std::fs::read(from.join(part)).unwrap();
        for _ in 0..draws.random_range(0..4) {
            let at = draws.random_range(0..bytes.len());
            bytes[at] = draws.random();
        }
        if draws.random_bool(0.3) {
            bytes.truncate(draws.random_range(0..bytes.len()));
        }
        std::fs::create_dir(to).unwrap();
        return std::fs::write(to.join(part), bytes).unwrap();
    }
    let session = Session::open(from).unwrap();
    let kind = |topic: &str| session.topics()[session.topic_number(topic).unwrap()].kind.kind().unwrap();
    rewrite_all(from, to, |samples, attachments| {
        for _ in 0..draws.random_range(1..4) {
            let at = draws.random_range(0..samples.len());
            match draws.random_range(0..5) {
                0 => drop(samples.remove(at)),
                1 => {
                    let last = samples.len() - 1;
                    samples.swap(at, last);
                }
                2 | 3 => {
                    let sample = &mut samples[at];
                    let byte = draws.random_range(0..sample.bytes.len());
                    let before = std::mem::replace(&mut sample.bytes[byte], draws.random());
                    // The lengths are the writer's.
                    if Pieces::split(kind(&sample.topic), &sample.bytes).is_err() {
                        sample.bytes[byte] = before;
                    }
                }
                _ => {
                    let which = draws.random_range(0..attachments.len());
                    let data = &mut attachments[which].bytes;
                    let byte = draws.random_range(0..data.len().max(1));
                    if let Some(byte) = data.get_mut(byte) {
                        *byte = draws.random_range(b' '..=b'~');
                    }
                }
            }
        }
    });
}

#[test]
fn damaged_sessions_are_compared_and_run_again_in_order() {
    let bench = Bench::new();
    let file = pipeline("settings.yaml");
    let run = ["run", text(&file), "--clock", "simulated", "--for", "300 ms", "--json", "--record", "s"];
    let report = bench.call(&run).good();
    let whole = report["session"].as_str().unwrap();
    let (mut refused, mut ran) = (0, 0);
    for seed in cases(16) {
        let broken = format!("broken-{seed}");
        damage(&bench.path(whole), &bench.path(&broken), &mut ChaCha8Rng::seed_from_u64(seed));
        for arguments in [
            &["diff", whole, &broken][..],
            &["replay", &broken, "--set", "law.rise=4 s"],
            &["replay", &broken, "--rerun", "law", "--hold", "rig"],
        ] {
            let done = bench.call(arguments);
            ends_in_order(&done, &format!("seed {seed}, {arguments:?}"));
            *(if done.code() == 0 { &mut ran } else { &mut refused }) += 1;
        }
        std::fs::remove_dir_all(bench.path(&broken)).unwrap();
    }
    println!("{refused} refused, {ran} ran");
}
