//! Answers of calls and the CPU time that they take: each call is computed once, by a worker of the library.

use std::collections::BTreeMap;

use rustix::time::{ClockId, clock_gettime};
use stillpoint_pool::{Build, Call, Hash, Kind, Message, PART, Store, Worker, WorkerSettings};

pub fn build() -> Build {
    Build::of("the build of this bench")
}

/// CPU time of this thread, ns.
pub fn cpu() -> u64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

pub struct Oracle {
    worker: Worker,
    _folder: tempfile::TempDir,
    answers: BTreeMap<Hash, (Kind, Vec<u8>, u64)>,
    /// Contents that calls need.
    contents: BTreeMap<Hash, Vec<u8>>,
    /// CPU time of checking, keeping and opening contents, ns, and their bytes.
    intake: (u64, u64),
}

impl Oracle {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), 1 << 40).unwrap();
        let settings = WorkerSettings { build: build(), incarnation: 1, slots: 1, most_open: 1 << 40 };
        let worker = Worker::new(settings, store);
        Self { worker, _folder: folder, answers: BTreeMap::new(), contents: BTreeMap::new(), intake: (0, 0) }
    }

    /// Whether a content was given to it.
    pub fn holds(&self, content: &Hash) -> bool {
        self.contents.contains_key(content)
    }

    /// A content that was given to it.
    pub fn content(&self, content: &Hash) -> Option<&[u8]> {
        self.contents.get(content).map(Vec::as_slice)
    }

    pub fn give(&mut self, content: Hash, bytes: Vec<u8>) {
        self.contents.insert(content, bytes);
    }

    /// CPU time of checking, keeping and opening so many bytes, ns.
    pub fn intake(&self, bytes: u64) -> u64 {
        self.intake.0.checked_mul(bytes).map_or(0, |product| product / self.intake.1.max(1))
    }

    /// The answer of a call and its time, ns. All its contents were given.
    pub fn answer(&mut self, key: Hash, call: &[u8]) -> (&[u8], u64) {
        if !self.answers.contains_key(&key) {
            self.compute(key, call);
        }
        let (_, bytes, time) = &self.answers[&key];
        (bytes, *time)
    }

    fn compute(&mut self, key: Hash, call: &[u8]) {
        let begun = cpu();
        self.worker.handle(0, "bench", &Message::Ask { key, call: call.to_vec() }.to_bytes());
        let job = loop {
            if let Some(job) = self.worker.next_job() {
                break job;
            }
            for (_, message) in self.worker.take_messages() {
                match message {
                    Message::Want { content, part, .. } => {
                        let bytes = &self.contents[&content];
                        let start = part as usize * PART;
                        let end = bytes.len().min(start + PART);
                        let (length, bytes) = (bytes.len() as u64, bytes[start..end].to_vec());
                        self.intake.1 += bytes.len() as u64;
                        let message = Message::Part { content, part, length, bytes };
                        self.worker.handle(0, "bench", &message.to_bytes());
                    }
                    Message::Failed { reason, .. } => panic!("{reason}"),
                    _ => {}
                }
            }
        };
        self.intake.0 += cpu() - begun;
        let begun = cpu();
        let bytes = job.ready.compute().unwrap();
        let time = cpu() - begun;
        self.worker.finish(key, Ok(bytes.clone()));
        self.answers.insert(key, (Call::from_bytes(call).unwrap().kind(), bytes, time));
    }

    /// CPU time of all different calls, s.
    pub fn seconds(&self) -> f64 {
        self.answers.values().map(|(.., time)| *time as f64 * 1e-9).sum()
    }

    /// Tells the measured times.
    pub fn report(&self) {
        println!(
            "\n| call | number | CPU s, all | median | longest | answer, kB |\n| --- | --- | --- | --- | --- | --- |"
        );
        for kind in Kind::ALL {
            let of_kind = || self.answers.values().filter(|(of, ..)| *of == kind);
            let mut times: Vec<f64> = of_kind().map(|(.., time)| *time as f64 * 1e-9).collect();
            times.sort_by(f64::total_cmp);
            let Some(longest) = times.last() else { continue };
            let bytes: usize = of_kind().map(|(_, bytes, _)| bytes.len()).sum();
            println!(
                "| {} | {} | {:.1} | {:.4} | {longest:.4} | {:.1} |",
                kind.word(),
                times.len(),
                times.iter().sum::<f64>(),
                times[times.len() / 2],
                bytes as f64 * 1e-3 / times.len() as f64
            );
        }
        let bytes: usize = self.contents.values().map(Vec::len).sum();
        let rate = self.intake.1 as f64 / self.intake.0.max(1) as f64 * 1e3;
        println!(
            "\n{} contents, {:.0} MB; {rate:.0} MB/s are checked, kept and opened",
            self.contents.len(),
            bytes as f64 * 1e-6
        );
    }
}
