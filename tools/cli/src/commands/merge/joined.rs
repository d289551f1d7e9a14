//! The session that is written: all samples in the order of time, with their times on the axis of the first session.

use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::Path;

use stillpoint_operator::outside::ClockOffset;
use stillpoint_pipeline::session::{PIPELINE, RUN};
use stillpoint_pipeline::session_recorder::create_folder;
use stillpoint_recorder::{
    Attachment, ClockSample, Closing, Compression, Opening, PartWriter, Recorded, Role, Samples, Session,
    Topic, TopicId, TopicInfo, create_part, write_metadata,
};
use stillpoint_report::MERGED;
use stillpoint_samples::{HEADER_SIZE, Header, Pieces};
use zerocopy::IntoBytes;

use super::part::MergedPart;
use crate::exit::Failure;

/// What was written.
pub struct Written {
    /// Samples of each session.
    pub samples: Vec<u64>,
    /// Topics whose samples this build cannot read.
    pub left_out: Vec<String>,
}

/// A session that is read, with its times on the axis of the first.
struct Walk<'p> {
    part: &'p MergedPart,
    clock: ClockOffset,
    /// Realtime minus session time of this session, and of the first one, ns.
    realtime: (i128, i128),
    /// The topic that each topic of the session becomes.
    topics: Vec<Option<TopicId>>,
    samples: Samples<'p>,
    next: Option<Recorded>,
}

impl Walk<'_> {
    /// Reads the next sample.
    fn advance(&mut self) -> Result<(), Failure> {
        let next = self.samples.next().transpose();
        self.next = next.map_err(|e| Failure::failed(format!("{}: {e}", self.part.path.display())))?;
        Ok(())
    }

    /// When a sample was recorded, by the realtime of the first session.
    fn logged(&self, log_time: u64) -> u64 {
        let there = i128::from(log_time) - self.realtime.0 - i128::from(self.clock.offset);
        u64::try_from(there + self.realtime.1).unwrap_or(0)
    }
}

/// Writes the session into a new folder. A session that cannot be read to its end leaves no folder.
pub fn write(out: &Path, parts: &[MergedPart], clocks: &[ClockOffset]) -> Result<Written, Failure> {
    create_folder(out).map_err(Failure::failed)?;
    let written = fill(out, parts, clocks);
    if written.is_err() {
        // The reason is that of the failure.
        let _ = std::fs::remove_dir_all(out);
    }
    written
}

fn fill(out: &Path, parts: &[MergedPart], clocks: &[ClockOffset]) -> Result<Written, Failure> {
    let io = |e: std::io::Error| Failure::failed(format!("{}: {e}", out.display()));
    let (_, file) = create_part(out).map_err(io)?;
    let opening = opening(parts, clocks);
    let mut writer =
        PartWriter::new(BufWriter::new(file), Compression::Lz4, &opening).map_err(Failure::failed)?;
    let mut written = Written { samples: vec![0; parts.len()], left_out: Vec::new() };
    let mut walks = Vec::new();
    for (part, clock) in parts.iter().zip(clocks) {
        let mut topics = Vec::new();
        for topic in part.session.topics() {
            let info = info(&part.host, topic);
            if info.is_none() && !matches!(topic.role, Role::Journal { .. }) {
                written.left_out.push(format!("{}.{}", part.host, topic.name));
            }
            topics.push(info.map(|info| writer.add_topic(info)).transpose().map_err(Failure::failed)?);
        }
        let samples = part.session.samples_where(|topic| !matches!(topic.role, Role::Journal { .. }));
        let realtime = (ahead(&part.session), ahead(&parts[0].session));
        let mut walk = Walk { part, clock: *clock, realtime, topics, samples, next: None };
        walk.advance()?;
        walks.push(walk);
    }
    let at = |walk: &Walk<'_>| walk.next.as_ref().map(|sample| walk.logged(sample.log_time));
    let mut last = 0;
    while let Some((logged, place)) =
        walks.iter().enumerate().filter_map(|(place, walk)| Some((at(walk)?, place))).min()
    {
        // A session is read in the order of its recording.
        last = logged.max(last);
        let walk = &mut walks[place];
        if let Some(sample) = walk.next.take()
            && let Some(topic) = walk.topics[sample.topic]
        {
            put(&mut writer, topic, walk.part, &sample, (walk.clock, last))?;
            written.samples[place] += 1;
        }
        walks[place].advance()?;
    }
    for walk in &walks {
        for lost in walk.part.session.lost() {
            let topic = walk.part.session.topic_number(&lost.topic).and_then(|number| walk.topics[number]);
            let Some(topic) = topic else { continue };
            let noted = writer.note_lost(topic, lost.incarnation, lost.first, lost.count, last);
            noted.map_err(Failure::failed)?;
        }
    }
    let gap = "it is joined from the sessions of several hosts, which replay each by itself".to_owned();
    let closing = Closing { gaps: vec![gap], realtime_ns: last, ..Closing::default() };
    let file = writer.finish(&closing).map_err(Failure::failed)?;
    file.into_inner().map_err(|e| io(e.into_error()))?.sync_all().map_err(io)?;
    let session = Session::open_any(out).map_err(Failure::failed)?;
    write_metadata(out, &session).map_err(io)?;
    Ok(written)
}

