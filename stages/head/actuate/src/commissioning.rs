//! From the readings of the guided sequence to the parameters of `actuate.valves`: dead bands, volume, supply and leak of
//! each bladder.
//!
//! What the pulses show of a bladder is how much air its pressure takes, dm/dg. The volume is the one that gives this slope
//! with the pressure at which it doubles, which is given: the estimate of the pressures needs no more.
//!
//! Between two rests the air that passed the valves is the difference of the air in the bladder. The outlet is choked, so its
//! flow is known from the pressure in the bladder; the flow of the inlet, whose orifice is the same, then gives the supply.
//! Pressures alone give the ratio of orifice and volume: the orifice is given (data sheet), and the volume is found.
//! The vacuum is not found, because a choked outlet does not depend on it.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, SVector, Vector3};
use stillpoint_mechanics::plant::valve::{Orifice, Valves};
use stillpoint_mechanics::shell::air::Air;

use crate::pressure::Compliance;
use crate::sequence::Phase;

/// What is known before: the orifice, and where the search for the rest begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Given {
    /// Diameter of the orifice of a valve, m.
    pub orifice: f64,
    /// Its discharge coefficient.
    pub discharge: f64,
    /// Pressure of the vacuum below that of the room, Pa.
    pub vacuum: f64,
    /// Pressure above that of the room at which a bladder has twice its volume, Pa.
    pub doubles_at: f64,
    /// Largest leak that is accepted: diameter of a hole, m.
    pub largest_leak: f64,
}

/// A reading of one bladder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// s.
    pub time: f64,
    pub phase: Phase,
    /// Duties of inlet and outlet.
    pub duty: [f64; 2],
    /// Measured pressure above that of the room, Pa.
    pub pressure: f64,
}

/// What was found of a bladder and its valves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Of inlet and outlet.
    pub dead_band: [f64; 2],
    pub bladder: Compliance,
    /// Mean pressure of the hold above that of the room, Pa.
    pub pressure: f64,
    /// Pressure of the supply above that of the room, Pa.
    pub supply: f64,
    /// Diameter of a hole that explains the fall of pressure; 0 if none is seen.
    pub leak: f64,
    /// Smallest leak that would have been seen, m.
    pub least_leak: f64,
    /// Root mean square of what the model leaves of the pressures after pulses, Pa.
    pub residual: f64,
    /// Pulses that were fitted.
    pub pulses: usize,
}

/// Why nothing is found.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Unfound {
    /// There are too few pulses or no hold.
    #[error("the sequence was not finished: {0} pulses; run it to its end")]
    Unfinished(usize),
    /// A valve does not let air through.
    #[error(
        "its pressure moved by {moved:.0} Pa with the {port} fully open; check the {port} and what feeds it"
    )]
    Unmoved { port: &'static str, moved: f64 },
    /// A bladder that did not hold.
    #[error(
        "it leaks: its pressure fell from {:.1} to {:.1} kPa while its valves were shut; find the leak, and repeat the sequence",
        from * 1e-3,
        to * 1e-3
    )]
    Unheld { from: f64, to: f64 },
    /// A leak.
    #[error(
        "it leaks as through a hole of {:.2} mm (allowed: up to {:.2} mm); find the leak, and repeat the sequence",
        found * 1e3,
        allowed * 1e3
    )]
    Leak { found: f64, allowed: f64 },
    /// No parameters explain the pressures.
    #[error(
        "no dead band, volume and supply explain its pressures: {residual:.0} Pa are left of {moved:.0} Pa; look for a valve \
         that sticks, or a head that moved"
    )]
    Unexplained { residual: f64, moved: f64 },
}

/// Least motion of the pressure by fully open valves, Pa.
const MOVED: f64 = 300.0;
/// Least motion by which a pulse counts, Pa.
const RESPONSE: f64 = 30.0;
/// Largest part of the motion that may be left.
const UNEXPLAINED: f64 = 0.15;
/// Time at the end of a rest in which its pressure is the mean, s.
const TAIL: f64 = 0.2;
/// Beginning of a hold that is not used for the leak, s: the head settles.
const AFTER: f64 = 1.0;
/// Step of the integration, s.
const STEP: f64 = 0.01;
/// Standard deviations that a leak has to be above none.
const SIGMA: f64 = 4.0;
/// Part of the pressure by which a fall over a hold is uncertain at least.
const CERTAIN: f64 = 1e-3;

