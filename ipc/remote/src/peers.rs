//! What a host knows of the others.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use stillpoint_transport::{LinkRefusal, LinkState};

use crate::beat::{BeatError, MOST_PEERS, Sends};
use crate::clocks::Offsets;
use crate::sender::Confirmed;
use crate::{Beat, HostIdentity, Offset, Seen, names};

/// How long a peer may be silent before it counts as gone: three beats and a half.
pub const PEER_SILENCE: Duration = Duration::from_millis(350);
/// Messages about peers that wait to be read.
const MOST_EVENTS: usize = 64;

/// How a peer stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PeerState {
    /// Samples can flow.
    Here,
    /// Its beats do not arrive any more.
    Silent,
    /// It is there, but nothing is exchanged with it, for these reasons.
    Refused(Vec<String>),
}

/// Something that happened to the peers of a host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostEvent {
    /// What happened.
    pub text: String,
    /// Nothing is exchanged with a peer any more, or never was.
    pub is_fault: bool,
}

/// What is known of a peer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PeerReport {
    /// Its name.
    pub host: String,
    /// How it stands.
    pub state: PeerState,
    /// Its clock against the clock of this host.
    pub offset: Option<Offset>,
}

/// The other hosts.
pub struct Peers {
    host: String,
    incarnation: u64,
    identity: HostIdentity,
    table: BTreeMap<String, Peer>,
    events: VecDeque<HostEvent>,
    last_look: Instant,
    /// The reason for which the last message was no beat.
    malformed: Option<String>,
}

struct Peer {
    beat: Beat,
    /// When the beat arrived, ns of this host's clock.
    at: u64,
    arrived: Instant,
    is_alive: bool,
    /// What differs from this host.
    differences: Vec<String>,
    offsets: Offsets,
}

impl Peer {
    /// What the peer says of this host in its newest beat.
    fn of<'p>(&'p self, host: &str, incarnation: u64) -> Option<&'p Seen> {
        self.beat.seen.iter().find(|h| h.host == host && h.incarnation == incarnation)
    }
}

impl Peers {
    pub fn new(host: String, incarnation: u64, identity: HostIdentity) -> Self {
        Self {
            host,
            incarnation,
            identity,
            table: BTreeMap::new(),
            events: VecDeque::new(),
            last_look: Instant::now(),
            malformed: None,
        }
    }

    pub fn note(&mut self, text: String, is_fault: bool) {
        if self.events.len() < MOST_EVENTS {
            self.events.push_back(HostEvent { text, is_fault });
        }
    }

    /// Messages about peers since the last call.
    pub fn take_events(&mut self) -> Vec<HostEvent> {
        self.events.drain(..).collect()
    }

    /// Whether any peer is heard.
    pub fn is_any_alive(&self) -> bool {
        self.table.values().any(|p| p.is_alive)
    }

