//! How many datagrams a sender may send: a flood costs no memory of a recording, and nobody else's datagrams.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

/// Time over which datagrams are counted.
const WINDOW: Duration = Duration::from_millis(100);
/// Datagrams of one port in that time that pass in any case: 500 a second, above what any sender of stillpoint sends.
const OF_PORT: u32 = 50;
/// Datagrams of one address in that time, beyond which a port has no more than `OF_PORT`: 2000 a second.
const OF_ADDRESS: u32 = 200;
/// Datagrams of all senders in that time: 4000 a second, which a recording keeps without loss.
const OF_ALL: u32 = 400;
/// Ports that are counted; the datagrams of others count as beyond their part. A port that was counted in the window before
/// keeps its place while it sends, so that a flood from many ports does not push it out.
const MOST_PORTS: usize = 256;

/// Counts datagrams by sender in windows of 100 ms.
#[derive(Default)]
pub struct RateLimit {
    begun: Option<Instant>,
    all: u32,
    of_address: BTreeMap<IpAddr, u32>,
    of_port: BTreeMap<SocketAddr, u32>,
}

impl RateLimit {
    /// Counts a datagram that came at `now`. Gives whether it passes.
    pub fn passes(&mut self, sender: SocketAddr, now: Instant) -> bool {
        if self.begun.is_none_or(|begun| now.saturating_duration_since(begun) >= WINDOW) {
            self.begun = Some(now);
            self.all = 0;
            self.of_address.clear();
            self.of_port.retain(|_, count| std::mem::take(count) > 0);
        }
        let is_counted = self.of_port.len() < MOST_PORTS || self.of_port.contains_key(&sender);
        let port = match is_counted {
            true => {
                let count = self.of_port.entry(sender).or_default();
                *count = count.saturating_add(1);
                *count
            }
            false => u32::MAX,
        };
        let address = self.of_address.entry(sender.ip()).or_default();
        let passes = port <= OF_PORT || (port < u32::MAX && *address < OF_ADDRESS && self.all < OF_ALL);
        if passes {
            *address = address.saturating_add(1);
            self.all = self.all.saturating_add(1);
        }
        passes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(port: u16) -> SocketAddr {
        SocketAddr::from(([10, 0, 0, 9], port))
    }

    #[test]
    fn a_flood_is_held_to_its_part_and_costs_no_other_sender() {
        let (mut limit, start) = (RateLimit::default(), Instant::now());
        let mut passed = [0_u32; 2];
        // A second of 11 datagrams a millisecond from one port, and of one every 10 ms from another of the same address.
        for ms in 0..1000_u64 {
            let now = start + Duration::from_millis(ms);
            passed[0] += (0..11).filter(|_| limit.passes(of(1), now)).count() as u32;
            if ms % 10 == 0 {
                passed[1] += u32::from(limit.passes(of(2), now));
            }
        }
        assert_eq!(passed[1], 100, "the other sender");
        assert!((1900..=2100).contains(&passed[0]), "{passed:?}");
    }

    #[test]
    fn a_flood_from_more_ports_than_are_counted_pushes_out_no_sender_that_was_there() {
        let (mut limit, start) = (RateLimit::default(), Instant::now());
        let mut passed = 0;
        for ms in 0..1000_u64 {
            let now = start + Duration::from_millis(ms);
            // From the second window on the flood comes first in each millisecond, from other ports each time.
            for k in 0..40 * u64::from(ms >= 100) {
                limit.passes(of((1000 + (40 * ms + k) % 60_000) as u16), now);
            }
            if ms % 10 == 0 {
                passed += u32::from(limit.passes(of(1), now));
            }
        }
        assert_eq!(passed, 100);
    }

    #[test]
    fn a_flood_from_many_ports_and_addresses_is_bounded_and_counted_ports_keep_theirs() {
        let (mut limit, start) = (RateLimit::default(), Instant::now());
        assert!(limit.passes(of(0), start));
        let from = |i: u32| SocketAddr::from(((0x0a00_0000 + i % 300).to_be_bytes(), 9));
        let passed = (0..100_000).filter(|i| limit.passes(from(*i), start)).count();
        assert!(passed <= MOST_PORTS * OF_PORT as usize, "{passed}");
        assert!((1..OF_PORT).all(|_| limit.passes(of(0), start)), "the first sender keeps its part");
        assert!(!limit.passes(of(0), start), "all have what they may have");
        assert!(limit.passes(of(0), start + WINDOW), "a new window");
    }
}