/// From one rest to the next.
#[derive(Clone, Debug)]
struct Pulse {
    /// 0 for the inlet, 1 for the outlet.
    port: usize,
    duty: f64,
    /// Time for which the valve was open, and until the end of the rest, s.
    open: f64,
    shut: f64,
    /// Pressures at both rests, Pa.
    before: f64,
    after: f64,
}

/// Fall of the pressure while the bladder was held.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fall {
    /// Pa/s, positive for a fall, and its standard deviation.
    rate: f64,
    sd: f64,
    /// Mean pressure, Pa.
    pressure: f64,
}

/// Finds the parameters of one bladder from its readings, in the order of time.
///
/// # Errors
/// [`Unfound`] where they cannot be told.
pub fn find(readings: &[Reading], given: &Given) -> Result<Found, Unfound> {
    let pulses = pulses(readings);
    held(readings)?;
    for (port, name) in [(0, "inlet"), (1, "outlet")] {
        let full = pulses.iter().filter(|p| p.port == port && p.duty >= 1.0);
        let moved = full.map(|p| (p.after - p.before).abs()).reduce(f64::max);
        match moved {
            None => return Err(Unfound::Unfinished(pulses.len())),
            Some(moved) if moved < MOVED => return Err(Unfound::Unmoved { port: name, moved }),
            Some(_) => {}
        }
    }
    let fall = fall(readings).ok_or(Unfound::Unfinished(pulses.len()))?;
    let used: Vec<Pulse> = pulses.into_iter().filter(|p| (p.after - p.before).abs() > RESPONSE).collect();
    if used.len() < 2 * Theta::COUNT {
        return Err(Unfound::Unfinished(used.len()));
    }
    let model = Model::new(given);
    let mut theta = Theta::start(&used);
    let mut leak = 0.0;
    let mut residual = f64::INFINITY;
    // The leak follows from the compliance, and the flows of the pulses from the leak.
    for _ in 0..4 {
        let area = leak_area(&model, &theta, fall.rate, fall.pressure);
        leak = if fall.rate > SIGMA * fall.sd { area.max(0.0) } else { 0.0 };
        (theta, residual) = fit(&model, &used, theta, leak);
    }
    let diameter = |area: f64| (4.0 * area.max(0.0) / (core::f64::consts::PI * given.discharge)).sqrt();
    let found = diameter(leak);
    if found > given.largest_leak {
        return Err(Unfound::Leak { found, allowed: given.largest_leak });
    }
    let moved = (used.iter().map(|p| (p.after - p.before).powi(2)).sum::<f64>() / used.len() as f64).sqrt();
    let is_explained = residual <= UNEXPLAINED * moved;
    if !is_explained {
        return Err(Unfound::Unexplained { residual, moved });
    }
    let [_, _, inlet, outlet, _] = theta.0.into();
    Ok(Found {
        dead_band: [inlet, outlet],
        bladder: model.bladder(&theta),
        pressure: fall.pressure,
        supply: theta.supply() - Air::ROOM.atmosphere,
        leak: found,
        least_leak: diameter(leak_area(&model, &theta, SIGMA * fall.sd, fall.pressure)),
        residual,
        pulses: used.len(),
    })
}

/// Effective area of a hole to the room that lets the pressure fall like that, m^2.
fn leak_area(model: &Model, theta: &Theta, rate: f64, pressure: f64) -> f64 {
    let bladder = model.bladder(theta);
    let slope = (bladder.mass(pressure + 50.0) - bladder.mass(pressure - 50.0)) / 100.0;
    let room = Air::ROOM.atmosphere;
    let flow = model.law.flow(1.0, room + pressure, room);
    if flow > 0.0 { rate * slope / flow } else { 0.0 }
}

/// The pulses of a bladder with the rests on both sides.
fn pulses(readings: &[Reading]) -> Vec<Pulse> {
    let is_open = |r: &Reading| r.duty[0] > 0.0 || r.duty[1] > 0.0;
    let mean = |part: &[Reading], until: f64| {
        let tail: Vec<f64> = part
            .iter()
            .filter(|r| r.time > until - TAIL && r.pressure.is_finite())
            .map(|r| r.pressure)
            .collect();
        (!tail.is_empty()).then(|| tail.iter().sum::<f64>() / tail.len() as f64)
    };
    // Stretches in which the duties are the same.
    let stretches: Vec<&[Reading]> = readings.chunk_by(|a, b| a.duty == b.duty).collect();
    stretches
        .windows(3)
        .filter_map(|w| {
            let [rest, pulse, next] = [w[0], w[1], w[2]];
            let (first, begin, end) = (pulse.first()?, next.first()?, next.last()?);
            if !is_open(first) || is_open(rest.first()?) || is_open(begin) {
                return None;
            }
            let port = usize::from(first.duty[1] > 0.0);
            Some(Pulse {
                port,
                duty: first.duty[port],
                open: begin.time - first.time,
                shut: end.time - begin.time,
                before: mean(rest, rest.last()?.time)?,
                after: mean(next, end.time)?,
            })
        })
        .collect()
}