    /// Takes a beat that arrived under `key` at `now`, ns of this host's clock. Gives whether this host should answer at
    /// once.
    pub fn receive(&mut self, key: &str, bytes: &[u8], now: u64) -> bool {
        // What a peer may send is checked by key, so the key must name the host of the beat.
        let named = |beat: Beat| match key.rsplit('/').next() == Some(names::chunk(&beat.host).as_str()) {
            true => Ok(beat),
            false => Err(BeatError::Key(beat.host)),
        };
        let beat = match Beat::read(bytes).and_then(named) {
            Ok(beat) => beat,
            Err(error) => {
                let reason = error.to_string();
                if self.malformed.as_ref() != Some(&reason) {
                    self.note(format!("a message of another host is not understood: {reason}"), true);
                    self.malformed = Some(reason);
                }
                return false;
            }
        };
        if beat.host == self.host {
            if beat.incarnation != self.incarnation && self.malformed.is_none() {
                let host = &self.host;
                self.malformed = Some(String::new());
                let text =
                    format!("another program says that it is the host `{host}`: its messages are not used");
                self.note(text, true);
            }
            return false;
        }
        let known = self.table.get(&beat.host);
        if known.is_none() && self.table.len() >= MOST_PEERS && !self.forget_one() {
            let reason = format!("host `{}` is not taken: {MOST_PEERS} others are known", beat.host);
            if self.malformed.as_ref() != Some(&reason) {
                self.note(reason.clone(), true);
                self.malformed = Some(reason);
            }
            return false;
        }
        let known = self.table.get(&beat.host);
        // A life that ended, or a beat that was overtaken.
        if known.is_some_and(|p| {
            // The clock by which lives are numbered may be set back while a peer is away.
            (beat.incarnation < p.beat.incarnation && p.is_alive)
                || (beat.incarnation == p.beat.incarnation && beat.number <= p.beat.number)
        }) {
            return false;
        }
        let ends = |b: &Beat| -> Vec<u64> { b.sends.iter().map(|s| s.end).collect() };
        let edges = |b: &Beat| -> Vec<String> { b.takes.iter().map(|t| t.edge.clone()).collect() };
        let same_life = known.is_some_and(|p| p.beat.incarnation == beat.incarnation);
        let is_news = known.is_none_or(|p| {
            !same_life || !p.is_alive || ends(&p.beat) != ends(&beat) || edges(&p.beat) != edges(&beat)
        });
        let was_alive = same_life && known.is_some_and(|p| p.is_alive);
        let mut offsets =
            self.table.remove(&beat.host).filter(|_| same_life).map(|p| p.offsets).unwrap_or_default();
        let differences = self.identity.differences(&beat.identity);
        if let Some(own) = beat.seen.iter().find(|h| h.host == self.host && h.incarnation == self.incarnation)
        {
            offsets.add(own.at, beat.at.saturating_sub(own.held), beat.at, now);
        }
        if !was_alive {
            let host = &beat.host;
            let event = match differences.is_empty() {
                true => format!("host `{host}` is here"),
                false => format!("host `{host}` is refused: {}", differences.join("; ")),
            };
            self.note(event, !differences.is_empty());
        }
        let peer = Peer { at: now, arrived: Instant::now(), is_alive: true, differences, offsets, beat };
        self.table.insert(peer.beat.host.clone(), peer);
        is_news
    }

    /// Makes room by the peer that is silent for longest and has no edge, so that no count of samples is lost. Gives whether
    /// there was one.
    fn forget_one(&mut self) -> bool {
        let has_edge = |peer: &Peer| !(peer.beat.sends.is_empty() && peer.beat.takes.is_empty());
        let silent = self.table.values().filter(|peer| !peer.is_alive && !has_edge(peer));
        let Some(host) = silent.min_by_key(|peer| peer.arrived).map(|peer| peer.beat.host.clone()) else {
            return false;
        };
        self.table.remove(&host).is_some()
    }

    /// Counts peers as gone whose beats do not arrive. Gives whether one is gone since the last look.
    pub fn look(&mut self) -> bool {
        let now = Instant::now();
        // While this host itself stood still, no beat could be read: that time does not count.
        let pause = now.saturating_duration_since(self.last_look).saturating_sub(Duration::from_millis(75));
        self.last_look = now;
        let mut gone = Vec::new();
        for peer in self.table.values_mut().filter(|p| p.is_alive) {
            peer.arrived = (peer.arrived + pause).min(now);
            if now.saturating_duration_since(peer.arrived) > PEER_SILENCE {
                peer.is_alive = false;
                gone.push(peer.beat.host.clone());
            }
        }
        for host in &gone {
            let silence = PEER_SILENCE.as_millis();
            self.note(format!("host `{host}` is silent for more than {silence} ms"), true);
        }
        !gone.is_empty()
    }

    /// What a beat says of the peers that this host hears.
    pub fn seen(&self, now: u64) -> Vec<Seen> {
        let alive = self.table.values().filter(|p| p.is_alive);
        alive
            .map(|p| Seen {
                host: p.beat.host.clone(),
                incarnation: p.beat.incarnation,
                number: p.beat.number,
                at: p.beat.at,
                held: now.saturating_sub(p.at),
                refused: p.differences.clone(),
            })
            .collect()
    }

    /// Every peer that was ever heard.
    pub fn reports(&self, now: u64) -> Vec<PeerReport> {
        let report = |p: &Peer| PeerReport {
            host: p.beat.host.clone(),
            state: match (p.is_alive, p.differences.is_empty()) {
                (false, _) => PeerState::Silent,
                (true, true) => PeerState::Here,
                (true, false) => PeerState::Refused(p.differences.clone()),
            },
            offset: p.offsets.best(now),
        };
        self.table.values().map(report).collect()
    }

    /// The clock of a peer.
    pub fn offset(&self, host: &str, now: u64) -> Option<Offset> {
        self.table.get(host)?.offsets.best(now)
    }

