//! The offset between the clocks of two hosts, from their beats.
//!
//! Each beat says when it was sent, and when the newest beat of the peer was sent and how long it has been held. Four
//! times bound the offset: it cannot differ from the middle by more than half of the time spent on the way (RFC 5905,
//! section 8).

use std::collections::VecDeque;

/// Measurements that are kept.
const RETAINED: usize = 64;
/// How fast two clocks may drift apart: 100 ns per ms.
const DRIFT: i64 = 10_000;

/// The clock of a peer against the clock of this host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Offset {
    /// Time of the peer minus time of this host, ns.
    pub offset: i64,
    /// The offset is at most this far from the true one, ns.
    pub uncertainty: i64,
}

/// The newest measurements.
#[derive(Debug, Default)]
pub struct Offsets {
    retained: VecDeque<(u64, Offset)>,
}

impl Offsets {
    /// Adds a measurement: this host sent a beat at `sent` (its clock); the peer received it at `received` and sent its own
    /// beat at `answered` (the peer's clock), which arrived at `now`.
    pub fn add(&mut self, sent: u64, received: u64, answered: u64, now: u64) {
        let (t0, t1, t2, t3) = (sent as i128, received as i128, answered as i128, now as i128);
        let in_transit = (t3 - t0) - (t2 - t1);
        // Times that are not in order measure nothing.
        if t3 < t0 || t2 < t1 || in_transit < 0 {
            return;
        }
        let offset = ((t1 - t0) + (t2 - t3)) / 2;
        let (Ok(offset), Ok(uncertainty)) = (i64::try_from(offset), i64::try_from(in_transit / 2 + 1)) else {
            return;
        };
        if self.retained.len() == RETAINED {
            self.retained.pop_front();
        }
        self.retained.push_back((now, Offset { offset, uncertainty }));
    }

    /// The best measurement, whose uncertainty grows with its age.
    pub fn best(&self, now: u64) -> Option<Offset> {
        let aged = |(at, o): &(u64, Offset)| {
            let age = i64::try_from(now.saturating_sub(*at)).unwrap_or(i64::MAX);
            Offset { offset: o.offset, uncertainty: o.uncertainty.saturating_add(age / DRIFT) }
        };
        self.retained.iter().map(aged).min_by_key(|o| o.uncertainty)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offset_is_within_its_uncertainty_however_unequal_the_ways() {
        // The peer's clock is 3 s ahead; 2 ms there, 40 us back.
        let mut offsets = Offsets::default();
        let ahead = 3_000_000_000;
        offsets.add(1_000, 1_000 + 2_000_000 + ahead, 1_000 + 7_000_000 + ahead, 1_000 + 7_040_000);
        let first = offsets.best(7_041_000).unwrap();
        assert!((first.offset - ahead as i64).abs() <= first.uncertainty && first.uncertainty < 1_100_000);
        // A quick exchange takes its place.
        offsets.add(8_000_000, 8_020_000 + ahead, 8_030_000 + ahead, 8_050_000);
        let best = offsets.best(8_050_000).unwrap();
        assert!((best.offset - ahead as i64).abs() <= best.uncertainty && best.uncertainty <= 20_001);
        assert!(offsets.best(1_008_050_000).unwrap().uncertainty > best.uncertainty);
    }

    #[test]
    fn times_out_of_order_measure_nothing() {
        let mut offsets = Offsets::default();
        offsets.add(10, 0, 0, 5);
        offsets.add(0, 10, 5, 20);
        offsets.add(0, 0, 100, 50);
        offsets.add(0, u64::MAX, u64::MAX, u64::MAX);
        assert!(offsets.retained.is_empty(), "{offsets:?}");
    }
}
