//! What real valves, rubber and contacts do and ideal ones do not.

use std::collections::VecDeque;

use nalgebra::SVector;
use stillpoint_mechanics::contact::mobility::{OPEN, SLIDING, STICKING};
use stillpoint_mechanics::plant::grip::{Grip, Held};
use stillpoint_mechanics::plant::layouts::{START_GAP, tangents};
use stillpoint_mechanics::plant::sticking::Sticking;
use stillpoint_mechanics::plant::{Plant, Pressed, State};
use stillpoint_mechanics::random::Random;
use stillpoint_mechanics::shell::rubber::{Relaxation, Wall};

/// Number of the random stream of the valves' delays.
const DELAYS: u64 = 0x76_61_6c_76_65;

/// How far valves, rubber and contacts are from ideal ones. All zero: ideal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Imperfections {
    /// Duty up to which a valve stays shut, 0 to 1; above it the opening grows in proportion, to full opening at full
    /// duty.
    pub dead_band: f64,
    /// Time after which a valve begins to follow its duty, in the mean of the valves, ns.
    pub delay: u64,
    /// Greatest deviation of a valve's delay from the mean, as a part of it, 0 to 1.
    pub spread: f64,
    /// Part by which the surplus pressure of stretched rubber falls in a decade of time.
    pub creep: f64,
    /// Coefficient of friction between bladders and head.
    pub friction: f64,
    /// Of the valves' delays.
    pub seed: u64,
}

impl Imperfections {
    /// Opening of a valve at this duty.
    fn opening(&self, duty: f64) -> f64 {
        let dead = self.dead_band;
        if duty <= dead { 0.0 } else { (duty - dead) / (1.0 - dead) }
    }
}

/// Valves, rubber and contacts through time.
#[derive(Debug, Clone, PartialEq)]
pub struct Hardware<const D: usize, const B: usize> {
    imperfections: Imperfections,
    /// Of each inlet and outlet, ns.
    delay: [[u64; 2]; B],
    /// Changes of the duties that a valve may not follow yet, with their times.
    ordered: VecDeque<(u64, [[f64; 2]; B])>,
    rubber: [Relaxation; B],
    contacts: Holding<D, B>,
}

/// What holds the head along its contacts.
#[derive(Debug, Clone, PartialEq)]
enum Holding<const D: usize, const B: usize> {
    /// Nothing: contacts that stay where they are, without friction.
    Nothing,
    /// Contacts that stay where they are.
    Fixed(Sticking<D, B>),
    Rolling(Grip<B>),
}

/// A contact along its surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Along {
    /// Length of the tangential force on the head, N.
    pub force: f64,
    /// What friction could bear beside it, N.
    pub margin: f64,
    pub slides: bool,
    /// What it leaves free between bladder and head (3.1).
    pub freedoms: u32,
}

impl<const D: usize, const B: usize> Hardware<D, B> {
    /// Of a plant that has been at rest for long. `channels` says which of x, y, z, pitch, roll, yaw its coordinates
    /// are.
    pub fn new<const N: usize>(
        imperfections: Imperfections,
        plant: &Plant<D, B, N>,
        channels: &[usize; D],
        state: &State<D, B>,
    ) -> Self {
        let mut random = Random::stream(imperfections.seed, DELAYS);
        let delay = core::array::from_fn(|_| {
            core::array::from_fn(|_| {
                let part = 1.0 + imperfections.spread * random.between(-1.0, 1.0);
                (imperfections.delay as f64 * part) as u64
            })
        });
        let pressed = plant.bladders(&state.position, &state.air);
        let friction = imperfections.friction;
        Self {
            imperfections,
            delay,
            ordered: VecDeque::with_capacity(64),
            rubber: pressed.map(|pressed| Relaxation::at_rest(&plant.shell, pressed.inner_stretch)),
            contacts: if plant.rolling.is_some() {
                Holding::Rolling(Grip::new(friction, &plant.shell, START_GAP))
            } else if friction > 0.0 {
                Holding::Fixed(Sticking::new(tangents(channels), friction, &plant.shell, START_GAP))
            } else {
                Holding::Nothing
            },
        }
    }

    /// The openings that inlets and outlets go to at `now`, ns, when these duties are ordered.
    pub fn openings(&mut self, now: u64, duty: [[f64; 2]; B]) -> [[f64; 2]; B] {
        let followed = if self.imperfections.delay == 0 { duty } else { self.delayed(now, duty) };
        followed.map(|pair| pair.map(|duty| self.imperfections.opening(duty)))
    }

    fn delayed(&mut self, now: u64, duty: [[f64; 2]; B]) -> [[f64; 2]; B] {
        if self.ordered.back().is_none_or(|(_, last)| *last != duty) {
            self.ordered.push_back((now, duty));
        }
        // What all valves follow already is the first entry.
        let latest = self.delay.iter().flatten().max().copied().unwrap_or(0);
        while self.ordered.get(1).is_some_and(|(time, _)| time.saturating_add(latest) <= now) {
            self.ordered.pop_front();
        }
        core::array::from_fn(|j| {
            core::array::from_fn(|v| {
                let followed =
                    self.ordered.iter().rev().find(|(time, _)| time.saturating_add(self.delay[j][v]) <= now);
                // Before its first duty a valve is shut.
                followed.map_or(0.0, |(_, duty)| duty[j][v])
            })
        })
    }

