//! The periodic motion of a patient, breath and nods, with frequencies that are tracked (SCIENCE Y4).
//!
//! A window of the positions that the orders do not explain is searched for tones: one candidate frequency at each call, so
//! that no step of a law is long. A tone is trusted if it explains half of what is left without it, which is the guard of
//! excitation: noise and a single cough explain less. Trusted tones fade in and out within a second.
//!
//! The tones are answered in coordinates of which each bladder moves one ([`Decoupling`]), where there are such. A coordinate
//! answers them as long as that makes its error smaller (`proof`): one valve that is stuck does not keep the others from
//! answering.

use core::f64::consts::TAU;

use crate::effect::Decoupling;
use crate::harmonic::{CHANNELS, Fit, Phasors, Position, TONES, Window};
use crate::proof::Proof;

/// Least and greatest frequency, Hz.
const RANGE: [f64; 2] = [0.08, 0.7];
/// From one candidate of the scan to the next.
const RATIO: f64 = 1.07;
/// Least distance of two samples, s.
const SPACING: f64 = 0.09;
/// Periods that the window must hold before a frequency is tried.
const PERIODS: f64 = 1.3;
/// Samples that the window must hold.
const LEAST: usize = 50;
/// A tone is trusted below the first part that it leaves of the squares, and no longer trusted above the second.
const TRUSTED: [f64; 2] = [0.5, 0.7];
/// Relative steps of the local search.
const STEPS: [f64; 4] = [0.03, 0.015, 0.007, 0.003];
/// Part of the squares, beside trend and model, that must be left for a further tone.
const WORTH: f64 = 0.001;
/// Two tones are at least this far apart, Hz.
const APART: f64 = 0.05;
/// Time in which a tone fades in or out, s.
const FADE: f64 = 1.0;
/// Change of the model between two samples above which nothing is judged, scales.
const RESTING: f64 = 2e-3;
/// Part of the squared error of all coordinates, without answers, below which the error of one is of no concern.
const FLOOR: f64 = 0.05;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Tone {
    /// rad/s; 0 where there is none.
    frequency: f64,
    is_trusted: bool,
    /// 0 to 1.
    part: f64,
}

/// Where the search is: the tone, and what is tried next.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Search {
    /// A frequency of the scan, Hz.
    Scan(f64),
    /// A step of the local search: its number, and whether up or down.
    Local { step: usize, up: bool },
}

/// The tones of a patient's motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Periodic {
    window: Window,
    tones: [Tone; TONES],
    phasors: [Phasors; TONES],
    /// Time that the phasors count from, s.
    origin: f64,
    /// The tone that is searched for.
    number: usize,
    search: Search,
    /// Best frequency of the search, rad/s, and what it leaves.
    best: (f64, f64),
    /// Part of the squares that all trusted tones leave.
    left: f64,
    /// Slope of the rest, once the window is long enough.
    drift: Option<[f64; CHANNELS]>,
    decoupling: Decoupling,
    proofs: [Proof; CHANNELS],
    /// Whether each coordinate answers the tones, and how far, 0 to 1.
    answers: [bool; CHANNELS],
    parts: [f64; CHANNELS],
}

impl Periodic {
    /// For this many channels, answered in these coordinates; no motion is known.
    #[must_use]
    pub fn new(channels: usize, decoupling: Decoupling) -> Self {
        Self {
            window: Window::new(channels),
            tones: [Tone::default(); TONES],
            phasors: [[[0.0; 2]; CHANNELS]; TONES],
            origin: 0.0,
            number: 0,
            search: Search::Scan(RANGE[0]),
            best: (0.0, f64::INFINITY),
            left: 1.0,
            drift: None,
            decoupling,
            proofs: [Proof::default(); CHANNELS],
            answers: [false; CHANNELS],
            parts: [0.0; CHANNELS],
        }
    }

    pub fn restart(&mut self) {
        self.window.clear();
        self.tones = [Tone::default(); TONES];
        (self.left, self.drift) = (1.0, None);
        self.proofs = [Proof::default(); CHANNELS];
        (self.answers, self.parts) = ([false; CHANNELS], [0.0; CHANNELS]);
        self.begin(0);
    }

