//! One part of a session, opened: its channels and where its messages are.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use crate::account::{CLOCK_CHANNEL, END_RECORD, FRAMES_CHANNEL, LOST_CHANNEL, RECOVERED_RECORD};
use crate::channels::{COMPANION, TOPIC};
use crate::fault::MessageFault;
use crate::file::{
    Block, Buffer, Channel, Damage, Loaded, Message, Record, Scan, Schema, Source, next_record, scan,
};
use crate::form::{Envelope, Fault, Form, Shared, own_header};

/// What the messages of a channel are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Use {
    /// Samples of the topic.
    Samples { form: Form, shared: Shared },
    /// Made from the samples of a topic, for viewers.
    Companion { topic: String, shared: Shared },
    /// Made from the samples of several topics, for viewers: each message follows its sample.
    CompanionOfAll,
    /// Losses.
    Lost,
    /// The clock.
    Clock,
    /// The static frames.
    Frames,
    /// Not of this project.
    Opaque,
}

/// A channel with what it is for.
#[derive(Clone, Debug)]
pub(crate) struct PartChannel {
    pub channel: Channel,
    /// The session's name of its topic: the channel itself has a name that ROS 2 accepts.
    pub topic: String,
    /// Type of its messages; empty if they have none.
    pub schema_name: String,
    pub purpose: Use,
}

/// One part.
#[derive(Debug)]
pub(crate) struct SessionPart {
    pub path: PathBuf,
    pub source: Source,
    pub size: u64,
    pub scan: Scan,
    pub schemas: BTreeMap<u16, Schema>,
    pub channels: BTreeMap<u16, PartChannel>,
    pub damage: Vec<Damage>,
    /// A recorder has it open.
    pub is_being_written: bool,
    /// Messages of each channel.
    pub counts: BTreeMap<u16, u64>,
    /// First and last log time of its messages, ns.
    pub times: Option<[u64; 2]>,
}

impl SessionPart {
    /// Whether its recorder ended it, and did not die.
    pub fn ended_in_order(&self) -> bool {
        self.has_record(END_RECORD)
    }

    /// Whether this project recorded it, repaired or not.
    pub fn is_ours(&self) -> bool {
        let own = |name: &str| name.starts_with("stillpoint.") && name != RECOVERED_RECORD;
        self.scan.metadata.iter().any(|(name, _)| own(name))
            || self.channels.values().any(|c| c.purpose != Use::Opaque)
    }

    /// Whether it is cut or damaged, or was closed without an end.
    pub fn needs_mending(&self) -> bool {
        let ends = self.ended_in_order() || self.has_record(RECOVERED_RECORD);
        !self.scan.footer || !self.damage.is_empty() || self.is_ours() && !ends
    }

    /// Stored bytes of its largest whole chunk.
    pub fn largest_chunk(&self) -> u64 {
        self.scan.blocks.iter().filter(|b| !b.cut).map(|b| b.stored).max().unwrap_or(0)
    }

    /// Whether it ends inside a chunk, as one does whose recorder was killed while it wrote.
    pub fn ends_in_chunk(&self) -> bool {
        self.scan.blocks.last().is_some_and(|b| b.cut)
    }

    fn has_record(&self, record: &str) -> bool {
        self.scan.metadata.iter().any(|(name, _)| name == record)
    }

