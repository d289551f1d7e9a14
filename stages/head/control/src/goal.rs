//! Where the head is to be, from where it was found, planned moves, and what people ask for.

use stillpoint_samples::{Refusal, Standing, TargetElement, TargetStatus, TrackElement};

use crate::channels::{Channels, difference};
use crate::moves::{Leg, Profile};
use crate::rig::Rig;

/// A move that was planned before the run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedMove {
    /// When it begins, ns after the start is known.
    pub at: u64,
    /// How long it takes, ns.
    pub over: u64,
    /// Profile of the motion over time.
    pub profile: Profile,
    /// Where to, for each channel that moves.
    pub to: [Option<f64>; 6],
}

/// What a goal is made from.
#[derive(Clone, Debug)]
pub struct GoalParams {
    /// The channels that are held. All arrays of six have their numbers in this order.
    pub channels: Channels,
    /// Targets are counted from the origin of the frame, else from the start.
    pub absolute: bool,
    /// Moves in the order of their times.
    pub moves: Vec<PlannedMove>,
    /// Least and greatest distance from the start.
    pub reach: [[f64; 2]; 6],
    /// What the rig can hold.
    pub rig: Rig,
    /// How long estimates are averaged to find the start, ns.
    pub settle: u64,
    /// How long the way to an asked target takes, ns.
    pub over: u64,
}

/// The last requested target and the present one, both counted like targets; NaN if there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// The last requested target.
    pub values: [f64; 6],
    /// What stands at the moment.
    pub standing: [f64; 6],
    /// Number of the bladder that prevents the last requested target.
    pub bladder: Option<usize>,
}

/// The mean of the first estimates.
#[derive(Clone, Copy, Debug)]
struct Settling {
    since: u64,
    first: [f64; 6],
    sums: [f64; 6],
    count: u32,
    newest: u64,
}

/// Where the head is to be.
#[derive(Clone, Debug)]
pub struct Goal {
    params: GoalParams,
    settling: Option<Settling>,
    /// Where the head was found, and when that was known, ns.
    start: Option<([f64; 6], u64)>,
    /// Distances from the start.
    leg: Leg,
    next: usize,
    asked: u32,
    values: [f64; 6],
    refusal: Refusal,
    /// Bits of the channels, as samples have them.
    unreachable: u32,
    bladder: Option<usize>,
    standing: [f64; 6],
}

impl Goal {
    /// A goal that does not know where the head is.
    #[must_use]
    pub fn new(params: GoalParams) -> Self {
        Self {
            params,
            settling: None,
            start: None,
            leg: Leg::resting([0.0; 6]),
            next: 0,
            asked: 0,
            values: [f64::NAN; 6],
            refusal: Refusal::None,
            unreachable: 0,
            bladder: None,
            standing: [f64::NAN; 6],
        }
    }

    /// The channels that are held.
    #[must_use]
    pub fn channels(&self) -> &Channels {
        &self.params.channels
    }

    /// Where the head was found, m and rad, once it is known.
    #[must_use]
    pub fn start(&self) -> Option<&[f64; 6]> {
        self.start.as_ref().map(|(start, _)| start)
    }

    /// The last requested target, and the target at the last [`at`](Self::at).
    #[must_use]
    pub fn asked(&self) -> Asked {
        Asked { values: self.values, standing: self.standing, bladder: self.bladder }
    }

    /// Drops the planned moves.
    pub fn skip_moves(&mut self) {
        self.next = self.params.moves.len();
    }

    /// Measures the start again, and holds the head there.
    pub fn start_anew(&mut self) {
        (self.start, self.settling) = (None, None);
        self.leg = Leg::resting([0.0; 6]);
    }

    /// Sees an estimate of this origin, ns, at a time.
    pub fn see(&mut self, track: &TrackElement, origin: u64, time: u64) {
        if self.start.is_some() || track.standing() == Standing::None {
            return;
        }
        let Some(pose) = self.params.channels.of_track(track).filter(|p| p.iter().all(|v| v.is_finite()))
        else {
            return;
        };
        let settling = self.settling.get_or_insert(Settling {
            since: time,
            first: pose,
            sums: [0.0; 6],
            count: 0,
            newest: 0,
        });
        if origin > settling.newest || settling.count == 0 {
            settling.newest = origin;
            settling.count += 1;
            for (i, channel) in self.params.channels.iter().enumerate() {
                settling.sums[i] += difference(channel, pose[i], settling.first[i]);
            }
        }
        if time.saturating_sub(settling.since) >= self.params.settle {
            let mean = |i: usize| settling.first[i] + settling.sums[i] / f64::from(settling.count);
            self.start = Some((std::array::from_fn(mean), time));
        }
    }

