//! Constant-velocity Kalman filter driven by stamped measurements (SCIENCE D1-D2).

use crate::manifold::Manifold;
use crate::measurement::Measurement;
use crate::process::{Hold, ProcessNoise};
use crate::state::{Innovation, State};
use nalgebra::SVector;
use thiserror::Error;

/// Parameters of a filter. Units are those of the measurement (m for SI).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KalmanParams<const N: usize> {
    pub process: ProcessNoise<N>,
    /// Standard deviation of a channel that the first measurement does not measure.
    pub open_sd: SVector<f64, N>,
    /// Standard deviation of the velocity before the first measurement, per second.
    pub initial_velocity_sd: SVector<f64, N>,
    /// A measurement is refused if nu_i^2 / S_ii of any channel exceeds this; 9 is three standard deviations, infinity
    /// refuses none. If the next measurement agrees better with the refused one than with the track, the track was
    /// wrong, and the filter starts again from these two.
    pub gate: f64,
    /// Time for which the filter predicts without a measurement that it uses, in nanoseconds. After that it has no
    /// state, and starts again.
    pub horizon: u64,
}

/// A parameter outside its range.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{name} is {value}; it must be {must}")]
pub struct ParamError {
    pub name: &'static str,
    pub value: f64,
    /// Its range, as text.
    pub must: &'static str,
}

/// A stamp that is not later than the one before it. The filter is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("stamp {found} ns does not come after {last} ns")]
pub struct StampError {
    /// The filter's stamp, in nanoseconds.
    pub last: u64,
    /// The refused stamp, in nanoseconds.
    pub found: u64,
}

/// The outcome of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome<const N: usize> {
    /// No measurement came before, or none for the whole horizon: there is no state.
    Waiting,
    /// The measurement became the state, alone or with the measurement before it that the former track had refused.
    Started,
    /// The measurement was used.
    Updated(Innovation<N>),
    /// There was no measurement: predicted only.
    Predicted,
    /// The innovation was beyond the gate: predicted only.
    Gated(Innovation<N>),
    /// The measurement was not finite, or its covariance not positive definite: predicted only.
    Refused,
}

/// Counts of outcomes since the filter was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Measurements used, those that started a track included.
    pub used: u64,
    /// Steps without a measurement.
    pub missing: u64,
    /// Measurements beyond the gate.
    pub gated: u64,
    /// Measurements not finite or with a bad covariance.
    pub refused: u64,
    /// Steps refused for their stamp.
    pub stale: u64,
    /// Tracks that ended: no measurement was used for the whole horizon, two measurements in a row agreed against the
    /// track, or the numbers left the range of `f64`.
    pub given_up: u64,
}

impl Counts {
    /// Measurements that were not used.
    #[must_use]
    pub fn rejected(&self) -> u64 {
        self.gated + self.refused + self.stale
    }
}

/// A filter for the position and velocity of N channels with a joint covariance. It does not allocate.
///
/// ```
/// use nalgebra::{Matrix1, Vector1};
/// use stillpoint_estimate::{Kalman, KalmanParams, Measurement, ProcessNoise};
///
/// let params = KalmanParams {
///     process: ProcessNoise::per_step(0.02),
///     open_sd: Vector1::new(1.0),
///     initial_velocity_sd: Vector1::new(0.1),
///     gate: 9.0,
///     horizon: 500_000_000,
/// };
/// let mut filter = Kalman::<1>::new(params)?;
/// for frame in 0..30_u64 {
///     let z = Measurement { position: Vector1::new(0.7), covariance: Matrix1::new(1e-6) };
///     filter.step(frame * 33_333_333, Some(&z))?;
/// }
/// assert!((filter.state().map_or(0.0, |s| s.position.x) - 0.7).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Kalman<const N: usize, X = SVector<f64, N>> {
    params: KalmanParams<N>,
    state: Option<State<N, X>>,
    stamp: Option<u64>,
    /// Stamp of the last measurement that was used.
    used_at: u64,
    /// The head at rest at the last measurement, where that was beyond the gate, at the last stamp.
    doubt: Option<State<N, X>>,
    run: u64,
    counts: Counts,
}

