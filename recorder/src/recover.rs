//! Mends a session whose recorder died: a file cut at any byte becomes one that standard readers open.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;

use crate::account::{DAMAGED_PLACES, RECOVERED_RECORD};
use crate::cut::{Limits, consistent_cut};
use crate::ended::Ended;
use crate::error::{SessionError, with_causes};
use crate::file::{Buffer, Message, Record, Source, next_record, scan};
use crate::folder::{create_private, is_being_written, is_blank, session_parts};
use crate::part::{PartChannel, Use};
use crate::session::{Place, Session};
use crate::topic::Role;

/// Why a session cannot be mended.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// It cannot be read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// Its recorder lives.
    #[error(
        "{part}: it is still being recorded; wait until the run has ended: it mends by itself what was cut"
    )]
    BeingRecorded {
        /// The part that is written.
        part: PathBuf,
    },
    /// The mended file cannot be written.
    #[error("{path}: cannot write the mended part: {}; the part as it was is untouched", with_causes(.cause))]
    Write {
        /// The mended file.
        path: PathBuf,
        /// Why not.
        cause: mcap::McapError,
    },
}

/// What mending one part kept and dropped.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Bytes of the part as it was.
    pub bytes: u64,
    /// Bytes behind the last whole record; whole messages of a cut chunk were kept nevertheless.
    pub bytes_cut: u64,
    /// Messages kept.
    pub messages: u64,
    /// Attachments kept.
    pub attachments: u64,
    /// Metadata records kept.
    pub metadata: u64,
    /// Samples dropped because the journal of their producer does not reach them.
    pub outputs_dropped: u64,
    /// Journal entries dropped because samples that they consumed are missing.
    pub entries_dropped: u64,
    /// Places that were damaged, with what was wrong; what they held is dropped.
    pub damage: Vec<String>,
    /// Where the part as it was is kept: more of it was dropped than a recorder that dies leaves behind.
    pub retained: Option<PathBuf>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "recovered {} messages, {} attachments and {} metadata records; dropped {} journal entries without their \
             inputs, {} samples without their journal entry, {} damaged places and the last {} of {} bytes",
            self.messages,
            self.attachments,
            self.metadata,
            self.entries_dropped,
            self.outputs_dropped,
            self.damage.len(),
            self.bytes_cut,
            self.bytes
        )?;
        match &self.retained {
            Some(retained) => write!(f, "; the original part is stored as {}", retained.display()),
            None => Ok(()),
        }
    }
}

/// Mends one file into `out`.
///
/// # Errors
/// The input is no MCAP file or cannot be read, or `out` takes no more bytes.
pub fn recover<W: Write>(input: Source, out: W) -> Result<(W, Report), RecoverError> {
    let session = Session::from_sources(vec![(PathBuf::from("part-000.mcap"), input)])?;
    let limits = limits(&session);
    let part = session.parts.first().ok_or_else(|| SessionError::NoParts { path: PathBuf::new() })?;
    rewrite(&session, 0, &limits, &part.path, out)
}

/// Mends the parts of a session in place, those that need it: each is written anew beside the old one, which it then
/// replaces. The old one is kept under another name where more of it is dropped than a recorder that dies leaves behind.
/// A part in which nothing stands is removed. Gives the parts that were mended.
///
/// # Errors
/// The session is being recorded or cannot be read, or a mended part not written; the old part then stays.
pub fn recover_session(path: &Path) -> Result<Vec<(PathBuf, Report)>, RecoverError> {
    let io = |cause| SessionError::Io { path: path.to_owned(), cause };
    let parts = session_parts(path).map_err(io)?;
    for part in &parts {
        if is_being_written(&File::open(part).map_err(io)?) {
            return Err(RecoverError::BeingRecorded { part: part.clone() });
        }
    }
    let session = Session::open_any(path)?;
    let limits = limits(&session);
    for part in parts {
        if part != path && is_blank(&part).map_err(io)? {
            std::fs::remove_file(&part).map_err(io)?;
        }
    }
    let mut mended = Vec::new();
    for (number, part) in session.parts.iter().enumerate().filter(|(_, part)| part.needs_mending()) {
        mended.push((part.path.clone(), mend(&session, number, &limits)?));
    }
    Ok(mended)
}

/// Mends the part of this number in place. Where that fails nothing is left beside it.
fn mend(session: &Session, number: usize, limits: &Limits) -> Result<Report, RecoverError> {
    let part = &session.parts[number];
    let companion = part.path.with_extension("mcap.mending");
    let failed = |cause: io::Error| RecoverError::Write { path: companion.clone(), cause: cause.into() };
    // One that was left by a run that died is worth nothing.
    match std::fs::remove_file(&companion) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(failed(e)),
        _ => {}
    }
    let replace = || {
        let file = create_private(&companion).map_err(failed)?;
        let (file, mut report) =
            rewrite(session, number, limits, &companion, io::BufWriter::with_capacity(1 << 16, file))?;
        let file = file.into_inner().map_err(|e| failed(e.into_error()))?;
        file.sync_all().map_err(failed)?;
        let cut_short = report.bytes_cut > part.largest_chunk() && !part.ends_in_chunk();
        if cut_short || !part.damage.is_empty() {
            report.retained = Some(keep(&part.path).map_err(failed)?);
        }
        std::fs::rename(&companion, &part.path).map_err(failed)?;
        Ok(report)
    };
    replace().inspect_err(|_| {
        let _ = std::fs::remove_file(&companion);
    })
}

