//! The guided sequence of commissioning: which valve is open when, by the measured pressures.
//!
//! One bladder after the other is filled a little, held, pulsed through each valve at several duties, and brought back to the
//! pressure of its start. The other valves stay shut. A head that lies on the bladders moves by some millimetres.

/// A valve of a bladder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// From the supply.
    Inlet,
    /// To the vacuum.
    Outlet,
}

/// What the sequence is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Phase {
    /// It has not begun.
    Waiting = 0,
    /// All valves are shut, and pressures settle.
    Settling = 1,
    /// A valve is fully open until a level is reached.
    Filling = 2,
    /// All valves are shut, so that a leak shows.
    Holding = 3,
    /// A valve is open for a time.
    Pulsing = 4,
    /// It is over.
    Done = 5,
    /// It was stopped: a pressure was above its limit.
    Stopped = 6,
}

/// Bounds of the sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequenceParams {
    pub bladders: usize,
    /// How far the pressure of a bladder is raised from that of its start, Pa.
    pub rise: f64,
    /// Pressure above that of the room at which the sequence stops, Pa.
    pub limit: f64,
    /// Time for which a bladder is held, s.
    pub hold: f64,
    /// Time after each pulse, s.
    pub settle: f64,
}

/// Duties of the pulses.
pub const DUTIES: [f64; 5] = [1.0, 0.5, 0.3, 0.2, 0.14];
/// Time for which a fully open valve is pulsed, s: smaller duties take longer in proportion.
const PULSE: f64 = 0.06;
/// Longest time in which a level is to be reached, s.
const REACH: f64 = 4.0;
/// Time after which a valve by which the pressure has not moved is left, s, and that motion, Pa.
const MOVES_WITHIN: f64 = 1.0;
const MOVES: f64 = 300.0;
/// How often the pulses are repeated.
const REPEATS: usize = 2;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Settle(f64),
    /// To the pressure of the start and the rise.
    Rise,
    /// Back to the pressure of the start.
    Return,
    Hold(f64),
    Pulse(Port, f64),
}

/// What the valves do now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Act {
    pub phase: Phase,
    pub bladder: usize,
    /// The valve that is open, and its duty.
    pub open: Option<(Port, f64)>,
}

/// The sequence through time.
#[derive(Clone, Debug)]
pub struct Sequence {
    params: SequenceParams,
    bladder: usize,
    step: usize,
    /// When the step began, s.
    since: Option<f64>,
    /// Pressure of the bladder when the step began, and when the bladder's turn began, Pa.
    from: f64,
    start: f64,
    stopped: bool,
}

impl Sequence {
    /// Before its beginning.
    #[must_use]
    pub fn new(params: SequenceParams) -> Self {
        Self { params, bladder: 0, step: 0, since: None, from: 0.0, start: 0.0, stopped: false }
    }

    /// The steps of a bladder.
    fn steps(params: &SequenceParams) -> impl Iterator<Item = Step> {
        let settle = params.settle;
        let pulses = (0..REPEATS).flat_map(|_| DUTIES).flat_map(move |duty| {
            let pulse = move |port| [Step::Pulse(port, duty), Step::Settle(settle)];
            [Port::Outlet, Port::Inlet].into_iter().flat_map(pulse)
        });
        [Step::Settle(2.0 * settle), Step::Rise, Step::Settle(2.0 * settle), Step::Hold(params.hold)]
            .into_iter()
            .chain(pulses)
            .chain([Step::Return, Step::Settle(settle)])
    }

    /// The longest time that it takes, s.
    #[must_use]
    pub fn longest(params: &SequenceParams) -> f64 {
        let time = |step: Step| match step {
            Step::Settle(time) | Step::Hold(time) => time,
            Step::Rise | Step::Return => REACH,
            Step::Pulse(_, duty) => PULSE / duty,
        };
        params.bladders as f64 * Self::steps(params).map(time).sum::<f64>()
    }

    /// What the valves do at a time, s, at these pressures, Pa above that of the room.
    pub fn look(&mut self, now: f64, pressures: &[f64]) -> Act {
        let idle = |phase, bladder| Act { phase, bladder, open: None };
        // A pressure that is not a number is above any limit.
        self.stopped |= !pressures.iter().all(|p| *p <= self.params.limit);
        if self.stopped {
            return idle(Phase::Stopped, self.bladder);
        }
        loop {
            let Some(pressure) = pressures.get(self.bladder).filter(|_| self.bladder < self.params.bladders)
            else {
                return idle(Phase::Done, self.params.bladders);
            };
            let Some(step) = Self::steps(&self.params).nth(self.step) else {
                (self.bladder, self.step, self.since) = (self.bladder + 1, 0, None);
                continue;
            };
            let since = match self.since {
                Some(since) => since,
                None => {
                    (self.since, self.from) = (Some(now), *pressure);
                    if self.step == 0 {
                        self.start = *pressure;
                    }
                    now
                }
            };
            let passed = now - since;
            let bladder = self.bladder;
            let act = match step {
                Step::Settle(time) => (passed < time).then_some(idle(Phase::Settling, bladder)),
                Step::Hold(time) => (passed < time).then_some(idle(Phase::Holding, bladder)),
                Step::Pulse(port, duty) => (passed < PULSE / duty).then_some(Act {
                    phase: Phase::Pulsing,
                    bladder,
                    open: Some((port, duty)),
                }),
                Step::Rise => self.reach(passed, *pressure, self.start + self.params.rise),
                Step::Return => self.reach(passed, *pressure, self.start),
            };
            match act {
                Some(act) => return act,
                None => (self.step, self.since) = (self.step + 1, None),
            }
        }
    }

    /// On the way to a level; `None` where it is reached, or never will be.
    fn reach(&self, passed: f64, pressure: f64, level: f64) -> Option<Act> {
        let port = if level > self.from { Port::Inlet } else { Port::Outlet };
        let is_there = if port == Port::Inlet { pressure >= level } else { pressure <= level };
        let is_stuck = passed > MOVES_WITHIN && (pressure - self.from).abs() < MOVES;
        (!is_there && !is_stuck && passed < REACH).then_some(Act {
            phase: Phase::Filling,
            bladder: self.bladder,
            open: Some((port, 1.0)),
        })
    }
}
