//! From the openings that a controller asks for to the duties that are sent: within bounds, grown no faster than allowed,
//! and beyond the dead band of the valves.

use stillpoint_samples::ActuationReason;

use crate::message::VALVES;

/// Behind a dead band, the least opening to which a shut valve is opened; an open one shuts below half of it. Less would
/// switch valves with the noise of the pose, and moves a head by some hundredths of a millimetre.
const LEAST: f64 = 0.001;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Greatest duty, up to 1.
    pub greatest: f64,
    /// Largest growth of an opening, 1/s. A valve may shut at once, because shut valves are safe.
    pub slew: f64,
    /// Duty up to which a valve stays shut; above it the opening grows in proportion, to full opening at full duty.
    pub dead_band: f64,
}

impl Bounds {
    /// How far a valve is open at a duty.
    fn opening(&self, duty: f64) -> f64 {
        ((duty - self.dead_band) / (1.0 - self.dead_band)).max(0.0)
    }

    /// Seconds in which a shut valve may open far enough to be opened at all.
    pub fn seconds_to_open(&self) -> f64 {
        LEAST / self.slew
    }

    /// The duty at which a valve is open so far; it `was` open so far before.
    fn duty(&self, opening: f64, was: f64) -> f64 {
        let least = if was > 0.0 { 0.5 * LEAST } else { LEAST };
        let is_shut = opening <= 0.0 || self.dead_band > 0.0 && opening < least;
        if is_shut { 0.0 } else { self.dead_band + (1.0 - self.dead_band) * opening }
    }
}

/// What was sent last, and what is sent next.
#[derive(Clone, Debug)]
pub struct Shaper {
    bounds: Bounds,
    sent: [f32; VALVES],
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shaped {
    /// Bits of [`ActuationReason`].
    pub reasons: u32,
    /// Bit i is set if the duty of valve i was changed.
    pub limited: u32,
}

impl Shaper {
    #[must_use]
    pub fn new(bounds: Bounds) -> Self {
        Self { bounds, sent: [0.0; VALVES] }
    }

    /// The duties that were sent last.
    #[must_use]
    pub fn sent(&self) -> &[f32; VALVES] {
        &self.sent
    }

    /// How far the valves are open with the duties that were sent last.
    #[must_use]
    pub fn openings(&self) -> [f64; VALVES] {
        self.sent.map(|duty| self.bounds.opening(f64::from(duty)))
    }

    /// Takes the valves for shut: what follows grows from there.
    pub fn rest(&mut self) {
        self.sent = [0.0; VALVES];
    }

    /// Shapes finite openings, `seconds` after the last ones. `ceiling` says for each inlet how far it may be open.
    pub fn shape(&mut self, asked: &[f64], seconds: f64, ceiling: impl Fn(usize) -> f64) -> Shaped {
        let mut shaped = Shaped::default();
        let bounds = self.bounds;
        let greatest = bounds.opening(bounds.greatest);
        let growth = bounds.slew * seconds.max(0.0);
        for (valve, (sent, asked)) in self.sent.iter_mut().zip(asked).enumerate() {
            let mut opening = asked.clamp(0.0, greatest);
            let mut limits = if opening == *asked { 0 } else { ActuationReason::DUTY_LIMITED };
            let was = bounds.opening(f64::from(*sent));
            let grown = was + growth;
            if opening > grown {
                opening = grown;
                limits |= ActuationReason::SLEW_LIMITED;
            }
            let least = if valve % 2 == 0 { ceiling(valve / 2) } else { 1.0 };
            if opening > least {
                opening = least;
                limits |= ActuationReason::PRESSURE_LIMITED;
            }
            let duty = bounds.duty(opening, was);
            // Rounded towards shut, so that bounds hold for what is sent, too; no number becomes a shut valve.
            *sent = if duty > 0.0 { floor(duty) } else { 0.0 };
            shaped.reasons |= limits;
            shaped.limited |= u32::from(limits != 0) << valve;
        }
        shaped
    }
}

/// The greatest `f32` that is not above a positive number.
fn floor(duty: f64) -> f32 {
    let near = duty as f32;
    if f64::from(near) > duty { near.next_down() } else { near }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn duties_stay_within_every_bound_whatever_is_asked(
            asked in prop::collection::vec(prop::array::uniform6(-3.0..3.0f64), 1..30),
            greatest in 0.01..=1.0f64,
            slew in 0.1..100.0f64,
            seconds in prop::collection::vec(0.0..0.1f64, 30),
            ceiling in 0.0..=1.0f64,
            dead_band in prop_oneof![Just(0.0), 0.0..0.3f64],
        ) {
            let bounds = Bounds { greatest, slew, dead_band };
            let mut shaper = Shaper::new(bounds);
            for (asked, seconds) in asked.iter().zip(seconds) {
                let before = shaper.openings();
                let shaped = shaper.shape(asked, seconds, |_| ceiling);
                for (valve, asked) in asked.iter().enumerate() {
                    let (was, is) = (before[valve], shaper.openings()[valve]);
                    let sent = f64::from(shaper.sent()[valve]);
                    prop_assert!((0.0..=greatest).contains(&sent));
                    prop_assert!(is > 0.0 || sent <= dead_band);
                    // The duty is rounded down; the opening that is computed from it may have one rounding more.
                    prop_assert!(is <= was + slew * seconds + 1e-15);
                    prop_assert!(valve % 2 == 1 || is <= ceiling + 1e-15);
                    prop_assert!(is <= asked.max(0.0) + 1e-15);
                    prop_assert!(dead_band > 0.0 || is == sent);
                    // Where nothing limits it, the command is what is sent, but for the rounding.
                    let free = shaped.limited >> valve & 1 == 0;
                    let is_shut = dead_band > 0.0 && is == 0.0 && *asked < LEAST;
                    prop_assert!(!free || is_shut || (asked - is).abs() <= 1e-7);
                }
                prop_assert!(shaper.sent()[6..].iter().all(|d| *d == 0.0));
            }
        }
    }

    #[test]
    fn noise_about_zero_does_not_switch_a_valve_with_a_dead_band() {
        let mut shaper = Shaper::new(Bounds { greatest: 1.0, slew: 100.0, dead_band: 0.07 });
        let mut sent = |asked: f64| {
            shaper.shape(&[asked, 0.0], 0.01, |_| 1.0);
            f64::from(shaper.sent()[0])
        };
        assert_eq!([0.0009, -0.001, 0.0005].map(&mut sent), [0.0; 3]);
        // Once it is open it stays so for less.
        assert!([0.0011, 0.0006, 0.0009].map(&mut sent).iter().all(|duty| *duty > 0.07));
        assert_eq!([0.0004, 0.0009].map(&mut sent), [0.0; 2]);
        assert!((sent(0.5) - 0.535).abs() < 1e-6);
    }

    #[test]
    fn a_valve_shuts_at_once_and_opens_by_and_by() {
        let mut shaper = Shaper::new(Bounds { greatest: 1.0, slew: 10.0, dead_band: 0.0 });
        for step in 1..=20 {
            let shaped = shaper.shape(&[1.0, 0.0], 0.01, |_| 1.0);
            let duty = f64::from(shaper.sent()[0]);
            assert!((duty - (0.1 * f64::from(step)).min(1.0)).abs() < 1e-6, "{step}: {duty}");
            assert_eq!(shaped.limited, u32::from(duty < 1.0));
        }
        shaper.shape(&[0.0, 0.0], 0.01, |_| 1.0);
        assert_eq!(shaper.sent()[0], 0.0);
    }
}
