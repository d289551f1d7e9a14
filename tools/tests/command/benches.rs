//! `stillpoint bench`: what measures nothing is refused.

use crate::{stillpoint, text};

#[test]
fn arguments_with_which_a_bench_measures_nothing_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (bench, option, wrong) in [
        ("hop", "windows", "0"),
        ("hop", "length", "10"),
        ("hop", "payload", "65"),
        ("record", "windows", "0"),
        ("record", "length", "100"),
        ("replay", "seconds", "0"),
        ("replay", "replays", "0"),
        ("ledger", "samples", "0"),
        ("ledger", "kill-every", "9"),
        ("killed", "kills", "0"),
        ("failsafe", "trials", "0"),
        ("failsafe", "threads", "0"),
        ("loop", "seconds", "0"),
        ("loop", "rounds", "0"),
        ("step", "seeds", "0"),
        ("step", "seconds", "nan"),
        ("step", "threads", "0"),
        ("robust", "seeds", "0"),
        ("robust", "seconds", "0"),
        ("tune", "rounds", "0"),
        ("tune", "held-out", "0"),
    ] {
        let out = stillpoint(folder.path(), &["bench", bench, &format!("--{option}"), wrong]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{bench} --{option} {wrong}: {said}");
        assert!(said.contains(&format!("invalid value '{wrong}' for '--{option}")), "{said}");
    }
}

#[test]
fn a_ledger_without_kills_balances() {
    let folder = tempfile::tempdir().unwrap();
    let ledger = ["bench", "ledger", "--kill-every", "0", "--samples", "2000", "--json"];
    let out = stillpoint(folder.path(), &ledger);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let told: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&told["kills"], &told["balanced"]), (&0.into(), &true.into()));
}
