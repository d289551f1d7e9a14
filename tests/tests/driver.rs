//! Driver programs of cameras in C, C++ and Python, and drivers that send what is no frame: `ingest.driver`.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;
use stillpoint_recorder::Session;
use stillpoint_samples::{DepthImage, Header, Intrinsics, Pieces, Sample};

use crate::bench::{Bench, text, wait_for};

pub const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/camera");
/// Images that a driver sends at least.
const IMAGES: u16 = 12;

/// A pipeline that takes the images of a driver, in a file of the bench.
pub fn pipeline(bench: &Bench) -> PathBuf {
    let file = bench.path("driver.yaml");
    let yaml = "stillpoint: 1\nname: driver\nframes: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }\noperators:\n  \
                camera: { use: ingest.driver, every: 2 ms, frame: camera, params: { socket: camera.sock, max_pixels: 4000 } }\n  \
                cloud: { use: ingest.depth, inputs: { image: camera.depth }, frame: camera, params: { max_pixels: 4000 } }\n\
                record: { topics: [cloud.cloud] }\n";
    std::fs::write(&file, yaml).unwrap();
    file
}

/// The program of a driver and its first arguments; `None` where the machine has no compiler or interpreter for it.
fn driver(bench: &Bench, source: &str) -> Option<(PathBuf, Vec<String>)> {
    let source_path = format!("{FOLDER}/{source}");
    match Path::new(source).extension().and_then(|e| e.to_str()) {
        Some("c") => Some((compiled(bench, "cc", &["-std=c99", "-Wpedantic"], &source_path)?, Vec::new())),
        Some("cpp") => {
            Some((compiled(bench, "c++", &["-std=c++11", "-Wpedantic"], &source_path)?, Vec::new()))
        }
        _ => has("python3").then(|| (PathBuf::from("python3"), vec![source_path])),
    }
}

/// Whether the machine has this program; a test without it says that it skips.
fn has(tool: &str) -> bool {
    let status = Command::new(tool).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    if status.is_err() {
        eprintln!("skipped: there is no {tool}");
    }
    status.is_ok()
}

/// A program or library of this source, without a warning; `None` where the machine has no compiler for it.
pub fn compiled(bench: &Bench, compiler: &str, arguments: &[&str], source: &str) -> Option<PathBuf> {
    let program = bench.path(Path::new(source).file_stem()?.to_str()?);
    let warnings = ["-Wall", "-Wextra", "-Werror", "-O1"];
    let mut command = Command::new(compiler);
    command.args(arguments).args(warnings).arg(source).arg("-o").arg(&program);
    let compiled = has(compiler).then(|| command.output().unwrap())?;
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    Some(program)
}

/// The newest count of this name on `camera.diagnostics`.
fn count(samples: &str, name: &str) -> u64 {
    let sample: Value = serde_json::from_str(samples.lines().last().unwrap()).unwrap();
    let metrics = sample["elements"].as_array().unwrap();
    metrics.iter().find(|m| m["name"] == name).unwrap()["value"].as_f64().unwrap() as u64
}

fn takes_the_images_of(source: &str) {
    let bench = Bench::new();
    let Some((program, arguments)) = driver(&bench, source) else { return };
    let run = bench.run(&pipeline(&bench));
    let socket = bench.path("camera.sock");
    wait_for("the socket", || socket.exists().then_some(()));
    let mut driven = Command::new(program).args(arguments).arg(&socket).spawn().unwrap();
    bench.wait_for_samples("camera.depth", IMAGES.into());
    driven.kill().unwrap();
    driven.wait().unwrap();
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    let recorded = Session::open(&bench.path(session)).unwrap();
    let (mut number, mut before) = (0, 0);
    for sample in recorded.samples_where(|topic| topic.name == "camera.depth") {
        let sample = sample.unwrap().sample;
        let image = Pieces::split(DepthImage::KIND, &sample).unwrap().view::<DepthImage>().unwrap();
        let Intrinsics { fx, fy, cx, cy, depth_unit, width, height, .. } = *image.body;
        assert_eq!(
            ([fx, fy, cx, cy, depth_unit], width, height),
            ([60.0, 60.0, 31.5, 23.5, 1e-3], 64, 48),
            "{source}"
        );
        let expected: Vec<u16> = (0..64 * 48).map(|i| 600 + number % 100 + i % 64).collect();
        assert_eq!(image.elements, expected, "{source}: image {number}");
        let Header { stamp, origin, .. } = image.header;
        assert!(origin > before && origin <= stamp, "{source}: {origin} {stamp}");
        (number, before) = (number + 1, origin);
    }
    assert!(number >= IMAGES, "{source}: {number} images");
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
}

