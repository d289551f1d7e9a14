//! Figures of a worker and of a router, read by a client of HTTP.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::Stdio;
use std::sync::mpsc::channel;

use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Build, ClientSettings, Pool, PoolDoses};

use crate::bench::{two_ports, wait_for};
use crate::pool::{Ends, program};
use crate::water::{Water, angles};

/// Starts a program with figures, and gives the address at which they are.
fn served(arguments: &[&str]) -> (Ends, String) {
    let mut command = program(arguments);
    command.args(["--metrics", "127.0.0.1:0"]).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    let (sends, address) = channel();
    // Read to the end: a program whose standard error is closed ends.
    std::thread::spawn(move || {
        for line in lines {
            if let Some((_, place)) = line.split_once("metrics at http://") {
                let _ = sends.send(place.trim_end_matches("/metrics").to_owned());
            }
        }
    });
    let address = address.recv().unwrap();
    (Ends(child), address)
}

/// The body of an answer.
fn figures(address: &str) -> String {
    let mut client = TcpStream::connect(address).unwrap();
    client.write_all(b"GET /metrics HTTP/1.1\r\nHost: here\r\n\r\n").unwrap();
    let mut answer = String::new();
    client.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200 OK") && head.contains("version=0.0.4"), "{head}");
    body.to_owned()
}

/// The value of a figure with these first labels.
fn value(body: &str, name: &str) -> Option<f64> {
    let line = body.lines().find(|line| line.starts_with(name))?;
    line.rsplit_once(' ')?.1.parse().ok()
}

#[test]
fn a_router_and_a_worker_serve_figures_of_calls_bytes_cache_and_peers() {
    let folder = tempfile::tempdir().unwrap();
    let endpoint = format!("tcp/127.0.0.1:{}", two_ports());
    let (_router, of_router) = served(&["router", "--listen", &endpoint]);
    let cache = folder.path().join("cache");
    let worker =
        ["worker", "--connect", &endpoint, "--name", "w", "--slots", "1", "--cache", cache.to_str().unwrap()];
    let (worker, of_worker) = served(&worker);
    wait_for("the greeting", || {
        let body = figures(&of_router);
        (value(&body, "stillpoint_router_peers ") == Some(1.0)
            && value(&body, "stillpoint_peer_greetings_total{peer=\"worker-w\"}")? > 1.0)
            .then_some(())
    });
    wait_for("the first figures", || {
        (value(&figures(&of_worker), "stillpoint_worker_slots{worker=\"worker-w\"}") == Some(1.0))
            .then_some(())
    });
    let before = figures(&of_worker);
    assert_eq!(value(&before, "stillpoint_worker_calls_answered_total"), Some(0.0), "{before}");
    // Calls are counted with their bytes.
    let courier = ChildCourier::start(program(&["plan-client", "--connect", &endpoint])).unwrap();
    let settings = ClientSettings { tells_demand: true, ..ClientSettings::new(Build::here().unwrap()) };
    let mut pool = Pool::new(courier, settings);
    let water = Water::new();
    let engines = [water.engine.clone()];
    let mut spare = PoolDoses::in_folder(&folder.path().join("spare")).unwrap();
    let mut round = 0.0;
    wait_for("calls", || {
        round += 1.0;
        let angles: Vec<f64> = angles().iter().map(|deg| deg + 0.01 * round).take(4).collect();
        spare.fill(&mut pool, &engines, &angles, || ()).unwrap();
        let body = figures(&of_worker);
        let of =
            |name: &str| value(&body, &format!("stillpoint_worker_{name}{{worker=\"worker-w\"")).unwrap();
        let counted = of("calls_answered_total") > 0.0 && of("cache_bytes") > 0.0 && of("peers") >= 1.0;
        let _ = of("pool_calls");
        (counted && of("received_bytes_total") > 100.0 && of("sent_bytes_total") > 100.0).then_some(())
    });
    let body = figures(&of_worker);
    assert_eq!(value(&body, "stillpoint_worker_calls_failed_total"), Some(0.0), "{body}");
    assert_eq!(value(&body, "stillpoint_worker_messages_lost_total"), Some(0.0), "{body}");
    let build = Build::here().unwrap();
    assert!(body.contains(&format!("build=\"{}\"", build.text())), "{body}");
    // One who asks is none of those who greet.
    assert!(!figures(&of_router).contains("peer=\"plan-"), "{}", figures(&of_router));
    // A worker that is gone is no longer a peer.
    drop(worker);
    wait_for("the end", || {
        (value(&figures(&of_router), "stillpoint_router_peers ") == Some(0.0)).then_some(())
    });
}
