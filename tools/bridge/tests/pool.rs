//! A plan over the pool: real workers, real processes, loopback.

use std::path::Path;
use std::process::{Child, Command, Stdio};

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
    // As a scheduler gives it, in the environment; the client below has it in arguments.
    let files = certificate(folder, role, name);
    for (at, variable) in ["CERTIFICATE", "KEY", "AUTHORITY"].iter().enumerate() {
        command.env(format!("STILLPOINT_{variable}"), &files[2 * at + 1]);
    }
    Ends(command.args(more).stdout(Stdio::null()).spawn().unwrap())
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
    let mut spare = PoolDoses::in_folder(&folder.path().join("spare")).unwrap();
    let engines = [water.engine.clone()];
    let mut both_answered = false;
    for round in 0..600 {
        let angles: Vec<f64> = angles().iter().map(|deg| deg + 0.01 * f64::from(round)).take(6).collect();
        spare.fill(&mut pool, &engines, &angles, || ()).unwrap();
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
fn the_pool_says_how_many_workers_are_wanted_and_one_that_is_asked_to_end_does_so_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let endpoint = format!("tcp/127.0.0.1:{}", two_ports());
    let _router = Ends(program(&["router", "--listen", &endpoint]).stdout(Stdio::null()).spawn().unwrap());
    let spare = folder.path().join("spare");
    let to = endpoint.clone();
    // Nobody computes yet.
    let asking = std::thread::spawn(move || {
        let courier = ChildCourier::start(program(&["plan-client", "--connect", &to])).unwrap();
        let settings = ClientSettings { tells_demand: true, ..ClientSettings::new(Build::here().unwrap()) };
        let mut pool = Pool::new(courier, settings);
        let mut spare = PoolDoses::in_folder(&spare).unwrap();
        let engines = [Water::new().engine];
        spare.fill(&mut pool, &engines, &angles()[..6], || ()).unwrap();
        pool.tally()
    });
    let wanted = |slots: &str| {
        let list = ["pool", &endpoint, "--wanted", "--json", "--slots", slots, "--seconds", "1"];
        let listed = program(&list).output().unwrap();
        assert!(listed.status.success(), "{listed:?}");
        serde_json::from_slice::<serde_json::Value>(&listed.stdout).unwrap()
    };
    let first = (0..60).map(|_| wanted("4")).find(|found| found["clients"] == 1).unwrap();
    assert_eq!((&first["calls"], &first["wanted"], &first["workers"]), (&6.into(), &2.into(), &0.into()));

    let cache = folder.path().join("cache");
    let mut command = program(&["worker", "--slots", "1"]);
    command.env("STILLPOINT_POOL", &endpoint).env("STILLPOINT_POOL_CACHE", &cache);
    let mut worker = Ends(command.stdout(Stdio::piped()).spawn().unwrap());
    let tally = asking.join().unwrap();
    // The worker answered all of them. For want of a second one this process compared its first answers, which are one or
    // two: no proof is there while the first is compared.
    assert!(tally.remote + tally.compared >= 6 && tally.local <= tally.compared, "{tally:?}");
    assert!(cache.is_dir());
    let is_sent = Command::new("kill").args(["-TERM", &worker.0.id().to_string()]).status().unwrap();
    assert!(is_sent.success());
    let mut said = String::new();
    std::io::Read::read_to_string(worker.0.stdout.as_mut().unwrap(), &mut said).unwrap();
    assert!(worker.0.wait().unwrap().success() && said.contains("ending: "), "{said}");
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
