//! A pipeline whose plans are computed by a pool of workers.

use std::process::Stdio;

use serde_json::Value;

use crate::bench::{Bench, two_ports, wait_for};
use crate::pool::{Ends, program};

/// A patient who does not move: one request, for the planned set-up. `at` is the endpoint of a pool.
fn pipeline(at: Option<&str>) -> String {
    let (answers, pool) = match at {
        Some(at) => (
            ", answers: { from: pool.messages, delay: 1 ms }",
            format!(
                "  pool: {{ use: pool.client, every: 2 ms, inputs: {{ calls: plans.calls }}, params: {{ connect: {at} }} }}\n"
            ),
        ),
        None => ("", String::new()),
    };
    format!(
        "stillpoint: 1
name: pooled
seed: 4
frames: {{ camera: {{ parent: couch, at: [0 mm, 0 mm, 720 mm], rotation: [180 deg, 0 deg, 0 deg] }} }}
operators:
  rig: {{ use: rig.camera, every: 100 ms, frame: camera, params: {{ motion: still, width: 24 px, height: 18 px, focal_length: 14 px }} }}
  watch: {{ use: plan.watch, inputs: {{ pose: rig.truth }}, params: {{ beams: 4, budget: 24 }} }}
  plans:
    use: plan.optimizer
    every: 50 ms
    inputs: {{ request: watch.request{answers} }}
    params: {{ angles: 18, grid: 10 mm, bixel: 15 mm, doses: 6, solves: 4, max_bixels: 1024 }}
{pool}processes: {{ patient: [rig, watch] }}
record: {{ topics: [watch.request, plans.plan, plans.diagnostics] }}
"
    )
}

/// Runs it until the work on the request has ended, into the session of this number. `meanwhile` is done when the first
/// update is there.
fn plan(bench: &Bench, file: &str, session: u32, meanwhile: impl FnOnce()) -> Value {
    let run = bench.start(&["run", file, "--json", "--record", "s"]);
    let session = format!("s/pooled-{session:04}");
    // The session is read while it is written.
    let wait_for_update = |words: &str| {
        wait_for(words, || {
            let done = bench.call(&["echo", "--json", "plans.plan", "--session", &session]);
            done.out.contains(words).then_some(())
        });
    };
    wait_for_update("\"request\":0");
    meanwhile();
    wait_for_update("\"ended\":1");
    run.stop().good()
}

/// What the updates say, without their heads.
fn updates(bench: &Bench, report: &Value) -> Vec<Value> {
    let mut updates = bench.samples(report["session"].as_str().unwrap(), "plans.plan");
    for update in &mut updates {
        let fields = update.as_object_mut().unwrap();
        ["stamp", "origin", "sequence", "incarnation"].iter().for_each(|head| drop(fields.remove(*head)));
    }
    updates
}

fn worker(bench: &Bench, name: &str, at: &str) -> Ends {
    let cache = bench.path(name);
    let mut command = program(&["worker", "--connect", at, "--name", name, "--slots", "1", "--cache"]);
    Ends(command.arg(cache).stdout(Stdio::null()).spawn().unwrap())
}

#[test]
fn updates_over_a_pool_are_those_without_one_though_a_worker_and_the_router_are_killed_and_the_session_replays()
 {
    let bench = Bench::new();
    let alone = plan(&bench, &bench.write("alone.yaml", &pipeline(None)), 1, || ());
    let expected = updates(&bench, &alone);
    let at = format!("tcp/127.0.0.1:{}", two_ports());
    let router = || Ends(program(&["router", "--listen", &at]).spawn().unwrap());
    let mut routers = vec![router()];
    let mut workers = vec![worker(&bench, "one", &at), worker(&bench, "two", &at)];
    let pooled = plan(&bench, &bench.write("pooled.yaml", &pipeline(Some(&at))), 2, || {
        workers.pop();
        routers.pop();
        routers.push(router());
    });
    drop((workers, routers));
    let found = updates(&bench, &pooled);
    assert_eq!(found, expected);
    assert_eq!(found.iter().filter(|update| update["ended"] == 1).count(), 1, "one result");
    assert_eq!(pooled["balanced"], true, "{}", pooled["ledger"]);
    let session = pooled["session"].as_str().unwrap();
    let reported = bench.samples(session, "plans.diagnostics");
    assert!(reported.last().unwrap().to_string().contains("calls_by_workers"), "{reported:?}");
    assert!(!bench.samples(session, "pool.messages").is_empty());
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!((&replay["identical_all"], &replay["differences"]), (&true.into(), &0.into()), "{replay}");
}