    /// Walks over the file and hands every message of it to `each`. `None`: it is no MCAP file.
    pub fn open(
        path: PathBuf,
        source: Source,
        mut each: impl FnMut(&PartChannel, u32, usize, &Message<'_>) -> Result<(), MessageFault>,
    ) -> io::Result<Option<Self>> {
        // Asked first: what ends in the meantime is whole.
        let is_being_written = source.is_being_written();
        let size = source.size()?;
        let Some(mut scan) = scan(&source)? else { return Ok(None) };
        let damage = std::mem::take(&mut scan.damage);
        let (schemas, channels) = (BTreeMap::new(), BTreeMap::new());
        let (counts, times) = (BTreeMap::new(), None);
        let mut part =
            Self { path, source, size, scan, schemas, channels, damage, is_being_written, counts, times };
        // Every block passes through the same room.
        let (mut bytes, mut stored) = (Buffer::default(), Buffer::default());
        for number in 0..part.scan.blocks.len() {
            if !part.load(number, &mut bytes, &mut stored)? {
                part.add_repeated(&mut bytes, &mut stored)?;
                continue;
            }
            let offset = part.scan.blocks[number].offset;
            let (mut at, mut start) = (0, 0);
            while let Some((_, record)) = next_record(&bytes, &mut at) {
                let fault = match record {
                    Ok(Record::Message(m)) => match part.channels.get(&m.channel) {
                        Some(channel) => {
                            *part.counts.entry(m.channel).or_default() += 1;
                            let [first, last] = part.times.unwrap_or([m.log_time; 2]);
                            part.times = Some([first.min(m.log_time), last.max(m.log_time)]);
                            each(channel, number as u32, start, &m).err().map(|fault| fault.to_string())
                        }
                        None => Some(format!("a message of channel {} comes before that channel", m.channel)),
                    },
                    Ok(Record::Channel(channel)) => part.add_channel(channel),
                    Ok(Record::Schema(schema)) => part.add_schema(schema),
                    Ok(_) => None,
                    Err(fault) => Some(fault.to_owned()),
                };
                if let Some(fault) = fault {
                    let what = format!("at byte {start} of its records, {fault}");
                    part.damage.push(Damage { offset, what });
                }
                start = at;
            }
            if at < bytes.len() && !part.scan.blocks[number].cut {
                let what = format!("its last {} bytes are not a whole record", bytes.len() - at);
                part.damage.push(Damage { offset, what });
            }
        }
        Ok(Some(part))
    }

    /// Loads the records of a block. False: they are damaged, which is noted.
    fn load(&mut self, number: usize, bytes: &mut Buffer, stored: &mut Buffer) -> io::Result<bool> {
        let block = &mut self.scan.blocks[number];
        Ok(match block.load(&self.source, bytes, stored)? {
            Loaded::Whole | Loaded::Partial => true,
            Loaded::Damaged(what) => {
                self.damage.push(Damage { offset: block.offset, what });
                false
            }
        })
    }

    /// Adds the schemas and channels that are repeated after the data: those of a damaged chunk may be among them.
    fn add_repeated(&mut self, bytes: &mut Buffer, stored: &mut Buffer) -> io::Result<()> {
        for block in std::mem::take(&mut self.scan.repeated) {
            block.load(&self.source, bytes, stored)?;
            let _ = match next_record(bytes, &mut 0) {
                Some((_, Ok(Record::Schema(schema)))) => self.add_schema(schema),
                Some((_, Ok(Record::Channel(channel)))) => self.add_channel(channel),
                _ => None,
            };
        }
        Ok(())
    }

    /// Puts the records of a block, as it was when the part was opened, into `bytes`; none if they are damaged.
    pub fn records(&self, number: usize, bytes: &mut Buffer, stored: &mut Buffer) -> io::Result<()> {
        match self.scan.blocks.get(number).map(|b: &Block| b.load(&self.source, bytes, stored)).transpose()? {
            Some(Loaded::Whole | Loaded::Partial) => {}
            _ => bytes.set_len(0),
        }
        Ok(())
    }

    fn add_schema(&mut self, schema: Schema) -> Option<String> {
        let id = schema.id;
        match self.schemas.get(&id) {
            _ if id == 0 => Some("a schema has the number 0".to_owned()),
            Some(known) if *known != schema => Some(format!("schema {id} is defined twice, differently")),
            Some(_) => None,
            None => {
                self.schemas.insert(id, schema);
                None
            }
        }
    }

    fn add_channel(&mut self, channel: Channel) -> Option<String> {
        let id = channel.id;
        if let Some(known) = self.channels.get(&id) {
            return (known.channel != channel).then(|| format!("channel {id} is defined twice, differently"));
        }
        if channel.schema_id != 0 && !self.schemas.contains_key(&channel.schema_id) {
            return Some(format!("channel {id} names schema {}, which is not there", channel.schema_id));
        }
        let purpose = Use::of(&channel);
        let topic = channel.metadata.get(TOPIC).unwrap_or(&channel.topic).clone();
        let schema_name = self.schemas.get(&channel.schema_id).map_or(String::new(), |s| s.name.clone());
        self.channels.insert(id, PartChannel { channel, topic, schema_name, purpose });
        None
    }
}

impl Use {
    fn of(channel: &Channel) -> Self {
        let shared = || Shared::from_entries(&channel.metadata);
        match channel.topic.as_str() {
            LOST_CHANNEL => return Self::Lost,
            CLOCK_CHANNEL => return Self::Clock,
            FRAMES_CHANNEL => return Self::Frames,
            _ => {}
        }
        if let Some(topic) = channel.metadata.get(COMPANION) {
            if topic.is_empty() {
                return Self::CompanionOfAll;
            }
            return Self::Companion { topic: topic.clone(), shared: shared() };
        }
        match channel.metadata.get("stillpoint.form").and_then(|name| Form::from_name(name)) {
            Some(form) => Self::Samples { form, shared: shared() },
            None => Self::Opaque,
        }
    }

    /// Incarnation and sequence of the sample that a message is, or stands beside. `None`: it is of no sample, or does
    /// not tell of which.
    pub fn number(&self, message: &Message<'_>) -> Result<Option<(u32, u64)>, Fault> {
        let envelope = Envelope::of(message);
        Ok(match self {
            Self::Samples { form: Form::Own, .. } => {
                let header = own_header(message.data)?;
                Some((header.incarnation, header.sequence))
            }
            Self::Samples { shared, .. } | Self::Companion { shared, .. } => {
                Some((shared.incarnation, shared.sequence(envelope)))
            }
            Self::CompanionOfAll | Self::Lost | Self::Clock | Self::Frames | Self::Opaque => None,
        })
    }
}

impl Envelope {
    pub fn of(message: &Message<'_>) -> Self {
        Self { sequence: message.sequence, publish_time: message.publish_time }
    }
}