impl<const N: usize, X: Manifold<N>> Kalman<N, X> {
    /// A filter that starts with its first measurement.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(params: KalmanParams<N>) -> Result<Self, ParamError> {
        let hold = match params.process.hold {
            Hold::Step => 1.0,
            Hold::Seconds(seconds) => seconds,
        };
        let finite = [
            ("acceleration_sd", &params.process.acceleration_sd),
            ("open_sd", &params.open_sd),
            ("initial_velocity_sd", &params.initial_velocity_sd),
            ("hold", &SVector::repeat(hold)),
        ];
        let bad = finite
            .into_iter()
            .flat_map(|(name, values)| values.iter().map(move |v| (name, *v)))
            .find(|(_, v)| !(v.is_finite() && *v > 0.0))
            .or((params.gate.is_nan() || params.gate <= 0.0).then_some(("gate", params.gate)));
        if let Some((name, value)) = bad {
            return Err(ParamError { name, value, must: "a number above 0" });
        }
        Ok(Self {
            params,
            state: None,
            stamp: None,
            used_at: 0,
            doubt: None,
            run: 0,
            counts: Counts::default(),
        })
    }

    /// Brings the filter to `stamp` (nanoseconds) and uses `measurement`, if there is one and it can be used.
    ///
    /// # Errors
    /// A stamp not after the last one; it is counted and the filter otherwise unchanged.
    pub fn step(
        &mut self,
        stamp: u64,
        measurement: Option<&Measurement<N, X>>,
    ) -> Result<Outcome<N>, StampError> {
        let dt = match self.stamp {
            Some(last) if stamp <= last => {
                self.counts.stale += 1;
                return Err(StampError { last, found: stamp });
            }
            Some(last) => (stamp - last) as f64 * 1e-9,
            None => 0.0,
        };
        self.stamp = Some(stamp);
        if self.state.is_some() && self.is_beyond_horizon(stamp) {
            self.give_up();
        }
        let prior = self.state.map(|state| state.predicted(dt, &self.params.process));
        self.state = prior;
        self.doubt = self.doubt.map(|state| state.predicted(dt, &self.params.process));
        let Some(z) = measurement else {
            self.counts.missing += 1;
            return Ok(if prior.is_some() { Outcome::Predicted } else { Outcome::Waiting });
        };
        let outcome = self.correct(prior, z);
        if self.state.is_some_and(|s| !s.is_finite()) {
            self.give_up();
            self.counts.refused += 1;
            return Ok(Outcome::Waiting);
        }
        if matches!(outcome, Outcome::Started | Outcome::Updated(_)) {
            self.counts.used += 1;
            self.run += 1;
            self.used_at = stamp;
        }
        Ok(outcome)
    }

    fn correct(&mut self, prior: Option<State<N, X>>, z: &Measurement<N, X>) -> Outcome<N> {
        if !z.is_usable() {
            self.counts.refused += 1;
            return Outcome::Refused;
        }
        let doubt = self.doubt.take();
        let Some(prior) = prior else {
            self.run = 0;
            self.state = Some(self.at_rest(z));
            return Outcome::Started;
        };
        let Some(innovation) = prior.innovation(z) else {
            self.counts.refused += 1;
            return Outcome::Refused;
        };
        if !innovation.exceeds(self.params.gate) {
            self.state = Some(prior.updated(&innovation, z));
            return Outcome::Updated(innovation);
        }
        let fits = |state: &State<N, X>| state.innovation(z).filter(|i| !i.exceeds(self.params.gate));
        if let Some((state, innovation)) = doubt.and_then(|state| Some((state, fits(&state)?))) {
            // One outlier is one; two that agree are where the head is.
            self.give_up();
            self.run = 0;
            self.state = Some(state.updated(&innovation, z));
            return Outcome::Started;
        }
        self.counts.gated += 1;
        self.doubt = Some(self.at_rest(z));
        Outcome::Gated(innovation)
    }

    fn at_rest(&self, z: &Measurement<N, X>) -> State<N, X> {
        State::at_rest(z, &self.params.open_sd, &self.params.initial_velocity_sd)
    }

    /// The state at `stamp`, predicted from the last state, which does not change. `None` if there is no state, or if
    /// `stamp` lies before it or beyond the horizon.
    #[must_use]
    pub fn predicted_to(&self, stamp: u64) -> Option<State<N, X>> {
        let ns = stamp.checked_sub(self.stamp?)?;
        let state = self.state.filter(|_| !self.is_beyond_horizon(stamp))?;
        let state = state.predicted(ns as f64 * 1e-9, &self.params.process);
        state.is_finite().then_some(state)
    }

    /// Ends the track, so that the next measurement starts another track at any stamp.
    pub fn restart(&mut self) {
        self.give_up();
        self.stamp = None;
    }

    fn give_up(&mut self) {
        self.doubt = None;
        self.counts.given_up += u64::from(self.state.take().is_some());
    }

    fn is_beyond_horizon(&self, stamp: u64) -> bool {
        stamp.saturating_sub(self.used_at) > self.params.horizon
    }

    /// The parameters of the filter.
    #[must_use]
    pub fn params(&self) -> &KalmanParams<N> {
        &self.params
    }

    /// The state at the last stamp; `None` before the first measurement and after a horizon without one.
    #[must_use]
    pub fn state(&self) -> Option<&State<N, X>> {
        self.state.as_ref()
    }

    /// The last stamp in nanoseconds.
    #[must_use]
    pub fn stamp(&self) -> Option<u64> {
        self.stamp
    }

    /// Measurements used since the track began.
    #[must_use]
    pub fn run(&self) -> u64 {
        self.run
    }

    /// The counts so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }
}