    /// A person asks for a target: a value for each channel.
    pub fn ask(&mut self, values: &[f64], time: u64) {
        let mut to = [None; 6];
        self.values = [f64::NAN; 6];
        for ((to, retained), value) in to.iter_mut().zip(&mut self.values).zip(values) {
            (*to, *retained) = (Some(*value), *value);
        }
        if values.len() != self.params.channels.count() {
            self.asked += 1;
            (self.refusal, self.unreachable, self.bladder) = (Refusal::WrongNumber, 0, None);
            return;
        }
        let over = self.params.over;
        self.begin(&PlannedMove { at: 0, over, profile: Profile::Linear, to }, time);
    }

    /// Begins a move at a time, or refuses it.
    fn begin(&mut self, planned: &PlannedMove, time: u64) {
        self.asked += 1;
        (self.unreachable, self.bladder) = (0, None);
        let Some((start, _)) = self.start else {
            self.refusal = Refusal::NoStart;
            return;
        };
        let (from, _) = self.leg.at(time);
        let mut to = self.leg.to;
        let mut finite = true;
        for (i, channel) in self.params.channels.iter().enumerate() {
            let Some(asked) = planned.to[i] else { continue };
            finite &= asked.is_finite();
            to[i] = if self.params.absolute { difference(channel, asked, start[i]) } else { asked };
            let [low, high] = self.params.reach[i];
            if asked.is_finite() && !(low..=high).contains(&to[i]) {
                self.unreachable |= 1 << channel.place();
            }
        }
        if finite && self.unreachable == 0 {
            self.ask_rig(&from, &to);
        }
        self.refusal = match (finite, self.unreachable) {
            (false, _) => Refusal::NotFinite,
            (true, 0) => Refusal::None,
            (true, _) => Refusal::Unreachable,
        };
        if self.refusal == Refusal::None {
            self.leg = Leg { begin: time, over: planned.over, profile: planned.profile, from, to };
        }
    }

    /// Checks the way to a target against the rig. If the rig cannot hold the way, all channels that move are
    /// unreachable.
    fn ask_rig(&mut self, from: &[f64; 6], to: &[f64; 6]) {
        let channels = &self.params.channels;
        if let Err(wall) = self.params.rig.check(&channels.spread(from), &channels.spread(to)) {
            self.bladder = wall.bladder();
            let moving = channels.iter().enumerate().filter(|(i, _)| from[*i] != to[*i]);
            self.unreachable = moving.fold(0, |bits, (_, c)| bits | 1 << c.place());
            // A rig that cannot even hold what stands has nowhere to go: then all channels are named.
            if self.unreachable == 0 {
                self.unreachable = channels.bits();
            }
        }
    }

    /// The target at a time. Times must not go back.
    pub fn at(&mut self, time: u64) -> TargetElement {
        let published = TargetElement {
            asked: self.asked,
            refusal: self.refusal as u32,
            unreachable: self.unreachable,
            ..TargetElement::NONE
        };
        let Some((start, known)) = self.start else {
            self.standing = [f64::NAN; 6];
            return published;
        };
        while let Some(planned) = self.params.moves.get(self.next).copied()
            && time.saturating_sub(known) >= planned.at
        {
            self.next += 1;
            for (retained, to) in self.values.iter_mut().zip(planned.to) {
                *retained = to.unwrap_or(f64::NAN);
            }
            self.begin(&planned, time);
        }
        let (place, rate) = self.leg.at(time);
        let mut element = TargetElement {
            channels: self.params.channels.bits(),
            status: match (self.refusal, self.leg.is_moving(time)) {
                (Refusal::None, true) => TargetStatus::Moving,
                (Refusal::None, false) => TargetStatus::Held,
                _ => TargetStatus::Refused,
            } as u32,
            asked: self.asked,
            refusal: self.refusal as u32,
            unreachable: self.unreachable,
            ..TargetElement::NONE
        };
        for (i, channel) in self.params.channels.iter().enumerate() {
            let (value, rate) = (start[i] + place[i], rate[i]);
            self.standing[i] = if self.params.absolute { value } else { place[i] };
            match channel.place() {
                at @ 0..3 => (element.position[at], element.velocity[at]) = (value, rate),
                at => (element.angles[at - 3], element.angle_rates[at - 3]) = (value, rate),
            }
        }
        element
    }
}