    /// Sees a position that the orders do not explain, with the error from the model. Older positions, and such that
    /// follow too closely, are not used.
    pub fn see(&mut self, position: Position, error: &[f64; CHANNELS]) {
        let before = self.window.newest().copied();
        if before.is_some_and(|newest| position.time < newest.time + SPACING) {
            return;
        }
        if let Some(before) = before {
            self.judge(&before, &position, error);
        }
        self.window.push(position);
        let (known, count) = self.known(TONES);
        if self.window.count() >= LEAST
            && let Some(fit) = self.window.fit(&known[..count])
        {
            (self.origin, self.phasors) = (position.time, fit.phasors);
            self.drift = Some(fit.drift);
        }
    }

    /// Drops the answers that do not make the error smaller, and gives those that may.
    fn judge(&mut self, before: &Position, position: &Position, error: &[f64; CHANNELS]) {
        let still = before.model.iter().zip(&position.model).all(|(a, b)| (a - b).abs() < RESTING);
        if !still {
            // What the bladders do on the way of the model is not the patient's motion. Tones go on as they were.
            self.window.clear();
            return;
        }
        let is_known = self.tones.iter().any(|tone| tone.is_trusted);
        let floor = self.floor();
        for (i, error) in self.decoupling.split(error).into_iter().enumerate().take(self.decoupling.count()) {
            let is_answered = self.parts[i] > 0.0 && self.tones.iter().any(|tone| tone.part > 0.0);
            let (time, dt) = (position.time, position.time - before.time);
            if self.proofs[i].fails(time, dt, error, is_answered, floor) {
                self.answers[i] = false;
            } else if is_known && !self.answers[i] && self.parts[i] == 0.0 {
                self.answers[i] = self.proofs[i].permits(time);
            }
        }
    }

    /// Tries one frequency, and lets tones fade, `dt` seconds after the last call.
    pub fn search(&mut self, dt: f64) {
        for tone in &mut self.tones {
            let step = if tone.is_trusted { dt } else { -dt } / FADE;
            tone.part = (tone.part + step).clamp(0.0, 1.0);
            if !tone.is_trusted && tone.part == 0.0 {
                tone.frequency = 0.0;
            }
        }
        for (part, answers) in self.parts.iter_mut().zip(self.answers) {
            *part = (*part + if answers { dt } else { -dt } / FADE).clamp(0.0, 1.0);
        }
        if self.window.count() < LEAST {
            return;
        }
        match self.search {
            Search::Scan(hertz) => {
                let near = |tone: &Tone| (tone.frequency - TAU * hertz).abs() < TAU * APART;
                let is_taken = self.tones[..self.number].iter().any(near);
                if hertz * self.window.length() >= PERIODS && !is_taken {
                    self.attempt(TAU * hertz);
                }
                let next = hertz * RATIO;
                self.search =
                    if next < RANGE[1] { Search::Scan(next) } else { Search::Local { step: 0, up: true } };
            }
            Search::Local { step, up } if step < STEPS.len() && self.best.0 > 0.0 => {
                let size = if up { 1.0 + STEPS[step] } else { 1.0 - STEPS[step] };
                self.attempt(self.best.0 * size);
                self.search = Search::Local { step: step + usize::from(!up), up: !up };
            }
            Search::Local { .. } => self.decide(),
        }
    }

    /// The rates of the periodic motion at a time, in scales per second, as far as they are answered.
    pub fn rates(&self, time: f64, rates: &mut [f64; CHANNELS]) {
        rates.fill(0.0);
        for (tone, phasors) in self.tones.iter().zip(&self.phasors).filter(|(tone, _)| tone.part > 0.0) {
            let (sin, cos) = libm::sincos(tone.frequency * (time - self.origin));
            let rate = phasors.map(|[s, c]| tone.frequency * (s * cos - c * sin));
            let mut answered = self.decoupling.split(&rate);
            for (rate, part) in answered.iter_mut().zip(&self.parts) {
                *rate *= part.min(tone.part);
            }
            rates.iter_mut().zip(self.decoupling.join(&answered)).for_each(|(sum, rate)| *sum += rate);
        }
    }

