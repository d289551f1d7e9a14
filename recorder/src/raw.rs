//! The messages of a session as they stand in the file, for tools that show a topic by its schema.

use crate::error::SessionError;
use crate::file::{Record, next_record};
use crate::part::PartChannel;
use crate::session::Session;

/// A message as it stands in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawMessage<'a> {
    /// Its topic; channels that are no topic of the session have names that start with `/`.
    pub topic: &'a str,
    /// Name of its schema; empty where the channel has none.
    pub schema_name: &'a str,
    /// `ros2msg` text of its schema.
    pub schema: &'a [u8],
    /// Realtime at which it was recorded, ns since the epoch.
    pub log_time: u64,
    /// Its bytes: CDR with its 4-byte header.
    pub data: Vec<u8>,
}

impl Session {
    /// The messages of the topics that `choose` says yes to, in the order of recording, one chunk in memory at a time.
    /// Unlike [`Session::samples`] it leaves out no topic and decodes none.
    pub fn messages<'a>(
        &'a self,
        choose: impl Fn(&str) -> bool + 'a,
    ) -> impl Iterator<Item = Result<RawMessage<'a>, SessionError>> + 'a {
        let blocks = self.parts.iter().zip(0..).flat_map(|(p, part)| {
            let count = p.scan.blocks.len() as u32;
            (0..count).map(move |block| (p, part, block))
        });
        blocks.flat_map(move |(p, part, block)| {
            let bytes = match self.records(part, block) {
                Ok(bytes) => bytes,
                Err(e) => return vec![Err(e)],
            };
            let mut found = Vec::new();
            let mut at = 0;
            while let Some((_, record)) = next_record(&bytes, &mut at) {
                let Ok(Record::Message(m)) = record else { continue };
                let Some(PartChannel { topic, channel, .. }) = p.channels.get(&m.channel) else { continue };
                if choose(topic) {
                    let schema = p.schemas.get(&channel.schema_id);
                    found.push(Ok(RawMessage {
                        topic,
                        schema_name: schema.map_or("", |s| &s.name),
                        schema: schema.map_or(&[], |s| &s.data),
                        log_time: m.log_time,
                        data: m.data.to_vec(),
                    }));
                }
            }
            found
        })
    }
}
