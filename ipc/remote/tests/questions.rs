//! How long a question of the planning pool and its answer take on the way: two processes on loopback, one of which is
//! the router, too, as a listening worker is.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use stillpoint_remote::{Mailbox, Router};

use crate::common::{retry, two_ports};

const PORT: &str = "STILLPOINT_TEST_QUESTION_PORT";
const PREFIX: &str = "stillpoint-test";
/// Bytes of a call.
const CALL: usize = 300;
/// Parts of an answer of 1 MiB, and how many of them are asked for at a time.
const PARTS: (usize, usize, usize) = (8, 128 << 10, 4);
const ROUNDS: usize = 300;

fn open(name: &str, port: &str) -> Mailbox {
    retry(|| Mailbox::open(PREFIX, name, &format!("tcp/127.0.0.1:{port}"), None).ok())
}

/// The other process: it answers each message with as many bytes as that asks for.
#[test]
#[ignore = "started by another test as a process of its own"]
fn answering_process() {
    let Ok(port) = std::env::var(PORT) else { return };
    let _router = Router::open(PREFIX, vec![format!("tcp/127.0.0.1:{port}")], None).unwrap();
    let mailbox = open("worker", &port);
    loop {
        if let Some((from, bytes)) = mailbox.receive(Duration::from_secs(1)) {
            let requested = u32::from_le_bytes(bytes[..4].try_into().unwrap());
            mailbox.send(Some(&from), vec![1; requested as usize]);
        }
    }
}

fn ask(mailbox: &Mailbox, requested: usize) {
    let mut bytes = vec![0; CALL];
    bytes[..4].copy_from_slice(&(requested as u32).to_le_bytes());
    mailbox.send(Some("worker"), bytes);
}

/// Whether an answer came; one that is lost is asked for again, and the round does not count.
fn answered(mailbox: &Mailbox) -> bool {
    mailbox.receive(Duration::from_secs(2)).is_some()
}

/// A long answer: that it is there, its first part, and the rest, as the pool fetches it.
fn fetched(mailbox: &Mailbox) -> bool {
    let (parts, bytes, outstanding) = PARTS;
    ask(mailbox, 64);
    if !answered(mailbox) {
        return false;
    }
    ask(mailbox, bytes);
    if !answered(mailbox) {
        return false;
    }
    (1..parts).take(outstanding).for_each(|_| ask(mailbox, bytes));
    (1..parts).all(|part| {
        let came = answered(mailbox);
        if part + outstanding < parts {
            ask(mailbox, bytes);
        }
        came
    })
}

fn reported(what: &str, round: impl Fn() -> bool) {
    let mut times: Vec<Duration> = (0..ROUNDS)
        .filter_map(|_| {
            let begun = Instant::now();
            round().then(|| begun.elapsed())
        })
        .collect();
    times.sort();
    let at = |share: usize| times[times.len() * share / 100].as_secs_f64() * 1e3;
    eprintln!(
        "{what}: least {:.2} ms, p50 {:.2} ms, p90 {:.2} ms, {} rounds",
        at(0),
        at(50),
        at(90),
        times.len()
    );
}

#[test]
#[ignore = "a measurement of some seconds: .ci/soak runs it"]
fn the_way_of_a_question_of_the_pool() {
    let port = two_ports().to_string();
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "questions::answering_process"])
        .env(PORT, &port)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mailbox = open("plan", &port);
    retry(|| {
        ask(&mailbox, 64);
        mailbox.receive(Duration::from_millis(50))
    });
    while mailbox.receive(Duration::from_millis(200)).is_some() {}
    reported("an answer of 4 KiB", || {
        ask(&mailbox, 4 << 10);
        answered(&mailbox)
    });
    reported("an answer of 1 MiB, in parts", || fetched(&mailbox));
    let _ = child.kill();
    let _ = child.wait();
}