    /// The part of the tones that a coordinate answers.
    #[must_use]
    pub fn answered(&self, coordinate: usize) -> f64 {
        self.parts[coordinate]
    }

    /// Frequency of a trusted tone, Hz.
    #[must_use]
    pub fn frequency(&self, tone: usize) -> Option<f64> {
        self.tones.get(tone).filter(|tone| tone.is_trusted).map(|tone| tone.frequency / TAU)
    }

    /// Part of the squares, beside trend and model, that the tones explain.
    #[must_use]
    pub fn explained(&self) -> f64 {
        1.0 - self.left
    }

    /// Slope of what is neither ordered, nor periodic, nor a part of the model's way, scales per second; `None` while the
    /// window is short. Bladders that leak and valves that are stuck open show in it.
    #[must_use]
    pub fn drift(&self) -> Option<[f64; CHANNELS]> {
        self.drift
    }

    /// The frequencies of the first `most` tones that are there, and their number.
    fn known(&self, most: usize) -> ([f64; TONES], usize) {
        let mut known = [0.0; TONES];
        let there = self.tones.iter().take(most).take_while(|tone| tone.frequency > 0.0);
        let count = there.zip(&mut known).map(|(tone, to)| *to = tone.frequency).count();
        (known, count)
    }

    fn fit_with(&self, frequency: f64) -> Option<Fit> {
        let (mut tones, count) = self.known(self.number);
        tones[count] = frequency;
        self.window.fit(&tones[..=count])
    }

    /// Squared error of one coordinate that is of no concern.
    fn floor(&self) -> f64 {
        FLOOR * self.proofs.iter().take(self.decoupling.count()).map(Proof::before).sum::<f64>()
    }

    fn attempt(&mut self, frequency: f64) {
        if let Some(fit) = self.fit_with(frequency)
            && fit.left < self.best.1
        {
            self.best = (frequency, fit.left);
        }
    }

    /// Takes the best frequency of the search as that of its tone, or drops the tone.
    fn decide(&mut self) {
        let (known, count) = self.known(self.number);
        let left = |tones: &[f64]| self.window.fit(tones).map_or(0.0, |fit| fit.left);
        // What the tone leaves is compared with what is left without it in the window of today. A second tone may not
        // only mend the frequency of the first.
        let without = left(&known[..count]);
        let without = if without > WORTH * left(&[]) { without } else { 0.0 };
        let with = self.fit_with(self.best.0);
        let left = with.filter(|_| without > 0.0).map_or(1.0, |fit| fit.left / without);
        let tone = &mut self.tones[self.number];
        let limit = TRUSTED[usize::from(tone.is_trusted)];
        if self.best.0 > 0.0 && left < limit {
            (tone.frequency, tone.is_trusted) = (self.best.0, true);
            self.left = if self.number == 0 { left } else { self.left * left };
            self.begin((self.number + 1) % TONES);
        } else {
            if self.number == 0 {
                self.left = 1.0;
                if tone.is_trusted {
                    self.proofs.iter_mut().for_each(Proof::restart);
                    self.answers = [false; CHANNELS];
                }
            }
            // The tones behind it were found beside it.
            self.tones[self.number..].iter_mut().for_each(|tone| tone.is_trusted = false);
            self.begin(0);
        }
    }

