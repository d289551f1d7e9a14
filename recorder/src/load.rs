//! Opens a session: its parts are read, and what each message says goes to its place.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use stillpoint_samples::Entry;

use crate::account::{ClockSample, Lost};
use crate::error::SessionError;
use crate::fault::{MessageFault, SampleFault};
use crate::file::{Message, Source, scan};
use crate::folder::{is_blank, session_parts};
use crate::form::{Envelope, Fault, transforms_from};
use crate::journal::entry_of;
use crate::layout::TopicKind;
use crate::opening::Attachment;
use crate::part::{PartChannel, SessionPart, Use};
use crate::session::{Place, SampleKey, Session, Topic};
use crate::topic::{Described, Role, TOPIC_RECORD};

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

    /// Opens a session whatever the layout of its topics: those that this build cannot read have no samples to give.
    ///
    /// # Errors
    /// It cannot be read or is no session.
    pub fn open_any(path: &Path) -> Result<Self, SessionError> {
        let io = |path: &Path| {
            let path = path.to_owned();
            move |cause| SessionError::Io { path, cause }
        };
        let (mut sources, mut blank) = (Vec::new(), None);
        for part in session_parts(path).map_err(io(path))? {
            // A file that is given by its name is opened whatever it is.
            if part != path && is_blank(&part).map_err(io(&part))? {
                blank.get_or_insert(part);
                continue;
            }
            let source = Source::open(&part).map_err(io(&part))?;
            sources.push((part, source));
        }
        if sources.is_empty() {
            return Err(match blank {
                Some(part) => SessionError::Blank { part },
                None => SessionError::NoParts { path: path.to_owned() },
            });
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
        session.order_journals();
        Ok(session)
    }

    /// Refuses a session of which a topic has another layout than in this build, and none that maps to it.
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

    fn add_part(&mut self, path: PathBuf, source: Source) -> Result<(), SessionError> {
        let number = self.parts.len() as u32;
        let io = |cause| SessionError::Io { path: path.clone(), cause };
        // The topics are described before the first message, in records that the walk over the file finds first.
        let found = scan(&source).map_err(io)?;
        for (name, entries) in found.into_iter().flat_map(|s| s.metadata) {
            if name == TOPIC_RECORD {
                if let Some(described) = Described::from_entries(&entries) {
                    self.describe(described);
                }
            } else {
                self.metadata.entry(name).or_insert(entries);
            }
        }
        let part = SessionPart::open(path.clone(), source, |channel, block, start, message| {
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

    fn add_message(
        &mut self,
        channel: &PartChannel,
        place: Place,
        message: &Message<'_>,
    ) -> Result<(), MessageFault> {
        match &channel.purpose {
            Use::Lost => self.lost.push(Lost::decode(message.data).map_err(Fault::from)?),
            Use::Clock => self.clock.push(ClockSample::decode(message.data).map_err(Fault::from)?),
            Use::Frames => {
                for t in transforms_from(message.data)? {
                    if !self.frames.contains(&t) {
                        self.frames.push(t);
                    }
                }
            }
            Use::Companion { .. } | Use::CompanionOfAll => {}
            Use::Samples { .. } | Use::Opaque => {
                let number = match self.numbers.get(&channel.topic) {
                    Some(number) => *number,
                    None => self.describe(described_by(channel)),
                };
                if let Some((incarnation, sequence)) = channel.purpose.number(message)? {
                    let key = (number, incarnation, sequence);
                    if let Some(known) = self.index.get(&key) {
                        let topic = &channel.topic;
                        if known.part < place.part && self.repeats(key, &channel.purpose, message) {
                            // Mending the earlier part then drops it there.
                            self.index.insert(key, place);
                            return Ok(());
                        }
                        return Err(MessageFault::Twice { sequence, topic: topic.clone(), incarnation });
                    }
                    let topic = &channel.topic;
                    let entry = self.check(number, &channel.purpose, message).map_err(|what| {
                        MessageFault::Sample { sequence, topic: topic.clone(), incarnation, what }
                    })?;
                    self.index.insert(key, place);
                    if let Some(entry) = entry {
                        let operator = self.topics[number].operator.clone();
                        self.journals.entry(operator).or_default().push(entry);
                    }
                }
                self.topics[number].samples += 1;
                self.topics[number].bytes += message.data.len() as u64;
            }
        }
        Ok(())
    }

    /// Whether a message is the sample that an earlier part holds: a recorder that is started again may write once more
    /// what its predecessor wrote and did not note.
    fn repeats(&self, key: SampleKey, purpose: &Use, message: &Message<'_>) -> bool {
        let (topic, incarnation, sequence) = key;
        let Use::Samples { form, shared } = purpose else { return false };
        let kind = &self.topics[topic].kind;
        let found = kind.decode(*form, shared, Envelope::of(message), message.data);
        let Ok(Some(found)) = found else { return false };
        self.holds(topic, incarnation, sequence, &found.to_bytes()).is_ok_and(|held| held == Some(true))
    }

    /// Checks that a message is the sample that its channel promises. Gives the entry that it is, where it is one.
    fn check(
        &self,
        topic: usize,
        purpose: &Use,
        message: &Message<'_>,
    ) -> Result<Option<Entry>, SampleFault> {
        let topic = &self.topics[topic];
        let Use::Samples { form, shared } = purpose else { return Ok(None) };
        let found = topic.kind.decode(*form, shared, Envelope::of(message), message.data)?;
        let (Some(found), Role::Journal { inputs, outputs }) = (found, &topic.role) else { return Ok(None) };
        Ok(Some(entry_of(&found.to_bytes(), inputs.len(), outputs.len())?))
    }

    /// Puts the entries of each journal in their order, over all parts.
    fn order_journals(&mut self) {
        for entries in self.journals.values_mut() {
            entries.sort_by_key(|e| (e.header.incarnation, e.header.sequence));
        }
    }
}

/// What a channel says of a topic that no record describes.
fn described_by(PartChannel { topic, channel, .. }: &PartChannel) -> Described {
    Described {
        name: topic.clone(),
        operator: topic.rsplit_once('.').map(|(operator, _)| operator.to_owned()).unwrap_or_default(),
        type_name: channel.metadata.get("stillpoint.type").cloned().unwrap_or_default(),
        schema: String::new(),
        frame: channel.metadata.get("stillpoint.frame").cloned(),
        role: Role::Computed,
    }
}
