//! Whether each bladder follows its orders: what they let in and what they let out, over some breaths.
//!
//! A head that rests takes as much air out of each bladder as it lets in, whatever it breathes. So the orders to the inlet
//! and to the outlet of a bladder have about the same effect over some seconds. A valve that is stuck breaks this: with an
//! outlet that stays shut nothing may come in any more, and with a valve that stays open, or with a leak, the orders
//! make up for it and go one way. The law takes such orders for a disturbance and holds the head, so the error does not
//! show them; but whoever estimates pressures from orders is farther off with each second.
//!
//! This holds where each bladder moves a coordinate of its own, so for as many bladders as channels.

/// Bladders that there is room for.
pub const BLADDERS: usize = 8;
/// Shortest time over which orders are summed, s: two breaths.
const WINDOW: f64 = 8.0;
/// Orders that a sum must hold, as the time of an inlet at full opening, s: noise alone makes less.
const LEAST: f64 = 0.03;
/// Logarithm of the inlet's effect over that of the outlet, up or down, that a bladder may have for ever: outlets with half
/// the effect that is assumed have 0.7.
const FOLLOWS: f64 = 1.0;
/// What is beyond that adds up from window to window, up to this much in each; a bladder that does not follow has twice
/// as much. So one window alone, a patient who moves away, is never enough.
const MOST: f64 = 0.5;

/// Sums the orders to each bladder.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Balance {
    sums: [Sum; BLADDERS],
}

/// Orders to one bladder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sum {
    time: f64,
    inlet: f64,
    outlet: f64,
    /// What is beyond in its windows, above zero where orders go in.
    beyond: f64,
    /// Part of the inlet in the last window.
    part: Option<f64>,
}

impl Balance {
    /// Forgets all orders.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Takes the effect of orders, in parts of the inlet at full opening, that act for `dt` seconds while the head is to
    /// rest. A head that is to move forgets the window.
    pub fn take(&mut self, effect: &[f64], dt: f64, rests: bool) {
        for (sum, effect) in self.sums.iter_mut().zip(effect) {
            if !rests {
                (sum.time, sum.inlet, sum.outlet) = (0.0, 0.0, 0.0);
                continue;
            }
            sum.time += dt;
            sum.inlet += dt * effect.max(0.0);
            sum.outlet += dt * (-effect).max(0.0);
            if sum.time >= WINDOW && sum.inlet + sum.outlet >= LEAST {
                let part = sum.inlet / (sum.inlet + sum.outlet);
                // Infinite where all orders go one way. What goes to and fro, as slow nods do, adds nothing up.
                let one_sided = libm::log(sum.inlet / sum.outlet);
                let before = if sum.beyond * one_sided > 0.0 { sum.beyond.abs() } else { 0.0 };
                let beyond = (before + (one_sided.abs() - FOLLOWS).min(MOST)).clamp(0.0, 2.0 * MOST);
                let beyond = beyond.copysign(one_sided);
                *sum = Sum { beyond, part: Some(part), ..Sum::default() };
            }
        }
    }

    /// Whether one of the bladders does not follow its orders.
    #[must_use]
    pub fn is_missed(&self) -> bool {
        self.sums.iter().any(|sum| sum.beyond.abs() >= 2.0 * MOST)
    }

    /// Part of the inlet in the effect of all orders to a bladder in its last window; `None` before there was one.
    #[must_use]
    pub fn part(&self, bladder: usize) -> Option<f64> {
        self.sums.get(bladder).and_then(|sum| sum.part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// When the bladder is missed, of orders over time.
    fn missed(seconds: f64, of: impl Fn(f64) -> f64) -> Option<f64> {
        let mut balance = Balance::default();
        (0..(seconds / 0.02) as u32).map(|k| 0.02 * f64::from(k)).find(|t| {
            balance.take(&[of(*t)], 0.02, true);
            balance.is_missed()
        })
    }

    fn breath(t: f64) -> f64 {
        libm::sin(core::f64::consts::TAU * t / 4.7)
    }

    #[test]
    fn orders_that_answer_a_breath_are_balanced_also_with_weak_and_strong_outlets() {
        for part in [0.4, 0.54, 1.0, 1.8] {
            let order = |t: f64| 0.02 * if breath(t) > 0.0 { breath(t) } else { breath(t) / part };
            assert_eq!(missed(120.0, order), None, "{part}");
        }
    }

    #[test]
    fn a_valve_that_is_stuck_is_missed_within_two_windows() {
        // An outlet that stays shut; one that stays open; a leak.
        for order in [-0.011, 0.011, 0.2] {
            let at = missed(60.0, |t| order * (1.0 + 0.5 * breath(t))).unwrap();
            assert!((15.9..16.2).contains(&at), "{order} {at}");
        }
    }

    #[test]
    fn a_valve_that_is_stuck_hardly_open_is_missed_within_four_windows() {
        // Nearly four fifths of the orders go in; a window has two whole breaths.
        let breath = |t: f64| libm::sin(core::f64::consts::TAU * t / 4.0);
        let at = missed(60.0, |t| 0.02 * (0.4 + breath(t))).unwrap();
        assert!((23.9..32.2).contains(&at), "{at}");
    }

    #[test]
    fn nods_slower_than_a_window_are_not_missed() {
        for period in [8.5, 10.0, 12.5, 14.0, 16.0, 18.0, 20.0] {
            let nod = |t: f64| 0.05 * libm::sin(core::f64::consts::TAU * t / period);
            assert_eq!(missed(600.0, nod), None, "{period}");
        }
    }

    #[test]
    fn a_patient_who_moves_away_once_and_noise_that_sums_up_to_little_are_not_missed() {
        let once = |t: f64| if (20.0..21.5).contains(&t) { -0.2 } else { 0.005 * breath(t) };
        assert_eq!(missed(120.0, once), None);
        assert_eq!(missed(120.0, |_| 0.0), None);
        // 0.03 s take more than a minute.
        assert!(missed(600.0, |_| 4e-4).unwrap() > 120.0);
    }

    #[test]
    fn a_head_that_is_to_move_forgets_the_window_and_one_that_follows_again_clears_it() {
        let mut balance = Balance::default();
        let mut over = |seconds: f64, order: f64, rests: bool| {
            (0..(seconds / 0.02) as u32).for_each(|_| balance.take(&[order], 0.02, rests));
            (balance.is_missed(), balance.part(0))
        };
        assert_eq!(over(7.9, 0.1, true), (false, None));
        assert_eq!(over(5.0, 0.1, false), (false, None));
        assert_eq!(over(8.1, 0.1, true), (false, Some(1.0)));
        assert_eq!(over(8.1, 0.1, true), (true, Some(1.0)));
        for _ in 0..5 {
            over(1.0, 0.1, true);
            over(1.0, -0.1, true);
        }
        assert!(!over(0.02, 0.1, true).0);
    }
}
