//! Messages that reach sources from outside the pipeline in a live run.

use std::collections::{BTreeMap, VecDeque};
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use stillpoint_samples::{Command, SettingElement};

/// Datagrams that may wait for their operator; a burst beyond them costs the oldest.
pub const MOST_DATAGRAMS: usize = 256;
/// Datagrams of one sender, an address with a port, that may wait; more cost its own oldest.
pub const MOST_FROM_ONE: usize = 16;
/// Datagrams of one address that may wait; more cost the oldest of that port of it which sent most, so that a flood from
/// many ports of one machine pushes out nobody else, on that machine neither.
pub const MOST_FROM_ADDRESS: usize = 64;
/// Senders whose datagrams are counted.
const MOST_SENDERS: usize = 512;
/// Addresses whose surplus is counted each by itself; that of others counts for the unspecified address.
const MOST_ADDRESSES: usize = 16;

/// Messages that reach an operator from outside.
#[derive(Clone, Default)]
pub struct Outside {
    /// Commands of people, for a console.
    pub inbox: Inbox,
    /// Datagrams or samples from other processes and machines, for the far end of a link; `None` where nothing comes over
    /// a wire.
    pub arrivals: Option<Arrivals>,
}

/// What a person sends to a console.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// A command.
    Command(Command),
    /// A change of a live parameter.
    Setting(SettingElement),
}

/// Messages that arrived from people and were not sent on yet. Executors fill it; only a console takes from it.
#[derive(Clone, Default)]
pub struct Inbox(Arc<Mutex<VecDeque<Message>>>);

impl Inbox {
    /// Adds a message.
    pub fn put(&self, message: Message) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push_back(message);
    }

    /// The oldest message.
    pub fn take(&self) -> Option<Message> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
    }
}

/// The clock of the host from which samples come, against the clock of this session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockOffset {
    /// Time there minus time here, ns.
    pub offset: i64,
    /// The offset is at most this far from the true one, ns.
    pub uncertainty: i64,
}

impl ClockOffset {
    /// A time of the other host as a time of this session, ns.
    pub fn here(&self, there: u64) -> u64 {
        let here = i128::from(there) - i128::from(self.offset);
        u64::try_from(here).unwrap_or(if here < 0 { 0 } else { u64::MAX })
    }
}

/// Datagrams or samples that arrived and were not taken yet.
#[derive(Clone)]
pub struct Arrivals {
    waiting: Arc<Mutex<Waiting>>,
    most: usize,
}

#[derive(Default)]
struct Waiting {
    /// Who sent each is known for datagrams.
    datagrams: VecDeque<(Option<SocketAddr>, Vec<u8>)>,
    /// Buffers to be used again.
    spare: Vec<Vec<u8>>,
    dropped: u64,
    foreign: u64,
    /// How many came from each address above what one may send.
    above: BTreeMap<IpAddr, u64>,
    /// How many came of each sender since all were taken.
    came: Vec<(SocketAddr, u32)>,
    clock: Option<ClockOffset>,
}

impl Waiting {
    /// Counts a datagram of a sender.
    fn count(&mut self, sender: SocketAddr) {
        let is_full = self.came.len() >= MOST_SENDERS;
        match self.came.iter_mut().find(|(s, _)| *s == sender) {
            Some((_, count)) => *count = count.saturating_add(1),
            // A sender that is not counted is one of a flood.
            None if is_full => {}
            None => self.came.push((sender, 1)),
        }
    }

    fn came(&self, sender: SocketAddr) -> u32 {
        self.came.iter().find(|(s, _)| *s == sender).map_or(u32::MAX, |(_, count)| *count)
    }

    fn of_address(&self, address: IpAddr) -> usize {
        self.datagrams.iter().filter(|(s, _)| s.is_some_and(|s| s.ip() == address)).count()
    }

    /// The oldest datagram of the sender at an address that sent most since all were taken; of several, of the one that
    /// sent last.
    fn oldest_of_loudest(&self, address: IpAddr) -> Option<usize> {
        let senders = self.datagrams.iter().filter_map(|(s, _)| *s).filter(|s| s.ip() == address);
        let (_, loudest) = senders.enumerate().max_by_key(|(n, s)| (self.came(*s), *n))?;
        self.datagrams.iter().position(|(s, _)| *s == Some(loudest))
    }

    /// Which datagram goes when one of this sender comes, if any.
    fn victim(&self, sender: Option<SocketAddr>, most: usize) -> Option<usize> {
        if let Some(sender) = sender {
            let of_sender = self.datagrams.iter().filter(|(s, _)| *s == Some(sender)).count();
            if of_sender >= MOST_FROM_ONE {
                return self.datagrams.iter().position(|(s, _)| *s == Some(sender));
            }
            if self.of_address(sender.ip()) >= MOST_FROM_ADDRESS {
                return self.oldest_of_loudest(sender.ip());
            }
        }
        (self.datagrams.len() >= most).then_some(0)
    }
}

