//! An operator for `robust` and `tune`: poses of another point of the head, with noise.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::Rng;
use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup, Stage};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{Pose, PoseElement, Sample};

/// Kinds of this file.
pub const STAGES: &[Stage] = &[Stage::of::<Noise>()];

/// Parameters of [`Noise`].
#[derive(Clone, Debug, Params)]
pub struct NoiseParams {
    /// Tracked point in the coordinates of the head, whose pose is the input.
    #[param(unit = "m", default = "[0 mm, 0 mm, 0 mm]", min = "-200 mm", max = "200 mm")]
    point: [f64; 3],
    /// Standard deviation of x, y and z.
    #[param(unit = "m", default = "[0 mm, 0 mm, 0 mm]", min = "0 mm", max = "100 mm")]
    position: [f64; 3],
    /// Standard deviation of the rotations about x, y and z.
    #[param(unit = "rad", default = "[0 deg, 0 deg, 0 deg]", min = "0 deg", max = "45 deg")]
    angles: [f64; 3],
    /// One pose in this many is sent.
    #[param(default = 1, min = 1, max = 1000000)]
    keep: u64,
    /// Fraction of the poses to send that is lost.
    #[param(default = 0, min = 0, max = 1)]
    lost: f64,
    /// Whether the covariance of the noise replaces that of the pose.
    #[param(default = false)]
    reported: bool,
}

/// Poses of a point of the head, with white noise.
pub struct Noise(NoiseParams);

impl Operator for Noise {
    type Params = NoiseParams;
    const KIND: Kind = Kind {
        name: "bench.noise",
        about: "Poses of a point of the head, with white noise.",
        role: Role::Operator,
        inputs: &[Input {
            name: "pose",
            sample: Pose::KIND,
            policy: Policy::Queue(4),
            required: true,
            about: "The pose.",
        }],
        outputs: &[Output {
            name: "pose",
            sample: Pose::KIND,
            frame: FrameRule::SameAs("pose"),
            about: "The pose with noise.",
        }],
        timer: Timer::No,
    };

    fn new(params: NoiseParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self(params))
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(pose) = activation.input::<Pose>(0).and_then(|view| view.first().copied()) else {
            return Ok(());
        };
        if !activation.index.is_multiple_of(self.0.keep) {
            return Ok(());
        }
        let mut random = activation.random();
        if f64::from(random.next_u32()) < self.0.lost * (f64::from(u32::MAX) + 1.0) {
            return Ok(());
        }
        let [w, x, y, z] = pose.orientation;
        let orientation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
        let point = Vector3::from(pose.position) + orientation * Vector3::from(self.0.point);
        let position = std::array::from_fn(|i| point[i] + self.0.position[i] * normal(&mut random));
        let turn = Vector3::from_fn(|i, _| self.0.angles[i] * normal(&mut random));
        let turned = UnitQuaternion::from_scaled_axis(turn) * orientation;
        let q = if turned.w < 0.0 { -turned.into_inner() } else { turned.into_inner() };
        let mut noisy = PoseElement { position, orientation: [q.w, q.i, q.j, q.k], ..pose };
        if self.0.reported {
            let deviations = self.0.position.iter().chain(&self.0.angles);
            noisy.covariance = [0.0; 36];
            deviations.enumerate().for_each(|(i, sd)| noisy.covariance[7 * i] = sd * sd);
        }
        outputs.send::<Pose>(0, &noisy)
    }
}

/// A normal deviate (Box and Muller 1958).
fn normal(random: &mut impl Rng) -> f64 {
    let mut uniform = || (f64::from(random.next_u32()) + 0.5) / (f64::from(u32::MAX) + 1.0);
    let (radius, angle) = (uniform(), uniform());
    libm::sqrt(-2.0 * libm::log(radius)) * libm::cos(core::f64::consts::TAU * angle)
}
