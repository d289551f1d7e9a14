//! Constant-velocity Kalman filter driven by stamped measurements (SCIENCE D1-D2).

use crate::state::{Innovation, State};
use nalgebra::{SMatrix, SVector};
use thiserror::Error;

/// What a filter needs to know. Units are the measurement's (m for SI).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KalmanParams {
    /// Standard deviation sigma_a of the acceleration between two stamps, per second squared.
    pub acceleration_sd: f64,
    /// Standard deviation of the velocity before the first measurement, per second.
    pub initial_velocity_sd: f64,
    /// A measurement is refused where nu_i^2 / S_ii of any channel exceeds this; 9 is three standard deviations,
    /// infinity refuses none. A refused measurement widens P, so a filter that was wrong comes back.
    pub gate: f64,
}

/// A parameter outside its range.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{name} is {value}; it must be {must}")]
pub struct ParamError {
    /// The parameter.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Its range, in words.
    pub must: &'static str,
}

/// A stamp that is not later than the one before it. The filter is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("stamp {found} ns does not come after {last} ns")]
pub struct StampError {
    /// The filter's stamp, in nanoseconds.
    pub last: u64,
    /// The stamp refused, in nanoseconds.
    pub found: u64,
}

/// A measured position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement<const N: usize> {
    /// z.
    pub position: SVector<f64, N>,
    /// R, symmetric.
    pub covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> Measurement<N> {
    /// Whether all numbers are finite and the covariance is positive definite.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        let finite = self.position.iter().chain(self.covariance.iter()).all(|v| v.is_finite());
        finite && self.covariance.cholesky().is_some()
    }
}

/// What a step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome<const N: usize> {
    /// Nothing was measured before: there is no state yet.
    Waiting,
    /// The first measurement became the state.
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

/// How often each thing happened since the filter was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Measurements used, the first one included.
    pub used: u64,
    /// Steps without a measurement.
    pub missing: u64,
    /// Measurements beyond the gate.
    pub gated: u64,
    /// Measurements not finite or with a bad covariance.
    pub refused: u64,
    /// Steps refused for their stamp.
    pub stale: u64,
}

/// A filter for the position and velocity of N channels, joint in their covariance. It allocates nothing.
///
/// ```
/// use nalgebra::{Matrix1, Vector1};
/// use stillpoint_estimate::{Kalman, KalmanParams, Measurement};
///
/// let params = KalmanParams { acceleration_sd: 0.02, initial_velocity_sd: 0.1, gate: 9.0 };
/// let mut filter = Kalman::<1>::new(params)?;
/// for frame in 0..30_u64 {
///     let z = Measurement { position: Vector1::new(0.7), covariance: Matrix1::new(1e-6) };
///     filter.step(frame * 33_333_333, Some(&z))?;
/// }
/// assert!((filter.state().map_or(0.0, |s| s.position.x) - 0.7).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Kalman<const N: usize> {
    params: KalmanParams,
    state: Option<State<N>>,
    stamp: Option<u64>,
    counts: Counts,
}

impl<const N: usize> Kalman<N> {
    /// A filter that starts with its first measurement.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(params: KalmanParams) -> Result<Self, ParamError> {
        let checks = [
            ("acceleration_sd", params.acceleration_sd, params.acceleration_sd.is_finite()),
            ("initial_velocity_sd", params.initial_velocity_sd, params.initial_velocity_sd.is_finite()),
            ("gate", params.gate, true),
        ];
        for (name, value, finite) in checks {
            let positive = value > 0.0;
            if !(finite && positive) {
                return Err(ParamError { name, value, must: "a number above 0" });
            }
        }
        Ok(Self { params, state: None, stamp: None, counts: Counts::default() })
    }

    /// A filter that is in `state` at `stamp` nanoseconds.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn starting_at(params: KalmanParams, stamp: u64, state: State<N>) -> Result<Self, ParamError> {
        Ok(Self { state: Some(state), stamp: Some(stamp), ..Self::new(params)? })
    }

    /// Brings the filter to `stamp` (nanoseconds) and uses `measurement`, if there is one and it can be used.
    ///
    /// # Errors
    /// A stamp not after the last one; it is counted and the filter otherwise unchanged.
    pub fn step(
        &mut self,
        stamp: u64,
        measurement: Option<&Measurement<N>>,
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
        let prior = self.state.map(|state| state.predicted(dt, self.params.acceleration_sd));
        self.state = prior;
        let Some(z) = measurement else {
            self.counts.missing += 1;
            return Ok(if prior.is_some() { Outcome::Predicted } else { Outcome::Waiting });
        };
        Ok(self.correct(prior, z))
    }

    fn correct(&mut self, prior: Option<State<N>>, z: &Measurement<N>) -> Outcome<N> {
        if !z.is_usable() {
            self.counts.refused += 1;
            return Outcome::Refused;
        }
        let Some(prior) = prior else {
            self.counts.used += 1;
            self.state = Some(State::at_rest(z.position, z.covariance, self.params.initial_velocity_sd));
            return Outcome::Started;
        };
        let Some(innovation) = prior.innovation(&z.position, &z.covariance) else {
            self.counts.refused += 1;
            return Outcome::Refused;
        };
        if innovation.exceeds(self.params.gate) {
            self.counts.gated += 1;
            return Outcome::Gated(innovation);
        }
        self.counts.used += 1;
        self.state = Some(prior.updated(&innovation, &z.covariance));
        Outcome::Updated(innovation)
    }

    /// The state at the last stamp; `None` before the first measurement.
    #[must_use]
    pub fn state(&self) -> Option<&State<N>> {
        self.state.as_ref()
    }

    /// The last stamp in nanoseconds.
    #[must_use]
    pub fn stamp(&self) -> Option<u64> {
        self.stamp
    }

    /// What happened so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }
}

impl<const N: usize> Innovation<N> {
    /// Whether nu_i^2 / S_ii exceeds `gate` in any channel.
    #[must_use]
    pub fn exceeds(&self, gate: f64) -> bool {
        (0..N).any(|i| self.residual[i] * self.residual[i] > gate * self.covariance[(i, i)])
    }
}