/// Writes a sample with its times on the axis of the first session.
fn put<W: std::io::Write>(
    writer: &mut PartWriter<W>,
    topic: TopicId,
    part: &MergedPart,
    sample: &Recorded,
    (clock, logged): (ClockOffset, u64),
) -> Result<(), Failure> {
    let topics = part.session.topics();
    let Some(kind) = topics[sample.topic].kind.kind() else { return Ok(()) };
    let pieces = Pieces::split(kind, &sample.sample).map_err(Failure::failed)?;
    let header = pieces.header();
    let header = Header { stamp: clock.here(header.stamp), origin: clock.here(header.origin), ..header };
    let mut meta = pieces.meta.to_vec();
    meta[..HEADER_SIZE].copy_from_slice(header.as_bytes());
    let moved = Pieces { meta: &meta, payload: pieces.payload };
    writer.write(topic, moved, logged).map_err(Failure::failed)
}

/// What a topic becomes; `None` for journals, and for samples that this build cannot read.
fn info(host: &str, topic: &Topic) -> Option<TopicInfo> {
    let kind = topic.kind.kind().filter(|_| !matches!(topic.role, Role::Journal { .. }))?;
    Some(TopicInfo {
        name: format!("{host}.{}", topic.name),
        operator: format!("{host}.{}", topic.operator),
        kind,
        frame: topic.frame.clone(),
        role: topic.role.clone(),
    })
}

/// Realtime minus session time when a session began, ns.
fn ahead(session: &Session) -> i128 {
    let first = session.clock().first();
    first.map_or(0, |clock| i128::from(clock.realtime_ns) - i128::from(clock.logical_ns))
}

fn opening(parts: &[MergedPart], clocks: &[ClockOffset]) -> Opening {
    let mut merged = BTreeMap::new();
    for (part, clock) in parts.iter().zip(clocks) {
        let mut say = |what: &str, value: String| merged.insert(format!("{}.{what}", part.host), value);
        say("session", part.path.display().to_string());
        say("offset_ns", clock.offset.to_string());
        say("uncertainty_ns", clock.uncertainty.to_string());
    }
    merged.insert("axis".to_owned(), parts[0].host.clone());
    let mut metadata = BTreeMap::from([(MERGED.to_owned(), merged)]);
    if let Some(run) = parts[0].session.metadata().get(RUN) {
        metadata.insert(RUN.to_owned(), run.clone());
    }
    let mut frames = Vec::new();
    for frame in parts.iter().flat_map(|part| part.session.frames()) {
        if !frames.contains(frame) {
            frames.push(frame.clone());
        }
    }
    let clock = parts[0].session.clock().first();
    Opening {
        attachments: vec![Attachment {
            name: format!("hosts/{PIPELINE}"),
            media_type: "application/yaml".to_owned(),
            bytes: parts[0].pipeline.clone().into_bytes(),
        }],
        metadata,
        frames,
        clock: clock.map(|c| ClockSample { logical_ns: c.logical_ns, realtime_ns: c.realtime_ns }),
    }
}
