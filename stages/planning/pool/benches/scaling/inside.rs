//! One worker in the thread of the client, and the CPU time of that thread as the time.

use std::collections::VecDeque;

use rustix::time::{ClockId, clock_gettime};
use stillpoint_pool::{Arrival, Build, Courier, CourierError, Spent, Store, To, Worker, WorkerSettings};

/// The name of the worker.
const NAME: &str = "worker";

pub fn build() -> Build {
    Build::of("the build of this bench")
}

/// CPU time of this thread, ns.
fn cpu() -> u64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

pub struct Inside {
    worker: Worker,
    _folder: tempfile::TempDir,
    arrivals: VecDeque<Vec<u8>>,
    /// CPU time in which the worker took messages since its answer before, ns.
    received: u64,
    /// Time that passes while nobody works, ns.
    waited: u64,
}

impl Inside {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), 1 << 40).unwrap();
        let settings = WorkerSettings { build: build(), incarnation: 1, slots: 1, most_open: 1 << 40 };
        let worker = Worker::new(settings, store);
        Self { worker, _folder: folder, arrivals: VecDeque::new(), received: 0, waited: 0 }
    }

    fn collect(&mut self) {
        self.arrivals.extend(self.worker.take_messages().iter().map(|(_, message)| message.to_bytes()));
    }
}

impl Courier for Inside {
    fn now(&self) -> u64 {
        cpu() + self.waited
    }

    fn send(&mut self, to: &To, bytes: Vec<u8>) {
        if *to == To::one(NAME) {
            let (now, begun) = (self.now(), cpu());
            self.worker.handle(now, "bench", &bytes);
            self.received += cpu() - begun;
            self.collect();
        }
    }

    fn receive(&mut self, until: u64) -> Result<Option<Arrival>, CourierError> {
        self.worker.tick(self.now());
        self.collect();
        if self.arrivals.is_empty()
            && let Some(job) = self.worker.next_job()
        {
            let (key, begun) = (job.key, cpu());
            let ready = job.open().unwrap();
            let opened = cpu() - begun;
            let result = ready.compute();
            let computed = cpu() - begun - opened;
            let spent =
                Spent { received: std::mem::take(&mut self.received), opened, computed, ..Spent::default() };
            self.worker.finish(key, result, spent);
            self.worker.tick(self.now());
            self.collect();
        }
        let arrival = self.arrivals.pop_front().map(|bytes| Arrival { from: NAME.to_owned(), bytes });
        if arrival.is_none() {
            self.waited += until.saturating_sub(self.now());
        }
        Ok(arrival)
    }
}
