//! A recorded session, opened: all of its parts, whole or cut, as one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use stillpoint_samples::{Entry, Pieces, Journal};

use crate::account::{ClockSample, END_RECORD, Lost};
use crate::cache::BlockCache;
use crate::complete::{Completeness, Gap};
use crate::error::SessionError;
use crate::file::{Message, Record, Source, next_record};
use crate::folder::session_parts;
use crate::form::{Envelope, Form, StaticTransform, transforms_from};
use crate::layout::TopicKind;
use crate::part::{Part, PartChannel, Use};
use crate::samples::{Recorded, Samples};
use crate::topic::{Described, Role, TOPIC_RECORD};
use crate::writer::Attachment;

/// A topic of a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// `operator.port`.
    pub name: String,
    /// The operator that sent it; empty where the recording does not say.
    pub operator: String,
    /// Type name with its layout hash, as recorded.
    pub type_name: String,
    /// The `ros2msg` text of the type, as recorded.
    pub schema: String,
    /// The frame of its coordinates.
    pub frame: Option<String>,
    /// What it is to replay.
    pub role: Role,
    /// What its samples are to this build.
    pub kind: TopicKind,
    /// Samples, or messages of an opaque topic, that are there.
    pub samples: u64,
    /// Their bytes as recorded, uncompressed.
    pub bytes: u64,
}

/// How the recording of a session came to its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The recorder ended it.
    InOrder,
    /// The recorder died: the last part is readable up to a byte.
    Cut {
        /// The last part.
        part: PathBuf,
        /// Where its last whole record ends, bytes.
        whole: u64,
        /// Bytes in the file.
        size: u64,
    },
}

/// Which sample: number of the topic in [`Session::topics`], incarnation, sequence.
pub(crate) type SampleKey = (usize, u32, u64);

/// Where a sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    pub part: u32,
    pub block: u32,
    /// Of its record in the block's records.
    pub start: usize,
}

/// A session, whole or cut, of one part or many.
#[derive(Debug, Default)]
pub struct Session {
    pub(crate) parts: Vec<Part>,
    pub(crate) index: BTreeMap<SampleKey, Place>,
    topics: Vec<Topic>,
    numbers: BTreeMap<String, usize>,
    attachments: BTreeMap<String, Attachment>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    frames: Vec<StaticTransform>,
    clock: Vec<ClockSample>,
    lost: Vec<Lost>,
    journals: BTreeMap<String, Vec<Entry>>,
    cache: BlockCache,
}

impl Session {
    /// Opens a session: a folder of parts, or one file.
    ///
    /// # Errors
    /// It cannot be read, is no session, or a topic's layout is not this build's.
    pub fn open(path: &Path) -> Result<Self, SessionError> {
        let session = Self::open_any(path)?;
        session.check_layouts()?;
        Ok(session)
    }

    /// Opens a session whatever the layout of its topics: those that are not this build's have no samples to give.
    ///
    /// # Errors
    /// It cannot be read or is no session.
    pub fn open_any(path: &Path) -> Result<Self, SessionError> {
        let io = |path: &Path| {
            let path = path.to_owned();
            move |cause| SessionError::Io { path, cause }
        };
        let mut sources = Vec::new();
        for part in session_parts(path).map_err(io(path))? {
            let source = Source::open(&part).map_err(io(&part))?;
            sources.push((part, source));
        }
        if sources.is_empty() {
            return Err(SessionError::NoParts { path: path.to_owned() });
        }
        Self::from_sources(sources)
    }

    /// Opens a session whose parts are given as their bytes.
    ///
    /// # Errors
    /// They are no session, or a topic's layout is not this build's.
    pub fn from_bytes(parts: impl IntoIterator<Item = Arc<[u8]>>) -> Result<Self, SessionError> {
        let sources = parts.into_iter().enumerate();
        let sources = sources.map(|(i, b)| (PathBuf::from(format!("part-{i:03}.mcap")), Source::Bytes(b)));
        let session = Self::from_sources(sources.collect())?;
        session.check_layouts()?;
        Ok(session)
    }

    /// Opens a session whose parts are given with a name each, whatever the layout of its topics.
    ///
    /// # Errors
    /// One cannot be read or is no MCAP file.
    pub fn from_sources(sources: Vec<(PathBuf, Source)>) -> Result<Self, SessionError> {
        let mut session = Self::default();
        for (path, source) in sources {
            session.add_part(path, source)?;
        }
        session.read_journals();
        Ok(session)
    }

