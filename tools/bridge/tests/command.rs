//! `stillpoint plan --pool` as people call it: the command, its bridge, and workers.

use std::path::Path;
use std::process::Stdio;

use stillpoint_pool::{Network, Record, Simulation};

use crate::bench::{Bench, two_ports};
use crate::pool::{Ends, program};

const ASKED: [&str; 13] = [
    "--beams",
    "3",
    "--budget",
    "6",
    "--fluence-only",
    "--grid",
    "12mm",
    "--bixel",
    "20mm",
    "--engine",
    "pencil",
    "--seed",
    "1",
];

/// Names of the files of a folder of doses, and how many files of workers are apart in it.
fn doses(folder: &Path) -> (Vec<String>, usize) {
    let names = |folder: &Path| -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    };
    let (mut doses, folders): (Vec<_>, Vec<_>) =
        names(folder).into_iter().partition(|name| name.ends_with(".dose"));
    doses.sort();
    let apart =
        folders.iter().flat_map(|name| names(&folder.join(name))).filter(|name| name.ends_with(".dose"));
    (doses, apart.count())
}

#[test]
fn patients_on_two_workers_get_the_plans_and_doses_of_this_machine_and_the_calls_are_recorded() {
    let bench = Bench::new();
    for seed in ["1", "2"] {
        let made = bench.call(&["case", "phantom", "--seed", seed, "--out", "."]);
        assert!(made.status.success(), "{}", made.err);
    }
    let endpoint = format!("tcp/127.0.0.1:{}", two_ports());
    let _workers = ["--listen", "--connect"].map(|reach| {
        let cache = bench.path(reach);
        let place = ["worker", reach, &endpoint, "--slots", "1", "--name", &reach[2..], "--cache"];
        Ends(program(&place).arg(cache).stdout(Stdio::null()).spawn().unwrap())
    });
    let plan = |cases: &[&str], out: &str, more: &[&str]| {
        let doses = format!("doses-{out}");
        let to = ["--out", out, "--doses", &doses];
        let done = bench.call(&[&["plan"], cases, &ASKED, &to, more].concat());
        assert!(done.status.success(), "{}\n{}", done.out, done.err);
        done
    };
    let both = ["pelvis-1.case", "pelvis-2.case"];
    let on_pool = ["--pool", &endpoint];
    plan(&both, "alone", &[]);
    plan(&both, "pooled", &on_pool);
    plan(&both[..1], "recorded", &[&on_pool[..], &["--pool-record", "calls.jsonl"]].concat());

    let read = |path: &str| std::fs::read(bench.path(path)).unwrap();
    for name in ["plan.json", "rtplan.dcm", "rtdose.dcm"] {
        for case in ["pelvis-1", "pelvis-2"] {
            assert!(
                read(&format!("alone/{case}/{name}")) == read(&format!("pooled/{case}/{name}")),
                "{case} {name}"
            );
        }
        assert!(read(&format!("alone/pelvis-1/{name}")) == read(&format!("recorded/{name}")), "{name}");
    }
    // All doses of the plans are part of the folder, byte for byte, and none is apart any more.
    let (here, there) = (doses(&bench.path("doses-alone")), doses(&bench.path("doses-pooled")));
    assert!(!here.0.is_empty());
    assert_eq!(here, there);
    for name in &here.0 {
        assert!(read(&format!("doses-alone/{name}")) == read(&format!("doses-pooled/{name}")), "{name}");
    }
    // The record has each dose, and the time of other workers can be computed from it.
    let record = Record::from_text(&String::from_utf8(read("calls.jsonl")).unwrap()).unwrap();
    assert!(
        record.calls.len() > doses(&bench.path("doses-recorded")).0.len(),
        "{} calls",
        record.calls.len()
    );
    let network = Network { bits_per_s: 1e9, delay: 1_000_000 };
    let outcome = Simulation { workers: 4, network }.run(&[&record]).unwrap();
    assert!(outcome.seconds > 0.0 && outcome.efficiency() <= 1.0, "{outcome:?}");
}
