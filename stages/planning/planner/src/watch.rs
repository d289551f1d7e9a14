//! `plan.watch`: requests a plan where a patient stays away from the set-up of the last request.

use nalgebra::{Isometry3, Point3, UnitQuaternion};
use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_pose::{checked_isometry, orientation};
use stillpoint_samples::{PlanRequest, PlanRequestElement, Pose, Sample};

use crate::patient::{case_of, hash_of};

const POSE: usize = 0;
const REQUEST: usize = 0;

/// The pose of the planned set-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Planned {
    /// The first pose.
    First,
    /// At `isocentre` without rotation: a perfect set-up of `track.head` with the planning CT as reference.
    Isocentre,
}

/// Parameters of `plan.watch`.
#[derive(Clone, Debug, Params)]
pub struct WatchParams {
    /// The case file, a path relative to the pipeline file; the session keeps it. Without it, the case is the synthetic
    /// pelvis of seed 0.
    #[param(file)]
    pub case: Option<String>,
    /// Which pose the planned set-up has.
    #[param(default = "first")]
    pub planned: Planned,
    /// Place of the machine's isocentre in the frame of the poses.
    #[param(unit = "m", default = "[0 mm, 0 mm, 0 mm]", min = "-10 m", max = "10 m")]
    pub isocentre: [f64; 3],
    /// Beams of the plan.
    #[param(default = 5, min = 1, max = 12)]
    pub beams: u64,
    /// Solves of a request.
    #[param(default = 20, min = 1, max = 1000)]
    pub budget: u64,
    /// Distance of the isocentre from where it was at the last request beyond which a plan is requested.
    #[param(unit = "m", default = "3 mm", above = "0 mm", max = "50 mm")]
    pub distance: f64,
    /// Rotation since the last request beyond which a plan is requested.
    #[param(unit = "rad", default = "1 deg", above = "0 deg", max = "45 deg")]
    pub turn: f64,
    /// How long the patient must stay beyond `distance` or `turn`.
    #[param(unit = "ns", default = "2 s", max = "10 min")]
    pub dwell: u64,
}

/// Requests a plan for the planned set-up when the first pose comes, and a plan for each set-up in which the patient stays.
///
/// A request is made when the patient has been farther than `distance` or `turn` from the set-up of the last request for
/// `dwell`: a set-up error, or a motion that was not corrected. Its set-up is the motion from the planned set-up, of the
/// point of the patient at the isocentre. A pose that is no rigid motion of finite numbers has no effect.
pub struct PlanWatch {
    params: WatchParams,
    hash: [u64; 4],
    planned: Option<Isometry3<f64>>,
    /// The motion of the last request.
    requested: Isometry3<f64>,
    /// Since when the patient is away from there, ns.
    away_since: Option<u64>,
}

impl Operator for PlanWatch {
    type Params = WatchParams;
    const KIND: Kind = Kind {
        name: "plan.watch",
        about: "Requests a plan where a patient stays away from the set-up of the last request.",
        role: Role::Operator,
        inputs: &[Input {
            name: "pose",
            sample: Pose::KIND,
            policy: Policy::Latest,
            required: true,
            about: "The pose of the patient, in the frame of the couch.",
        }],
        outputs: &[Output {
            name: "request",
            sample: PlanRequest::KIND,
            frame: FrameRule::None,
            about: "The motion from the planned set-up to the present one.",
        }],
        timer: Timer::No,
    };

    fn new(params: WatchParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        if let Some(Some(frame)) = setup.input_frames.get(POSE)
            && frame != "couch"
        {
            return Err(SetupError(format!(
                "the poses are in the frame `{frame}`; plan.watch takes poses in `couch`"
            )));
        }
        let hash = hash_of(&case_of(params.case.as_deref(), setup)?)?;
        Ok(Self { params, hash, planned: None, requested: Isometry3::identity(), away_since: None })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(pose) = activation.fresh::<Pose>(POSE).and_then(|view| view.elements.first().copied())
        else {
            return Ok(());
        };
        let finite = pose.position.iter().all(|metres| metres.is_finite());
        let pose = checked_isometry(pose.position, pose.orientation).filter(|_| finite);
        let Some(pose) = pose else { return Ok(()) };
        let Some(planned) = self.planned else {
            self.planned = Some(match self.params.planned {
                Planned::First => pose,
                Planned::Isocentre => {
                    Isometry3::from_parts(self.params.isocentre.into(), UnitQuaternion::identity())
                }
            });
            return self.request(outputs, Isometry3::identity());
        };
        let motion = self.at_isocentre(&(pose * planned.inverse()));
        if !self.is_away(&motion) {
            self.away_since = None;
            return Ok(());
        }
        let since = *self.away_since.get_or_insert(activation.time);
        if activation.time.saturating_sub(since) < self.params.dwell {
            return Ok(());
        }
        self.away_since = None;
        self.request(outputs, motion)
    }
}

impl PlanWatch {
    /// A motion of the couch's frame as one of the point at the isocentre, and a turn about it.
    fn at_isocentre(&self, motion: &Isometry3<f64>) -> Isometry3<f64> {
        let isocentre = Point3::from(self.params.isocentre);
        Isometry3::from_parts((motion * isocentre - isocentre).into(), motion.rotation)
    }

    fn is_away(&self, motion: &Isometry3<f64>) -> bool {
        let distance = (motion.translation.vector - self.requested.translation.vector).norm();
        let turn = motion.rotation.angle_to(&self.requested.rotation);
        distance > self.params.distance || turn > self.params.turn
    }

    fn request(&mut self, outputs: &mut Outputs<'_>, motion: Isometry3<f64>) -> Result<(), StepError> {
        self.requested = motion;
        let request = PlanRequestElement {
            position: motion.translation.vector.into(),
            orientation: orientation(&motion.rotation),
            case_hash: self.hash,
            beams: self.params.beams as u32,
            budget: self.params.budget as u32,
        };
        outputs.send::<PlanRequest>(REQUEST, &request)
    }
}