impl Arrivals {
    /// Room for so many; what comes on top costs the oldest.
    pub fn at_most(most: usize) -> Self {
        Self { waiting: Arc::default(), most }
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds one, of this sender where it is known, and exchanges its buffer for one that is free.
    pub fn put(&self, sender: Option<SocketAddr>, bytes: &mut Vec<u8>) {
        let mut waiting = self.waiting();
        if let Some(sender) = sender {
            waiting.count(sender);
        }
        let victim = waiting.victim(sender, self.most);
        let free = match victim.and_then(|victim| waiting.datagrams.remove(victim)) {
            Some((_, buffer)) => {
                waiting.dropped += 1;
                buffer
            }
            None => waiting.spare.pop().unwrap_or_default(),
        };
        waiting.datagrams.push_back((sender, std::mem::replace(bytes, free)));
    }

    /// Whether one more would cost the oldest.
    pub fn is_full(&self) -> bool {
        self.waiting().datagrams.len() >= self.most
    }

    /// Counts messages that were dropped before they came here, as too many waited.
    pub fn count_dropped(&self, count: u64) {
        if count > 0 {
            self.waiting().dropped += count;
        }
    }

    /// Counts a datagram that has not the form of those that the sender of the link sends.
    pub fn count_foreign(&self) {
        self.waiting().foreign += 1;
    }

    /// Counts a datagram of an address that sends more than one may.
    pub fn count_above(&self, address: IpAddr) {
        let mut waiting = self.waiting();
        let is_counted = waiting.above.len() < MOST_ADDRESSES || waiting.above.contains_key(&address);
        let of = if is_counted { address } else { IpAddr::V6(Ipv6Addr::UNSPECIFIED) };
        *waiting.above.entry(of).or_default() += 1;
    }

    /// How many had another form than those of the link's sender, since the last call.
    pub fn foreign(&self) -> u64 {
        std::mem::take(&mut self.waiting().foreign)
    }

    /// How many came from each address above what one may send, since the last call.
    pub fn above(&self) -> BTreeMap<IpAddr, u64> {
        std::mem::take(&mut self.waiting().above)
    }

    /// States the clock of what arrives from now on.
    pub fn set_clock(&self, clock: ClockOffset) {
        self.waiting().clock = Some(clock);
    }

    /// The clock of the host from which samples come, where it is not that of this session.
    pub fn clock(&self) -> Option<ClockOffset> {
        self.waiting().clock
    }

    /// The oldest.
    pub fn take(&self) -> Option<Vec<u8>> {
        let mut waiting = self.waiting();
        let taken = waiting.datagrams.pop_front().map(|(_, buffer)| buffer);
        if waiting.datagrams.is_empty() {
            waiting.came.clear();
        }
        taken
    }

    /// Gives a buffer back.
    pub fn give_back(&self, buffer: Vec<u8>) {
        self.waiting().spare.push(buffer);
    }

    /// How many went because too many waited, since the last call.
    pub fn dropped(&self) -> u64 {
        std::mem::take(&mut self.waiting().dropped)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_floods_pushes_out_nobody_else() {
        let arrivals = Arrivals::at_most(MOST_DATAGRAMS);
        let address = |port: u16| SocketAddr::from(([127, 0, 0, 1], port));
        let put = |sender, bytes: &[u8]| arrivals.put(Some(sender), &mut bytes.to_vec());
        put(address(1), b"order 1");
        (0..1000_u32).for_each(|i| put(address(2), &i.to_le_bytes()));
        put(address(1), b"order 2");
        assert_eq!(arrivals.dropped(), 1000 - MOST_FROM_ONE as u64);
        let taken: Vec<Vec<u8>> = std::iter::from_fn(|| arrivals.take()).collect();
        assert_eq!((taken.len(), &taken[0][..]), (MOST_FROM_ONE + 2, &b"order 1"[..]));
        // What is left of the flood is its newest.
        assert_eq!(taken[1], (1000 - MOST_FROM_ONE as u32).to_le_bytes());
        assert_eq!(taken[MOST_FROM_ONE + 1], b"order 2");
    }

    #[test]
    fn a_flood_from_many_ports_costs_no_order_of_another_port_or_address() {
        let arrivals = Arrivals::at_most(MOST_DATAGRAMS);
        let flood = |port: u16| SocketAddr::from(([10, 0, 0, 9], 4000 + port));
        let (neighbour, elsewhere) =
            (SocketAddr::from(([10, 0, 0, 9], 99)), SocketAddr::from(([10, 0, 0, 2], 4000)));
        let put = |sender, bytes: &[u8]| arrivals.put(Some(sender), &mut bytes.to_vec());
        let mut taken = [0, 0];
        for order in 0..250_u32 {
            put(neighbour, b"order beside");
            put(elsewhere, b"order elsewhere");
            // As many as 164,000 a second are in 2 ms, over 64 ports.
            (0..328_u32).for_each(|k| put(flood((k % 64) as u16), &(order + k).to_le_bytes()));
            while let Some(bytes) = arrivals.take() {
                taken[0] += u32::from(bytes == b"order beside");
                taken[1] += u32::from(bytes == b"order elsewhere");
            }
        }
        assert_eq!(taken, [250, 250]);
    }

    #[test]
    fn a_time_of_another_host_becomes_one_of_this_session() {
        let ahead = ClockOffset { offset: 3_000, uncertainty: 10 };
        assert_eq!(ahead.here(10_000), 7_000);
        assert_eq!(ClockOffset { offset: -3_000, ..ahead }.here(10_000), 13_000);
        // Times beyond the clock stay at its ends.
        assert_eq!((ahead.here(1), ClockOffset { offset: -1, ..ahead }.here(u64::MAX)), (0, u64::MAX));
    }

    #[test]
    fn a_burst_costs_the_oldest_and_says_how_many() {
        let arrivals = Arrivals::at_most(256);
        for i in 0..259_u32 {
            arrivals.put(None, &mut i.to_le_bytes().to_vec());
        }
        assert_eq!(arrivals.dropped(), 3);
        assert_eq!(arrivals.dropped(), 0);
        assert_eq!(arrivals.take().unwrap(), 3_u32.to_le_bytes());
    }
}