    fn begin(&mut self, number: usize) {
        self.number = number;
        self.search = Search::Scan(RANGE[0]);
        self.best = (0.0, f64::INFINITY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Effect;

    const TICK: f64 = 0.02;

    /// As many bladders as channels, each of which moves one.
    fn decoupling(channels: usize) -> Decoupling {
        Effect::new(nalgebra::DMatrix::identity(channels, channels)).unwrap().decoupling()
    }

    /// Sees a motion at 10 Hz for some seconds; returns the tones.
    fn seen(seconds: f64, motion: impl Fn(f64) -> [f64; 2]) -> Periodic {
        let mut periodic = Periodic::new(2, decoupling(2));
        for k in 0..(seconds / TICK) as u32 {
            let time = TICK * f64::from(k);
            if k % 5 == 0 {
                let [a, b] = motion(time);
                let value = [a, b, 0.0, 0.0, 0.0, 0.0];
                // Nothing is judged where there is no error.
                periodic.see(Position { time, value, ..Position::default() }, &[0.0; CHANNELS]);
            }
            periodic.search(TICK);
        }
        periodic
    }

    /// Rough numbers from -1 to 1, the same each time.
    fn noise(time: f64) -> f64 {
        let x = libm::sin(time * 12_989.8) * 43_758.5;
        2.0 * (x - x.floor()) - 1.0
    }

    /// Greatest error of the rates of the first channel within 0.1 s from a time on.
    fn missed(periodic: &Periodic, from: f64, rate: impl Fn(f64) -> f64) -> f64 {
        let mut most = 0.0_f64;
        for k in 0..50 {
            let time = from + 0.002 * f64::from(k);
            let mut rates = [0.0; CHANNELS];
            periodic.rates(time, &mut rates);
            most = most.max((rates[0] - rate(time)).abs());
        }
        most
    }

    #[test]
    fn a_breath_is_found_at_any_frequency_and_its_speed_is_known_ahead() {
        for hertz in [0.17, 0.25, 0.31, 0.47] {
            let w = TAU * hertz;
            let periodic =
                seen(25.0, |t| [0.07 * (w * t).sin() + 0.003 * noise(t), 0.02 * (w * t).cos() + 0.01 * t]);
            let found = periodic.frequency(0).unwrap();
            assert!((found / hertz - 1.0).abs() < 0.01, "{hertz} {found}");
            let missed = missed(&periodic, 25.0, |t| 0.07 * w * (w * t).cos());
            assert!(missed < 0.05 * 0.07 * w, "{hertz}: {missed} of {}", 0.07 * w);
        }
    }

    #[test]
    fn breath_and_nods_are_two_tones_and_a_frequency_that_wanders_is_followed() {
        let nods =
            |t: f64| [1.0 * (TAU * 0.1 * t).sin() + 0.08 * (TAU * 0.25 * t).sin() + 0.003 * noise(t), 0.0];
        let periodic = seen(30.0, nods);
        let mut found = [periodic.frequency(0).unwrap(), periodic.frequency(1).unwrap()];
        found.sort_by(f64::total_cmp);
        assert!((found[0] - 0.1).abs() < 2e-3 && (found[1] - 0.25).abs() < 5e-3, "{found:?}");
        // From 0.2 to 0.3 Hz within 50 s.
        let phase = |t: f64| TAU * (0.2 * t + 0.001 * t * t);
        let periodic = seen(50.0, |t| [0.1 * phase(t).sin(), 0.0]);
        let found = periodic.frequency(0).unwrap();
        assert!((found - 0.3).abs() < 0.02, "{found}");
    }

    #[test]
    fn noise_drift_and_one_cough_are_no_periodic_motion() {
        let nothing =
            seen(60.0, |t| [0.02 * noise(t), 0.05 * (TAU * t / 90.0).sin() + 0.02 * noise(t + 0.5)]);
        assert_eq!(nothing.frequency(0), None);
        let cough = |t: f64| if (12.0..12.8).contains(&t) { 0.2 * (TAU * 2.5 * t).sin() } else { 0.0 };
        let mut rates = [1.0; CHANNELS];
        let coughed = seen(20.0, |t| [cough(t) + 0.003 * noise(t), 0.003 * noise(t + 0.5)]);
        coughed.rates(20.0, &mut rates);
        assert!(rates.iter().all(|r| r.abs() < 0.02), "{rates:?} {:?}", coughed.frequency(0));
        // A breath that stops is forgotten.
        let stopped = seen(60.0, |t| {
            [if t < 20.0 { 0.1 * (TAU * 0.25 * t).sin() } else { 0.0 } + 0.003 * noise(t), 0.0]
        });
        stopped.rates(60.0, &mut rates);
        assert!(rates.iter().all(|r| r.abs() < 0.005), "{rates:?}");
    }

    #[test]
    fn a_bladder_that_cannot_be_emptied_stops_alone() {
        let mut periodic = Periodic::new(2, decoupling(2));
        let (mut ordered, mut moved) = ([0.0; 2], [0.0; 2]);
        let (mut most, mut both, mut second) = (0.0_f64, 0.0, 0.0);
        for k in 0..(100.0 / TICK) as u32 {
            let time = TICK * f64::from(k);
            let breath = 0.1 * (TAU * 0.25 * time).sin();
            let error = [breath + moved[0], breath + moved[1], 0.0, 0.0, 0.0, 0.0];
            if k % 5 == 0 {
                let value = [error[0] - ordered[0], error[1] - ordered[1], 0.0, 0.0, 0.0, 0.0];
                periodic.see(Position { time, value, ..Position::default() }, &error);
            }
            periodic.search(TICK);
            let mut rates = [0.0; CHANNELS];
            periodic.rates(time + 0.5 * TICK, &mut rates);
            for i in 0..2 {
                let order = -TICK * (rates[i] + 0.3 * error[i]);
                ordered[i] += order;
                moved[i] += if i == 0 { order } else { order.max(0.0) };
            }
            if time > 40.0 {
                most = most.max(error[0].abs());
                both += if periodic.answers[0] { TICK } else { 0.0 };
                second += if periodic.answers[1] { TICK } else { 0.0 };
            }
        }
        assert!(most < 0.03 && both > 59.0 && second < 30.0, "{most} {both} {second}");
    }

    /// Answers a breath of 0.1 at 0.25 Hz with orders that have `effect` times the effect that is assumed. Returns half
    /// the range of the error in the last 10 s, and the seconds in which a tone was answered. Weak feedback takes offsets.
    fn answered(effect: f64, seconds: f64) -> (f64, f64) {
        let mut periodic = Periodic::new(1, decoupling(1));
        let (mut ordered, mut trusted) = (0.0, 0.0);
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 0..(seconds / TICK) as u32 {
            let time = TICK * f64::from(k);
            let error = 0.1 * (TAU * 0.25 * time).sin() + effect * ordered;
            if k % 5 == 0 {
                let value = [error - ordered, 0.0, 0.0, 0.0, 0.0, 0.0];
                periodic
                    .see(Position { time, value, ..Position::default() }, &[error, 0.0, 0.0, 0.0, 0.0, 0.0]);
            }
            periodic.search(TICK);
            let mut rates = [0.0; CHANNELS];
            periodic.rates(time + 0.5 * TICK, &mut rates);
            ordered -= TICK * (rates[0] + 0.3 * error);
            trusted += if periodic.answers[0] { TICK } else { 0.0 };
            if time > seconds - 10.0 {
                (least, most) = (error.min(least), error.max(most));
            }
        }
        (0.5 * (most - least), trusted)
    }

    #[test]
    fn orders_of_less_or_more_than_the_assumed_effect_still_cancel_a_breath() {
        for effect in [0.6, 1.0, 1.4] {
            let (worst, trusted) = answered(effect, 80.0);
            assert!(worst < 0.03 && trusted > 40.0, "{effect}: {worst} {trusted}");
        }
    }

    #[test]
    fn orders_without_effect_do_not_grow() {
        let (worst, trusted) = answered(0.0, 200.0);
        assert!(worst < 0.11 && trusted < 80.0, "{worst} {trusted}");
    }

    #[test]
    fn times_that_do_not_grow_and_numbers_that_are_none_leave_it_without_tones() {
        let stuck = seen(20.0, |_| [f64::NAN, 0.0]);
        let mut rates = [1.0; CHANNELS];
        stuck.rates(20.0, &mut rates);
        assert_eq!((rates, stuck.frequency(0), stuck.explained()), ([0.0; CHANNELS], None, 0.0));
        let mut periodic = Periodic::new(2, decoupling(2));
        for _ in 0..100 {
            periodic.see(Position { time: 1.0, ..Position::default() }, &[0.0; CHANNELS]);
        }
        assert_eq!(periodic.window.count(), 1);
    }
}
