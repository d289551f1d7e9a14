//! The process that records: it polls, off the data path, and a second thread writes.
//!
//! - `writing`: the thread that writes
//! - `flushed`: the numbers of the samples in the file, for a recorder that is started again

mod flushed;
mod writing;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crossbeam_channel::{Sender, unbounded};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use stillpoint_recorder::{
    Closing, Encoded, PartWriter, Session, TopicId, TopicInfo, WriteError, create_part, session_parts,
};
use stillpoint_shm::{Domain, ShmError, Subscriber, Topic};

use self::flushed::Flushed;
use self::writing::{Item, Spare, Written, write};
use super::contracts;
use super::control::{Connect, FromWorker, HelloRecorder, RecorderReport, ToRecorder};
use super::error::RecorderError;
use super::missed::missed;
use super::pipe::{PipeError, PipeRead, orders, send_message, take_control, wait_for};
use super::run_folder::hold;
use super::worker::{graph_of, ignore_interrupts};
use crate::clock::{cpu_time, realtime};
use crate::graph::Graph;
use crate::limits::start_thread;
use crate::operator::Registry;
use crate::session::{opening, timing_infos, topic_infos};
use crate::session_recorder::{SessionError, end_facts};

/// How often shared memory is looked at, ns. Below the period of the fastest images: who sends finds the memory of the last
/// sample free again, and warm.
const PERIOD: i64 = 5_000_000;
/// How long the recorder of a run whose supervisor died waits for the last process.
const AFTER_THE_LAST: std::time::Duration = std::time::Duration::from_millis(100);
/// Bytes that may wait for the disk.
const MOST_WAITING: usize = 256 << 20;
/// The body of the recorder's process.
pub fn recorder_main(registry: &Registry) -> ExitCode {
    if take_control().is_err() {
        return ExitCode::from(70);
    }
    ignore_interrupts();
    match serve(registry) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let (operator, reason) = ("recorder".to_string(), error.to_string());
            let _ = send_message(&FromWorker::Fault { operator, incarnation: 0, reason, fatal: true });
            ExitCode::from(70)
        }
    }
}

fn serve(registry: &Registry) -> Result<(), RecorderError> {
    let mut orders = orders()?;
    let Some(hello) = wait_for::<HelloRecorder>(&mut orders)? else { return Ok(()) };
    let graph = graph_of(&hello.hello, registry)?;
    let _held = hold(&hello.hello.root)?;
    let domain = Domain::join(&hello.hello.root, &hello.hello.prefix, "recorder")?;
    let mut recorder = Recorder::open(&graph, &domain, &hello)?;
    send_message(&FromWorker::Made)?;
    let mut reported = true;
    loop {
        while reported {
            match orders.next::<ToRecorder>()? {
                PipeRead::Nothing => reported = false,
                PipeRead::Message(ToRecorder::Connect(Connect { number })) => {
                    recorder.connect()?;
                    send_message(&FromWorker::Connected { number })?;
                }
                PipeRead::Message(ToRecorder::Finish { ledger, gaps, recorder_deaths, ended_early }) => {
                    let mut facts = end_facts(ended_early.as_deref());
                    facts.insert("recorder_deaths".to_string(), recorder_deaths.to_string());
                    let report = recorder.finish(Some(ledger), gaps, facts)?;
                    return Ok(send_message(&FromWorker::Recorded(report))?);
                }
                PipeRead::Ended => {
                    recorder.outlive(graph.outlives())?;
                    let reason = "the supervisor died";
                    recorder.finish(None, vec![reason.to_string()], end_facts(Some(reason)))?;
                    return Ok(());
                }
            }
        }
        recorder.drain()?;
        let mut fd = [PollFd::from_borrowed_fd(orders.fd(), PollFlags::IN)];
        match poll(&mut fd, Some(&Timespec { tv_sec: 0, tv_nsec: PERIOD })) {
            Ok(ready) => reported = ready > 0,
            Err(rustix::io::Errno::INTR) => {}
            Err(e) => return Err(PipeError::Read(e).into()),
        }
    }
}

