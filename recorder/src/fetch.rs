//! One sample out of a session, by its number.

use std::sync::Arc;

use stillpoint_samples::AlignedBytes;

use crate::error::SessionError;
use crate::file::{Buffer, Message, Record, next_record};
use crate::form::{Decoded, Envelope, Fault};
use crate::part::{PartChannel, Use};
use crate::session::{Place, SampleKey, Session};

/// A sample out of a session: its exact bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Number of its topic in [`Session::topics`].
    pub topic: usize,
    /// Incarnation of its producer.
    pub incarnation: u32,
    /// Its number on the topic.
    pub sequence: u64,
    /// Realtime at which it was recorded, ns since the epoch: for people, never compared.
    pub log_time: u64,
    /// `Header ++ Body ++ elements`, as it was in shared memory.
    pub sample: AlignedBytes,
}

impl Session {
    /// One sample; `None` where it was not kept, or its topic is of no kind of this build.
    ///
    /// # Errors
    /// It cannot be read, or is not what its channel promises.
    pub fn sample(
        &self,
        topic: usize,
        incarnation: u32,
        sequence: u64,
    ) -> Result<Option<Recorded>, SessionError> {
        self.look_at((topic, incarnation, sequence), |found, log_time| Recorded {
            topic,
            incarnation,
            sequence,
            log_time,
            sample: found.to_bytes(),
        })
    }

    /// Whether a sample was recorded with exactly these bytes, without a copy of it; `None` where it was not kept, or
    /// its topic is of no kind of this build.
    ///
    /// # Errors
    /// It cannot be read, or is not what its channel promises.
    pub fn holds(
        &self,
        topic: usize,
        incarnation: u32,
        sequence: u64,
        sample: &[u8],
    ) -> Result<Option<bool>, SessionError> {
        self.look_at((topic, incarnation, sequence), |found, _| found.is(sample))
    }

    fn look_at<T>(
        &self,
        key: SampleKey,
        look: impl FnOnce(&Decoded<'_>, u64) -> T,
    ) -> Result<Option<T>, SessionError> {
        let Some(place) = self.index.get(&key) else { return Ok(None) };
        let bytes = self.records(place.part, place.block)?;
        let mut at = place.start;
        match next_record(&bytes, &mut at) {
            Some((_, Ok(Record::Message(m)))) => {
                Ok(self.decode(*place, &m)?.map(|(_, found)| look(&found, m.log_time)))
            }
            _ => Ok(None),
        }
    }

    /// Whether the message at a place is what its channel promises: one of no sample, or the one that stands in the index
    /// for its sample.
    pub(crate) fn stands_at(&self, channel: &PartChannel, m: &Message<'_>, place: Place) -> bool {
        if !matches!(channel.purpose, Use::Samples { .. }) {
            return true;
        }
        let Ok(Some((incarnation, sequence))) = channel.purpose.number(m) else { return false };
        let Some(topic) = self.topic_number(&channel.topic) else { return false };
        self.index.get(&(topic, incarnation, sequence)) == Some(&place)
    }

    pub(crate) fn records(&self, part: u32, block: u32) -> Result<Arc<Buffer>, SessionError> {
        let p = &self.parts[part as usize];
        self.cache
            .get((part, block), |bytes, stored| p.records(block as usize, bytes, stored))
            .map_err(|cause| SessionError::Io { path: p.path.clone(), cause })
    }

    /// The sample of a message, and its name. `None`: it is no sample of a known kind, or another stands in the index for it.
    pub(crate) fn decode<'m>(
        &self,
        place: Place,
        m: &Message<'m>,
    ) -> Result<Option<(SampleKey, Decoded<'m>)>, SessionError> {
        let part = &self.parts[place.part as usize];
        let Some(channel) = part.channels.get(&m.channel) else { return Ok(None) };
        let Use::Samples { form, shared } = &channel.purpose else { return Ok(None) };
        let Some(topic) = self.topic_number(&channel.topic) else { return Ok(None) };
        let fault = |what: Fault| SessionError::Message {
            path: part.path.clone(),
            topic: channel.topic.clone(),
            offset: part.scan.blocks.get(place.block as usize).map_or(0, |b| b.offset),
            within: place.start,
            what: what.to_string(),
        };
        let Some((incarnation, sequence)) = channel.purpose.number(m).map_err(fault)? else {
            return Ok(None);
        };
        let key = (topic, incarnation, sequence);
        if self.index.get(&key) != Some(&place) {
            return Ok(None);
        }
        let sample = self.topics[topic].kind.decode(*form, shared, Envelope::of(m), m.data).map_err(fault)?;
        Ok(sample.map(|sample| (key, sample)))
    }
}
