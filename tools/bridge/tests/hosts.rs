//! Two programs, each of which runs the part of one host.

use serde_json::Value;

use crate::bench::{Bench, two_ports};

/// Poses and images at 100 Hz leave the bedside, the cluster counts them, and its counts come back.
fn pipeline(port: u16) -> String {
    format!(
        "stillpoint: 1
name: two
frames: {{ camera: {{ parent: couch, at: [0 mm, 0 mm, 720 mm], rotation: [180 deg, 0 deg, 0 deg] }} }}
operators:
  rig: {{ use: rig.camera, every: 10 ms, frame: camera, params: {{ motion: raise, width: 32 px, height: 24 px, focal_length: 28 px }} }}
  near: {{ use: sink.null, inputs: {{ pose: rig.truth }} }}
  far: {{ use: sink.null, inputs: {{ pose: rig.truth }} }}
  eye: {{ use: sink.null, inputs: {{ image: rig.depth }} }}
  back: {{ use: sink.null, inputs: {{ diagnostics: far.counts }} }}
hosts:
  bedside: {{ listen: tcp/127.0.0.1:{port} }}
  cluster: {{ connect: tcp/127.0.0.1:{port} }}
processes:
  patient: {{ operators: [rig, near, back], host: bedside }}
  heavy: {{ operators: [far, eye], host: cluster }}
record: {{ topics: [rig.truth, near.counts, far.counts, back.counts] }}
"
    )
}

/// The line of the ledger about a consumer.
fn line<'r>(report: &'r Value, consumer: &str) -> &'r Value {
    let lines = report["ledger"].as_array().unwrap();
    lines.iter().find(|l| l["consumer"] == consumer).unwrap_or_else(|| panic!("{consumer}: {report}"))
}

fn count(line: &Value, name: &str) -> u64 {
    line[name].as_u64().unwrap_or(0)
}

/// The session of a report replays bit for bit.
fn replays(bench: &Bench, report: &Value) {
    let replay = bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
    assert_eq!(replay["differences"], 0, "{replay}");
}

#[test]
fn samples_of_several_types_go_there_and_back_and_both_sessions_replay_without_a_network() {
    let bench = Bench::new();
    let file = bench.write("two.yaml", &pipeline(two_ports()));
    let (bedside, cluster) = (bench.host(&file, "bedside"), bench.host(&file, "cluster"));
    bedside.wait_for_words("host `cluster` is here");
    bench.wait_for_samples("two-bedside", "back.counts", 30);
    // The bedside ends first, while the cluster can still say what it has.
    let bedside = bedside.stop().good();
    let cluster = cluster.stop().good();
    for report in [&bedside, &cluster] {
        assert_eq!(report["balanced"], true, "{}", report["ledger"]);
        assert_eq!(report["complete"], true, "{report}");
        replays(&bench, report);
    }
    // Each sample that was sent is in one count, at both ends.
    for (edge, there, here) in [
        ("rig_truth_cluster", &bedside, &cluster),
        ("rig_depth_cluster", &bedside, &cluster),
        ("far_counts_bedside", &cluster, &bedside),
    ] {
        let sent = line(there, &format!("bridge.{edge}"));
        let taken = line(here, &format!("{edge}.sample"));
        assert!(count(taken, "received") > 20, "{edge}: {sent} {taken}");
        // What a host says last may be older than what it takes last.
        let put = count(sent, "received") + count(sent, "lost");
        assert!(put >= count(taken, "received"), "{edge}: {sent} {taken}");
        assert_eq!(
            count(sent, "refused") + count(taken, "refused") + count(taken, "lost"),
            0,
            "{edge}: {taken}"
        );
    }
    // Remote samples are recorded inputs, with the time of acquisition in the clock of the host that took them.
    let session = bedside["session"].as_str().unwrap();
    let taken = bench.samples(session, "far_counts_bedside.sample");
    assert_eq!(taken.len() as u64, count(line(&bedside, "far_counts_bedside.sample"), "received"));
    for sample in &taken {
        let (origin, stamp) = (sample["origin"].as_u64().unwrap(), sample["stamp"].as_u64().unwrap());
        assert!(origin <= stamp && stamp - origin < 10_000_000_000, "{sample}");
    }
    let clock = bench.samples(session, "far_counts_bedside.diagnostics");
    let metrics = clock[0]["elements"].as_array().unwrap();
    let metric = |name: &str| metrics.iter().find(|m| m["name"] == name).unwrap()["value"].as_f64().unwrap();
    // Both hosts have the clock of one machine.
    assert!(metric("clock_offset_s").abs() <= metric("clock_uncertainty_s"), "{metrics:?}");
    assert!(metric("clock_uncertainty_s") < 1.0);
    // The two sessions become one, in which nothing arrives before it was sent, beyond what the clocks leave open.
    let joined = bench.path("joined").to_str().unwrap().to_owned();
    let message = bench
        .call(&["merge", session, cluster["session"].as_str().unwrap(), "--out", &joined, "--json"])
        .good();
    let (offset, uncertainty) = (
        message["hosts"][1]["offset_ns"].as_i64().unwrap(),
        message["hosts"][1]["uncertainty_ns"].as_i64().unwrap(),
    );
    assert!(offset.abs() <= uncertainty && uncertainty < 1_000_000_000, "{message}");
    let sent = bench.samples(&joined, "cluster.far.counts");
    let arrived = bench.samples(&joined, "bedside.far_counts_bedside.sample");
    let stamp = |sample: &Value| sample["stamp"].as_i64().unwrap();
    assert!(sent.len() > 20 && arrived.len() > 20);
    assert!(stamp(&arrived[0]) + uncertainty >= stamp(&sent[0]), "{} {}", arrived[0], sent[0]);
}