    /// The rubber of each bladder.
    pub fn walls(&self) -> [Wall; B] {
        self.rubber.map(|rubber| rubber.wall(self.imperfections.creep))
    }

    /// Friction of fixed contacts on the head, N and N m.
    pub fn friction(&self) -> Option<SVector<f64, D>> {
        if let Holding::Fixed(contacts) = &self.contacts { Some(contacts.force()) } else { None }
    }

    /// Tangential forces of contacts that roll, in a step from this position.
    pub fn held<const N: usize>(
        &self,
        plant: &Plant<D, B, N>,
        position: &SVector<f64, D>,
    ) -> Option<Held<D>> {
        let Holding::Rolling(grip) = &self.contacts else { return None };
        plant.rolling.as_ref().map(|rolling| grip.held(rolling, position))
    }

    /// Contact `j` along its surface while its bladder presses so.
    pub fn along(&self, j: usize, pressed: &Pressed) -> Along {
        let push = pressed.force();
        let (force, moved) = match &self.contacts {
            Holding::Nothing => (0.0, [true; 2]),
            Holding::Fixed(contacts) => {
                let (force, slid) = contacts.tangential(j);
                (force, [slid; 2])
            }
            Holding::Rolling(grip) => (grip.tangential(j), grip.moved(j)),
        };
        let freedoms = match moved {
            _ if push <= 0.0 => OPEN,
            [true, true] => SLIDING,
            [true, false] => SLIDING - 1,
            [false, true] => STICKING + 1,
            [false, false] => STICKING,
        };
        Along { force, margin: self.imperfections.friction * push - force, slides: moved[0], freedoms }
    }

    /// The plant has gone from one state to another in `h` seconds.
    pub fn advance<const N: usize>(
        &mut self,
        plant: &Plant<D, B, N>,
        before: &State<D, B>,
        after: &State<D, B>,
        h: f64,
    ) {
        if self.imperfections.creep == 0.0 && self.contacts == Holding::Nothing {
            return;
        }
        let pressed = plant.creeping(after, &self.walls());
        for (rubber, pressed) in self.rubber.iter_mut().zip(&pressed) {
            rubber.advance(&plant.shell, pressed.inner_stretch, h);
        }
        match &mut self.contacts {
            Holding::Nothing => {}
            Holding::Fixed(contacts) => {
                contacts.advance(&(after.position - before.position), pressed.iter().map(|p| p.force()));
            }
            Holding::Rolling(grip) => {
                if let Some(rolling) = &plant.rolling {
                    grip.advance(rolling, &before.position, &after.position, &pressed);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_mechanics::plant::ThreeDof;

    fn hardware(imperfections: Imperfections) -> Hardware<3, 3> {
        let plant = ThreeDof::rig(5.0);
        let state = State::at_rest(SVector::zeros(), plant.start_air());
        Hardware::new(imperfections, &plant, &[2, 3, 4], &state)
    }

    #[test]
    fn a_valve_stays_shut_within_its_dead_band_and_is_fully_open_at_full_duty() {
        for dead_band in [0.0, 0.07, 0.5] {
            let opening = |duty| Imperfections { dead_band, ..Imperfections::default() }.opening(duty);
            assert_eq!([0.0, dead_band, 1.0].map(opening), [0.0, 0.0, 1.0]);
            let middle = opening(0.5 + 0.5 * dead_band);
            assert!((middle - 0.5).abs() < 1e-15, "{dead_band}: {middle}");
        }
        // Without a dead band a duty is the opening, to the bit.
        assert_eq!([0.1, 0.3, 0.7].map(|duty| Imperfections::default().opening(duty)), [0.1, 0.3, 0.7]);
    }

    #[test]
    fn each_valve_follows_after_its_own_delay() {
        let delay = 6_000_000;
        let mut hardware =
            hardware(Imperfections { delay, spread: 0.5, seed: 3, ..Imperfections::default() });
        let delays: Vec<u64> = hardware.delay.iter().flatten().copied().collect();
        assert!(delays.iter().all(|d| (3_000_000..=9_000_000).contains(d)), "{delays:?}");
        assert!(delays.iter().max().unwrap() - delays.iter().min().unwrap() > 1_000_000, "{delays:?}");
        let (shut, open) = ([[0.0; 2]; 3], [[0.4; 2]; 3]);
        for k in 0..200_u64 {
            // Open at 50 ms, shut again at 55 ms.
            let now = k * 500_000;
            let is_open = |now: u64| (50_000_000..55_000_000).contains(&now);
            let found = hardware.openings(now, if is_open(now) { open } else { shut });
            for (opening, delay) in found.iter().flatten().zip(&delays) {
                let due = now.checked_sub(*delay).is_some_and(is_open);
                assert_eq!(*opening > 0.0, due, "{now} {delay}");
            }
            assert!(hardware.ordered.len() <= 3);
        }
    }
}