struct Tap {
    subscriber: Subscriber,
    /// Samples that its buffer holds: no look takes more, or a topic that never pauses would keep all others waiting.
    buffer: usize,
    info: TopicInfo,
    topic: TopicId,
    /// Buffers that were written, back from the writer.
    spare: Spare,
    /// By incarnation: the number expected next.
    next: BTreeMap<u32, u64>,
    /// The number expected first of an incarnation that is not in `next`; `None`: that of its first sample.
    first: Option<u64>,
    _topic: Topic,
}

struct Recorder {
    taps: Vec<Tap>,
    /// What one look brought goes to the writer at once, which is woken once.
    items: Option<Sender<Vec<Item>>>,
    waiting: Arc<AtomicUsize>,
    writer: Option<std::thread::JoinHandle<Result<Written, WriteError>>>,
    lost: BTreeMap<String, u64>,
    part: PathBuf,
    first_part: bool,
    /// What this process had used when its topics and its part were open, ns.
    cpu_before: u64,
}

impl Recorder {
    fn open(graph: &Graph, domain: &Domain, hello: &HelloRecorder) -> Result<Self, RecorderError> {
        let clock = hello.hello.clock;
        let (path, file) =
            create_part(&hello.session).map_err(|e| SessionError::refused(&hello.session, e))?;
        let start = opening(graph, &hello.hello.source, clock, hello.hello.directed, &hello.identity)?;
        let mut part =
            PartWriter::new(file, hello.compression, &start).map_err(|e| SessionError::no_room(&path, e))?;
        let first_part = session_parts(&hello.session).is_ok_and(|parts| parts.len() == 1);
        let before = if first_part { None } else { Flushed::load(&hello.hello.root) };
        let mut flushed = Flushed::new(&hello.hello.root, before.as_ref());
        let mut taps = Vec::new();
        let retained = topic_infos(graph).into_iter().map(|(info, source)| match source {
            (operator, None) => (info, contracts::journal(graph, operator)),
            (operator, Some(port)) => (info, contracts::output(graph, operator, port)),
        });
        let measured = timing_infos(graph)
            .into_iter()
            .filter_map(|(info, operator)| Some((info, contracts::timing(graph, operator)?)));
        for (info, contract) in retained.chain(measured) {
            let topic = Topic::open(domain, &contract)?;
            let (subscriber, buffer) = topic.subscriber_with_history()?;
            let id = part.add_topic(info.clone())?;
            let mut next = BTreeMap::new();
            let mut first = first_part.then_some(0);
            if topic.contract().history > 0 {
                flushed.add(id, &info.name);
                if let Some(before) = &before {
                    (next, first) = (before.of(&info.name), Some(0));
                }
            }
            let spare = Spare::default();
            taps.push(Tap { subscriber, buffer, info, topic: id, spare, next, first, _topic: topic });
        }
        part.flush().map_err(|e| SessionError::no_room(&path, e))?;
        let (items, inbox) = unbounded();
        let waiting = Arc::new(AtomicUsize::new(0));
        let counter = waiting.clone();
        let writer = start_thread(move || write(part, &inbox, &counter, clock, flushed))?;
        Ok(Self {
            taps,
            items: Some(items),
            waiting,
            writer: Some(writer),
            lost: BTreeMap::new(),
            part: path,
            first_part,
            cpu_before: cpu_time(),
        })
    }

    fn connect(&self) -> Result<(), ShmError> {
        for tap in &self.taps {
            tap.subscriber.connect()?;
        }
        Ok(())
    }

    /// Takes what waits, and says whether there was anything.
    fn drain(&mut self) -> Result<bool, RecorderError> {
        if self.writer.as_ref().is_some_and(std::thread::JoinHandle::is_finished) {
            // The writer ends by itself only when the disk refuses.
            return Err(match self.writer.take().map(std::thread::JoinHandle::join) {
                Some(Ok(Err(reason))) => SessionError::no_room(&self.part, reason).into(),
                _ => RecorderError::WriterEnded,
            });
        }
        let mut taken = Vec::new();
        let looked = self.look(&mut taken);
        let any = !taken.is_empty();
        if let (true, Some(items)) = (any, &self.items) {
            let _ = items.send(taken);
        }
        looked.map(|()| any)
    }