    fn add_part(&mut self, path: PathBuf, source: Source) -> Result<(), SessionError> {
        let number = self.parts.len() as u32;
        let io = |cause| SessionError::Io { path: path.clone(), cause };
        // The topics are described before the first message, in records that the walk over the file finds first.
        let scan = crate::file::scan(&source).map_err(io)?;
        for (name, entries) in scan.into_iter().flat_map(|s| s.metadata) {
            if name == TOPIC_RECORD {
                if let Some(described) = Described::from_entries(&entries) {
                    self.describe(described);
                }
            } else {
                self.metadata.entry(name).or_insert(entries);
            }
        }
        let part = Part::open(path.clone(), source, |channel, block, start, message| {
            self.add_message(channel, Place { part: number, block, start }, message)
        })
        .map_err(io)?;
        let mut part = part.ok_or(SessionError::NotMcap { path })?;
        for a in std::mem::take(&mut part.scan.attachments) {
            let attachment = Attachment { name: a.name.clone(), media_type: a.media_type, bytes: a.data };
            self.attachments.entry(a.name).or_insert(attachment);
        }
        self.parts.push(part);
        Ok(())
    }

    fn describe(&mut self, d: Described) -> usize {
        if let Some(number) = self.numbers.get(&d.name) {
            return *number;
        }
        let kind = TopicKind::of(&d.type_name, &d.schema);
        self.numbers.insert(d.name.clone(), self.topics.len());
        self.topics.push(Topic {
            name: d.name,
            operator: d.operator,
            type_name: d.type_name,
            schema: d.schema,
            frame: d.frame,
            role: d.role,
            kind,
            samples: 0,
            bytes: 0,
        });
        self.topics.len() - 1
    }

    fn add_message(&mut self, channel: &PartChannel, place: Place, message: &Message<'_>) -> Result<(), String> {
        match &channel.purpose {
            Use::Lost => self.lost.push(Lost::decode(message.data)?),
            Use::Clock => self.clock.push(ClockSample::decode(message.data)?),
            Use::Frames => {
                for t in transforms_from(message.data)? {
                    if !self.frames.contains(&t) {
                        self.frames.push(t);
                    }
                }
            }
            Use::Beside { .. } => {}
            Use::Samples { .. } | Use::Opaque => {
                let number = match self.numbers.get(&channel.channel.topic) {
                    Some(number) => *number,
                    None => self.describe(described_by(&channel.channel)),
                };
                if let Some((incarnation, sequence)) = channel.purpose.number(message)? {
                    let key = (number, incarnation, sequence);
                    if self.index.contains_key(&key) {
                        let topic = &channel.channel.topic;
                        return Err(format!("sample {sequence} of `{topic}`, incarnation {incarnation}, stands there twice"));
                    }
                    self.index.insert(key, place);
                }
                self.topics[number].samples += 1;
                self.topics[number].bytes += message.data.len() as u64;
            }
        }
        Ok(())
    }

    fn read_journals(&mut self) {
        let mut journals: BTreeMap<String, Vec<Entry>> = BTreeMap::new();
        let is_journal = |t: &Topic| matches!(t.role, Role::Journal { .. });
        for recorded in self.samples_where(is_journal) {
            let Ok(recorded) = recorded else { continue };
            let operator = &self.topics[recorded.topic].operator;
            let Ok(pieces) = Pieces::split(<Journal as stillpoint_samples::Sample>::KIND, &recorded.sample) else { continue };
            if let Ok(view) = pieces.view::<Journal>() {
                let entry = Entry { head: view.head, body: *view.body, refs: view.elements.to_vec() };
                journals.entry(operator.clone()).or_default().push(entry);
            }
        }
        for entries in journals.values_mut() {
            entries.sort_by_key(|e| (e.head.incarnation, e.head.sequence));
        }
        self.journals = journals;
    }

    /// Refuses a session of which a topic has another layout than in this build.
    ///
    /// # Errors
    /// The first such topic, with the fields that differ.
    pub fn check_layouts(&self) -> Result<(), SessionError> {
        for t in &self.topics {
            if let TopicKind::Changed { ours, difference } = &t.kind {
                return Err(SessionError::Layout {
                    topic: t.name.clone(),
                    recorded: t.type_name.clone(),
                    ours: ours.type_name(),
                    difference: difference.clone(),
                });
            }
        }
        Ok(())
    }

    /// The topics, in the order in which they were added.
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Number of a topic in [`Session::topics`].
    pub fn topic_number(&self, name: &str) -> Option<usize> {
        self.numbers.get(name).copied()
    }

    /// The files kept in the session, by name.
    pub fn attachments(&self) -> &BTreeMap<String, Attachment> {
        &self.attachments
    }

