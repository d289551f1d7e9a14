//! A filter of N channels, from measured pose to track: what `estimate.kalman` runs, whatever N is.

use stillpoint_samples::{Metric, PoseElement, Standing, TrackElement};

use crate::channels::{Channels, InSamples};
use crate::consistency::{nees, nis};
use crate::kalman::{Kalman, Outcome};
use crate::measurement::Measurement;
use crate::operators::truths::Truths;
use crate::state::{Innovation, State};

/// Numbers of a diagnostics sample.
pub const METRICS: usize = 13;

/// Standard deviations that stand in place of the measurements' own.
#[derive(Clone, Copy, Debug)]
pub struct Given {
    /// Of lengths, m.
    pub length: Option<f64>,
    /// Of angles, rad.
    pub angle: Option<f64>,
}

/// What a measurement brought about.
pub struct FilterOutput {
    /// The sample for the topic of the state, if there is one.
    pub track: Option<TrackElement>,
    /// The sample for the topic of the diagnostics.
    pub metrics: [Metric; METRICS],
}

/// A filter of any number of channels.
pub trait Filter: Send {
    /// Uses a pose that was measured at `origin` and arrived at `time`, both ns. A pose that was measured later than it
    /// arrived, by more than the clocks may differ, is not used.
    fn measure(&mut self, pose: &PoseElement, origin: u64, time: u64, truths: &Truths) -> FilterOutput;
    /// Whether a measurement acquired at `origin`, ns, or later has come.
    fn has_seen(&self, origin: u64) -> bool;
    /// Ends the track, for what is measured from now on is in another frame. Where the newest measurement, acquired at
    /// `origin` or later, ns, is so already, it begins the next track.
    fn begin_anew(&mut self, origin: u64, time: u64, truths: &Truths) -> Option<FilterOutput>;
    /// The track at `time`, ns, predicted from what was measured before; `None` where a newer one was sent.
    fn predict(&self, time: u64) -> Option<TrackElement>;
}

/// A [`Filter`] of N channels.
pub struct FilterOf<const N: usize, X> {
    kalman: Kalman<N, X>,
    channels: Channels<N>,
    given: Given,
    /// How far a sensor's clock may be ahead, ns.
    clock_ahead: u64,
    /// Measurements that were farther ahead.
    early: u64,
    /// The newest measurement, and when it was acquired, ns.
    last: Option<(PoseElement, u64)>,
    repeated: u64,
    /// When the last measurement that was used arrived, ns.
    used_at: u64,
}

impl<const N: usize, X: InSamples<N>> FilterOf<N, X> {
    /// A filter without measurements.
    pub fn new(kalman: Kalman<N, X>, channels: Channels<N>, given: Given, clock_ahead: u64) -> Self {
        Self { kalman, channels, given, clock_ahead, early: 0, last: None, repeated: 0, used_at: 0 }
    }

    /// The measurement with the standard deviations that are given.
    fn measurement(&self, pose: &PoseElement) -> Measurement<N, X> {
        let mut measurement = self.channels.measurement::<X>(pose);
        let given =
            self.channels.each(self.given.length.unwrap_or(f64::NAN), self.given.angle.unwrap_or(f64::NAN));
        let measured = measurement.measured();
        for i in 0..N {
            if !given[i].is_nan() && measured[i] {
                measurement.covariance.row_mut(i).fill(0.0);
                measurement.covariance.column_mut(i).fill(0.0);
                measurement.covariance[(i, i)] = given[i] * given[i];
            }
        }
        measurement
    }

    fn track(&self, state: Option<&State<N, X>>, standing: Standing) -> TrackElement {
        let counts = self.kalman.counts();
        let (numbers, standing, run) = match state {
            Some(state) => {
                (self.channels.track(state, &self.kalman.params().process), standing, self.kalman.run())
            }
            None => (TrackElement::NONE, Standing::None, 0),
        };
        TrackElement {
            accepted: counts.used,
            rejected: counts.rejected() + self.early,
            run,
            repeated: self.repeated,
            channels: self.channels.bits(),
            standing: standing as u32,
            ..numbers
        }
    }