    /// How a sending end stands that was announced in the beat of this number.
    pub fn of_sender(&self, edge: &str, channel: &str, announced: u64) -> LinkState {
        let mut state = LinkState::Waiting;
        for peer in self.table.values().filter(|p| p.is_alive) {
            let Some(takes) = peer.beat.takes.iter().find(|t| t.edge == edge) else { continue };
            if let Some(refusal) = self.refusal(peer, &takes.channel, channel) {
                state = LinkState::Refused(refusal);
            } else if peer.of(&self.host, self.incarnation).is_some_and(|h| h.number >= announced) {
                return LinkState::Open;
            }
        }
        state
    }

    /// What the peer that takes the samples of a sending end says of them.
    pub fn confirmed(&self, edge: &str, end: u64) -> Option<Confirmed> {
        self.table.values().find_map(|peer| {
            let takes = peer.beat.takes.iter().find(|t| t.edge == edge && t.from == end)?;
            Some(Confirmed {
                incarnation: peer.beat.incarnation,
                received: takes.received,
                refused: takes.refused,
            })
        })
    }

    /// How a taking end stands, and the sending ends from which it takes with what they have put.
    pub fn of_receiver(&self, edge: &str, channel: &str) -> (LinkState, Vec<(String, Sends)>) {
        let mut state = LinkState::Waiting;
        let mut accepted = Vec::new();
        for peer in self.table.values() {
            for sends in peer.beat.sends.iter().filter(|s| s.edge == edge) {
                match self.refusal(peer, &sends.channel, channel) {
                    Some(refusal) if peer.is_alive && accepted.is_empty() => {
                        state = LinkState::Refused(refusal)
                    }
                    Some(_) => {}
                    None => {
                        accepted.push((peer.beat.host.clone(), sends.clone()));
                        if peer.is_alive {
                            state = LinkState::Open;
                        }
                    }
                }
            }
        }
        (state, accepted)
    }

    /// Why nothing passes between an end of a peer and one of this host.
    fn refusal(&self, peer: &Peer, there: &str, here: &str) -> Option<LinkRefusal> {
        let host = &peer.beat.host;
        if !peer.differences.is_empty() {
            return Some(LinkRefusal::Other(format!(
                "host `{host}` is refused: {}",
                peer.differences.join("; ")
            )));
        }
        if let Some(of_us) = peer.of(&self.host, self.incarnation)
            && !of_us.refused.is_empty()
        {
            return Some(LinkRefusal::Other(format!(
                "host `{host}` refuses this host: {}",
                of_us.refused.join("; ")
            )));
        }
        (there != here).then(|| LinkRefusal::OtherChannel {
            peer: host.clone(),
            found: there.to_owned(),
            expected: here.to_owned(),
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn beat(host: &str, edges: usize) -> (String, Vec<u8>) {
        let sends = (0..edges)
            .map(|n| Sends { edge: n.to_string(), channel: "depth".to_owned(), end: 1, put: 1 })
            .collect();
        let beat = Beat {
            protocol: crate::beat::PROTOCOL,
            host: host.to_owned(),
            incarnation: 1,
            number: 1,
            identity: HostIdentity::default(),
            at: 0,
            seen: Vec::new(),
            sends,
            takes: Vec::new(),
        };
        (format!("beat/{}", names::chunk(host)), beat.to_bytes())
    }

    #[test]
    fn a_peer_that_is_gone_makes_room_for_another_unless_its_samples_are_counted() {
        let mut peers = Peers::new("me".to_owned(), 1, HostIdentity::default());
        let greet = |peers: &mut Peers, host: &str, edges| {
            let (key, bytes) = beat(host, edges);
            peers.receive(&key, &bytes, 0);
            peers.table.contains_key(host)
        };
        for number in 0..MOST_PEERS {
            assert!(greet(&mut peers, &format!("host-{number}"), usize::from(number == 0)));
        }
        assert!(!greet(&mut peers, "late", 0), "all are alive");
        assert!(peers.take_events().last().unwrap().text.contains("host `late` is not taken"));
        for peer in peers.table.values_mut() {
            peer.is_alive = false;
        }
        for number in 0..2 * MOST_PEERS {
            assert!(greet(&mut peers, &format!("new-{number}"), 0), "{number}");
            peers.table.get_mut(&format!("new-{number}")).unwrap().is_alive = false;
        }
        assert!(peers.table.contains_key("host-0"), "its samples are counted");
    }
}
