//! Valves and beam at the far end, locked to each other: the beam is off before anything vents.

use crate::acknowledgement::{Acknowledgement, PRESSURES};
use crate::datagram::receiving;
use crate::key::Key;
use crate::message::{Receiving, Session};
use crate::receiver::{Act, Receiver, Receives};
use crate::refusal::{Counts, DatagramRefusal};

/// What valves and beam are to do now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doing {
    pub valves: Act,
    /// Whether the beam may be on.
    pub beam: bool,
}

/// Takes datagrams for valves and beam. The beam is on only while its lease is valid **and** the valves follow valid
/// orders. If the valves are to vent, they hold in the first step and vent from the next step on, after the beam is
/// off. So a sender that dies ends the beam at the valves' deadline, even if its lease would last longer.
#[derive(Clone, Debug)]
pub struct FarEnd {
    valves: Receiver,
    beam: Receiver,
    was_on: bool,
}

impl FarEnd {
    /// A far end with this many valves, and clocks as `receives` says.
    #[must_use]
    pub fn new(key: &Key, receives: Receives) -> Self {
        let beam = Receives { clock: receives.clock, ..Receives::beam() };
        Self {
            valves: Receiver::new(key.clone(), receives),
            beam: Receiver::new(key.clone(), beam),
            was_on: false,
        }
    }

    /// Takes bytes that arrived at `arrival`, ns.
    ///
    /// # Errors
    /// Why they are refused; it is counted.
    pub fn receive(&mut self, bytes: &[u8], arrival: u64) -> Result<Receiving, DatagramRefusal> {
        let receiver = match receiving(bytes) {
            Some(Receiving::Beam) => &mut self.beam,
            // What is for nobody is the valves' to count.
            _ => &mut self.valves,
        };
        receiver.receive(bytes, arrival).map(|message| message.receiving)
    }

    /// What is to be done from `now`, ns, to the next step. Steps are of the far end's own period.
    pub fn step(&mut self, now: u64) -> Doing {
        let valves = self.valves.act(now);
        let follows = matches!(valves, Act::Follow(_));
        let beam = follows && matches!(self.beam.act(now), Act::Follow(_));
        let valves = match valves {
            Act::Vent if self.was_on => Act::Hold,
            act => act,
        };
        self.was_on = beam;
        Doing { valves, beam }
    }

    /// What the sender is told at `now`, ns, of what is done since the last step. `far` is the session of this far end.
    #[must_use]
    pub fn acknowledgement(&self, doing: &Doing, far: Session, number: u64, now: u64) -> Acknowledgement {
        let (last, counts) = (self.valves.last(), self.valves.counts());
        Acknowledgement {
            doing: doing.valves.doing(),
            beam: doing.beam,
            session: last.map_or(Session::default(), |last| last.session),
            sequence: last.map_or(0, |last| last.sequence),
            order_stamp: last.map_or(0, |last| last.stamp),
            accepted: counts.in_session,
            refused: counts.all_refused(),
            far,
            number,
            stamp: now,
            bladders: 0,
            pressure: [0.0; PRESSURES],
        }
    }

    /// Counts of the datagrams for the valves, and of those without a known recipient.
    #[must_use]
    pub fn valves(&self) -> &Counts {
        self.valves.counts()
    }

    /// What became of the beam's datagrams.
    #[must_use]
    pub fn beam(&self) -> &Counts {
        self.beam.counts()
    }

    /// The receiver of the valves' datagrams.
    #[must_use]
    pub fn valves_receiver(&self) -> &Receiver {
        &self.valves
    }

    /// The receiver of the beam's datagrams.
    #[must_use]
    pub fn beam_receiver(&self) -> &Receiver {
        &self.beam
    }
}
