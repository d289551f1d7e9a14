//! Two sensors that are apart: which of them is wrong, and when it may come back.

use nalgebra::SMatrix;

use crate::channels::InSamples;
use crate::cross::Side;
use crate::operators::fusion::FusionOf;
use crate::state::State;
use crate::watch::{Agreement, Verdict};

/// Whether both sensors are left out because they are apart, and it cannot be told which is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dispute {
    None,
    /// Number of samples in a row that must agree again.
    Open(u64),
}

/// Sensors are close where their distance is at most this part of the gate: half as many standard deviations.
pub const CLOSE: f64 = 0.25;

impl<const N: usize, const M: usize, X: InSamples<N>> FusionOf<N, M, X> {
    /// How far two states are from each other, over what they may be: the worst channel, squared.
    fn distance(&self, a: &State<N, X>, b: &State<N, X>, p12: &SMatrix<f64, M, M>) -> f64 {
        let tolerance = self.channels.each(self.params.tolerance, self.params.angle_tolerance);
        let apart = b.position.minus(&a.position);
        let beyond = |i: usize| (apart[i].abs() - tolerance[i]).max(0.0);
        (0..N).fold(0.0, |worst: f64, i| {
            let variance = a.pp[(i, i)] + b.pp[(i, i)] - 2.0 * p12[(i, i)];
            worst.max(beyond(i) * beyond(i) / variance.max(f64::MIN_POSITIVE))
        })
    }

    /// Where a sensor is, seen from the other; a sensor that turns out to be wrong while it is used is left out.
    pub(super) fn agreement(&mut self, side: Side, time: u64) -> Agreement {
        let (own, other) = (side as usize, 1 - side as usize);
        self.distance = f64::NAN;
        let comparable = [Verdict::Used, Verdict::Disagrees, Verdict::Returning];
        let theirs =
            self.state(other, time).filter(|_| comparable.contains(&self.sensors[other].watch.verdict()));
        let (Some(mine), Some(theirs)) = (self.state(own, time), theirs) else {
            return match &mut self.dispute {
                Dispute::None => Agreement::Unknown,
                Dispute::Open(close) => {
                    *close = 0;
                    Agreement::Disputed
                }
            };
        };
        let p12 = self.p12(time);
        self.distance = self.distance(&mine, &theirs, &p12);
        if let Dispute::Open(close) = &mut self.dispute {
            *close = if self.distance <= CLOSE * self.params.gate { *close + 1 } else { 0 };
            return Agreement::Disputed;
        }
        if self.distance <= self.params.gate {
            return Agreement::Together;
        }
        let newcomer = !matches!(self.sensors[own].watch.verdict(), Verdict::Used | Verdict::Waiting);
        match (newcomer, self.is_used(other)) {
            (true, _) => Agreement::Apart,
            (false, false) => Agreement::Unknown,
            (false, true) => self.blame(&mine, &theirs, other, time),
        }
    }

    /// Two sensors in use disagree: the sensor that left the place where both were is wrong. If one sensor drifted away
    /// slowly, the estimate followed until they disagreed. Then the last agreement is too long ago to decide, and
    /// neither is used.
    fn blame(&mut self, mine: &State<N, X>, theirs: &State<N, X>, other: usize, time: u64) -> Agreement {
        let process = self.sensors[other].track.as_ref().map(|(_, track)| track.process);
        let before = self
            .consensus
            .zip(process)
            .map(|((at, state), process)| state.predicted(time.saturating_sub(at) as f64 * 1e-9, &process));
        let is_there = |state: &State<N, X>| {
            // Without what the two have in common, so the variance is rather too large.
            before.as_ref().is_some_and(|b| self.distance(state, b, &SMatrix::zeros()) <= self.params.gate)
        };
        match (is_there(mine), is_there(theirs)) {
            (true, false) => {
                self.sensors[other].watch.expel(time);
                Agreement::Unknown
            }
            (false, true) => Agreement::Apart,
            _ => {
                self.dispute = Dispute::Open(0);
                self.sensors[other].watch.expel(time);
                Agreement::Disputed
            }
        }
    }

    /// Sensors in dispute come back together, when both have been close for long enough.
    pub(super) fn settle(&mut self, time: u64) {
        if let Dispute::Open(close) = self.dispute
            && close >= 2 * self.params.watch.readmit_after
        {
            self.dispute = Dispute::None;
            self.sensors.iter_mut().for_each(|s| s.watch.reinstate(time));
        }
    }
}
