//! The states of actuation: disarmed, armed, holding, venting, fault.
//!
//! A person arms while every condition holds. Then commands are followed while no condition is missing. A missing
//! condition (a stale pose, a stale command) causes a hold, and then the safe state. This ends by itself: a hold at
//! once, a vent after it has settled. Faults are a condition that is missing for too long, a pressure above its limit,
//! values that are not finite, and a reference that was lost with its tracker: a person has to resume. A person can
//! vent and disarm at any time.
//!
//! Before every vent comes a hold for the time that the beam needs to end (`lead`): by then the state gives the reason,
//! and the gate has ended its lease.

use stillpoint_samples::{ActuationReason as Reason, ActuationState};

use crate::message::{Order, Safe};

/// Weight of time with a missing condition, relative to time in which every condition holds.
const FADES: u64 = 4;

/// How actuation answers to what happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rules {
    /// The safe state, for missing conditions and faults.
    pub safe: Safe,
    /// How long it holds before it vents, ns.
    pub lead: u64,
    /// How long all must be there again, once it vented, before commands are followed, ns.
    pub settle: u64,
    /// Time for which a condition may be missing, ns. Short gaps add up if a condition is missing for more than a fifth
    /// of the time.
    pub patience: u64,
}

/// What a person asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    Arm,
    Disarm,
    /// To go on after a fault, or after venting.
    Resume,
    /// To let the air out.
    Vent,
}

/// What is seen at the moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// The time, ns.
    pub now: u64,
    /// What went wrong: bits of [`Reason`].
    pub faults: u32,
    /// What is missing to follow commands: bits of [`Reason`].
    pub missing: u32,
    /// What is missing to be armed, besides: bits of [`Reason`].
    pub unready: u32,
    /// Whether the controller asks that all valves be shut.
    pub is_idle: bool,
    /// Whether the face moves by itself, so that the pose may follow it.
    pub is_face: bool,
    /// The reference of the pose: its number, and the incarnation of its tracker; `None` if none is required.
    pub reference: Option<(u32, u32)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Disarmed,
    Armed {
        reference: Option<(u32, u32)>,
    },
    /// On a person's command.
    Vented,
    Fault(u32),
}

/// The states of actuation.
#[derive(Clone, Debug)]
pub struct Machine {
    rules: Rules,
    mode: Mode,
    state: ActuationState,
    /// Since when the state holds, ns.
    since: u64,
    reasons: u32,
    /// Time since which no command is followed, ns; `None` while commands are followed.
    halted: Option<u64>,
    /// When it last looked, ns.
    looked: Option<u64>,
    /// Accumulated time with a missing condition, ns; it falls while no condition is missing.
    lacked: u64,
    /// It vented for what is missing.
    vented: bool,
    /// Time since which every condition holds, ns.
    well: Option<u64>,
    faults: u64,
    last_fault: u32,
    refused: u64,
    lacking: u32,
}

impl Machine {
    #[must_use]
    pub fn new(rules: Rules) -> Self {
        Self {
            rules,
            mode: Mode::Disarmed,
            state: ActuationState::Disarmed,
            since: 0,
            reasons: Reason::NOT_ARMED,
            halted: None,
            looked: None,
            lacked: 0,
            vented: false,
            well: None,
            faults: 0,
            last_fault: 0,
            refused: 0,
            lacking: 0,
        }
    }

    /// Takes what a person asks. [`look`](Self::look) says what comes of it.
    pub fn ask(&mut self, asked: Asked, seen: &Seen) {
        match (asked, self.mode) {
            (Asked::Vent, _) => self.mode = Mode::Vented,
            (Asked::Disarm, _) => self.mode = Mode::Disarmed,
            (Asked::Arm | Asked::Resume, Mode::Armed { .. }) => {}
            (Asked::Arm, Mode::Disarmed) | (Asked::Resume, Mode::Fault(_) | Mode::Vented) => {
                match seen.faults | seen.missing | seen.unready {
                    0 => {
                        self.mode = Mode::Armed { reference: seen.reference };
                        (self.lacked, self.vented, self.well) = (0, false, None);
                    }
                    lacking => self.refuse(lacking),
                }
            }
            // After a fault or a vent a person resumes or disarms, and says so.
            (Asked::Arm, Mode::Fault(why)) => self.refuse(why),
            (Asked::Arm, Mode::Vented) => self.refuse(Reason::ASKED),
            (Asked::Resume, Mode::Disarmed) => self.refuse(Reason::NOT_ARMED),
        }
    }

    fn refuse(&mut self, lacking: u32) {
        self.refused += 1;
        self.lacking = lacking;
    }