#[test]
fn the_images_of_a_driver_in_c_arrive() {
    takes_the_images_of("camera.c");
}

#[test]
fn the_images_of_a_driver_in_cpp_arrive() {
    takes_the_images_of("camera.cpp");
}

#[test]
fn the_images_of_a_driver_in_python_arrive() {
    takes_the_images_of("camera.py");
}

/// A frame of 2 x 1 pixels.
fn frame(number: u64, fx: f64, width: u32) -> Vec<u8> {
    let mut bytes = b"SPF1".to_vec();
    bytes.extend(68_u32.to_le_bytes());
    // Of the year 2001.
    bytes.extend([number, 1_000_000_000_000_000_000].map(u64::to_le_bytes).as_flattened());
    bytes.extend([fx, 1.0, 0.0, 0.0, 1e-3].map(f64::to_le_bytes).as_flattened());
    bytes.extend([width, 1].map(u32::to_le_bytes).as_flattened());
    bytes.extend([500_u16, 0].map(u16::to_le_bytes).as_flattened());
    bytes
}

#[test]
fn what_is_no_frame_is_refused_with_its_cause_and_the_next_driver_is_taken() {
    let bench = Bench::new();
    let run = bench.run(&pipeline(&bench));
    let socket = bench.path("camera.sock");
    wait_for("the socket", || socket.exists().then_some(()));
    let connect = || UnixStream::connect(&socket).unwrap();
    let refused = |name: &str| {
        wait_for(name, || {
            let said = bench.call(&["echo", "--json", "camera.diagnostics", "--count", "1"]);
            (said.code() == 0 && count(&said.out, name) == 1).then_some(said.out)
        })
    };
    // Two frames that are wrong, and after each one that is right: the connection stays.
    let mut driver = connect();
    for bytes in [frame(0, 1.0, 2), frame(1, f64::NAN, 2), frame(2, 1.0, 3), frame(5, 1.0, 2)] {
        driver.write_all(&bytes).unwrap();
    }
    // What is no frame at all ends it, with the cause.
    driver.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    let mut answer = vec![0; 200];
    let length = driver.read(&mut answer).unwrap();
    assert_eq!(&answer[..length], b"refused: this is not the beginning of a message\n");
    // The next driver is taken, and one that is gone within a frame is counted.
    let mut next = connect();
    next.write_all(&frame(0, 1.0, 2)).unwrap();
    next.write_all(&frame(1, 1.0, 2)[..40]).unwrap();
    drop(next);
    // Every count stays as it is while a live echo waits for the next sample, so that one more driver sends on.
    let mut last = connect();
    let said = std::thread::scope(|scope| {
        let sending = scope.spawn(|| {
            // Ends where the run is over.
            while last.write_all(&frame(1, 1.0, 2)).is_ok() {
                std::thread::yield_now();
            }
        });
        let said = refused("refused_cut");
        let report = run.stop().good();
        sending.join().unwrap();
        assert_eq!(report["balanced"], true, "{}", report["ledger"]);
        said
    });
    for (name, expected) in [
        ("refused_camera", 1),
        ("refused_length", 1),
        ("refused_foreign", 1),
        ("refused_too_long", 0),
        ("missing", 4),
    ] {
        assert_eq!(count(&said, name), expected, "{name}: {said}");
    }
    assert!(!socket.exists(), "the run has left its socket");
}

#[test]
fn a_driver_is_for_live_runs_and_two_operators_need_two_sockets() {
    let bench = Bench::new();
    let file = pipeline(&bench);
    let simulated = bench.call(&["run", text(&file), "--clock", "simulated", "--for", "1 s"]);
    assert_ne!(simulated.code(), 0);
    assert!(simulated.err.contains("which a live run alone does"), "{}", simulated.err);
    assert_eq!(bench.call(&["check", text(&file)]).code(), 0);
    let example = format!("{FOLDER}/pipeline.yaml");
    let checked = bench.call(&["check", &example]);
    assert_eq!(checked.code(), 0, "{}{}", checked.out, checked.err);
    let yaml = std::fs::read_to_string(&file).unwrap();
    let twice = yaml.replacen(
        "  cloud:",
        "  other: { use: ingest.driver, every: 2 ms, frame: camera, params: { socket: camera.sock } }\n  cloud:",
        1,
    );
    std::fs::write(&file, twice).unwrap();
    let refused = bench.call(&["check", text(&file)]);
    assert!(
        refused.code() != 0 && refused.err.contains("listen at the same socket, camera.sock"),
        "{}{}",
        refused.out,
        refused.err
    );
}
