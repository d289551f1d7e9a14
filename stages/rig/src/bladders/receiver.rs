//! The rig's end of the datagrams: orders to valves and beam, and what became of them.

use stillpoint_actuate::{Act, FarEnd, Key, Receives, Safe};
use stillpoint_samples::{FarEndDoing, FarEndElement, RigMode};

/// A far end that keeps account of itself.
#[derive(Clone, Debug)]
pub struct Orders {
    far_end: FarEnd,
    account: FarEndElement,
    duty: [f32; stillpoint_actuate::VALVES],
}

impl Orders {
    /// For a rig with this many valves. Before the first datagram it holds: a head that lies on its bladders is not let
    /// down before anybody asks for it.
    pub fn new(key: &Key, valves: usize) -> Self {
        let receives = Receives { idle: Safe::Hold, ..Receives::valves(valves) };
        Self {
            far_end: FarEnd::new(key, receives),
            account: FarEndElement::default(),
            duty: [0.0; stillpoint_actuate::VALVES],
        }
    }

    /// Takes bytes that arrive now, ns. What is refused is counted.
    pub fn receive(&mut self, bytes: &[u8], now: u64) {
        let before = self.far_end.valves().accepted;
        // Why it is refused stands in the counts.
        let _ = self.far_end.receive(bytes, now);
        if self.far_end.valves().accepted > before {
            self.account.arrived = now;
        }
    }

    /// What the valves do from now, ns, to the next tick, and their duties.
    pub fn step(&mut self, now: u64) -> (RigMode, &[f32]) {
        let doing = self.far_end.step(now);
        let counts = self.far_end.valves();
        let (mode, what) = match doing.valves {
            Act::Follow(duty) => {
                self.duty = duty;
                (RigMode::Driven, FarEndDoing::Following)
            }
            Act::Vent => (RigMode::Venting, FarEndDoing::Venting),
            Act::Hold if counts.accepted == 0 => (RigMode::Waiting, FarEndDoing::Holding),
            Act::Hold => (RigMode::Holding, FarEndDoing::Holding),
        };
        if self.account.doing != what as u32 || self.account.since == 0 {
            (self.account.doing, self.account.since) = (what as u32, now);
        }
        self.account.ends = self.far_end.valves_receiver().ends().unwrap_or(0);
        self.account.accepted = counts.accepted;
        self.account.missing = counts.missing;
        self.account.refused = counts.all_refused();
        self.account.refused_beam = self.far_end.beam().all_refused();
        self.account.beam = u32::from(doing.beam);
        (mode, &self.duty)
    }

    /// What it does since the last tick, and what became of the datagrams.
    pub fn account(&self) -> &FarEndElement {
        &self.account
    }
}
