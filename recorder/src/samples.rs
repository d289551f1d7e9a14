//! The samples of a session in the order of recording.

use std::sync::Arc;

use crate::error::SessionError;
use crate::fetch::Recorded;
use crate::file::{Buffer, Record, next_record};
use crate::part::Use;
use crate::session::{Place, Session, Topic};

/// Walks over the samples of a session.
pub struct Samples<'a> {
    session: &'a Session,
    /// Topics to give.
    chosen: Vec<bool>,
    place: Place,
    /// The records of the block, once it is read.
    bytes: Option<Arc<Buffer>>,
}

impl Session {
    /// All samples in the order of recording, one chunk in memory at a time.
    pub fn samples(&self) -> Samples<'_> {
        self.samples_where(|_| true)
    }

    /// The samples of the topics that `choose` says yes to, in the order of recording.
    pub fn samples_where(&self, choose: impl Fn(&Topic) -> bool) -> Samples<'_> {
        let chosen = self.topics.iter().map(|t| t.kind.kind().is_some() && choose(t)).collect();
        Samples::new(self, chosen)
    }
}

impl<'a> Samples<'a> {
    fn new(session: &'a Session, chosen: Vec<bool>) -> Self {
        Self { session, chosen, place: Place { part: 0, block: 0, start: 0 }, bytes: None }
    }

    /// Moves to the next block that there is, and reads it.
    fn block(&mut self) -> Result<Option<Arc<Buffer>>, SessionError> {
        if let Some(bytes) = &self.bytes {
            return Ok(Some(Arc::clone(bytes)));
        }
        while let Some(part) = self.session.parts.get(self.place.part as usize) {
            if (self.place.block as usize) < part.scan.blocks.len() {
                let bytes = self.session.records(self.place.part, self.place.block)?;
                self.bytes = Some(Arc::clone(&bytes));
                return Ok(Some(bytes));
            }
            self.place = Place { part: self.place.part + 1, block: 0, start: 0 };
        }
        Ok(None)
    }

    fn skip_block(&mut self) {
        self.bytes = None;
        self.place = Place { block: self.place.block + 1, start: 0, ..self.place };
    }

    fn is_chosen(&self, channel: u16) -> bool {
        self.session.parts[self.place.part as usize].channels.get(&channel).is_some_and(|c| {
            matches!(c.purpose, Use::Samples { .. })
                && self.session.topic_number(&c.topic).is_some_and(|n| self.chosen[n])
        })
    }
}

impl Iterator for Samples<'_> {
    type Item = Result<Recorded, SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let bytes = match self.block() {
                Ok(bytes) => bytes?,
                Err(e) => {
                    self.skip_block();
                    return Some(Err(e));
                }
            };
            let place = self.place;
            match next_record(&bytes, &mut self.place.start) {
                None => self.skip_block(),
                Some((_, Ok(Record::Message(m)))) if self.is_chosen(m.channel) => {
                    match self.session.decode(place, &m) {
                        Ok(None) => {}
                        Err(e) => return Some(Err(e)),
                        Ok(Some(((topic, incarnation, sequence), found))) => {
                            let sample = found.to_bytes();
                            let log_time = m.log_time;
                            return Some(Ok(Recorded { topic, incarnation, sequence, log_time, sample }));
                        }
                    }
                }
                Some(_) => {}
            }
        }
    }
}
