//! `track.centroid`: where the face is, as the mean of its points.

use nalgebra::{Matrix3, Vector3};
use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{PointCloud, Pose, PoseElement, Sample};

use crate::centroid::centroid;
use crate::output_frame::output_from_face;

const FACE: usize = 0;
const POSITION: usize = 0;

/// Parameters of `track.centroid`.
#[derive(Clone, Debug, Params)]
pub struct CentroidParams {
    /// Standard deviation of the error that all points of a frame share, on each axis. It is added to the deviation
    /// from the spread of the points.
    #[param(unit = "m", default = "0.3 mm", above = "0 mm", max = "100 mm")]
    pub shared_sd: f64,
}

/// Sends the centroid of each face; a face of fewer than two finite points causes no sample.
pub struct TrackCentroid {
    /// Variance that all points share, m2.
    shared: f64,
    /// `output_from_face`, m.
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

impl Operator for TrackCentroid {
    type Params = CentroidParams;
    const KIND: Kind = Kind {
        name: "track.centroid",
        about: "Measures the position of a face: the mean of its points, with covariance.",
        role: Role::Operator,
        inputs: &[Input {
            name: "face",
            sample: PointCloud::KIND,
            policy: Policy::Queue(1),
            required: true,
            about: "The points of the face.",
        }],
        outputs: &[Output {
            name: "position",
            sample: Pose::KIND,
            frame: FrameRule::KeyOr("face"),
            about: "The centroid; its orientation is unknown: the identity with infinite variance.",
        }],
        timer: Timer::No,
    };

    fn new(params: CentroidParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let rigid = output_from_face(setup)?;
        Ok(Self {
            shared: params.shared_sd * params.shared_sd,
            rotation: Matrix3::from_fn(|i, j| rigid.rotation[i][j]),
            translation: Vector3::from(rigid.translation),
        })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(face) = activation.input::<PointCloud>(FACE) else { return Ok(()) };
        let Some(mean) = centroid(face.elements.iter().map(|p| p.xyz)) else { return Ok(()) };
        let position = self.rotation * mean.position + self.translation;
        let spread = self.rotation * mean.covariance * self.rotation.transpose();
        outputs.send::<Pose>(POSITION, &position_only(position, spread, self.shared))
    }
}

/// A pose of which only the position is known. `shared` is a variance on each axis, m2.
fn position_only(position: Vector3<f64>, spread: Matrix3<f64>, shared: f64) -> PoseElement {
    let mut covariance = [0.0; 36];
    for row in 0..3 {
        for column in 0..3 {
            // Rounding leaves the two halves of the product a little apart.
            covariance[6 * row + column] = 0.5 * (spread[(row, column)] + spread[(column, row)]);
        }
        covariance[7 * row] += shared;
        covariance[7 * (row + 3)] = f64::INFINITY;
    }
    PoseElement { position: position.into(), orientation: [1.0, 0.0, 0.0, 0.0], covariance }
}
