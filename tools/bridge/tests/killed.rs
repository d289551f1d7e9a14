//! One plan, during which a worker is killed again and again while another one gives wrong answers.

use std::collections::BTreeSet;
use std::process::Stdio;

use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Arrival, Build, ClientSettings, Courier, CourierError, Message, Pool, To};

use crate::bench::two_ports;
use crate::pool::{Ends, program};
use crate::water::{Water, alone, pooled};

const KILLED: &str = "worker-killed";
const KILLS: usize = 20;

/// Carries messages, kills a worker again and again, and lets those of the others through when it has been killed often
/// enough.
struct Killing<F> {
    courier: ChildCourier,
    start: F,
    worker: Option<Ends>,
    left: usize,
    greeted: BTreeSet<String>,
}

impl<F: Fn() -> Ends> Killing<F> {
    /// Waits until so many workers have greeted.
    fn wait_for(&mut self, workers: usize) {
        while self.greeted.len() < workers {
            self.receive(self.now() + 1_000_000_000).unwrap();
        }
    }
}

impl<F: Fn() -> Ends> Courier for Killing<F> {
    fn now(&self) -> u64 {
        self.courier.now()
    }

    fn send(&mut self, to: &To, bytes: Vec<u8>) {
        self.courier.send(to, bytes);
    }

    fn receive(&mut self, until: u64) -> Result<Option<Arrival>, CourierError> {
        let arrival = self.courier.receive(until)?;
        let Some(Arrival { from, bytes }) = &arrival else { return Ok(None) };
        self.greeted.insert(from.clone());
        if self.left == 0 {
            return Ok(arrival);
        }
        // With a call in its hands, and with an answer given, by turns.
        let is_time = match Message::from_bytes(bytes).unwrap() {
            Message::Working { .. } => !self.left.is_multiple_of(2),
            Message::Answer { .. } | Message::Done { .. } => self.left.is_multiple_of(2),
            _ => false,
        };
        if from == KILLED && is_time {
            self.left -= 1;
            self.worker = None;
            self.worker = Some((self.start)());
        }
        // Whoever waits for the next message looks again.
        Ok(arrival.filter(|arrival| arrival.from == KILLED))
    }
}

#[test]
fn a_plan_is_the_same_with_a_worker_that_is_killed_twenty_times_and_one_of_three_that_lies() {
    let water = Water::new();
    let expected = alone(&water);
    let folder = tempfile::tempdir().unwrap();
    let endpoint = format!("tcp/127.0.0.1:{}", two_ports());
    let worker = |name: &str, more: &[&str]| {
        let cache = folder.path().join(name);
        let mut command = program(&["worker", "--name", name, "--slots", "1", "--cache"]);
        Ends(command.arg(cache).args(more).stdout(Stdio::null()).spawn().unwrap())
    };
    let _good = worker("good", &["--listen", &endpoint]);
    let _liar = worker("liar", &["--connect", &endpoint, "--wrong-from", "1"]);
    let start = || worker("killed", &["--connect", &endpoint]);
    let courier = ChildCourier::start(program(&["plan-client", "--connect", &endpoint])).unwrap();
    let worker = Some(start());
    let mut killing = Killing { courier, start, worker, left: KILLS, greeted: BTreeSet::new() };
    killing.wait_for(3);
    let mut pool = Pool::new(killing, ClientSettings::new(Build::here().unwrap()));
    assert!(pooled(&water, &mut pool) == expected);
    assert_eq!(pool.courier().left, 0, "the worker was killed {KILLS} times");
    let tally = pool.tally();
    assert!(tally.remote > tally.local, "{tally:?}");
    let out = |name: &str| pool.workers()[name].shut_out.is_some();
    assert!(out("worker-liar") && !out("worker-good") && !out(KILLED), "{:?}", pool.workers());
}