/// Gives a part a second name, under which it stays when another takes its place.
fn keep(part: &Path) -> io::Result<PathBuf> {
    let name = |n: u32| match n {
        0 => "mcap.damaged".to_owned(),
        n => format!("mcap.damaged-{n}"),
    };
    let mut number = 0;
    loop {
        let retained = part.with_extension(name(number));
        match std::fs::hard_link(part, &retained) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => number += 1,
            // A file system without links.
            Err(_) => return std::fs::copy(part, &retained).map(|_| retained),
            Ok(()) => return Ok(retained),
        }
    }
}

/// Only a session that was cut is ahead of itself.
fn limits(session: &Session) -> Limits {
    match session.ended() {
        Ended::InOrder | Ended::Early { .. } => Limits::new(),
        _ => consistent_cut(session),
    }
}

/// Writes what is kept of the part of this number to `out`, which stands at `path`.
fn rewrite<W: Write>(
    session: &Session,
    number: usize,
    limits: &Limits,
    path: &Path,
    out: W,
) -> Result<(W, Report), RecoverError> {
    let part = &session.parts[number];
    let read = |cause| SessionError::Io { path: part.path.clone(), cause };
    let write = |cause: mcap::McapError| RecoverError::Write { path: path.to_owned(), cause };
    let mut report = Report {
        bytes: part.size,
        bytes_cut: if part.scan.footer { 0 } else { part.size - part.scan.whole },
        damage: part.damage.iter().map(|d| format!("at offset {}: {}", d.offset, d.what)).collect(),
        ..Report::default()
    };
    let options = mcap::WriteOptions::new()
        .profile("ros2")
        .library(concat!("stillpoint-recorder/", env!("CARGO_PKG_VERSION")))
        .disable_seeking(true)
        .compression_threads(0)
        .compression(Some(mcap::Compression::Lz4));
    let mut w = options.create(NoSeek::new(out)).map_err(write)?;
    let scan = scan(&part.source).map_err(read)?.unwrap_or_default();
    for a in &scan.attachments {
        let attachment = mcap::Attachment {
            log_time: a.log_time,
            create_time: a.create_time,
            name: a.name.clone(),
            media_type: a.media_type.clone(),
            data: (&a.data[..]).into(),
        };
        w.attach(&attachment).map_err(write)?;
        report.attachments += 1;
    }
    for (name, entries) in &scan.metadata {
        w.write_metadata(&Metadata { name: name.clone(), metadata: entries.clone() }).map_err(write)?;
        report.metadata += 1;
    }
    for (id, s) in &part.schemas {
        w.add_schema_with_id(*id, &s.name, &s.encoding, &s.data).map_err(write)?;
    }
    for (id, PartChannel { channel: c, .. }) in &part.channels {
        w.add_channel_with_id(*id, c.schema_id, &c.topic, &c.encoding, &c.metadata).map_err(write)?;
    }
    let journals: BTreeSet<&str> = session
        .topics()
        .iter()
        .filter(|t| matches!(t.role, Role::Journal { .. }))
        .map(|t| t.name.as_str())
        .collect();
    let (mut bytes, mut stored) = (Buffer::default(), Buffer::default());
    // The last sample, behind which stand the messages made from it.
    let mut is_retained = true;
    for block in 0..part.scan.blocks.len() {
        part.records(block, &mut bytes, &mut stored).map_err(read)?;
        let (mut at, mut behind) = (0, 0);
        while let Some((_, record)) = next_record(&bytes, &mut behind) {
            let start = std::mem::replace(&mut at, behind);
            let Ok(Record::Message(m)) = record else { continue };
            let Some(channel) = part.channels.get(&m.channel) else { continue };
            let place = Place { part: number as u32, block: block as u32, start };
            let (stands, beyond) = (session.stands_at(channel, &m, place), beyond(limits, channel, &m));
            let of_sample = matches!(channel.purpose, Use::Samples { .. });
            if of_sample {
                is_retained = stands && beyond.is_none();
            }
            if !stands || (channel.purpose == Use::CompanionOfAll && !is_retained) {
                continue;
            }
            if let Some(topic) = beyond {
                let count = if journals.contains(topic) {
                    &mut report.entries_dropped
                } else {
                    &mut report.outputs_dropped
                };
                *count += u64::from(of_sample);
                continue;
            }
            let header = MessageHeader {
                channel_id: m.channel,
                sequence: m.sequence,
                log_time: m.log_time,
                publish_time: m.publish_time,
            };
            w.write_to_known_channel(&header, m.data).map_err(write)?;
            report.messages += 1;
        }
    }
    let recovered = Metadata { name: RECOVERED_RECORD.to_owned(), metadata: entries(&report) };
    w.write_metadata(&recovered).map_err(write)?;
    w.finish().map_err(write)?;
    Ok((w.into_inner().into_inner(), report))
}

/// The topic of a message that stands beyond the cut. `None`: it is kept.
fn beyond<'a>(limits: &Limits, channel: &'a PartChannel, m: &Message<'_>) -> Option<&'a str> {
    let topic = match &channel.purpose {
        Use::Companion { topic, .. } => topic,
        _ => &channel.topic,
    };
    let limit = limits.get(topic)?;
    let number = channel.purpose.number(m).ok().flatten()?;
    (number >= *limit).then_some(topic)
}

/// The entries of the record that says what mending did.
fn entries(report: &Report) -> BTreeMap<String, String> {
    [
        ("bytes", report.bytes),
        ("bytes_cut", report.bytes_cut),
        ("messages", report.messages),
        ("entries_dropped", report.entries_dropped),
        ("outputs_dropped", report.outputs_dropped),
        (DAMAGED_PLACES, report.damage.len() as u64),
    ]
    .into_iter()
    .map(|(name, value)| (name.to_owned(), value.to_string()))
    .collect()
}
