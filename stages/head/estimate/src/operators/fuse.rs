//! `estimate.fuse`: the tracks of two sensors become one.

use nalgebra::{Isometry3, SVector};
use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{Feeder, FeederConflict};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Cause, Diagnostics, Health, Sample, Track};

use crate::channels::{Channels, Follow};
use crate::cross::Side;
use crate::operators::fusion::{Fusion, FusionOf, FusionParams, METRICS, NAMES};
use crate::watch::WatchParams;

const STATE: usize = 0;
const HEALTH: usize = 1;
const DIAGNOSTICS: usize = 2;

/// How two tracks are weighed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Method {
    /// By the covariances of both and of both together, which comes of the motion that they share.
    CrossCovariance,
    /// By the inverse of the covariances, as the dissertation prints it; the covariance that it claims is too small.
    InverseVariance,
    /// By covariance intersection: safe if the correlation of the tracks is unknown.
    Intersection,
}

/// Parameters of `estimate.fuse`.
#[derive(Clone, Debug, Params)]
pub struct FuseParams {
    /// The state of the tracks: the same as in both filters.
    #[param(default = "position")]
    pub follow: Follow,
    /// How the tracks are weighted.
    #[param(default = "cross_covariance")]
    pub method: Method,
    /// Sensors disagree if the squared difference of a channel, after subtracting the tolerance, is more than this many
    /// times its variance.
    #[param(default = 25, above = 0, max = 1000000000)]
    pub gate: f64,
    /// Allowed constant difference between the sensors: the residual of their extrinsics, and their different
    /// measurements of one surface.
    #[param(unit = "m", default = "1 mm", min = "0 mm", max = "1 m")]
    pub tolerance: f64,
    /// Allowed constant difference between the sensors in rotation.
    #[param(unit = "rad", default = "0.5 deg", min = "0 deg", max = "180 deg")]
    pub angle_tolerance: f64,
    /// A sensor that sent nothing for this time is silent, and an older track is not used.
    #[param(unit = "ns", default = "200 ms", min = "1 ms", max = "1 min")]
    pub timeout: u64,
    /// A delay from acquisition to arrival that differs by more than this from the delay before counts as a jump of a
    /// clock.
    #[param(unit = "ns", default = "100 ms", min = "1 ms", max = "1 min")]
    pub clock_jump: u64,
    /// Largest lead of a sensor's clock over the clock of this machine. A sensor that is farther ahead is excluded.
    #[param(unit = "ns", default = "5 ms", min = "0 ms", max = "1 s")]
    pub clock_ahead: u64,
    /// Number of identical measurements in a row after which a sensor counts as frozen.
    #[param(default = 3, min = 1)]
    pub frozen_after: u64,
    /// Number of measurements in a row that its filter does not use after which a sensor is excluded.
    #[param(default = 3, min = 1)]
    pub unused_after: u64,
    /// Number of good samples in a row after which a sensor is used again.
    #[param(default = 5, min = 1)]
    pub readmit_after: u64,
}

/// Track-to-track fusion (4.2.3, SCIENCE D3) of sensors of any rates.
///
/// All origins are assumed to be on the session's clock, to which sources map their own clocks. A constant offset of
/// one clock is estimated from the motion (`clock_offset_s`, not corrected). A sensor whose clock jumps, or is farther
/// ahead than `clock_ahead`, is excluded. The tracks are those of `estimate.kalman` without `every:`, which carry the
/// gains that the cross covariance needs.
///
/// A track causes the fused state at its origin, and a tick causes the state predicted to the tick, unless a newer one
/// was sent. A sensor is excluded if it is silent or frozen, if its clock jumps, if it has no estimate, or if it
/// disagrees with the other sensor and with the last estimate; `health` gives the reason. Without a usable sensor there
/// is no estimate: the sample says so and has no numbers.
pub struct EstimateFuse {
    fusion: Box<dyn Fusion>,
}

impl Operator for EstimateFuse {
    type Params = FuseParams;
    const KIND: Kind = Kind {
        name: "estimate.fuse",
        about: "Fuses the tracks of two sensors into one, and excludes a sensor that fails.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: NAMES[0],
                sample: Track::KIND,
                policy: Policy::Queue(8),
                required: true,
                about: "Track of one sensor, from a filter without timer.",
            },
            Input {
                name: NAMES[1],
                sample: Track::KIND,
                policy: Policy::Queue(8),
                required: true,
                about: "Track of the other sensor, in the same frame.",
            },
        ],
        outputs: &[
            Output {
                name: "state",
                sample: Track::KIND,
                frame: FrameRule::SameAs(NAMES[0]),
                about: "The fused track at the sample's origin.",
            },
            Output {
                name: "health",
                sample: Health::KIND,
                frame: FrameRule::None,
                about: "Whether each sensor is used, and if not, why.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "Sensors used, weight of the second, offset of the clocks.",
            },
        ],
        // Both sensors may fall silent, and that has to be said: somebody must look at the time.
        timer: Timer::Required,
    };

    fn validate_input(_: &FuseParams, input: usize, from: &Feeder<'_>) -> Result<(), FeederConflict> {
        match from.every {
            Some(_) if from.kind.starts_with("estimate.") => Err(FeederConflict {
                reason: format!(
                    "{} has a timer (`every:`), so most of its tracks are predictions, and `{}` would be left out of the fusion",
                    from.operator, NAMES[input]
                ),
                help: format!("remove `every:` from {}: the fusion has a timer of its own", from.operator),
            }),
            _ => Ok(()),
        }
    }

    fn new(params: FuseParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let fusion = FusionParams {
            method: params.method,
            gate: params.gate,
            tolerance: params.tolerance,
            angle_tolerance: params.angle_tolerance,
            watch: WatchParams {
                timeout: params.timeout,
                clock_jump: params.clock_jump,
                clock_ahead: params.clock_ahead,
                frozen_after: params.frozen_after,
                unused_after: params.unused_after,
                readmit_after: params.readmit_after,
            },
        };
        Ok(Self {
            fusion: match params.follow {
                Follow::X => Box::new(FusionOf::<1, 2, SVector<f64, 1>>::new(fusion, Channels::axis(0))),
                Follow::Y => Box::new(FusionOf::<1, 2, SVector<f64, 1>>::new(fusion, Channels::axis(1))),
                Follow::Z => Box::new(FusionOf::<1, 2, SVector<f64, 1>>::new(fusion, Channels::axis(2))),
                Follow::Position => {
                    Box::new(FusionOf::<3, 6, SVector<f64, 3>>::new(fusion, Channels::POSITION))
                }
                Follow::Pose => Box::new(FusionOf::<6, 12, Isometry3<f64>>::new(fusion, Channels::POSE)),
            },
        })
    }

    fn capacities(_: &FuseParams) -> Vec<usize> {
        vec![1, NAMES.len(), METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let time = activation.time;
        let fused = if activation.cause == Cause::Timer {
            self.fusion.predict(time)
        } else {
            let side = if activation.port == 0 { Side::First } else { Side::Second };
            let Some(view) = activation.fresh::<Track>(activation.port) else { return Ok(()) };
            let Some(track) = view.first() else { return Ok(()) };
            self.fusion.take(side, track, view.header.origin, time).map_err(|e| StepError(e.to_string()))?
        };
        if let Some(fused) = &fused {
            outputs.send::<Track>(STATE, fused)?;
        }
        outputs.send_slice::<Health>(HEALTH, &(), &self.fusion.health(time))?;
        outputs.send_slice::<Diagnostics>(DIAGNOSTICS, &(), &self.fusion.metrics())
    }
}