/// Refuses a bladder that lost half of its pressure in the hold.
fn held(readings: &[Reading]) -> Result<(), Unfound> {
    let mut hold = readings.iter().filter(|r| r.phase == Phase::Holding && r.pressure.is_finite());
    let Some(first) = hold.next() else { return Ok(()) };
    let (from, to) = (first.pressure, hold.next_back().unwrap_or(first).pressure);
    if to < 0.5 * from { Err(Unfound::Unheld { from, to }) } else { Ok(()) }
}

/// The fall of the pressure in a hold: what goes on at a constant rate, without what slows down as creep does, with the
/// logarithm of time.
fn fall(readings: &[Reading]) -> Option<Fall> {
    let hold: Vec<&Reading> =
        readings.iter().filter(|r| r.phase == Phase::Holding && r.pressure.is_finite()).collect();
    let begin = hold.first()?.time;
    let used: Vec<(f64, f64)> =
        hold.iter().map(|r| (r.time - begin, r.pressure)).filter(|(t, _)| *t > AFTER).collect();
    let n = used.len();
    if n < 50 {
        return None;
    }
    let row = |t: f64| Vector3::new(1.0, t, libm::log(t));
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (t, p) in &used {
        normal += row(*t) * row(*t).transpose();
        right += row(*t) * *p;
    }
    let inverse = normal.try_inverse()?;
    let line = inverse * right;
    let squares: f64 = used.iter().map(|(t, p)| (p - row(*t).dot(&line)).powi(2)).sum();
    // The pressures come in steps of the acknowledgements: neighbours are not independent, so ten readings count as one.
    let variance = 10.0 * squares / (n - 3) as f64;
    let pressure = used.iter().map(|(_, p)| p).sum::<f64>() / n as f64;
    // Sensors without noise do not make rubber known: a thousandth of the pressure over the hold is no leak.
    let span = used.last().map_or(1.0, |(t, _)| t.max(1.0));
    let sd = (variance * inverse[(1, 1)]).sqrt().max(CERTAIN * pressure.abs() / span);
    Some(Fall { rate: -line[1], sd, pressure })
}

/// Logarithms of the volume and of the absolute supply; dead bands of inlet and outlet; drift of the pressure by creep of the
/// rubber, in 10 Pa/s.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Theta(SVector<f64, { Self::COUNT }>);

impl Theta {
    const COUNT: usize = 5;

    /// Where the search begins: a bladder of the rigs, and dead bands below the smallest duty that did anything.
    fn start(pulses: &[Pulse]) -> Self {
        let least =
            |port: usize| pulses.iter().filter(|p| p.port == port).map(|p| p.duty).fold(1.0, f64::min);
        let dead = |port: usize| 0.5 * least(port);
        let supply = Air::ROOM.atmosphere + 100e3;
        Self(SVector::from([libm::log(0.5e-3), libm::log(supply), dead(0), dead(1), 0.0]))
    }

    /// m^3.
    fn volume(&self) -> f64 {
        libm::exp(self.0[0])
    }

    /// Absolute, Pa.
    fn supply(&self) -> f64 {
        libm::exp(self.0[1])
    }

    /// Pa/s.
    fn drift(&self) -> f64 {
        10.0 * self.0[4]
    }

    fn is_possible(&self) -> bool {
        let dead = [self.0[2], self.0[3]];
        dead.iter().all(|d| (-0.05..0.9).contains(d))
            && (1e-6..0.1).contains(&self.volume())
            && (0.5e5..2e6).contains(&self.supply())
            && self.0[4].abs() < 100.0
    }
}

struct Model {
    law: Orifice,
    /// Effective area of a fully open valve, m^2.
    area: f64,
    /// Absolute pressure behind the outlets, Pa.
    exhaust: f64,
    doubles_at: f64,
}

