//! The involuntary motion of a person: breathing, nodding off, drift, coughs. A pure function of time and seed.
//!
//! Offsets are the distances by which a free head would move: metres in the couch frame, and angles (pitch, roll, yaw).
//!
//! A breath that is not regular is the model of Lujan et al. (Med. Phys. 26, 1999) with n = 2, a second harmonic of a
//! quarter, so that the head rests where breath is out; its frequency and size wander about those of the person.

use core::f64::consts::TAU;

use nalgebra::Vector3;

/// What a person does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Habit {
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
    /// 0: breath and nods are sines of 0.25 and 0.1 Hz. 1: those of a person drawn from the seed, which wander.
    pub irregularity: f64,
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
            Habit::Breathes => (self.swing(BREATH, 0.25, t), 0.0, 0.0),
            Habit::Nods => (self.swing(BREATH, 0.25, t), self.swing(NOD, 0.1, t), cough(self.seed, t)),
        };
        let translation =
            drift(self.seed, t) + Vector3::new(0.0, 1e-3 * cough, 0.3e-3 * breath + 2e-3 * cough);
        let pitch = (1.5 * nod + 0.1 * breath + 0.6 * cough).to_radians();
        (translation * self.strength, Vector3::new(pitch, 0.0, 0.0) * self.strength)
    }

    /// A motion about `hertz` of size about 1, zero at the start; a sine where it is regular.
    ///
    /// With irregularity r, frequency and size of the person are up to exp(r / 4) and exp(0.7 r) times as large or as small,
    /// and wander with standard deviations of 10 % and 20 % of r within 15 to 60 s.
    fn swing(&self, index: u64, hertz: f64, t: f64) -> f64 {
        let r = self.irregularity;
        if r == 0.0 {
            return libm::sin(TAU * hertz * t);
        }
        let draw = |number| uniform(self.seed, index, number);
        let own = |spread: f64, number| libm::exp(r * spread * (2.0 * draw(number) - 1.0));
        // Of a wandering sine its frequency, rad/s, and its phase.
        let wander = |number: u64| (TAU / (15.0 + 45.0 * draw(number)), TAU * draw(number + 1));
        let ahead: f64 = [2, 4]
            .map(wander)
            .iter()
            .map(|(w, phase)| (libm::sin(w * t + phase) - libm::sin(*phase)) * 0.1 * r / w)
            .sum();
        let larger: f64 =
            [6, 8].map(wander).iter().map(|(w, phase)| 0.2 * r * libm::sin(w * t + phase)).sum();
        let angle = TAU * hertz * own(0.25, 0) * (t + ahead);
        let rest = if index == BREATH { 0.25 * r * (1.0 - libm::cos(2.0 * angle)) } else { 0.0 };
        own(0.7, 1) * (1.0 + larger) * (libm::sin(angle) + rest)
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
const BREATH: u64 = u64::MAX - 1;
const NOD: u64 = u64::MAX - 2;
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
            let of = |strength, t| Involuntary { habit, seed: 7, strength, irregularity: 0.6 }.offset(t);
            assert_eq!(of(1.0, 0.0), (Vector3::zeros(), Vector3::zeros()), "{habit:?}");
            let ((one, turned), (two, _)) = (of(1.0, 2.3), of(2.0, 2.3));
            assert!((one * 2.0 - two).norm() < 1e-15, "{habit:?}");
            assert_eq!(turned.norm() > 0.0, habit != Habit::Still, "{habit:?}");
        }
    }

    #[test]
    fn an_irregular_breath_wanders_about_that_of_its_person_and_rests_where_it_is_out() {
        let person =
            |seed, irregularity| Involuntary { habit: Habit::Nods, seed, strength: 1.0, irregularity };
        assert_eq!(person(7, 0.0).swing(BREATH, 0.25, 1.7), libm::sin(TAU * 0.25 * 1.7));
        assert_ne!(person(7, 1.0).offset(9.0).1, person(8, 1.0).offset(9.0).1);
        for seed in 0..20 {
            let of = |t: f64| person(seed, 1.0).swing(BREATH, 0.25, t);
            let values: Vec<f64> = (0..60_000).map(|k| of(0.01 * f64::from(k))).collect();
            let begins: Vec<usize> =
                (1..values.len()).filter(|&k| values[k - 1] < 0.0 && values[k] >= 0.0).collect();
            let periods: Vec<f64> = begins.windows(2).map(|pair| 0.01 * (pair[1] - pair[0]) as f64).collect();
            let mean = periods.iter().sum::<f64>() / periods.len() as f64;
            let variance =
                periods.iter().map(|p| (p - mean) * (p - mean)).sum::<f64>() / periods.len() as f64;
            let spread = libm::sqrt(variance) / mean;
            // 4 s times or over exp(1 / 4).
            assert!((2.9..5.5).contains(&mean), "{seed}: {mean} s");
            assert!((0.04..0.18).contains(&spread), "{seed}: {spread}");
            // In is further than out, 1.0 from 0.5 up and down, so more than half of the time is spent below the middle.
            let [low, high] = [f64::min, f64::max].map(|of| values.iter().copied().reduce(of).unwrap_or(0.0));
            let middle = 0.5 * (low + high);
            let below = values.iter().filter(|v| **v < middle).count() as f64 / values.len() as f64;
            assert!(below > 0.55, "{seed}: {below}");
        }
    }
}