#[test]
fn the_bedside_goes_on_without_the_far_host_takes_it_back_and_replays() {
    let bench = Bench::new();
    let file = bench.write("two.yaml", &pipeline(two_ports()));
    // It starts alone.
    let bedside = bench.host(&file, "bedside");
    bench.wait_for_samples("two-bedside", "near.counts", 10);
    let cluster = bench.host(&file, "cluster");
    bedside.wait_for_words("host `cluster` is here");
    bench.wait_for_samples("two-bedside", "back.counts", 10);
    cluster.kill();
    bedside.wait_for_words("host `cluster` is silent");
    bench.wait_for_samples("two-bedside", "near.counts", 10);
    let cluster = bench.host(&file, "cluster");
    bench.wait_for_samples("two-bedside", "back.counts", 10);
    // A bridge that dies is started again, and costs nothing but samples that are counted.
    bedside.kill_child("bridge");
    bench.wait_for_samples("two-bedside", "back.counts", 10);
    let bedside = bedside.stop().good();
    let cluster = cluster.stop().good();
    for report in [&bedside, &cluster] {
        assert_eq!(report["balanced"], true, "{}", report["ledger"]);
        replays(&bench, report);
    }
    let sent = line(&bedside, "bridge.rig_truth_cluster");
    assert!(count(sent, "unheard") > 0 && count(sent, "received") > 0, "{sent}");
    // No operator of the bedside waited for the network.
    let near = line(&bedside, "near.pose");
    assert_eq!((count(near, "overwritten"), count(near, "down")), (0, 0), "{near}");
}

#[test]
fn hosts_that_do_not_run_the_same_pipeline_say_what_differs_and_exchange_nothing() {
    let bench = Bench::new();
    let port = two_ports();
    let file = bench.write("two.yaml", &pipeline(port));
    let other = bench.write("other.yaml", &pipeline(port).replace("width: 32 px", "width: 33 px"));
    let (bedside, cluster) = (bench.host(&file, "bedside"), bench.host(&other, "cluster"));
    for (host, peer) in [(&bedside, "cluster"), (&cluster, "bedside")] {
        host.wait_for_words(&format!(
            "host `{peer}` is refused: the hash of the pipeline with its settings and files is"
        ));
    }
    bench.wait_for_samples("two-bedside", "near.counts", 10);
    let bedside = bedside.stop().good();
    cluster.stop().good();
    let sent = line(&bedside, "bridge.rig_truth_cluster");
    assert_eq!((count(sent, "received"), count(sent, "sent")), (0, count(sent, "unheard")), "{sent}");
}

#[test]
fn a_missing_program_is_named_with_the_command_that_builds_it() {
    let bench = Bench::new();
    let file = bench.write("two.yaml", &pipeline(two_ports()));
    let arguments = ["run", &file, "--host", "bedside", "--no-record"];
    let done = bench.start_with_bridge(&arguments, "/nowhere/stillpoint-bridge").finish();
    assert!(!done.status.success());
    for words in ["/nowhere/stillpoint-bridge", "cargo build", "--manifest-path tools/bridge/Cargo.toml"] {
        assert!(done.err.contains(words), "{}", done.err);
    }
    // One program runs both hosts without it.
    let whole = ["run", &file, "--for", "300ms", "--no-record", "--json"];
    bench.start_with_bridge(&whole, "/nowhere/stillpoint-bridge").finish().good();
}

#[test]
fn a_taken_port_ends_the_run_before_it_begins_and_is_named() {
    let bench = Bench::new();
    let port = two_ports();
    let _taken = std::net::TcpListener::bind(("127.0.0.1", port)).unwrap();
    let file = bench.write("two.yaml", &pipeline(port));
    let done = bench.call(&["run", &file, "--host", "bedside", "--no-record"]);
    assert!(!done.status.success());
    assert!(done.err.contains(&format!("tcp/127.0.0.1:{port}")), "{}", done.err);
}

/// A certificate of the test's authority, in the folder `pki`.
fn certificate(bench: &Bench, arguments: &[&str]) {
    let all = [&["pki", "certificate", "pki"], arguments].concat();
    let done = bench.call(&all);
    assert!(done.status.success(), "{}", done.err);
}

/// With certificates, of which the listening host gets a new one: its bridge begins anew, and no operator does.
#[test]
fn the_example_plans_on_the_cluster_over_tls_and_the_bedside_replays() {
    let bench = Bench::new();
    assert!(bench.call(&["pki", "authority", "pki"]).status.success());
    certificate(&bench, &["bedside"]);
    certificate(&bench, &["cluster", "--address", "127.0.0.1"]);
    let yaml = include_str!("../../../examples/remote-planning.yaml");
    let file = bench.write("planning.yaml", &yaml.replace("7447", &two_ports().to_string()));
    let (cluster, bedside) = (bench.host(&file, "cluster"), bench.host(&file, "bedside"));
    bench.wait_for_samples("remote-planning-bedside", "plans_plan_bedside.sample", 1);
    certificate(&bench, &["cluster", "--address", "127.0.0.1", "--replace"]);
    cluster.wait_for_words("a new certificate was written");
    // Its place is taken by the next life of the bridge.
    cluster.wait_for_words_after("a new certificate was written", "host `bedside` is here");
    let (bedside, cluster) = (bedside.stop().good(), cluster.stop().good());
    assert_eq!((&bedside["balanced"], &cluster["balanced"]), (&true.into(), &true.into()));
    for report in [&bedside, &cluster] {
        let text = report.to_string();
        assert!(!text.contains("PRIVATE KEY"), "{text}");
    }
    let session = bedside["session"].as_str().unwrap();
    assert!(!bench.samples(session, "plans_plan_bedside.sample").is_empty());
    replays(&bench, &bedside);
    replays(&bench, &cluster);
}
