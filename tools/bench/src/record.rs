//! `stillpoint bench record`: the cost of recording, against the bare MCAP writer and for the recorded edges.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_pipeline::clock::cpu_time;
use stillpoint_recorder::{CHUNK_SIZE, Compression, Session};
use stillpoint_samples::{Cause, Entry, HEADER_SIZE};
use zerocopy::IntoBytes;

use super::cores::{self, Layout};
use super::figures::{Quantiles, median, ratio};
use super::folder::Folder;
use super::stages::{Word, payload};
use super::window::{Outcome, Window};
use stillpoint::{Ended, Exit, Failure, print_json};

/// Size of a payload, bytes.
const PAYLOAD: usize = 1_200_000;
/// Time from one payload to the next, us: 200 MB/s.
const PERIOD_US: u64 = 6000;

/// Measure the cost of recording 200 MB/s: the bytes per CPU-second against the bare MCAP writer with the same chunks
/// and compression, the median latency of a recorded edge against the same edge unrecorded, and the ticks that a 100 Hz
/// loop misses meanwhile.
///
/// The CPU time of the recorder is that of its whole process, from when its topics and its part are open to when the
/// file is on the disk: polling, copying out of shared memory, journals, writing. The bare writer writes the same
/// number of messages of the same bytes from ordinary memory, once at full speed, and once at the pace of the source,
/// so that its caches and file pages are as cold as those of the recorder. Chunks, checksums and disk are the same, and
/// windows are interleaved. In the JSON, rates are in bytes per CPU-second and times in us.
#[derive(Args)]
pub struct Record {
    /// Number of windows of each kind.
    #[arg(long, default_value_t = 10, value_parser = super::at_least::<usize>(1))]
    windows: usize,
    /// Length of a window, ms.
    #[arg(long, default_value_t = 2000, value_parser = super::at_least::<u64>(200))]
    length: u64,
    /// Folder for the sessions; they are removed when the measurement ends.
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// A short measurement: two windows of 600 ms.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct RecordFigures {
    compression: Compression,
    /// Bytes of samples per CPU-second of the recorder's process.
    recorder: f64,
    /// Bytes of messages per CPU-second of the bare writer.
    bare: f64,
    /// Bytes of messages per CPU-second of the bare writer at the pace of the source.
    paced: f64,
    /// Median over the windows of the recorder's rate relative to the bare writer's.
    ratio: f64,
    /// The same relative to the paced bare writer's.
    paced_ratio: f64,
    /// Number of samples that the recorder lost.
    lost: u64,
    /// Ages of the samples of the recorded edge, us.
    edge: Quantiles,
    /// Median over the windows of the median age on the recorded edge, relative to that on the same edge unrecorded.
    edge_ratio: f64,
    /// Number of ticks that the 100 Hz loop executed.
    ticks: u64,
    /// Number of ticks that the 100 Hz loop missed.
    missed: u64,
}

impl Record {
    /// Runs the windows with each compression and prints their figures.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let folder = Folder::create(self.folder.as_deref())?;
        let cores = cores::cores()?;
        let core = Layout::One.core(&cores, 0);
        // The edge and the loop run on one core, the recorder and the supervisor on the others.
        let rest: Vec<usize> = cores.iter().copied().filter(|c| *c != core).collect();
        cores::bind(if rest.is_empty() { &cores } else { &rest })?;
        let mut lines = Vec::new();
        for compression in [Compression::None, Compression::Lz4] {
            lines.push(self.measure(compression, core, &folder, registry)?);
        }
        if self.json {
            print_json(&lines)?;
        } else {
            out!("{}", table(&lines));
        }
        Ok(Exit::Done)
    }

    fn measure(
        &self,
        compression: Compression,
        core: usize,
        folder: &Folder,
        registry: &Registry,
    ) -> Result<RecordFigures, Failure> {
        let windows = if self.quick { 2 } else { self.windows };
        let length = Duration::from_millis(if self.quick { 600 } else { self.length });
        let pipeline = pipeline(core);
        let run = |session: Option<&Path>| -> Result<Outcome, Failure> {
            let session = session.map(|path| (path, compression));
            Window { pipeline: &pipeline, registry, length, session, taps: &["sink.ages"] }.run()
        };
        let (mut plain, mut taped) = (Vec::new(), Vec::new());
        let (mut ours, mut theirs, mut paced) = (Vec::new(), Vec::new(), Vec::new());
        let (mut lost, mut ticks, mut missed) = (0, 0, 0);
        for _ in 0..windows {
            plain.push(run(None)?.ages_of("sink.ages").whole);
            let path = folder.free("session")?;
            let mut outcome = run(Some(&path))?;
            taped.push(outcome.ages_of("sink.ages").whole);
            let (mut bytes, mut cpu) = (0, 0);
            for part in &outcome.report.recorded {
                bytes += part.bytes;
                cpu += part.cpu_ns;
                lost += part.lost.values().sum::<u64>();
            }
            ours.push(bytes as f64 / cpu as f64 * 1e9);
            let session = Session::open(&path).map_err(Failure::failed)?;
            let (seen, gone) = loop_ticks(&session);
            ticks += seen;
            missed += gone;
            theirs.push(bare(&folder.free("bare")?, compression, bytes, Duration::ZERO)?);
            let period = Duration::from_micros(PERIOD_US);
            paced.push(bare(&folder.free("bare")?, compression, bytes, period)?);
        }
        let to = |theirs: &[f64]| median(&ours.iter().zip(theirs).map(|(a, b)| a / b).collect::<Vec<_>>());
        Ok(RecordFigures {
            compression,
            recorder: median(&ours),
            bare: median(&theirs),
            paced: median(&paced),
            ratio: to(&theirs),
            paced_ratio: to(&paced),
            lost,
            edge: Quantiles::of(&taped.concat()),
            edge_ratio: ratio(&taped, &plain),
            ticks,
            missed,
        })
    }
}

