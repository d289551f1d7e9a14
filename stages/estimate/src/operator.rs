//! `estimate.kalman`: position and velocity of what is measured, as an operator.

use nalgebra::{Matrix3, Vector3};
use stillpoint_pipeline::operator::{
    FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer,
};
use stillpoint_pipeline::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_samples::{Cause, Pose, PoseElement, Sample, Track, TrackElement};

use crate::kalman::{Kalman, KalmanParams, Measurement, Outcome};
use crate::state::{Innovation, State};

const MEASUREMENT: usize = 0;
const STATE: usize = 0;

/// Parameters of `estimate.kalman`.
#[derive(Clone, Debug, Params)]
pub struct FilterParams {
    /// Standard deviation of the acceleration between two measurements, on each axis.
    #[param(unit = "m/s2", default = "100 mm/s2", above = "0 mm/s2", max = "100 m/s2")]
    pub acceleration_sd: f64,
    /// Standard deviation of the velocity before the first measurement, on each axis.
    #[param(unit = "m/s", default = "50 mm/s", above = "0 mm/s", max = "10 m/s")]
    pub initial_velocity_sd: f64,
    /// A measurement is refused where the innovation of an axis, squared, is more than this many times its variance.
    #[param(default = 9, above = 0, max = 1000000000)]
    pub gate: f64,
}

/// Constant-velocity filter of a position (SCIENCE D1-D2), from acquisition time to acquisition time.
///
/// Each measurement sends the state at its acquisition time; one that is refused sends the prediction. A measurement
/// acquired no later than the last one is counted as rejected and sends nothing. With a timer, each tick sends the
/// state predicted to the tick, which changes nothing in the filter.
pub struct EstimateKalman {
    params: KalmanParams,
    filter: Kalman<3>,
    /// Counts of filters that were given up because their numbers had left the range of `f64`.
    accepted_before: u64,
    rejected_before: u64,
}

impl Operator for EstimateKalman {
    type Params = FilterParams;
    const KIND: Kind = Kind {
        name: "estimate.kalman",
        about: "Position and velocity from measured positions: a Kalman filter of constant velocity.",
        role: Role::Operator,
        inputs: &[Input {
            name: "measurement",
            sample: Pose::KIND,
            policy: Policy::Queue(4),
            required: true,
            about: "Measured position with its covariance; the orientation is not used.",
        }],
        outputs: &[Output {
            name: "state",
            sample: Track::KIND,
            frame: FrameRule::SameAs("measurement"),
            about: "Mean and covariance at the sample's origin.",
        }],
        timer: Timer::Optional,
    };

    fn new(params: FilterParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let params = KalmanParams {
            acceleration_sd: params.acceleration_sd,
            initial_velocity_sd: params.initial_velocity_sd,
            gate: params.gate,
        };
        let filter = Kalman::new(params).map_err(|e| SetupError(e.to_string()))?;
        Ok(Self { params, filter, accepted_before: 0, rejected_before: 0 })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if activation.cause == Cause::Timer {
            return self.predict(activation.time, outputs);
        }
        let Some(view) = activation.fresh::<Pose>(MEASUREMENT) else { return Ok(()) };
        let Some(pose) = view.first() else { return Ok(()) };
        let Ok(outcome) = self.filter.step(view.head.origin, Some(&measurement(pose))) else {
            return Ok(());
        };
        if self.filter.state().is_some_and(|s| !is_finite(s)) {
            return self.start_afresh();
        }
        let innovation = match outcome {
            Outcome::Updated(innovation) | Outcome::Gated(innovation) => Some(innovation),
            _ => None,
        };
        match self.filter.state() {
            Some(state) => outputs.send::<Track>(STATE, &self.track(state, innovation.as_ref())),
            None => Ok(()),
        }
    }
}

impl EstimateKalman {
    /// Sends the state at `time`, ns, if that is not before the last measurement.
    fn predict(&self, time: u64, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let (Some(state), Some(stamp)) = (self.filter.state(), self.filter.stamp()) else { return Ok(()) };
        let Some(ns) = time.checked_sub(stamp) else { return Ok(()) };
        let state = state.predicted(ns as f64 * 1e-9, self.params.acceleration_sd);
        outputs.send::<Track>(STATE, &self.track(&state, None))
    }

    /// Gives up a filter whose numbers are useless, and keeps its counts: the last measurement counts as rejected.
    fn start_afresh(&mut self) -> Result<(), StepError> {
        let counts = self.filter.counts();
        self.accepted_before += counts.used;
        self.rejected_before += counts.gated + counts.refused + counts.stale;
        self.filter = Kalman::new(self.params).map_err(|e| StepError(e.to_string()))?;
        Ok(())
    }

    fn track(&self, state: &State<3>, innovation: Option<&Innovation<3>>) -> TrackElement {
        let counts = self.filter.counts();
        TrackElement {
            position: state.position.into(),
            velocity: state.velocity.into(),
            covariance: joint(state),
            innovation: innovation.map_or([f64::NAN; 3], |i| i.residual.into()),
            nis: innovation.and_then(nis).unwrap_or(f64::NAN),
            accepted: self.accepted_before + counts.used,
            rejected: self.rejected_before + counts.gated + counts.refused + counts.stale,
        }
    }
}

/// The position of a pose and the first three rows and columns of its covariance.
fn measurement(pose: &PoseElement) -> Measurement<3> {
    Measurement {
        position: Vector3::from(pose.position),
        covariance: Matrix3::from_fn(|i, j| pose.covariance[6 * i + j]),
    }
}

/// Normalised innovation squared, nu^T S^-1 nu.
fn nis(innovation: &Innovation<3>) -> Option<f64> {
    let solved = innovation.covariance.cholesky()?.solve(&innovation.residual);
    let nis = innovation.residual.dot(&solved);
    nis.is_finite().then_some(nis)
}

/// The covariance of (position, velocity), row by row.
fn joint(state: &State<3>) -> [f64; 36] {
    std::array::from_fn(|place| {
        let (row, column) = (place / 6, place % 6);
        match (row < 3, column < 3) {
            (true, true) => state.pp[(row, column)],
            (true, false) => state.pv[(row, column - 3)],
            (false, true) => state.pv[(column, row - 3)],
            (false, false) => state.vv[(row - 3, column - 3)],
        }
    })
}

fn is_finite(state: &State<3>) -> bool {
    let matrices = [&state.pp, &state.pv, &state.vv];
    state.position.iter().chain(&state.velocity).all(|v| v.is_finite())
        && matrices.iter().all(|m| m.iter().all(|v| v.is_finite()))
}
