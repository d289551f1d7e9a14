//! The bedside as a program of its own: it outlives the program that controls it, and is safe when that dies.

use serde_json::Value;
use stillpoint_pipeline::clock::realtime;

use crate::bench::{Bench, Running, two_ports, udp_ports, wait_for};

const PIPELINE: &str = include_str!("../../../examples/head-3dof-apart.yaml");
const KEY: &str = include_str!("../../../examples/data/rig.key");
/// From the last datagram to the safe state, ns.
const LIMIT: u64 = 100_000_000;

/// The example at ports that nobody has, with its key, and with a head that is held where it is.
fn pipeline(bench: &Bench) -> String {
    let mut yaml = PIPELINE.replace("at: 5 s, z:", "at: 1 h, z:");
    let free = udp_ports::<3>();
    for (own, free) in ["5005", "5006", "5008"].iter().zip(free) {
        let link = format!("udp: 127.0.0.1:{own}");
        assert!(yaml.contains(&link));
        yaml = yaml.replace(&link, &format!("udp: 127.0.0.1:{free}"));
    }
    std::fs::create_dir(bench.path("data")).unwrap();
    std::fs::write(bench.path("data/rig.key"), KEY).unwrap();
    assert_eq!(yaml.matches("tcp/127.0.0.1:5010").count(), 2);
    bench.write("apart.yaml", &yaml.replace("tcp/127.0.0.1:5010", &format!("tcp/127.0.0.1:{}", two_ports())))
}

fn control(bench: &Bench, file: &str) -> Running {
    bench.host(file, "main")
}

fn states(lines: &str) -> Vec<Value> {
    lines.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
}

/// Waits until the far end does this, with the beam as it is to be.
fn wait_until(bench: &Bench, what: &str, doing: u64, beam: u64) {
    wait_for(what, || {
        let done =
            bench.call(&["echo", "--json", "--run", "head-3dof-apart-rig", "far.state", "--count", "1"]);
        let state = states(&done.out).pop()?["elements"][0].clone();
        if state["doing"] == doing && state["beam"] == beam {
            return Some(());
        }
        if beam == 1 {
            // On a busy machine the script's arm may have come too early, and a loop that stood still waits for a person.
            for message in ["console.resume", "console.arm"] {
                bench.call(&["send", "--run", "head-3dof-apart", message]);
            }
        }
        None
    });
}

/// How long an operator that ticks every few ms was kept from it, ns.
fn stood(states: &[Value], from: u64, until: u64) -> u64 {
    let stamps: Vec<u64> = states.iter().map(|s| s["stamp"].as_u64().unwrap()).collect();
    let pauses = stamps.windows(2).filter(|pair| pair[1] > from && pair[0] < until);
    pauses.map(|pair| (pair[1] - pair[0]).saturating_sub(10_000_000)).sum()
}

const VENTING: u64 = 1;
const FOLLOWING: u64 = 2;

#[test]
fn a_rig_outlives_its_control_vents_in_time_and_takes_the_next() {
    let bench = Bench::new();
    let file = pipeline(&bench);
    let rig = bench.start(&["rig", &file, "--json", "--record", "s"]);
    let first = control(&bench, &file);
    wait_until(&bench, "the beam", FOLLOWING, 1);
    // All of the program, supervisor and bridge included. Stamps of a live session are of this clock.
    let killed = realtime();
    first.kill_group();
    wait_until(&bench, "the vent", VENTING, 0);
    let second = control(&bench, &file);
    wait_until(&bench, "the beam of the next program", FOLLOWING, 1);
    let controlled = second.stop().good();
    let bedside = rig.stop().good();
    for report in [&controlled, &bedside] {
        assert_eq!(report["balanced"], true, "{}", report["ledger"]);
        let replay = bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
        assert_eq!(replay["identical_all"], true);
    }

    let session = bedside["session"].as_str().unwrap();
    let far = states(&bench.call(&["echo", "--json", "far.state", "--session", session]).out);
    let valves = states(&bench.call(&["echo", "--json", "rig.state", "--session", session]).out);
    let since = |state: &&Value| state["stamp"].as_u64().unwrap() >= killed;
    let vent = far.iter().filter(since).find(|s| s["elements"][0]["doing"] == VENTING).unwrap();
    let arrived = vent["elements"][0]["arrived"].as_u64().unwrap();
    let safe = valves.iter().find(|state| {
        let opening = state["elements"][0]["opening"].as_array().unwrap();
        let at = |i: usize| opening[i].as_f64().unwrap();
        state["stamp"].as_u64().unwrap() > arrived
            && (0..3).all(|b| at(2 * b) <= 0.05 && at(2 * b + 1) >= 0.5)
    });
    let safe = safe.unwrap()["stamp"].as_u64().unwrap();
    // The bedside stands for hardware of its own: for as long as this machine gave it no core, nobody waits.
    let stood: u64 = [&far, &valves].iter().map(|states| stood(states, arrived, safe)).sum();
    let took = (safe - arrived) / 1_000_000;
    assert!(
        safe - arrived <= LIMIT + stood,
        "safe {took} ms after the last order, {stood} ns without a core"
    );
    // Nothing of the beam is left then.
    let dark = far.iter().find(|s| s["stamp"].as_u64().unwrap() >= safe).unwrap();
    assert_eq!(dark["elements"][0]["beam"], 0);
}
