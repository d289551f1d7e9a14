//! `track.summit`: one coordinate of a face, that of its highest place.

use stillpoint_operator::frames::Rigid;
use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{PointCloud, Pose, PoseElement, Sample};

use crate::output_frame::output_from_face;
use crate::summit::SummitFinder;

const FACE: usize = 0;
const POSITION: usize = 0;

/// Which way is up, along an axis of the output's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Up {
    /// Along x.
    X,
    /// Along y.
    Y,
    /// Along z: the couch's up.
    Z,
    /// Against z: towards a camera in its own frame.
    MinusZ,
}

/// Parameters of `track.summit`.
#[derive(Clone, Debug, Params)]
pub struct SummitParams {
    /// Which way is up in the output's frame.
    #[param(default = "z")]
    pub up: Up,
    /// Share of the face's points, the highest ones, that say where its highest place is sought.
    #[param(default = 0.02, above = 0, max = 1)]
    pub share: f64,
    /// Radius about that place over which the surface is averaged.
    #[param(unit = "m", default = "8 mm", above = "0 mm", max = "200 mm")]
    pub radius: f64,
    /// Standard deviation of the error that all points of a frame share.
    #[param(unit = "m", default = "0.3 mm", above = "0 mm", max = "100 mm")]
    pub shared_sd: f64,
}

/// Sends the coordinate of the highest place of each face; a face without such a place causes no sample.
pub struct TrackSummit {
    params: SummitParams,
    output_from_face: Rigid,
    finder: SummitFinder,
    /// The face in the output's frame, up last; room that grows to the largest face.
    points: Vec<[f32; 3]>,
}

impl Operator for TrackSummit {
    type Params = SummitParams;
    const KIND: Kind = Kind {
        name: "track.summit",
        about: "One coordinate of a face, that of its highest place: the distance to the forehead.",
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
            about: "The highest place; all but its coordinate along the axis has infinite variance.",
        }],
        timer: Timer::No,
    };

    fn new(params: SummitParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let output_from_face = output_from_face(setup)?;
        Ok(Self { params, output_from_face, finder: SummitFinder::default(), points: Vec::new() })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(face) = activation.input::<PointCloud>(FACE) else { return Ok(()) };
        // Places of (across, across, up) among x, y, z, and the sign of up.
        let ([a, b, c], sign) = match self.params.up {
            Up::X => ([1, 2, 0], 1.0),
            Up::Y => ([2, 0, 1], 1.0),
            Up::Z => ([0, 1, 2], 1.0),
            Up::MinusZ => ([0, 1, 2], -1.0),
        };
        self.points.clear();
        self.points.extend(face.elements.iter().map(|p| {
            let at = self.output_from_face.apply(p.xyz.map(f64::from));
            [at[a] as f32, at[b] as f32, (sign * at[c]) as f32]
        }));
        let Some(summit) = self.finder.find(&self.points, self.params.share, self.params.radius) else {
            return Ok(());
        };
        let mut pose =
            PoseElement { position: [0.0; 3], orientation: [1.0, 0.0, 0.0, 0.0], covariance: [0.0; 36] };
        pose.position[a] = summit.position[0];
        pose.position[b] = summit.position[1];
        pose.position[c] = sign * summit.position[2];
        for i in 0..6 {
            let known = summit.variance + self.params.shared_sd * self.params.shared_sd;
            pose.covariance[7 * i] = if i == c { known } else { f64::INFINITY };
        }
        outputs.send::<Pose>(POSITION, &pose)
    }
}
