//! A plan over the pool: real workers, real processes, loopback.

use std::path::Path;
use std::process::{Child, Command, Stdio};

use stillpoint_plan::dose::DoseCache;
use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Build, ClientSettings, Pool, PoolDoses};
use stillpoint_remote::{Authority, Role};

use crate::bench::two_ports;
use crate::water::{Water, alone, angles, pooled};

/// A process that ends with the test.
pub struct Ends(pub Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub fn program(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_stillpoint-bridge"));
    command.args(arguments);
    command
}

fn worker(folder: &Path, name: &str, place: [&str; 2], role: Role, more: &[&str]) -> Ends {
    let cache = folder.join(name);
    let cache = cache.to_str().unwrap();
    let mut command =
        program(&["worker", place[0], place[1], "--name", name, "--slots", "1", "--cache", cache]);
    Ends(command.args(certificate(folder, role, name)).args(more).stdout(Stdio::null()).spawn().unwrap())
}

/// The arguments for a new certificate.
fn certificate(folder: &Path, role: Role, name: &str) -> Vec<String> {
    let authority = Authority::open(&folder.join("pki")).unwrap();
    let made = authority.issue(role, name, &["127.0.0.1".to_owned()], 2, false).unwrap();
    let file = |option: &str, file: &Path| [option.to_owned(), file.to_str().unwrap().to_owned()];
    let [certificate, key, authority] = [made.certificate, made.key, made.authority];
    [file("--certificate", &certificate), file("--key", &key), file("--authority", &authority)].concat()
}

#[test]
fn a_plan_with_one_worker_killed_and_one_that_lies_is_that_of_one_process() {
    let water = Water::new();
    let expected = alone(&water);
    let folder = tempfile::tempdir().unwrap();
    Authority::create(&folder.path().join("pki"), 2).unwrap();
    let endpoint = format!("tls/127.0.0.1:{}", two_ports());
    let _good = worker(folder.path(), "good", ["--listen", &endpoint], Role::Router, &[]);
    let killed = worker(folder.path(), "killed", ["--connect", &endpoint], Role::Worker, &[]);
    let bedside = certificate(folder.path(), Role::Bedside, "bedside");
    let client = || {
        let mut command = program(&["plan-client", "--connect", &endpoint]);
        command.args(&bedside);
        ChildCourier::start(command).unwrap()
    };
    let courier = client();
    let settings = ClientSettings { checked: 0.5, ..ClientSettings::new(Build::here().unwrap()) };
    let mut pool = Pool::new(courier, settings);

    // Both compute doses.
    let spare = DoseCache::in_folder(&folder.path().join("spare")).unwrap();
    let engines = [water.engine.clone()];
    let mut both_answered = false;
    for round in 0..600 {
        let angles: Vec<f64> = angles().iter().map(|deg| deg + 0.01 * f64::from(round)).take(6).collect();
        PoolDoses::default().fill(&mut pool, &spare, &engines, &angles, || ()).unwrap();
        both_answered = pool.workers().values().filter(|worker| worker.answered > 0).count() == 2;
        if both_answered {
            break;
        }
    }
    assert!(both_answered, "{:?}", pool.take_news());
    drop(killed);
    let _liar = worker(folder.path(), "liar", ["--connect", &endpoint], Role::Worker, &["--wrong-from", "1"]);

    // Plans are made until the liar has taken part: the bytes are the same each time.
    let mut caught = false;
    for _ in 0..50 {
        assert!(pooled(&water, &mut pool) == expected);
        caught = pool.workers().get("worker-liar").is_some_and(|worker| worker.shut_out.is_some());
        if caught {
            break;
        }
        // A new pool of calls: answers that are known are not asked again.
        let courier = client();
        pool = Pool::new(
            courier,
            ClientSettings { checked: 0.5, ..ClientSettings::new(Build::here().unwrap()) },
        );
    }
    assert!(caught);
    assert!(
        pool.workers()
            .get("worker-good")
            .is_some_and(|worker| worker.shut_out.is_none() && worker.answered > 0)
    );
    let mut list = program(&["pool", &endpoint]);
    let listed = list.args(certificate(folder.path(), Role::Viewer, "viewer")).output().unwrap();
    let text = String::from_utf8_lossy(&listed.stdout);
    assert!(
        text.contains("worker-good: ") && text.contains("worker-liar: ") && text.contains("build: as here"),
        "{listed:?}"
    );
}

#[test]
fn a_program_whose_certificate_has_another_role_says_so_and_ends() {
    let folder = tempfile::tempdir().unwrap();
    Authority::create(&folder.path().join("pki"), 2).unwrap();
    let viewer = certificate(folder.path(), Role::Viewer, "viewer");
    for arguments in
        [vec!["worker", "--connect", "tls/127.0.0.1:1"], vec!["router", "--listen", "tls/127.0.0.1:1"]]
    {
        let done = program(&arguments).args(&viewer).output().unwrap();
        let text = String::from_utf8_lossy(&done.stderr);
        assert!(!done.status.success() && text.contains("has the role `viewer`, which may not"), "{text}");
    }
}