    /// Looks at what there is, and says what the valves are to do.
    pub fn look(&mut self, seen: &Seen) -> Order {
        let gone = self.looked.replace(seen.now).map_or(0, |looked| seen.now.saturating_sub(looked));
        self.fail_or_end(seen, gone);
        let present = seen.faults | seen.missing;
        let (state, reasons, order) = match self.mode {
            Mode::Disarmed => {
                (ActuationState::Disarmed, Reason::NOT_ARMED | present | seen.unready, Order::Hold)
            }
            Mode::Vented => {
                let order = if self.may_vent(seen.now) { Order::Vent } else { Order::Hold };
                (ActuationState::Venting, Reason::ASKED | present, order)
            }
            Mode::Fault(why) => (ActuationState::Fault, why | present, self.safe(seen.now)),
            Mode::Armed { .. } => match (self.is_well(seen), seen.is_idle || seen.is_face) {
                (true, false) => (ActuationState::Armed, 0, Order::Follow),
                (true, true) => {
                    let idle = if seen.is_idle { Reason::IDLE } else { 0 };
                    let face = if seen.is_face { Reason::FACE_MOVES } else { 0 };
                    (ActuationState::Holding, idle | face, Order::Hold)
                }
                (false, _) => {
                    let order = self.safe(seen.now);
                    self.vented |= order == Order::Vent;
                    let state =
                        if order == Order::Vent { ActuationState::Venting } else { ActuationState::Holding };
                    let settling = if seen.missing == 0 { Reason::SETTLING } else { 0 };
                    (state, seen.missing | settling, order)
                }
            },
        };
        self.halted = match order {
            Order::Follow => None,
            Order::Hold | Order::Vent => self.halted.or(Some(seen.now)),
        };
        if state != self.state {
            (self.state, self.since) = (state, seen.now);
        }
        self.reasons = reasons;
        order
    }

    /// Ends being armed where it must end.
    fn fail_or_end(&mut self, seen: &Seen, gone: u64) {
        let Mode::Armed { reference } = self.mode else { return };
        if seen.faults != 0 {
            return self.fail(seen.faults);
        }
        if reference != seen.reference {
            // Poses are of another reference now: what the controller makes of them, nobody meant. Where a person took it,
            // the head stays where it is. Where who held it died, or a vent has begun, the safe state follows: valves that
            // shut now would leave the head halfway.
            let holder = |reference: Option<(u32, u32)>| reference.map(|(_, holder)| holder);
            if self.vented || holder(reference) != holder(seen.reference) {
                return self.fail(Reason::REFERENCE);
            }
            self.lacking = Reason::REFERENCE;
            self.mode = Mode::Disarmed;
            return;
        }
        if seen.missing == 0 {
            self.lacked = self.lacked.saturating_sub(gone / FADES);
            return;
        }
        self.well = None;
        self.lacked = self.lacked.saturating_add(gone);
        if self.lacked >= self.rules.patience {
            self.fail(seen.missing | Reason::TOO_LONG);
        }
    }

    fn fail(&mut self, why: u32) {
        self.mode = Mode::Fault(why);
        self.faults += 1;
        self.last_fault = why;
    }

    /// Whether no condition is missing, and after a vent for long enough.
    fn is_well(&mut self, seen: &Seen) -> bool {
        if seen.missing != 0 {
            return false;
        }
        if self.vented {
            let since = *self.well.get_or_insert(seen.now);
            if seen.now.saturating_sub(since) < self.rules.settle {
                return false;
            }
        }
        (self.vented, self.well) = (false, None);
        true
    }

    /// The safe state, at this time.
    fn safe(&self, now: u64) -> Order {
        match self.rules.safe {
            Safe::Vent if self.may_vent(now) => Order::Vent,
            Safe::Vent | Safe::Hold => Order::Hold,
        }
    }

    fn may_vent(&self, now: u64) -> bool {
        self.halted.is_some_and(|halted| now.saturating_sub(halted) >= self.rules.lead)
    }

    /// The state that the last look found.
    #[must_use]
    pub fn state(&self) -> ActuationState {
        self.state
    }

    /// Since when that state holds, ns.
    #[must_use]
    pub fn since(&self) -> u64 {
        self.since
    }

    /// Why: bits of [`Reason`].
    #[must_use]
    pub fn reasons(&self) -> u32 {
        self.reasons
    }

    /// How many faults there were, and what made the last.
    #[must_use]
    pub fn faults(&self) -> (u64, u32) {
        (self.faults, self.last_fault)
    }

    /// How many commands of people were refused, and what was missing at the last.
    #[must_use]
    pub fn refused(&self) -> (u64, u32) {
        (self.refused, self.lacking)
    }

    /// Number of the reference with which it is armed; 0 for none.
    #[must_use]
    pub fn reference(&self) -> u32 {
        match self.mode {
            Mode::Armed { reference: Some((number, _)) } => number,
            _ => 0,
        }
    }
}