fn pipeline(core: usize) -> String {
    format!(
        "stillpoint: 1
name: bench-record
operators:
  source: {{ use: bench.source, every: {PERIOD_US} us, params: {{ words: {} }} }}
  sink:   {{ use: bench.sink, inputs: {{ load: source.load }}, params: {{ batch: 16 }} }}
  loop:   {{ use: bench.source, every: 10 ms }}
processes:
  source: {{ operators: [source], core: {core} }}
  sink:   {{ operators: [sink], core: {core} }}
  loop:   {{ operators: [loop], core: {core} }}
record: {{ topics: [source.load] }}
",
        PAYLOAD / size_of::<Word>()
    )
}

/// Number of ticks in the journal of the loop, and number of ticks that are missing between them.
fn loop_ticks(session: &Session) -> (u64, u64) {
    let journal = session.journals().get("loop");
    let entries = journal.into_iter().flatten().filter(|e| e.cause() == Some(Cause::Timer));
    let ticks: Vec<u64> = entries.map(|e: &Entry| e.body.tick).collect();
    match (ticks.first(), ticks.last()) {
        (Some(first), Some(last)) => (ticks.len() as u64, last - first + 1 - ticks.len() as u64),
        _ => (0, 0),
    }
}

/// Writes this number of bytes with the bare writer, one message per `period`. Gives bytes per CPU-second.
fn bare(folder: &Path, compression: Compression, bytes: u64, period: Duration) -> Result<f64, Failure> {
    let compression = match compression {
        Compression::None => None,
        Compression::Lz4 => Some(mcap::Compression::Lz4),
        Compression::Zstd => Some(mcap::Compression::Zstd),
    };
    let mut message = vec![0u8; HEADER_SIZE];
    message.extend_from_slice(payload(PAYLOAD / size_of::<Word>()).as_bytes());
    // The bare writer takes turns between as many messages as the memory of a publisher holds.
    let messages: Vec<Vec<u8>> = (0..8).map(|_| message.clone()).collect();
    stillpoint_recorder::create_session(folder).map_err(Failure::failed)?;
    let (_, file) = stillpoint_recorder::create_part(folder).map_err(Failure::failed)?;
    let before = cpu_time();
    let options = mcap::WriteOptions::new()
        .chunk_size(Some(CHUNK_SIZE))
        .disable_seeking(true)
        .compression_threads(0)
        .compression(compression);
    let mut writer = options.create(mcap::write::NoSeek::new(file)).map_err(Failure::failed)?;
    let channel_id = writer
        .add_channel(0, "source.load", "cdr", &std::collections::BTreeMap::new())
        .map_err(Failure::failed)?;
    let count = bytes / message.len() as u64;
    let begun = Instant::now();
    for i in 0..count {
        let wait = period.saturating_mul(i as u32).saturating_sub(begun.elapsed());
        if !wait.is_zero() {
            std::thread::sleep(wait);
        }
        let header =
            mcap::records::MessageHeader { channel_id, sequence: i as u32, log_time: i, publish_time: i };
        writer
            .write_to_known_channel(&header, &messages[i as usize % messages.len()])
            .map_err(Failure::failed)?;
    }
    writer.finish().map_err(Failure::failed)?;
    writer.into_inner().into_inner().sync_all().map_err(Failure::failed)?;
    Ok((count * message.len() as u64) as f64 / (cpu_time() - before) as f64 * 1e9)
}

fn table(lines: &[RecordFigures]) -> String {
    let mut text = format!(
        "{:<12} {:>9} {:>6} {:>6} {:>6} {:>6} {:>6}   {:>9} {:>9} {:>6}   {:>6} {:>7}\n",
        "compression",
        "GB/CPU-s",
        "bare",
        "ratio",
        "paced",
        "ratio",
        "lost",
        "edge p50",
        "p99 us",
        "ratio",
        "ticks",
        "missed"
    );
    for l in lines {
        let _ = writeln!(
            text,
            "{:<12} {:>9.2} {:>6.2} {:>6.2} {:>6.2} {:>6.2} {:>6}   {:>9.1} {:>9.1} {:>6.2}   {:>6} {:>7}",
            l.compression,
            l.recorder / 1e9,
            l.bare / 1e9,
            l.ratio,
            l.paced / 1e9,
            l.paced_ratio,
            l.lost,
            l.edge.p50,
            l.edge.p99,
            l.edge_ratio,
            l.ticks,
            l.missed
        );
    }
    text
}
