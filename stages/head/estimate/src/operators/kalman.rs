//! `estimate.kalman`: position and velocity of a measured pose.

use nalgebra::{Isometry3, SVector};
use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Cause, Diagnostics, Pose, PoseReport, Sample, Track};

use crate::channels::{Channels, Follow, InSamples};
use crate::kalman::{Kalman, KalmanParams};
use crate::operators::filter::{Filter, FilterOf, FilterOutput, Given, METRICS};
use crate::operators::truths::Truths;
use crate::process::{Hold, ProcessNoise};

const MEASUREMENT: usize = 0;
const TRUTH: usize = 1;
const REPORT: usize = 2;
const STATE: usize = 0;
const DIAGNOSTICS: usize = 1;

/// Parameters of `estimate.kalman`.
#[derive(Clone, Debug, Params)]
pub struct FilterParams {
    /// The estimated state: one coordinate of the position, all three, or the whole pose.
    #[param(default = "position")]
    pub follow: Follow,
    /// Standard deviation of the acceleration, on each axis. A cough that moves a head by 2 mm in 0.4 s has 250 mm/s2.
    /// With far less, the filter refuses exact poses during a cough.
    #[param(unit = "m/s2", default = "300 mm/s2", above = "0 mm/s2", max = "100 m/s2")]
    pub acceleration_sd: f64,
    /// Standard deviation of the angular acceleration, about each axis.
    #[param(unit = "rad/s2", default = "300 deg/s2", above = "0 deg/s2", max = "1000 rad/s2")]
    pub angular_acceleration_sd: f64,
    /// Duration of an acceleration. Without this parameter it lasts from one measurement to the next. Set it if this
    /// track is fused with tracks of other rates.
    #[param(unit = "s", above = "0 s", max = "1 s")]
    pub acceleration_hold: Option<f64>,
    /// Standard deviation of the velocity before the first measurement, on each axis.
    #[param(unit = "m/s", default = "50 mm/s", above = "0 mm/s", max = "10 m/s")]
    pub initial_velocity_sd: f64,
    /// Standard deviation of the angular velocity before the first measurement, about each axis.
    #[param(unit = "rad/s", default = "30 deg/s", above = "0 deg/s", max = "100 rad/s")]
    pub initial_angular_velocity_sd: f64,
    /// Standard deviation of a coordinate that the first measurement does not measure.
    #[param(unit = "m", default = "1 m", above = "0 m", max = "100 m")]
    pub open_sd: f64,
    /// Standard deviation of a rotation that the first measurement does not measure.
    #[param(unit = "rad", default = "60 deg", above = "0 deg", max = "180 deg")]
    pub open_angle_sd: f64,
    /// Standard deviation of a measured coordinate, in place of the covariance of the measurement.
    #[param(unit = "m", above = "0 m", max = "1 m")]
    pub measurement_sd: Option<f64>,
    /// Standard deviation of a measured rotation, in place of the covariance of the measurement.
    #[param(unit = "rad", above = "0 rad", max = "180 deg")]
    pub measurement_angle_sd: Option<f64>,
    /// A measurement is refused if the squared innovation of a channel is more than this many times its variance.
    #[param(default = 9, above = 0, max = 1000000000)]
    pub gate: f64,
    /// Time for which the filter predicts without a measurement that it uses. After that there is no estimate.
    #[param(unit = "ns", default = "500 ms", min = "1 ms", max = "1 min")]
    pub horizon: u64,
    /// Largest lead of a sensor's clock over the clock of this machine. A measurement whose acquisition time is later
    /// than its arrival by more than this is not used.
    #[param(unit = "ns", default = "5 ms", min = "0 ms", max = "1 s")]
    pub clock_ahead: u64,
}

/// Constant-velocity filter (SCIENCE D1-D2), from acquisition time to acquisition time.
///
/// Each measurement causes a sample with the state at its acquisition time; a refused measurement causes a sample with
/// the prediction. A direction of infinite variance is not used. A measurement acquired no later than the last one is
/// counted as late and causes no sample. If all measurements of a horizon are late, the clock of the sensor went back,
/// and the track starts again. A measurement whose acquisition time lies ahead is counted as early and causes a sample
/// without numbers, because there is no estimate of that time. With a timer, each tick sends the state predicted to the
/// tick, unless a newer one was sent; the filter does not change. If no measurement was used for the horizon, there is
/// no estimate: the sample says so and has no numbers. The track starts again with two measurements in a row that the
/// gate refuses and that agree, and with the first measurement against another reference, if `report` is connected.
pub struct EstimateKalman {
    filter: Box<dyn Filter>,
    truths: Truths,
    /// Number of the reference that poses are relative to; 0 before the first.
    reference: u32,
    /// Measurements acquired from then on, ns, are relative to another reference than the track.
    anew_from: Option<u64>,
}