    /// Looks at each topic once.
    fn look(&mut self, taken: &mut Vec<Item>) -> Result<(), RecorderError> {
        for tap in &mut self.taps {
            for _ in 0..tap.buffer {
                let Some(sample) = tap.subscriber.receive()? else { break };
                let header = sample.header();
                // Where nothing is kept for a later part, it cannot know where an incarnation that goes on stood; the
                // journals show what is missing.
                let next = tap.next.entry(header.incarnation).or_insert(tap.first.unwrap_or(header.sequence));
                if header.sequence < *next {
                    // An earlier part has it: the publisher kept it, too.
                    continue;
                }
                let mut lose = |first: u64, count: u64| {
                    *self.lost.entry(tap.info.name.clone()).or_insert(0) += count;
                    taken.push(Item::Lost {
                        topic: tap.topic,
                        incarnation: header.incarnation,
                        first,
                        count,
                    });
                };
                if header.sequence > *next {
                    lose(*next, header.sequence - *next);
                }
                *next = header.sequence + 1;
                let size = tap.info.kind.total_size(header.count).unwrap_or(0);
                if self.waiting.load(Ordering::Relaxed) + size > MOST_WAITING {
                    lose(header.sequence, 1);
                    continue;
                }
                self.waiting.fetch_add(size, Ordering::Relaxed);
                // The one copy out of shared memory is the message as it will be written.
                let buffer = tap.spare.take();
                let sample = Encoded::new(&tap.info, sample.pieces(), buffer).map_err(|e| {
                    RecorderError::Sample { topic: tap.info.name.clone(), reason: e.to_string() }
                })?;
                let (log_time, spare) = (realtime(), tap.spare.clone());
                taken.push(Item::Sample { topic: tap.topic, sample, size, log_time, spare });
            }
        }
        Ok(())
    }

    /// Goes on for as long as some process of the run does, its supervisor being dead.
    fn outlive(&mut self, time: u64) -> Result<(), RecorderError> {
        if time == 0 {
            return Ok(());
        }
        // A little longer than they: their last words are to be heard.
        let end = std::time::Instant::now() + std::time::Duration::from_nanos(time) + AFTER_THE_LAST;
        while std::time::Instant::now() < end {
            self.drain()?;
            std::thread::sleep(std::time::Duration::from_nanos(PERIOD.unsigned_abs()));
        }
        Ok(())
    }

    /// Lists what was sent while no recorder was there. Only at the end is it all known, and nobody waits.
    fn list_missed(&mut self, part: &mut PartWriter<std::fs::File>) -> Result<(), RecorderError> {
        let say = |e: &dyn std::fmt::Display| RecorderError::Missed(e.to_string());
        part.flush().map_err(|e| say(&e))?;
        let folder = self.part.parent().unwrap_or(&self.part);
        for lost in missed(&Session::open(folder).map_err(|e| say(&e))?) {
            let Some(tap) = self.taps.iter().find(|t| t.info.name == lost.topic) else { continue };
            part.note_lost(tap.topic, lost.incarnation, lost.first, lost.count, realtime())
                .map_err(|e| say(&e))?;
            *self.lost.entry(lost.topic).or_insert(0) += lost.count;
        }
        Ok(())
    }

    fn finish(
        &mut self,
        ledger: Option<String>,
        gaps: Vec<String>,
        facts: BTreeMap<String, String>,
    ) -> Result<RecorderReport, RecorderError> {
        while self.drain()? {}
        self.items = None;
        let mut written = match self.writer.take().map(std::thread::JoinHandle::join) {
            Some(Ok(written)) => written.map_err(|e| SessionError::no_room(&self.part, e))?,
            _ => return Err(RecorderError::WriterPanicked),
        };
        let mut gaps = gaps;
        if !self.first_part {
            gaps.extend(self.list_missed(&mut written.part).err().map(|e| e.to_string()));
        }
        let closing =
            Closing { ledger: ledger.map(String::into_bytes), gaps, facts, realtime_ns: realtime() };
        let file = written.part.finish(&closing).map_err(|e| SessionError::no_room(&self.part, e))?;
        file.sync_all().map_err(|e| SessionError::refused(&self.part, e))?;
        Ok(RecorderReport {
            samples: written.samples,
            bytes: written.bytes,
            cpu_ns: cpu_time().saturating_sub(self.cpu_before),
            lost: std::mem::take(&mut self.lost),
            part: self.part.clone(),
        })
    }
}
