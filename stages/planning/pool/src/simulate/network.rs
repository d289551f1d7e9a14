//! Hosts with a link each, and messages under way.
//!
//! Every host has a link of the same bandwidth in each direction to a switch that never is the narrowest part. The first worker
//! listens, and messages between other hosts pass it, as in the pool. Messages above 16 KiB follow each other on a link; shorter
//! ones overtake them, as on the two connections of the pool.

use std::collections::BTreeMap;

/// Longest message that overtakes others, bytes.
const SMALL: usize = 16 << 10;

/// The network between hosts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Network {
    /// Bandwidth of the link of each host in each direction, bit/s.
    pub bits_per_s: f64,
    /// Time of a message without its bytes, ns.
    pub delay: u64,
}

/// Who sends and takes messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Node {
    /// A client, by its place.
    Client(usize),
    /// A worker, by its place.
    Worker(usize),
}

/// A message under way.
pub struct Posted {
    /// Who sent it.
    pub from: Node,
    /// To whom it goes.
    pub to: Node,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// When the two directions of the link of a host are free, ns.
#[derive(Clone, Copy, Default)]
struct Link {
    up: u64,
    down: u64,
}

/// The links, and what happens next.
pub struct Links<H> {
    network: Network,
    /// The host of the clients, then those of the workers.
    links: Vec<Link>,
    sent: u64,
    received: u64,
    number: u64,
    /// By time and number.
    happenings: BTreeMap<(u64, u64), H>,
}

impl<H> Links<H> {
    /// Of one host for all clients, and one for each worker.
    pub fn new(network: Network, workers: usize) -> Self {
        let links = vec![Link::default(); 1 + workers.max(1)];
        Self { network, links, sent: 0, received: 0, number: 0, happenings: BTreeMap::new() }
    }

    /// Bytes that the host of the clients sent and received.
    pub fn of_clients(&self) -> (u64, u64) {
        (self.sent, self.received)
    }

    /// Something happens at a time.
    pub fn at(&mut self, time: u64, happening: H) {
        self.number += 1;
        self.happenings.insert((time, self.number), happening);
    }

    /// Something that was to happen waits until a time, with its number.
    pub fn put_off(&mut self, time: u64, number: u64, happening: H) {
        self.happenings.insert((time, number), happening);
    }

    /// What happens next, with its time and number.
    pub fn next(&mut self) -> Option<(u64, u64, H)> {
        self.happenings.pop_first().map(|((time, number), happening)| (time, number, happening))
    }

    /// A message is sent at a time.
    pub fn post(&mut self, at: u64, posted: Posted, arrival: impl FnOnce(Posted) -> H) {
        let bytes = posted.bytes.len();
        match (posted.from, posted.to) {
            (Node::Client(_), _) => self.sent += bytes as u64,
            (_, Node::Client(_)) => self.received += bytes as u64,
            _ => {}
        }
        let span = (bytes as f64 * 8e9 / self.network.bits_per_s) as u64;
        let (from, to) = (host(posted.from), host(posted.to));
        let passes = from != ROUTER && to != ROUTER;
        let hops = if passes { vec![(from, ROUTER), (ROUTER, to)] } else { vec![(from, to)] };
        let arrives = hops.into_iter().fold(at, |at, (from, to)| match bytes <= SMALL {
            true => at + span + self.network.delay,
            false => self.carry(at, span, (from, to)),
        });
        self.at(arrives, arrival(posted));
    }

    /// A long message goes from one host to another: when it is there.
    fn carry(&mut self, at: u64, span: u64, (from, to): (usize, usize)) -> u64 {
        let up = &mut self.links[from].up;
        *up = at.max(*up) + span;
        let sent = *up + self.network.delay;
        let down = &mut self.links[to].down;
        *down = sent.max(*down + span);
        *down
    }
}

/// The host of the first worker.
const ROUTER: usize = 1;

fn host(node: Node) -> usize {
    match node {
        Node::Client(_) => 0,
        Node::Worker(place) => 1 + place,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn posted(from: Node, to: Node, bytes: usize) -> Posted {
        Posted { from, to, bytes: vec![0; bytes] }
    }

    #[test]
    fn long_messages_share_a_link_and_short_ones_overtake_them() {
        let network = Network { bits_per_s: 8e6, delay: 1000 };
        let mut links = Links::new(network, 2);
        let [client, one, two] = [Node::Client(0), Node::Worker(0), Node::Worker(1)];
        // 100 kB take 0.1 s on each link of 1 MB/s.
        links.post(0, posted(one, client, 100_000), |posted| posted);
        links.post(0, posted(one, client, 100_000), |posted| posted);
        links.post(0, posted(one, client, 1000), |posted| posted);
        links.post(0, posted(client, one, 100_000), |posted| posted);
        // By the first worker: one hop more, behind what it sends and takes itself.
        links.post(0, posted(client, two, 1000), |posted| posted);
        links.post(0, posted(two, client, 100_000), |posted| posted);
        let order: Vec<(u64, usize)> =
            std::iter::from_fn(|| links.next()).map(|(at, _, posted)| (at, posted.bytes.len())).collect();
        let long = 100_000_000;
        assert_eq!(
            order,
            [
                (1_001_000, 1000),
                (2_002_000, 1000),
                (long + 1000, 100_000),
                (long + 1000, 100_000),
                (2 * long + 1000, 100_000),
                (3 * long + 2000, 100_000),
            ]
        );
        assert_eq!(links.of_clients(), (101_000, 301_000));
    }
}
