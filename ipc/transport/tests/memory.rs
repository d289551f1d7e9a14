//! A transport in this process, right or with one fault: what the conformance body has to notice.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use stillpoint_samples::Pieces;
use stillpoint_transport::conformance::conforms;
use stillpoint_transport::{
    Carries, Channel, LinkRefusal, LinkState, Origin, Receiver, Sender, Transport, TransportError,
};

/// What is wrong with the transport.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    None,
    Reorders,
    Repeats,
    Cuts,
    TakesAnyType,
    SendsWhenClosed,
}

/// Samples that wait at the receiver.
const MOST_WAITING: usize = 4;

/// Whether a transport with this fault passes the conformance body.
pub fn conforms_with(fault: Fault) -> bool {
    let fresh = move || -> Box<dyn Transport> { Box::new(Memory { fault, line: Arc::default() }) };
    std::panic::catch_unwind(move || conforms(&fresh)).is_ok()
}

struct Memory {
    fault: Fault,
    line: Arc<Mutex<MemoryQueue>>,
}

/// What both ends share: the receiver that was opened last.
#[derive(Default)]
struct MemoryQueue {
    sent: Option<Channel>,
    taken: Option<Channel>,
    samples: VecDeque<Vec<u8>>,
    discarded: u64,
    refusal: Option<LinkRefusal>,
}

impl Transport for Memory {
    fn carries(&self) -> Carries {
        Carries::Samples
    }

    fn open_sender(&self, channel: &Channel) -> Result<Box<dyn Sender>, TransportError> {
        self.line.lock().unwrap().sent = Some(channel.clone());
        Ok(Box::new(End { fault: self.fault, line: self.line.clone(), is_closed: false }))
    }

    fn open_receiver(&self, channel: &Channel) -> Result<Box<dyn Receiver>, TransportError> {
        let mut line = self.line.lock().unwrap();
        line.taken = Some(channel.clone());
        line.refusal = None;
        line.samples.clear();
        Ok(Box::new(End { fault: self.fault, line: self.line.clone(), is_closed: false }))
    }
}

struct End {
    fault: Fault,
    line: Arc<Mutex<MemoryQueue>>,
    is_closed: bool,
}

impl Sender for End {
    fn send(&mut self, sample: Pieces<'_>) -> Result<(), TransportError> {
        let mut line = self.line.lock().unwrap();
        let line = &mut *line;
        if self.is_closed && self.fault != Fault::SendsWhenClosed {
            return Err(TransportError::Closed);
        }
        let (Some(sent), Some(taken)) = (&line.sent, &line.taken) else { return Ok(()) };
        let sample = sample.check(sent.kind).map_err(TransportError::Sample)?;
        if sent.name() != taken.name() && self.fault != Fault::TakesAnyType {
            let (found, expected) = (sent.name(), taken.name());
            line.refusal = Some(LinkRefusal::OtherChannel { peer: "memory".to_string(), found, expected });
            return Ok(());
        }
        let mut bytes = [sample.meta, sample.payload].concat();
        if bytes.len() > taken.longest() {
            let (bytes, longest) = (bytes.len(), taken.longest());
            line.refusal = Some(LinkRefusal::TooLong { peer: "memory".to_string(), bytes, longest });
            return Ok(());
        }
        if self.fault == Fault::Cuts && bytes.len() > 200 {
            bytes[100] ^= 1;
        }
        if line.samples.len() == MOST_WAITING {
            line.samples.pop_front();
            line.discarded += 1;
        }
        if self.fault == Fault::Repeats {
            line.samples.push_back(bytes.clone());
        }
        line.samples.push_back(bytes);
        Ok(())
    }

    fn state(&self) -> LinkState {
        if self.is_closed { LinkState::Closed } else { LinkState::Open }
    }

    fn close(&mut self) {
        self.is_closed = true;
    }
}

impl Receiver for End {
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError> {
        if self.is_closed {
            return Err(TransportError::Closed);
        }
        let mut line = self.line.lock().unwrap();
        let next = match self.fault {
            Fault::Reorders => line.samples.pop_back(),
            _ => line.samples.pop_front(),
        };
        let Some(next) = next else { return Ok(None) };
        *bytes = next;
        Ok(Some(Origin { sender: None }))
    }

    fn discarded(&mut self) -> u64 {
        std::mem::take(&mut self.line.lock().unwrap().discarded)
    }

    fn keeps_waiting(&self) -> bool {
        true
    }

    fn state(&self) -> LinkState {
        match (self.is_closed, &self.line.lock().unwrap().refusal) {
            (true, _) => LinkState::Closed,
            (false, Some(refusal)) => LinkState::Refused(refusal.clone()),
            (false, None) => LinkState::Open,
        }
    }

    fn close(&mut self) {
        self.is_closed = true;
    }
}
