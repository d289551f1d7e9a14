//! A foreign peer: the Python package `eclipse-zenoh`, which knows nothing of this project. `python3`, or the program
//! that STILLPOINT_ZENOH_PYTHON names, needs it (`pip install eclipse-zenoh`); without it the tests say so and test
//! nothing.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;

use stillpoint_remote::{Endpoints, Host, Remote, Role};
use stillpoint_transport::{LinkState, Receiver, Sender, Transport};

use crate::common::{channel, connecting, eventually, host, identity, listening, send, settings, two_ports};
use crate::tls::Pki;

/// The Python that has the package.
fn python() -> Option<String> {
    let python = std::env::var("STILLPOINT_ZENOH_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let asked =
        Command::new(&python).args(["-c", "import zenoh; zenoh.Config"]).stderr(Stdio::null()).status();
    if asked.is_ok_and(|status| status.success()) {
        return Some(python);
    }
    eprintln!("skipped: {python} has no package `zenoh` (pip install eclipse-zenoh)");
    None
}

/// The foreign peer; it ends with the test.
struct Peer(Child, BufReader<ChildStdout>);

impl Peer {
    fn start(python: &str, endpoint: &str, action: &str, key: &str, tls: &[&str]) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python_peer.py");
        let mut child = Command::new(python)
            .args([script, endpoint, action, key])
            .args(tls)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        Self(child, out)
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.1.read_line(&mut line).unwrap();
        line.trim().to_owned()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Samples go out from the host that listens, and others come back to it.
struct Traffic {
    listens: Arc<Host>,
    _connects: Arc<Host>,
    out: (Box<dyn Sender>, Box<dyn Receiver>),
    back: (Box<dyn Sender>, Box<dyn Receiver>),
    next: u64,
}

impl Traffic {
    fn between(listens: Arc<Host>, connects: Arc<Host>) -> Self {
        let ends = |from: &Arc<Host>, to: &Arc<Host>, edge: &str| {
            let receiver = Remote::new(to, edge).open_receiver(&channel(64)).unwrap();
            (Remote::new(from, edge).open_sender(&channel(64)).unwrap(), receiver)
        };
        let (out, back) = (ends(&listens, &connects, "out"), ends(&connects, &listens, "back"));
        let mut traffic = Self { listens, _connects: connects, out, back, next: 0 };
        eventually("both edges are open", || {
            traffic.exchange();
            [traffic.out.0.state(), traffic.back.0.state()].iter().all(|state| *state == LinkState::Open)
        });
        traffic
    }

    fn exchange(&mut self) {
        send(&mut *self.out.0, &mut self.next);
        send(&mut *self.back.0, &mut self.next);
        let mut bytes = Vec::new();
        while self.out.1.receive(&mut bytes).unwrap().is_some() {}
        while self.back.1.receive(&mut bytes).unwrap().is_some() {}
    }

    /// The first sample that a peer takes: its line.
    fn until_taken(&mut self, mut peer: Peer) -> String {
        assert_eq!(peer.line(), "ready");
        let reader = std::thread::spawn(move || peer.line());
        eventually("the foreign peer has a sample", || {
            self.exchange();
            reader.is_finished()
        });
        reader.join().unwrap()
    }

    fn strange(&self) -> u64 {
        self.listens.taken()["back"].strange
    }
}

#[test]
fn a_foreign_peer_takes_samples_by_the_documented_bytes_and_what_it_puts_is_counted_and_not_taken() {
    let Some(python) = python() else { return };
    let port = two_ports();
    let listens = host("bedside", listening(port), identity());
    let mut traffic = Traffic::between(listens, host("cluster", connecting(port), identity()));
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let line =
        traffic.until_taken(Peer::start(&python, &endpoint, "take", "stillpoint-test/test/out/**", &[]));
    let taken: serde_json::Value = serde_json::from_str(&line).unwrap();
    let sequence = taken[1].as_u64().unwrap();
    // Count, bytes of the body, and its first byte, which is the number of the sample.
    assert_eq!(
        (&taken[2], &taken[3], &taken[4]),
        (&64.into(), &64.into(), &serde_json::json!(sequence as u8)),
        "{line}"
    );
    let key = taken[0].as_str().unwrap();
    assert!(key.starts_with("stillpoint-test/test/out/"), "{key}");

    let before = traffic.strange();
    let mut forger = Peer::start(&python, &endpoint, "put", &key.replace("/out/", "/back/"), &[]);
    assert_eq!(forger.line(), "put");
    eventually("what is forged is counted", || traffic.strange() > before);
    let accepted = traffic.listens.taken()["back"];
    assert_eq!(accepted.refused + accepted.lost, 0, "{accepted:?}");
}

#[test]
fn a_foreign_peer_is_refused_without_a_certificate_and_one_of_a_viewer_may_take_and_not_put() {
    let Some(python) = python() else { return };
    let pki = Pki::new();
    let port = two_ports();
    let open = |name: &str, role, endpoints: Endpoints| {
        let endpoints = Endpoints { tls: pki.tls(role, name), ..endpoints };
        Host::open(settings(name, endpoints, identity(), 1, 0)).unwrap()
    };
    let endpoint = format!("tls/127.0.0.1:{port}");
    let listen = Endpoints { listen: vec![endpoint.clone()], ..Endpoints::default() };
    let connect = Endpoints { connect: vec![endpoint.clone()], ..Endpoints::default() };
    let listens = open("bedside", Role::Bedside, listen);
    let mut traffic = Traffic::between(listens, open("cluster", Role::Cluster, connect));
    let key = "stillpoint-test/test/out/**";

    let viewer = pki.issue(Role::Viewer, "viewer");
    let [certificate, private, authority] =
        [&viewer.certificate, &viewer.key, &viewer.authority].map(|file| file.to_str().unwrap());
    let mut bare = Peer::start(&python, &endpoint, "take", key, &["", "", authority]);
    let message = bare.line();
    assert!(message.starts_with("refused"), "{message}");

    let files = [certificate, private, authority];
    let line = traffic.until_taken(Peer::start(&python, &endpoint, "take", key, &files));
    let taken: serde_json::Value = serde_json::from_str(&line).unwrap();
    let key = taken[0].as_str().unwrap().replace("/out/", "/back/");
    let before = traffic.strange();
    let mut forger = Peer::start(&python, &endpoint, "put", &key, &files);
    assert_eq!(forger.line(), "put");
    // The end of its output comes after its session was closed, so what it put has been sent.
    assert_eq!(forger.line(), "");
    let received = traffic.listens.taken()["back"].received;
    eventually("samples pass on", || {
        traffic.exchange();
        traffic.listens.taken()["back"].received > received + 5
    });
    assert_eq!(traffic.strange(), before);
}
