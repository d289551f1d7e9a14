//! The samples on their way to one input: sent, arrived, pushed out by newer ones.

use std::collections::VecDeque;

use stillpoint_samples::Header;

use crate::operator::Policy;

/// The samples on their way to one input.
pub struct Waiting {
    depth: usize,
    /// Sent, not arrived: (time of arrival, header).
    in_transit: VecDeque<(u64, Header)>,
    arrived: VecDeque<Header>,
}

impl Waiting {
    /// None yet, for an input of this policy.
    pub fn of(policy: Policy) -> Self {
        Self { depth: depth_of(policy), in_transit: VecDeque::new(), arrived: VecDeque::new() }
    }

    /// A sample is sent, and arrives at this time, ns.
    pub fn send(&mut self, arrival: u64, header: Header) {
        self.in_transit.push_back((arrival, header));
    }

    /// When the next sample arrives.
    pub fn next_arrival(&self) -> Option<u64> {
        self.in_transit.front().map(|(arrival, _)| *arrival)
    }

    /// Moves what has arrived by `time` into the bounded queue; the oldest goes where it is full. Says whether anything
    /// came.
    pub fn arrive(&mut self, time: u64) -> bool {
        let mut any = false;
        while let Some((_, header)) = self.in_transit.pop_front_if(|(arrival, _)| *arrival <= time) {
            if self.arrived.len() >= self.depth {
                self.arrived.pop_front();
            }
            self.arrived.push_back(header);
            any = true;
        }
        any
    }

    /// The oldest sample that has arrived.
    pub fn take(&mut self) -> Option<Header> {
        self.arrived.pop_front()
    }

    /// Takes away what was sent before a time.
    pub fn forget_before(&mut self, time: u64) {
        self.arrived.clear();
        self.in_transit.retain(|(arrival, _)| *arrival >= time);
    }
}

/// How many samples wait on an input at most.
pub fn depth_of(policy: Policy) -> usize {
    match policy {
        Policy::Queue(n) => n as usize,
        // Only the newest counts; a few more, so that a delayed one is not pushed out by those behind it.
        Policy::Latest => 4,
        Policy::Sync { .. } => 8,
    }
}