impl Model {
    fn new(given: &Given) -> Self {
        let valves = Valves {
            discharge: given.discharge,
            diameter: given.orifice,
            lag: 0.0,
            supply: 0.0,
            exhaust: 0.0,
        };
        Self {
            law: Orifice::new(&Air::ROOM),
            area: valves.effective_area(1.0),
            exhaust: (Air::ROOM.atmosphere - given.vacuum).max(0.0),
            doubles_at: given.doubles_at,
        }
    }

    fn bladder(&self, theta: &Theta) -> Compliance {
        Compliance { volume: theta.volume(), doubles_at: self.doubles_at }
    }

    /// The pressure after a pulse.
    fn after(&self, pulse: &Pulse, theta: &Theta, leak: f64) -> f64 {
        let (bladder, room) = (self.bladder(theta), Air::ROOM.atmosphere);
        let dead = theta.0[2 + pulse.port];
        let area = self.area * ((pulse.duty - dead) / (1.0 - dead)).max(0.0);
        let mut mass = bladder.mass(pulse.before);
        for (time, area) in [(pulse.open, area), (pulse.shut, 0.0)] {
            // Without a leak nothing happens while the valve is shut.
            let steps = if area == 0.0 && leak == 0.0 { 0.0 } else { libm::ceil(time / STEP).max(1.0) };
            let dt = time / steps;
            for _ in 0..steps as usize {
                let inside = room + bladder.gauge(mass);
                let flow = match pulse.port {
                    0 => self.law.flow(area, theta.supply(), inside),
                    _ => -self.law.flow(area, inside, self.exhaust),
                };
                mass += dt * (flow - self.law.flow(leak, inside, room));
            }
        }
        bladder.gauge(mass) + theta.drift() * (pulse.open + pulse.shut)
    }

    fn residuals(&self, pulses: &[Pulse], theta: &Theta, leak: f64) -> DVector<f64> {
        DVector::from_iterator(pulses.len(), pulses.iter().map(|p| self.after(p, theta, leak) - p.after))
    }
}

