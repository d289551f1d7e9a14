//! A transport of your own: samples pass between two threads, in memory. One to another program has the same two ends.
//! `stillpoint_transport::conformance::conforms` says what every transport has to do; a test runs it on this one.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use stillpoint_samples::Pieces;
use stillpoint_transport::*;

/// Samples that wait for the receiver. No sender waits, so a newer sample displaces the oldest.
const MOST_WAITING: usize = 4;

#[derive(Clone, Default)]
pub struct Memory(Arc<Mutex<Link>>);

#[derive(Default)]
struct Link {
    receiver: Option<Channel>,
    waiting: VecDeque<Vec<u8>>,
    discarded: u64,
    refusal: Option<LinkRefusal>,
}

/// The sender's or the receiver's end, until it is closed.
struct End(Option<Memory>, Channel);

impl End {
    /// Does something with the link; a closed end does nothing. A thread that panicked elsewhere leaves the link whole.
    fn with<T>(&self, work: impl FnOnce(&mut Link) -> T) -> Result<T, TransportError> {
        let memory = self.0.as_ref().ok_or(TransportError::Closed)?;
        Ok(work(&mut memory.0.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

impl Transport for Memory {
    fn carries(&self) -> Carries {
        Carries::Samples
    }
    fn open_sender(&self, channel: &Channel) -> Result<Box<dyn Sender>, TransportError> {
        Ok(Box::new(End(Some(self.clone()), channel.clone())))
    }
    fn open_receiver(&self, channel: &Channel) -> Result<Box<dyn Receiver>, TransportError> {
        let end = End(Some(self.clone()), channel.clone());
        end.with(|link| *link = Link { receiver: Some(channel.clone()), ..Link::default() })?;
        Ok(Box::new(end))
    }
}

impl Sender for End {
    fn send(&mut self, sample: Pieces<'_>) -> Result<(), TransportError> {
        // Lengths are compared with the header before a byte is copied.
        let Pieces { meta, payload } = sample.check(self.1.kind).map_err(TransportError::Sample)?;
        let bytes = [meta, payload].concat();
        self.with(|link| {
            let Some(receiver) = &link.receiver else { return };
            let (found, expected, longest) = (self.1.name(), receiver.name(), receiver.longest());
            // Another type, layout or frame: its bytes would be read as something else.
            if found != expected {
                link.refusal = Some(LinkRefusal::OtherChannel { peer: "here".into(), found, expected });
            } else if bytes.len() > longest {
                link.refusal = Some(LinkRefusal::TooLong { peer: "me".into(), bytes: bytes.len(), longest });
            } else {
                link.waiting.push_back(bytes);
                let surplus = link.waiting.len().saturating_sub(MOST_WAITING);
                link.discarded += link.waiting.drain(..surplus).count() as u64;
            }
        })
    }
    fn state(&self) -> LinkState {
        self.with(|_| LinkState::Open).unwrap_or(LinkState::Closed)
    }
    fn close(&mut self) {
        self.0 = None;
    }
}

impl Receiver for End {
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError> {
        let Some(next) = self.with(|link| link.waiting.pop_front())? else { return Ok(None) };
        *bytes = next;
        Ok(Some(Origin { sender: None }))
    }
    fn discarded(&mut self) -> u64 {
        self.with(|link| std::mem::take(&mut link.discarded)).unwrap_or(0)
    }
    fn keeps_waiting(&self) -> bool {
        true
    }
    fn state(&self) -> LinkState {
        let state = |link: &mut Link| link.refusal.clone().map_or(LinkState::Open, LinkState::Refused);
        self.with(state).unwrap_or(LinkState::Closed)
    }
    fn close(&mut self) {
        self.0 = None;
    }
}