    /// The metadata records, by name.
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.metadata
    }

    /// The frames that do not move.
    pub fn frames(&self) -> &[StaticTransform] {
        &self.frames
    }

    /// The clock's relation to realtime, in the order of recording.
    pub fn clock(&self) -> &[ClockSample] {
        &self.clock
    }

    /// What could not be kept, as the recorder listed it.
    pub fn lost(&self) -> &[Lost] {
        &self.lost
    }

    /// The journals by operator, each in the order of incarnation and entry.
    pub fn journals(&self) -> &BTreeMap<String, Vec<Entry>> {
        &self.journals
    }

    /// How the recording ended.
    pub fn ended(&self) -> Ended {
        match self.parts.last() {
            Some(p) if p.scan.metadata.iter().any(|(name, _)| name == END_RECORD) => Ended::InOrder,
            Some(p) => Ended::Cut { part: p.path.clone(), whole: p.scan.whole, size: p.size },
            None => Ended::Cut { part: PathBuf::new(), whole: 0, size: 0 },
        }
    }

    /// Whether everything that replay needs is there, and if not, what is missing.
    pub fn completeness(&self) -> Completeness {
        let gaps: Vec<Gap> = crate::complete::gaps(self);
        if gaps.is_empty() { Completeness::Complete } else { Completeness::Gaps(gaps) }
    }

    /// All samples in the order of recording, one chunk in memory at a time.
    pub fn samples(&self) -> Samples<'_> {
        self.samples_where(|_| true)
    }

    /// The samples of the topics that `choose` says yes to, in the order of recording.
    pub fn samples_where(&self, choose: impl Fn(&Topic) -> bool) -> Samples<'_> {
        let chosen = self.topics.iter().map(|t| matches!(t.kind, TopicKind::Known(_)) && choose(t)).collect();
        Samples::new(self, chosen)
    }

    /// The incarnation and sequence of every sample of a topic, in order.
    pub fn numbers(&self, topic: usize) -> impl DoubleEndedIterator<Item = (u32, u64)> {
        self.index.range((topic, 0, 0)..=(topic, u32::MAX, u64::MAX)).map(|((_, i, s), _)| (*i, *s))
    }

    /// Incarnation and sequence of the last sample of a topic before (incarnation, sequence).
    pub(crate) fn last_before(&self, topic: usize, (incarnation, sequence): (u32, u64)) -> Option<(u32, u64)> {
        let mut before = self.index.range((topic, 0, 0)..(topic, incarnation, sequence));
        before.next_back().map(|((_, i, s), _)| (*i, *s))
    }

    /// Whether a sample is there.
    pub fn has(&self, topic: usize, incarnation: u32, sequence: u64) -> bool {
        self.index.contains_key(&(topic, incarnation, sequence))
    }

    /// One sample; `None` where it was not kept, or its topic is of no kind of this build.
    ///
    /// # Errors
    /// It cannot be read, or is not what its channel promises.
    pub fn sample(&self, topic: usize, incarnation: u32, sequence: u64) -> Result<Option<Recorded>, SessionError> {
        let Some(place) = self.index.get(&(topic, incarnation, sequence)) else { return Ok(None) };
        let bytes = self.records(place.part, place.block)?;
        let mut at = place.start;
        match next_record(&bytes, &mut at) {
            Some((_, Ok(Record::Message(m)))) => self.decode(*place, &m),
            _ => Ok(None),
        }
    }

    pub(crate) fn records(&self, part: u32, block: u32) -> Result<Arc<Vec<u8>>, SessionError> {
        let p = &self.parts[part as usize];
        self.cache
            .get((part, block), || p.records(block as usize))
            .map_err(|cause| SessionError::Io { path: p.path.clone(), cause })
    }

    /// The sample of a message. `None`: it is no sample of a known kind, or another stands in the index for it.
    pub(crate) fn decode(&self, place: Place, m: &Message<'_>) -> Result<Option<Recorded>, SessionError> {
        let part = &self.parts[place.part as usize];
        let Some(channel) = part.channels.get(&m.channel) else { return Ok(None) };
        let Use::Samples { form, shared } = &channel.purpose else { return Ok(None) };
        let Some(topic) = self.topic_number(&channel.channel.topic) else { return Ok(None) };
        let TopicKind::Known(kind) = self.topics[topic].kind else { return Ok(None) };
        let fault = |what: String| SessionError::Message {
            path: part.path.clone(),
            topic: channel.channel.topic.clone(),
            offset: part.scan.blocks.get(place.block as usize).map_or(0, |b| b.offset),
            within: place.start,
            what,
        };
        let Some((incarnation, sequence)) = channel.purpose.number(m).map_err(fault)? else { return Ok(None) };
        if self.index.get(&(topic, incarnation, sequence)) != Some(&place) {
            return Ok(None);
        }
        if *form != Form::Own && *form != Form::of(kind) {
            return Err(fault(format!("a {} is not recorded as {}", kind.name, form.name())));
        }
        let sample = form.decode(kind, shared, Envelope::of(m), m.data).map_err(fault)?;
        Ok(Some(Recorded { topic, incarnation, sequence, log_time: m.log_time, sample }))
    }
}

/// What a channel says of a topic that no record describes.
fn described_by(channel: &crate::file::Channel) -> Described {
    Described {
        name: channel.topic.clone(),
        operator: channel.topic.rsplit_once('.').map(|(operator, _)| operator.to_owned()).unwrap_or_default(),
        type_name: channel.metadata.get("stillpoint.type").cloned().unwrap_or_default(),
        schema: String::new(),
        frame: channel.metadata.get("stillpoint.frame").cloned(),
        role: Role::Computed,
    }
}
