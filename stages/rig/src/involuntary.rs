//! The involuntary motion of a person: breathing, nodding off, drift, coughs. A pure function of time and seed.
//!
//! Offsets are the distances by which a free head would move: metres in the couch frame, and angles (pitch, roll, yaw).

use core::f64::consts::TAU;

use nalgebra::Vector3;

/// What a person does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Habit {
    /// Nothing.
    Still,
    /// Breathing (0.3 mm and 0.1 deg at 0.25 Hz) and drift below 2 mm over minutes.
    Breathes,
    /// The same, slow nodding (1.5 deg at 0.1 Hz) and in every second window of 20 s, on average, a cough.
    Nods,
}

/// A habit with its seed and strength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Involuntary {
    /// What the person does.
    pub habit: Habit,
    /// What drift and coughs are drawn from.
    pub seed: u64,
    /// Factor of every offset.
    pub strength: f64,
}

impl Involuntary {
    /// Whether the person coughs `t` seconds after the start.
    pub fn coughs(&self, t: f64) -> bool {
        self.habit == Habit::Nods && cough(self.seed, t) != 0.0
    }

    /// Translation (m) and angles (pitch, roll, yaw; rad) `t` seconds after the start, zero at the start.
    pub fn offset(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        // A NaN is not above zero.
        let t = if t > 0.0 { t.min(1e9) } else { 0.0 };
        let (breath, nod, cough) = match self.habit {
            Habit::Still => return (Vector3::zeros(), Vector3::zeros()),
            Habit::Breathes => (libm::sin(TAU * 0.25 * t), 0.0, 0.0),
            Habit::Nods => (libm::sin(TAU * 0.25 * t), libm::sin(TAU * 0.1 * t), cough(self.seed, t)),
        };
        let translation =
            drift(self.seed, t) + Vector3::new(0.0, 1e-3 * cough, 0.3e-3 * breath + 2e-3 * cough);
        let pitch = (1.5 * nod + 0.1 * breath + 0.6 * cough).to_radians();
        (translation * self.strength, Vector3::new(pitch, 0.0, 0.0) * self.strength)
    }
}

/// Slow wandering from zero at the start: two sines of 60 to 180 s and 0.5 mm on each axis.
pub(crate) fn drift(seed: u64, t: f64) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| {
        let sine = |number: u64| {
            let draw = 4 * axis as u64 + 2 * number;
            let period_secs = 60.0 + 120.0 * uniform(seed, DRIFT, draw);
            let phase = TAU * uniform(seed, DRIFT, draw + 1);
            0.5e-3 * (libm::sin(TAU * t / period_secs + phase) - libm::sin(phase))
        };
        sine(0) + sine(1)
    })
}

/// From -1 to 1: a burst of 0.8 s somewhere in about every second window of 20 s.
pub(crate) fn cough(seed: u64, t: f64) -> f64 {
    const WINDOW_SECS: f64 = 20.0;
    const BURST_SECS: f64 = 0.8;
    let window = (t / WINDOW_SECS).floor();
    let draw = |number| uniform(seed ^ COUGH, window as u64, number);
    if draw(0) < 0.5 {
        return 0.0;
    }
    let start = 1.0 + draw(1) * (WINDOW_SECS - BURST_SECS - 2.0);
    let since = t - window * WINDOW_SECS - start;
    if !(0.0..BURST_SECS).contains(&since) {
        return 0.0;
    }
    let envelope = libm::sin(0.5 * TAU * since / BURST_SECS);
    envelope * envelope * libm::sin(TAU * 2.5 * since)
}

const DRIFT: u64 = u64::MAX;
const COUGH: u64 = 0x636f_7567_6821;

/// A number from 0 up to 1 for each (seed, index, draw), by the finaliser of splitmix64
/// (Steele, Lea and Flood 2014): any time can be asked for without those before it.
pub(crate) fn uniform(seed: u64, index: u64, draw: u64) -> f64 {
    let mut hash = seed;
    for word in [index, draw] {
        hash =
            hash.wrapping_add(word.wrapping_mul(0x9e37_79b9_7f4a_7c15)).wrapping_add(0x9e37_79b9_7f4a_7c15);
        hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        hash ^= hash >> 31;
    }
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn about_every_second_window_has_a_cough() {
        let coughs = |window: u32| {
            (0..400).any(|step| cough(7, f64::from(window) * 20.0 + f64::from(step) * 0.05) != 0.0)
        };
        let count = (0..200).filter(|&window| coughs(window)).count();
        assert!((70..130).contains(&count), "{count}");
    }

    #[test]
    fn every_habit_starts_at_rest_and_grows_with_its_strength() {
        for habit in [Habit::Still, Habit::Breathes, Habit::Nods] {
            let of = |strength, t| Involuntary { habit, seed: 7, strength }.offset(t);
            assert_eq!(of(1.0, 0.0), (Vector3::zeros(), Vector3::zeros()), "{habit:?}");
            let ((one, turned), (two, _)) = (of(1.0, 2.3), of(2.0, 2.3));
            assert!((one * 2.0 - two).norm() < 1e-15, "{habit:?}");
            assert_eq!(turned.norm() > 0.0, habit != Habit::Still, "{habit:?}");
        }
    }
}
