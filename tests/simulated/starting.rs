//! `check` refuses what the start of a run refuses.

use stillpoint_mechanics::random::Random;
use stillpoint_operator::Files;
use stillpoint_operator::files::{DiskFiles, MemoryFiles};
use stillpoint_pipeline::config::{Faults, Machine, check, check_for};
use stillpoint_testing::run;

use crate::{from_root, registry};

/// What `check` and `run` find in a pipeline that is to run in session time.
fn checked(text: &str, files: &dyn Files) -> Result<(), Faults> {
    let here = Machine::here().in_session_time();
    check_for(&here, text, "x.yaml", &[], &registry(), files).map(drop)
}

fn with_files(files: &[(&str, &[u8])]) -> MemoryFiles {
    MemoryFiles { files: files.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec())).collect() }
}

/// A pipeline of one source and its file.
fn source(kind: &str, file: &str) -> String {
    format!(
        "stillpoint: 1\nname: start\nframes: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}\noperators:\n  \
         src: {{ use: {kind}, every: 100 ms, frame: camera, params: {{ files: {file} }} }}\n"
    )
}

/// The simulated pelvis under a plan whose parameter names a file.
fn plan(param: &str, file: &str) -> String {
    let text = std::fs::read_to_string(from_root("examples/plan.yaml")).unwrap();
    assert!(text.contains("angles: 18,"));
    match param {
        // The last one is that of the plan.
        "case" => {
            let (before, after) = text.rsplit_once("case: data/head.case").unwrap();
            format!("{before}case: {file}{after}")
        }
        _ => text.replacen("angles: 18,", &format!("angles: 18, {param}: {file},"), 1),
    }
}

#[test]
fn a_file_whose_content_no_start_takes_is_refused_with_its_line() {
    let short =
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  end_header\n0 0 1\n";
    let image = include_bytes!("../../examples/data/depth/000.png");
    let cases: [(String, &str, &[u8]); 7] = [
        (source("ingest.ply", "a.ply"), "a.ply", short),
        (source("ingest.pcd", "a.pcd"), "a.pcd", b"garbage"),
        (source("ingest.pcd", "\"d/*.pcd\""), "d/1.pcd", b""),
        (plan("case", "a.case"), "a.case", b"garbage"),
        (plan("protocol", "a.yaml"), "a.yaml", b"limits: 7"),
        (plan("objectives", "a.json"), "a.json", b"{"),
        (plan("machine", "a.machine"), "a.machine", &image[..100]),
    ];
    for (text, file, bytes) in cases {
        let head = std::fs::read(from_root("examples/data/head.case")).unwrap();
        let files = with_files(&[(file, bytes), ("data/head.case", &head)]);
        let faults = checked(&text, &files).expect_err(file).to_string();
        let folder = file.split('/').next().unwrap();
        let line = 1 + text.lines().position(|line| line.contains(folder)).unwrap();
        assert!(faults.starts_with(&format!("x.yaml:{line}:")), "{faults}");
        assert!(faults.contains("cannot start: ") && faults.contains(file), "{faults}");
        // A session of it is read, and its replay says what it lacks.
        assert!(check(&text, "x.yaml", &[], &registry(), &files).is_ok(), "{file}");
    }
}

#[test]
fn a_key_that_no_start_takes_is_refused_with_its_line() {
    let text = std::fs::read_to_string(from_root("pipeline.yaml")).unwrap();
    let line = 1 + text.lines().position(|line| line.contains("rig.key")).unwrap();
    let faults = checked(&text, &with_files(&[("examples/data/rig.key", b"short")])).unwrap_err().to_string();
    assert!(faults.starts_with(&format!("x.yaml:{line}:")), "{faults}");
}

/// Examples whose files are small.
const EXAMPLES: [&str; 6] = [
    "own-cloud.yaml",
    "own-recording.yaml",
    "one-dof-tracking.yaml",
    "one-dof-lqg.yaml",
    "plan.yaml",
    "forehead.yaml",
];

/// Pipelines that are drawn: `PROPTEST_CASES` sets the number in long campaigns.
fn number_of_cases() -> u64 {
    std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).map_or(40, |n: u64| n.min(2000))
}

/// A number below `end`, which is above 0.
fn below(random: &mut Random, end: usize) -> usize {
    ((random.uniform() * end as f64) as usize).min(end - 1)
}

/// An example in which a number has another value, or of which a file is damaged.
fn drawn(random: &mut Random) -> (String, MemoryFiles) {
    let path = from_root("examples").join(EXAMPLES[below(random, EXAMPLES.len())]);
    let mut text = std::fs::read_to_string(&path).unwrap();
    let disk = DiskFiles::next_to(&path);
    let graph = check(&text, "x.yaml", &[], &registry(), &disk).unwrap();
    let mut files = MemoryFiles::default();
    for name in graph.operators.iter().flat_map(|o| &o.files).flat_map(|name| disk.list(name).unwrap()) {
        files.files.insert(name.clone(), disk.read(&name).unwrap());
    }
    let damaged = below(random, files.files.len() + 1);
    if let Some(bytes) = files.files.values_mut().nth(damaged) {
        match below(random, 3) {
            0 => bytes.truncate(below(random, bytes.len() + 1)),
            1 => bytes.clear(),
            _ => {
                let at = below(random, bytes.len().min(400));
                bytes[at] ^= 1 << below(random, 8);
            }
        }
    } else {
        let numbers: Vec<usize> = text.match_indices(": ").map(|(at, _)| at + 2).collect();
        let places: Vec<usize> =
            numbers.into_iter().filter(|at| text[*at..].starts_with(|c: char| c.is_ascii_digit())).collect();
        let at = places[below(random, places.len())];
        let end = at + text[at..].find(|c: char| !c.is_ascii_digit() && c != '.').unwrap();
        let value = ["0", "1", "3", "8", "0.5", "-1", "1000", "86400"][below(random, 8)];
        text.replace_range(at..end, value);
    }
    (text, files)
}

#[test]
fn no_drawn_pipeline_that_the_check_passes_is_refused_by_the_start_of_its_run() {
    let (mut passed, mut refused) = (0, 0);
    for seed in 0..number_of_cases() {
        let (text, files) = drawn(&mut Random::new(seed));
        if checked(&text, &files).is_err() {
            refused += 1;
            continue;
        }
        passed += 1;
        let started = run(&text, &registry(), &files, 1);
        assert!(started.is_ok(), "seed {seed}: {}\n{text}", started.err().unwrap());
    }
    assert!(passed > 0 && refused > 0, "{passed} passed, {refused} refused");
}
