//! How often and how long the valves vented, or actuation stood in a fault, with the reasons.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_samples::{ActuationElement, ActuationReason, ActuationState, ValveOrder};

/// An order of [`ActuationElement`] to vent.
const VENT: u32 = ValveOrder::Vent as u32;

/// Stretches of time in which something held, counted from sample to sample.
#[derive(Clone, Debug, Default)]
pub struct Stretches {
    /// Stretches by the reasons with which they began.
    begun: BTreeMap<String, u64>,
    /// Time in all, ns.
    time: u64,
    /// The last sample that was inside a stretch, ns.
    inside: Option<u64>,
}

/// Stretches of a run, as figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Episodes {
    pub times: u64,
    /// Time in all, s.
    pub seconds: f64,
    /// The reasons with which stretches began and their counts, ordered by reason.
    pub reasons: Vec<(String, u64)>,
}

impl Stretches {
    /// Takes a sample of this time, ns, whose state holds until the next sample. `reasons` is read if a stretch begins.
    pub fn take(&mut self, stamp: u64, holds: bool, reasons: impl FnOnce() -> String) {
        if let Some(before) = self.inside {
            self.time += stamp.saturating_sub(before);
        } else if holds {
            *self.begun.entry(reasons()).or_default() += 1;
        }
        self.inside = holds.then_some(stamp);
    }

    /// The stretches so far.
    pub fn episodes(&self) -> Episodes {
        Episodes {
            times: self.begun.values().sum(),
            seconds: self.time as f64 * 1e-9,
            reasons: self.begun.iter().map(|(why, times)| (why.clone(), *times)).collect(),
        }
    }
}

impl Episodes {
    /// Such as `vented 4 times, 2.9 s, pose stale`; `None` where it never happened.
    pub fn line(&self, verb: &str) -> Option<String> {
        let times = |n: u64| if n == 1 { "once".to_owned() } else { format!("{n} times") };
        let reasons = match self.reasons.as_slice() {
            [] => return None,
            [(why, _)] => why.clone(),
            several => {
                let each = |(why, n): &(String, u64)| format!("{} {}", named(why), times(*n));
                several.iter().map(each).collect::<Vec<_>>().join("; ")
            }
        };
        let reasons = if reasons.is_empty() { String::new() } else { format!(", {reasons}") };
        Some(format!("{verb} {}, {:.1} s{reasons}", times(self.times), self.seconds))
    }
}

fn named(why: &str) -> &str {
    if why.is_empty() { "without a reason" } else { why }
}

/// The vents and faults that the samples of actuation state.
#[derive(Clone, Debug, Default)]
pub struct ActuationEpisodes {
    vents: Stretches,
    faults: Stretches,
}

impl ActuationEpisodes {
    /// Takes a state of this time, ns.
    pub fn take(&mut self, stamp: u64, actuation: &ActuationElement) {
        let is_fault = actuation.state() == ActuationState::Fault;
        let words = |bits| ActuationReason::words(bits).collect::<Vec<_>>().join(", ");
        let cause = if is_fault { actuation.fault } else { actuation.reasons };
        self.vents.take(stamp, actuation.order == VENT, || words(cause));
        self.faults.take(stamp, is_fault, || words(actuation.fault));
    }

    /// Times in which the valves vented.
    pub fn vents(&self) -> Episodes {
        self.vents.episodes()
    }

    /// Times in which actuation stood in a fault.
    pub fn faults(&self) -> Episodes {
        self.faults.episodes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn state(state: ActuationState, order: u32, reasons: u32, fault: u32) -> ActuationElement {
        ActuationElement { state: state as u32, order, reasons, fault, ..ActuationElement::default() }
    }

    #[test]
    fn each_vent_and_each_fault_counts_once_with_its_time_and_reason() {
        let armed = state(ActuationState::Armed, 2, 0, 0);
        let stale = ActuationReason::POSE_STALE;
        let venting = state(ActuationState::Venting, VENT, stale, 0);
        let settling = state(ActuationState::Venting, VENT, ActuationReason::SETTLING, 0);
        let fault = state(ActuationState::Fault, VENT, stale, ActuationReason::TOO_LONG);
        let mut found = ActuationEpisodes::default();
        let states = [armed, venting, settling, armed, venting, fault, fault, armed, armed];
        for (k, state) in states.iter().enumerate() {
            found.take(k as u64 * 100 * MS, state);
        }
        let (vents, faults) = (found.vents(), found.faults());
        assert_eq!(vents.line("vented").unwrap(), "vented 2 times, 0.5 s, pose stale");
        assert_eq!(faults.line("fault").unwrap(), "fault once, 0.2 s, too long");
    }

    #[test]
    fn several_reasons_stand_with_their_counts() {
        let mut found = Stretches::default();
        let whys = [Some("asked"), None, Some("pose stale"), None, Some("asked"), None];
        for (k, why) in whys.iter().enumerate() {
            found.take(k as u64 * 1000 * MS, why.is_some(), || why.unwrap_or_default().to_owned());
        }
        let reported = found.episodes();
        assert_eq!(reported.line("vented").unwrap(), "vented 3 times, 3.0 s, asked 2 times; pose stale once");
        assert_eq!(Episodes::default().line("vented"), None);
    }
}