/// Least squares by Levenberg's and Marquardt's method. Gives the parameters and the root mean square of the residuals, Pa.
fn fit(model: &Model, pulses: &[Pulse], start: Theta, leak: f64) -> (Theta, f64) {
    let cost = |theta: &Theta| model.residuals(pulses, theta, leak).norm_squared();
    let (mut theta, mut damping) = (start, 1e-3);
    let mut best = cost(&theta);
    for _ in 0..60 {
        let residuals = model.residuals(pulses, &theta, leak);
        let mut jacobian = DMatrix::zeros(pulses.len(), Theta::COUNT);
        for i in 0..Theta::COUNT {
            let h = 1e-4;
            let (mut up, mut down) = (theta, theta);
            up.0[i] += h;
            down.0[i] -= h;
            let slope =
                (model.residuals(pulses, &up, leak) - model.residuals(pulses, &down, leak)) / (2.0 * h);
            jacobian.set_column(i, &slope);
        }
        let normal: SMatrix<f64, 5, 5> = SMatrix::from_fn(|i, j| jacobian.column(i).dot(&jacobian.column(j)));
        let right: SVector<f64, 5> = SVector::from_fn(|i, _| -jacobian.column(i).dot(&residuals));
        let before = best;
        for _ in 0..12 {
            let damped = normal + SMatrix::from_diagonal(&(normal.diagonal() * damping).add_scalar(1e-12));
            let Some(step) = damped.cholesky().map(|c| c.solve(&right)) else { break };
            let tried = Theta(theta.0 + step);
            let found = if tried.is_possible() { cost(&tried) } else { f64::INFINITY };
            if found < best {
                (theta, best, damping) = (tried, found, damping * 0.3);
                break;
            }
            damping *= 4.0;
        }
        if before - best <= 1e-10 * before {
            break;
        }
    }
    (theta, (best / pulses.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequence::{Port, Sequence, SequenceParams};

    struct Truth {
        bladder: Compliance,
        supply: f64,
        dead_band: [f64; 2],
        leak: f64,
        /// Duty that the valves follow in place of that of the inlet.
        stuck: Option<f64>,
    }

    const GIVEN: Given =
        Given { orifice: 1e-3, discharge: 0.8, vacuum: 82.7e3, doubles_at: 50e3, largest_leak: 0.3e-3 };
    const PARAMS: SequenceParams =
        SequenceParams { bladders: 1, rise: 1.5e3, limit: 40e3, hold: 10.0, settle: 1.0 };

    /// The readings of a bladder of known parameters: integrated in steps of 1 ms, by the orifice law alone.
    fn readings(truth: &Truth) -> Vec<Reading> {
        let law = Orifice::new(&Air::ROOM);
        let area = 0.25 * core::f64::consts::PI * 0.8e-6;
        let room = Air::ROOM.atmosphere;
        let mut mass = truth.bladder.mass(8e3);
        let mut sequence = Sequence::new(PARAMS);
        let mut readings = Vec::new();
        for tick in 0..20_000 {
            let time = f64::from(tick) * 0.01;
            let pressure = truth.bladder.gauge(mass);
            let act = sequence.look(time, &[pressure]);
            if act.phase == Phase::Done {
                break;
            }
            let duty = match act.open {
                None => [0.0; 2],
                Some((Port::Inlet, duty)) => [duty, 0.0],
                Some((Port::Outlet, duty)) => [0.0, duty],
            };
            readings.push(Reading { time, phase: act.phase, duty, pressure });
            for _ in 0..10 {
                let inside = room + truth.bladder.gauge(mass);
                let opening = |port: usize| {
                    let asked = if port == 0 { truth.stuck.unwrap_or(duty[0]) } else { duty[1] };
                    ((asked - truth.dead_band[port]) / (1.0 - truth.dead_band[port])).max(0.0) * area
                };
                let flow = law.flow(opening(0), room + truth.supply, inside)
                    - law.flow(opening(1), inside, room - 82.7e3)
                    - law.flow(0.8 * 0.25 * core::f64::consts::PI * truth.leak * truth.leak, inside, room);
                mass += 1e-3 * flow;
            }
        }
        readings
    }

    fn truth() -> Truth {
        Truth {
            bladder: Compliance { volume: 0.52e-3, doubles_at: 50e3 },
            supply: 103e3,
            dead_band: [0.07, 0.07],
            leak: 0.0,
            stuck: None,
        }
    }

    #[test]
    fn drawn_parameters_are_found_again() {
        let mut random = stillpoint_mechanics::random::Random::stream(5, 1);
        for draw in 0..12 {
            let truth = Truth {
                bladder: Compliance {
                    volume: random.between(0.35e-3, 0.9e-3),
                    doubles_at: random.between(10e3, 80e3),
                },
                supply: random.between(60e3, 140e3),
                dead_band: [random.between(0.0, 0.11), random.between(0.0, 0.11)],
                leak: if draw % 3 == 0 { random.between(0.1e-3, 0.25e-3) } else { 0.0 },
                stuck: None,
            };
            let found = find(&readings(&truth), &GIVEN).unwrap_or_else(|e| panic!("{draw}: {e}"));
            let near = |found: f64, truth: f64, part: f64| (found / truth - 1.0).abs() < part;
            // The air that a rise of the pressure takes, where the pulses were.
            let slope = |bladder: &Compliance| bladder.mass(9.5e3) - bladder.mass(8.5e3);
            assert!(near(slope(&found.bladder), slope(&truth.bladder), 0.03), "{draw}: {found:?}");
            assert!(near(found.supply, truth.supply, 0.05), "{draw}: {found:?} {}", truth.supply);
            for (found, truth) in found.dead_band.iter().zip(truth.dead_band) {
                assert!((found - truth).abs() < 3e-3, "{draw}: {found} {truth}");
            }
            assert!((found.leak - truth.leak).abs() < 0.02e-3, "{draw}: {} {}", found.leak, truth.leak);
        }
    }

    #[test]
    fn a_large_leak_a_shut_supply_and_an_unfinished_sequence_are_refused_with_their_cause() {
        let emptied = find(&readings(&Truth { leak: 0.5e-3, ..truth() }), &GIVEN);
        assert!(matches!(emptied, Err(Unfound::Unheld { .. })), "{emptied:?}");
        let strict = Given { largest_leak: 0.1e-3, ..GIVEN };
        let leaking = find(&readings(&Truth { leak: 0.2e-3, ..truth() }), &strict);
        assert!(
            matches!(leaking, Err(Unfound::Leak { found, .. }) if (found - 0.2e-3).abs() < 0.02e-3),
            "{leaking:?}"
        );
        let stuck = find(&readings(&Truth { stuck: Some(0.0), ..truth() }), &GIVEN);
        assert!(matches!(stuck, Err(Unfound::Unmoved { port: "inlet", .. })), "{stuck:?}");
        let whole = readings(&truth());
        let part = find(&whole[..400], &GIVEN);
        assert!(matches!(part, Err(Unfound::Unfinished(_))), "{part:?}");
    }
}