    fn metrics(
        &self,
        track: Option<&TrackElement>,
        dof: usize,
        nees: Option<f64>,
        time: u64,
    ) -> [Metric; METRICS] {
        let counts = self.kalman.counts();
        let standing = track.map_or(Standing::None, TrackElement::standing);
        let since = if counts.used > 0 { time.saturating_sub(self.used_at) as f64 * 1e-9 } else { f64::NAN };
        [
            Metric::new("estimate", if standing == Standing::None { 0.0 } else { 1.0 }),
            Metric::new("nis", track.map_or(f64::NAN, |t| t.nis)),
            Metric::new("nis_mean_expected", dof as f64),
            Metric::new("nees", nees.unwrap_or(f64::NAN)),
            Metric::new("nees_mean_expected", N as f64),
            Metric::new("used", counts.used as f64),
            Metric::new("gated", counts.gated as f64),
            Metric::new("refused", counts.refused as f64),
            Metric::new("late", counts.stale as f64),
            Metric::new("early", self.early as f64),
            Metric::new("repeated", self.repeated as f64),
            Metric::new("given_up", counts.given_up as f64),
            Metric::new("since_used_s", since),
        ]
    }

    /// NEES of the position against the truth of the same frame.
    fn nees(&self, truths: &Truths, origin: u64) -> Option<f64> {
        let truth = truths.at(origin)?;
        let state = self.kalman.state()?;
        let truth = X::read(truth.position, truth.orientation, &self.channels)?;
        nees(&state.position.minus(&truth), &state.pp)
    }
}

impl<const N: usize, X: InSamples<N>> Filter for FilterOf<N, X> {
    fn measure(&mut self, pose: &PoseElement, origin: u64, time: u64, truths: &Truths) -> FilterOutput {
        if origin > time.saturating_add(self.clock_ahead) {
            self.early += 1;
            let track = self.track(None, Standing::None);
            return FilterOutput { metrics: self.metrics(Some(&track), 0, None, time), track: Some(track) };
        }
        let same = self.last.is_some_and(|(last, _)| has_same_numbers(&last, pose));
        self.repeated = if same { self.repeated + 1 } else { 0 };
        self.last = Some((*pose, origin));
        let measurement = self.measurement(pose);
        let silent = time.saturating_sub(self.used_at) > self.kalman.params().horizon;
        let outcome = match self.kalman.step(origin, Some(&measurement)) {
            // Late for so long: the sensor's clock went back, and will not catch up.
            Err(_) if silent => {
                self.kalman.restart();
                self.kalman.step(origin, Some(&measurement))
            }
            stepped => stepped,
        };
        let Ok(outcome) = outcome else {
            return FilterOutput { track: None, metrics: self.metrics(None, 0, None, time) };
        };
        if matches!(outcome, Outcome::Started | Outcome::Updated(_)) {
            self.used_at = time;
        }
        let (standing, innovation) = match outcome {
            Outcome::Started => (Standing::Measured, None),
            Outcome::Updated(innovation) => (Standing::Measured, Some(innovation)),
            Outcome::Gated(innovation) => (Standing::Refused, Some(innovation)),
            Outcome::Waiting | Outcome::Predicted | Outcome::Refused => (Standing::Refused, None),
        };
        let mut track = self.track(self.kalman.state(), standing);
        if let Some(innovation) = &innovation {
            let gain = [&innovation.position_gain, &innovation.velocity_gain];
            let gain = (standing == Standing::Measured).then_some(gain);
            self.channels.write_innovation(&innovation.residual, gain, &mut track);
            track.nis = nis(innovation).unwrap_or(f64::NAN);
        }
        let dof =
            innovation.as_ref().map_or(0, |i: &Innovation<N>| i.measured.iter().filter(|m| **m).count());
        let nees = self.nees(truths, origin);
        FilterOutput { metrics: self.metrics(Some(&track), dof, nees, time), track: Some(track) }
    }

    fn has_seen(&self, origin: u64) -> bool {
        self.last.is_some_and(|(_, acquired)| acquired >= origin)
    }

    fn begin_anew(&mut self, origin: u64, time: u64, truths: &Truths) -> Option<FilterOutput> {
        self.kalman.restart();
        let (pose, acquired) = self.last.take()?;
        (acquired >= origin).then(|| self.measure(&pose, acquired, time, truths))
    }

    fn predict(&self, time: u64) -> Option<TrackElement> {
        if self.kalman.state().is_some() && self.kalman.stamp().is_some_and(|stamp| time < stamp) {
            return None;
        }
        let state = self.kalman.predicted_to(time);
        Some(self.track(state.as_ref(), Standing::Predicted))
    }
}

/// Whether two poses have the same bytes: two of a sensor that is alive never do. The covariance counts, for it comes of
/// what is left over: images that differ may show one pose.
fn has_same_numbers(a: &PoseElement, b: &PoseElement) -> bool {
    let bits = |p: &PoseElement| {
        (p.position.map(f64::to_bits), p.orientation.map(f64::to_bits), p.covariance.map(f64::to_bits))
    };
    bits(a) == bits(b)
}
