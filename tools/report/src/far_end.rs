//! The far end of valves and beam: what it did and how many datagrams it accepted and refused, from its samples.

use std::fmt::{Display, Formatter};

use serde::Serialize;
use stillpoint_samples::{FarEndDoing, FarEndElement, Metric};

use crate::episodes::{Episodes, Stretches};

/// A far end over time.
#[derive(Clone, Debug, Default)]
pub struct FarEnds {
    /// Topic of its state.
    pub topic: String,
    /// Topic of its refusals by reason, if there is one.
    pub diagnostics: Option<String>,
    newest: Option<(u64, FarEndElement)>,
    begun: u64,
    on_for: u64,
    vents: Stretches,
    reasons: Vec<Refused>,
}

/// The figures of a far end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FarEnd {
    /// Topic of its state.
    pub topic: String,
    /// `following`, `holding` or `venting`, at the end.
    pub doing: &'static str,
    /// Datagrams for the valves that were accepted.
    pub accepted: u64,
    /// Refused datagrams for the valves, or without a known recipient.
    pub refused: u64,
    /// Refused datagrams for the beam.
    pub refused_beam: u64,
    /// Both kinds of refusals by reason, if the reasons were kept.
    pub reasons: Vec<Refused>,
    /// Datagrams that did not arrive or were refused, by their numbers.
    pub missing: u64,
    /// Whether the beam is on at the end.
    pub beam: bool,
    /// How long the beam was on at the far end, s.
    pub on_s: f64,
    /// Observed time, s.
    pub watched_s: f64,
    /// Times in which it vented after its first datagram.
    pub vents: Episodes,
}

/// Datagrams that were refused for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Refused {
    pub reason: String,
    pub count: u64,
}

impl FarEnds {
    /// A far end with these topics, without samples.
    pub fn new(topic: &str, diagnostics: Option<String>) -> Self {
        Self { topic: topic.to_owned(), diagnostics, ..Self::default() }
    }

    /// Takes a state of this time, ns. It holds until the next state.
    pub fn take(&mut self, stamp: u64, state: &FarEndElement) {
        match &self.newest {
            None => self.begun = stamp,
            Some((since, before)) if before.beam != 0 => self.on_for += stamp.saturating_sub(*since),
            Some(_) => {}
        }
        // Before the first datagram it vents because nobody has told it anything yet.
        let is_venting = state.accepted > 0 && state.doing() == FarEndDoing::Venting;
        self.vents.take(stamp, is_venting, String::new);
        self.newest = Some((stamp, *state));
    }

    /// Takes its counts of refusals by reason.
    pub fn take_reasons(&mut self, metrics: &[Metric]) {
        let counts = metrics.iter().filter(|m| m.value > 0.0);
        self.reasons =
            counts.map(|m| Refused { reason: m.name().to_owned(), count: m.value as u64 }).collect();
    }

    /// The figures so far; none if the far end was silent.
    pub fn reported(&self) -> Option<FarEnd> {
        let (last, state) = self.newest.as_ref()?;
        Some(FarEnd {
            topic: self.topic.clone(),
            doing: doing(state),
            accepted: state.accepted,
            refused: state.refused,
            refused_beam: state.refused_beam,
            reasons: self.reasons.clone(),
            missing: state.missing,
            beam: state.beam != 0,
            on_s: self.on_for as f64 * 1e-9,
            watched_s: last.saturating_sub(self.begun) as f64 * 1e-9,
            vents: self.vents.episodes(),
        })
    }
}

/// The word for what the far end makes the valves do.
pub fn doing(state: &FarEndElement) -> &'static str {
    state.doing().word()
}

impl FarEnd {
    /// Fraction of the observed time in which the beam was on; none before any time was observed.
    pub fn duty(&self) -> Option<f64> {
        (self.watched_s > 0.0).then(|| self.on_s / self.watched_s)
    }

    /// The reasons of refusals with their counts.
    pub fn why(&self) -> String {
        self.reasons.iter().map(|r| format!("{} {}", r.reason, r.count)).collect::<Vec<_>>().join(", ")
    }

    /// The refusals in a few words; none if nothing was refused.
    pub fn now(&self) -> Option<String> {
        let all = self.refused + self.refused_beam;
        (all > 0).then(|| format!("far end {}, refused {all} datagrams ({})", self.doing, self.why()))
    }
}

impl Display for FarEnd {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let Self { topic, doing, accepted, refused, refused_beam, on_s, watched_s, .. } = self;
        let duty = self.duty().map_or("-".to_owned(), |duty| format!("{:.0} %", duty * 100.0));
        let beam = if self.beam { "on" } else { "off" };
        write!(
            f,
            "{topic}: {doing}, beam {beam}; on {duty} ({on_s:.1} s) of {watched_s:.1} s; \
             accepted {accepted} datagrams, refused {refused} for the valves and {refused_beam} for the beam"
        )?;
        if !self.reasons.is_empty() {
            write!(f, " ({})", self.why())?;
        }
        if self.missing > 0 {
            write!(f, "; {} orders did not arrive or were refused", self.missing)?;
        }
        self.vents.line("vented").map_or(Ok(()), |vented| write!(f, "; {vented}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_beam_was_on_from_a_sample_that_says_so_to_the_next() {
        let mut far = FarEnds::new("far.state", None);
        assert_eq!(far.reported(), None);
        let on = |k: u64| (2..5).contains(&k) || k == 9;
        for k in 0..11 {
            let state = FarEndElement { beam: u32::from(on(k)), accepted: k, doing: 2, ..Default::default() };
            far.take(1_000_000_000 + k * 500_000_000, &state);
        }
        let reported = far.reported().unwrap();
        assert_eq!((reported.on_s, reported.watched_s, reported.duty()), (2.0, 5.0, Some(0.4)));
        assert_eq!(
            (reported.doing, reported.beam, reported.accepted, reported.now()),
            ("following", false, 10, None)
        );
    }

    #[test]
    fn refusals_stand_with_their_reasons() {
        let mut far = FarEnds::new("far.state", None);
        far.take(0, &FarEndElement { refused: 300, refused_beam: 102, doing: 1, ..Default::default() });
        far.take_reasons(&[Metric::new("late", 0.0), Metric::new("forged", 402.0)]);
        let reported = far.reported().unwrap();
        assert_eq!(reported.now().unwrap(), "far end venting, refused 402 datagrams (forged 402)");
        assert!(
            reported.to_string().ends_with("refused 300 for the valves and 102 for the beam (forged 402)")
        );
    }
}
