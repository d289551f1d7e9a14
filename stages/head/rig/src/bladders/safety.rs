//! What the valves do when duties stop: the far end looks after itself.

use stillpoint_samples::{DutiesElement, RigMode};

/// Inlet and outlet of a bladder whose air goes out.
const VENTED: [f64; 2] = [0.0, 1.0];

/// Safe state of the valves when duties stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Safe {
    /// Inlets shut, outlets open to the room.
    Vent,
    Hold,
}

/// The present duties, their age, and the safe state.
#[derive(Debug, Clone, PartialEq)]
pub struct Safety<const B: usize> {
    /// Time for which duties are valid, ns.
    time_to_live: u64,
    safe: Safe,
    /// The last that were accepted.
    last: Option<Accepted<B>>,
    refused: u64,
}

/// Duties that were accepted.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Accepted<const B: usize> {
    /// ns.
    stamp: u64,
    /// Inlet and outlet of each bladder.
    duty: [[f64; 2]; B],
    /// They ask for the air to go out into the room.
    vents: bool,
}

impl<const B: usize> Safety<B> {
    /// Duties are valid for `time_to_live` ns; then the valves take the safe state `safe`.
    pub fn new(time_to_live: u64, safe: Safe) -> Self {
        Self { time_to_live, safe, last: None, refused: 0 }
    }

    /// Takes duties that were made at `stamp` and arrive at `now`, ns. Those that are not finite, not from 0 to 1, for
    /// another number of valves or older than the last are counted and not used: then time runs on.
    pub fn take(&mut self, duties: &DutiesElement, stamp: u64, now: u64) {
        let valves = &duties.duty[..(2 * B).min(DutiesElement::ROOM)];
        let sound = duties.valves as usize == 2 * B && valves.iter().all(|d| (0.0..=1.0).contains(d));
        if !sound || self.last.is_some_and(|last| stamp < last.stamp) {
            self.refused += 1;
            return;
        }
        let (shut, vents) = (duties.idle != 0, duties.vent != 0);
        let duty = core::array::from_fn(|j| {
            core::array::from_fn(|v| match (shut, vents) {
                (true, _) => 0.0,
                (_, true) => VENTED[v],
                _ => valves.get(2 * j + v).copied().unwrap_or(0.0),
            })
        });
        // A stamp of the future would be good for too long.
        self.last = Some(Accepted { stamp: stamp.min(now), duty, vents: vents && !shut });
    }

    /// What moves the valves at a time, ns.
    pub fn mode(&self, now: u64) -> RigMode {
        match self.last {
            None => RigMode::Waiting,
            Some(last) if now.saturating_sub(last.stamp) <= self.time_to_live => {
                if last.vents {
                    RigMode::Venting
                } else {
                    RigMode::Driven
                }
            }
            Some(_) if self.safe == Safe::Vent => RigMode::Venting,
            Some(_) => RigMode::Holding,
        }
    }

    /// Duty of each bladder's inlet and outlet at a time, ns.
    pub fn duty(&self, now: u64) -> [[f64; 2]; B] {
        match (self.mode(now), self.last) {
            (RigMode::Driven, Some(last)) => last.duty,
            (RigMode::Venting, _) => [VENTED; B],
            _ => [[0.0; 2]; B],
        }
    }

    /// Age of the duties, ns.
    pub fn age(&self, now: u64) -> Option<u64> {
        self.last.map(|last| now.saturating_sub(last.stamp))
    }

    /// How many duties were refused.
    pub fn refused(&self) -> u64 {
        self.refused
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn duties(inlet: f64) -> DutiesElement {
        let mut duty = [0.0; 16];
        duty[0] = inlet;
        DutiesElement { duty, valves: 2, ..Default::default() }
    }

    #[test]
    fn nothing_moves_before_the_first_duties() {
        let safety = Safety::<1>::new(60, Safe::Vent);
        assert_eq!((safety.mode(1_000_000), safety.duty(1_000_000)), (RigMode::Waiting, [[0.0; 2]]));
    }

    #[test]
    fn duties_hold_for_their_time_to_live_and_then_the_air_goes_out() {
        let mut safety = Safety::<1>::new(60, Safe::Vent);
        safety.take(&duties(0.4), 1000, 1002);
        assert_eq!((safety.mode(1060), safety.duty(1060)), (RigMode::Driven, [[0.4, 0.0]]));
        assert_eq!((safety.mode(1061), safety.duty(1061)), (RigMode::Venting, [[0.0, 1.0]]));
        safety.take(&duties(0.1), 1100, 1100);
        assert_eq!(safety.duty(1100), [[0.1, 0.0]]);
    }

    #[test]
    fn duties_that_vent_open_the_outlets_to_the_room_whatever_else_they_say() {
        let mut safety = Safety::<1>::new(60, Safe::Hold);
        safety.take(&DutiesElement { vent: 1, ..duties(0.4) }, 1000, 1000);
        assert_eq!((safety.mode(1010), safety.duty(1010)), (RigMode::Venting, [[0.0, 1.0]]));
        safety.take(&duties(0.4), 1020, 1020);
        assert_eq!((safety.mode(1020), safety.duty(1020)), (RigMode::Driven, [[0.4, 0.0]]));
    }

    #[test]
    fn a_rig_that_holds_shuts_its_valves() {
        let mut safety = Safety::<1>::new(60, Safe::Hold);
        safety.take(&duties(0.4), 1000, 1000);
        assert_eq!((safety.mode(2000), safety.duty(2000)), (RigMode::Holding, [[0.0; 2]]));
    }

    #[test]
    fn duties_that_make_no_sense_are_counted_and_do_not_stop_the_clock() {
        let mut safety = Safety::<1>::new(60, Safe::Hold);
        safety.take(&duties(0.4), 1000, 1000);
        for bad in [f64::NAN, f64::INFINITY, -0.1, 1.1] {
            safety.take(&duties(bad), 1050, 1050);
        }
        safety.take(&DutiesElement { valves: 6, ..duties(0.1) }, 1050, 1050);
        safety.take(&duties(0.1), 900, 1050);
        assert_eq!((safety.refused(), safety.mode(1061)), (6, RigMode::Holding));
    }

    #[test]
    fn a_stamp_of_the_future_is_good_for_no_longer() {
        let mut safety = Safety::<1>::new(60, Safe::Hold);
        safety.take(&duties(0.4), 9_000, 1000);
        assert_eq!(safety.mode(1061), RigMode::Holding);
    }

    #[test]
    fn idle_duties_shut_the_valves_and_keep_the_rig_driven() {
        let mut safety = Safety::<1>::new(60, Safe::Vent);
        safety.take(&DutiesElement { idle: 1, ..duties(0.4) }, 1000, 1000);
        assert_eq!((safety.mode(1010), safety.duty(1010)), (RigMode::Driven, [[0.0; 2]]));
    }
}
