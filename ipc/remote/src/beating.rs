//! The thread that beats, acknowledges, and looks for silent peers.

use std::sync::PoisonError;
use std::time::{Duration, Instant};

use zenoh::Wait;

use crate::Beat;
use crate::beat::{PROTOCOL, Sends, Takes};
use crate::sender::Outgoing;
use crate::shared::{Shared, lock};

/// Period of the beats.
const BEAT: Duration = Duration::from_millis(100);
/// The least time between two beats.
const LEAST: Duration = Duration::from_millis(5);
/// How often silent peers are looked for.
const LOOK: Duration = Duration::from_millis(25);
impl Shared {
    /// The body of the thread that beats, acknowledges, and looks for silent peers.
    pub fn beat(&self) {
        let mut next = Instant::now();
        loop {
            let due = lock(&self.due);
            let wait = next.saturating_duration_since(Instant::now()).min(LOOK);
            let is_idle = !due.beat && !due.is_closed && due.acknowledge.is_empty() && !wait.is_zero();
            let mut due = match is_idle {
                true => self.signal.wait_timeout(due, wait).unwrap_or_else(PoisonError::into_inner).0,
                false => due,
            };
            let acknowledge = std::mem::take(&mut due.acknowledge);
            let (is_closed, is_early) = (due.is_closed, std::mem::take(&mut due.beat));
            drop(due);
            if !acknowledge.is_empty() {
                let pairs =
                    acknowledge.iter().flat_map(|(end, number)| [end.to_le_bytes(), number.to_le_bytes()]);
                let bytes: Vec<u8> = pairs.flatten().collect();
                let _ = self.acknowledgements.put(bytes).wait();
            }
            if is_closed {
                // The last counts.
                self.put_beat();
                return;
            }
            if lock(&self.peers).look() {
                self.refresh();
            }
            let now = Instant::now();
            if now >= next {
                self.put_beat();
                next = now + BEAT;
            } else if is_early {
                next = next.min(now + LEAST);
            }
        }
    }

    fn put_beat(&self) {
        let bytes = {
            let mut ends = lock(&self.ends);
            ends.number += 1;
            let now = Instant::now();
            ends.closed.retain(|(until, _)| *until > now);
            let open = ends.outgoing.iter().map(|o| sends(o));
            let takes = ends.incoming.iter().map(|i| {
                let (from, received, refused) = i.from();
                Takes { edge: i.edge.clone(), channel: i.channel.clone(), from, received, refused }
            });
            let at = self.now();
            Beat {
                protocol: PROTOCOL,
                host: self.settings.name.clone(),
                incarnation: self.settings.incarnation,
                number: ends.number,
                identity: self.settings.identity.clone(),
                at,
                seen: lock(&self.peers).seen(at),
                sends: open.chain(ends.closed.iter().map(|(_, s)| s.clone())).collect(),
                takes: takes.collect(),
            }
            .to_bytes()
        };
        let _ = self.beats.put(bytes).wait();
    }
}

/// What a beat tells of a sending end.
pub fn sends(outgoing: &Outgoing) -> Sends {
    let put = outgoing.sent().put;
    Sends { edge: outgoing.edge.clone(), channel: outgoing.channel.clone(), end: outgoing.end, put }
}