impl Operator for EstimateKalman {
    type Params = FilterParams;
    const KIND: Kind = Kind {
        name: "estimate.kalman",
        about: "Estimates a position or a pose and its rates from measurements: a Kalman filter of constant velocity.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "measurement",
                sample: Pose::KIND,
                policy: Policy::Queue(4),
                required: true,
                about: "Measured pose with its covariance; directions of infinite variance are not used.",
            },
            Input {
                name: "truth",
                sample: Pose::KIND,
                policy: Policy::Queue(8),
                required: false,
                about: "True pose of the same point, only for the NEES.",
            },
            Input {
                name: "report",
                sample: PoseReport::KIND,
                policy: Policy::Queue(4),
                required: false,
                about: "The report on each measurement: with another reference the track starts again.",
            },
        ],
        outputs: &[
            Output {
                name: "state",
                sample: Track::KIND,
                frame: FrameRule::SameAs("measurement"),
                about: "Mean and covariance at the sample's origin.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "NIS, NEES, and the counts of used and refused measurements.",
            },
        ],
        timer: Timer::Optional,
    };

    fn new(params: FilterParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let filter = match params.follow {
            Follow::X => filter::<1, SVector<f64, 1>>(&params, Channels::axis(0))?,
            Follow::Y => filter::<1, SVector<f64, 1>>(&params, Channels::axis(1))?,
            Follow::Z => filter::<1, SVector<f64, 1>>(&params, Channels::axis(2))?,
            Follow::Position => filter::<3, SVector<f64, 3>>(&params, Channels::POSITION)?,
            Follow::Pose => filter::<6, Isometry3<f64>>(&params, Channels::POSE)?,
        };
        Ok(Self { filter, truths: Truths::default(), reference: 0, anew_from: None })
    }

    fn capacities(_: &FilterParams) -> Vec<usize> {
        vec![1, METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if activation.cause == Cause::Timer {
            return match self.filter.predict(activation.time) {
                Some(track) => outputs.send::<Track>(STATE, &track),
                None => Ok(()),
            };
        }
        if let Some(truth) = activation.fresh::<Pose>(TRUTH)
            && let Some(pose) = truth.first()
        {
            self.truths.keep(truth.header.origin, *pose);
        }
        if let Some(report) = activation.fresh::<PoseReport>(REPORT)
            && let Some(reported) = report.first()
            && let Some(step) = self.receive(reported.reference, report.header.origin, activation.time)
        {
            return send(&step, outputs);
        }
        let Some(measured) = activation.fresh::<Pose>(MEASUREMENT) else { return Ok(()) };
        let Some(pose) = measured.first() else { return Ok(()) };
        let origin = measured.header.origin;
        if self.anew_from.is_some_and(|from| origin >= from) {
            self.anew_from = None;
            self.filter.begin_anew(u64::MAX, activation.time, &self.truths);
        }
        send(&self.filter.measure(pose, origin, activation.time, &self.truths), outputs)
    }
}

impl EstimateKalman {
    /// Takes the reference of the pose that was acquired at `origin`, ns. Pose and report belong to one activation, and
    /// either may come first: a pose that was already used is processed again.
    fn receive(&mut self, reference: u32, origin: u64, time: u64) -> Option<FilterOutput> {
        let before = std::mem::replace(&mut self.reference, reference);
        if before == 0 || before == reference {
            return None;
        }
        if !self.filter.has_seen(origin) {
            self.anew_from = Some(origin);
            return None;
        }
        self.filter.begin_anew(origin, time, &self.truths)
    }
}

fn send(step: &FilterOutput, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
    if let Some(track) = &step.track {
        outputs.send::<Track>(STATE, track)?;
    }
    outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &step.metrics)
}

fn filter<const N: usize, X: InSamples<N>>(
    params: &FilterParams,
    channels: Channels<N>,
) -> Result<Box<dyn Filter>, SetupError> {
    let process = ProcessNoise {
        acceleration_sd: channels.each(params.acceleration_sd, params.angular_acceleration_sd),
        hold: params.acceleration_hold.map_or(Hold::Step, Hold::Seconds),
    };
    let kalman = Kalman::<N, X>::new(KalmanParams {
        process,
        open_sd: channels.each(params.open_sd, params.open_angle_sd),
        initial_velocity_sd: channels.each(params.initial_velocity_sd, params.initial_angular_velocity_sd),
        gate: params.gate,
        horizon: params.horizon,
    })
    .map_err(|e| SetupError(e.to_string()))?;
    let given = Given { length: params.measurement_sd, angle: params.measurement_angle_sd };
    Ok(Box::new(FilterOf::new(kalman, channels, given, params.clock_ahead)))
}
