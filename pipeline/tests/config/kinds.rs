//! Kinds of operators with the ports and parameters of a small pipeline. They do nothing: only their description counts.

use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_operator::{
    FrameRule, Input, Kind, Output, ParamConflict, Policy, Registry, Role, SetupError, Stage, StepError,
    Timer,
};
use stillpoint_samples::{
    ConsoleCommand, DepthImage, Diagnostics, PointCloud, Pose, Sample, SampleKind, Track,
};

use crate::others;

macro_rules! kind {
    ($name:ident, $params:ty, $kind:expr $(, laps: $laps:expr)? $(, fit: $fit:expr)?) => {
        pub struct $name;
        impl Operator for $name {
            type Params = $params;
            const KIND: Kind = $kind;
            $(const LAPS: &'static [&'static str] = $laps;)?
            $(fn validate(params: &$params) -> Result<(), ParamConflict> {
                let fit: fn(&$params) -> Result<(), ParamConflict> = $fit;
                fit(params)
            })?
            fn new(_: $params, _: &Setup<'_>) -> Result<Self, SetupError> {
                Ok(Self)
            }
            fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
                Ok(())
            }
        }
    };
}

pub const fn needs(name: &'static str, sample: &'static SampleKind, policy: Policy) -> Input {
    Input { name, sample, policy, required: true, about: "What the operator works on." }
}

pub const fn takes(name: &'static str, sample: &'static SampleKind, policy: Policy) -> Input {
    Input { required: false, ..needs(name, sample, policy) }
}

pub const fn sends(name: &'static str, sample: &'static SampleKind, frame: FrameRule) -> Output {
    Output { name, sample, frame, about: "What the operator makes." }
}

/// What the rig's head does.
#[derive(Clone, Copy, Debug, PartialEq, Choice)]
pub enum Motion {
    Still,
    Nods,
    SlowSweep,
}

#[derive(Clone, Params)]
pub struct RigParams {
    /// What the head does.
    #[param(default = "nods")]
    pub motion: Motion,
    /// Standard deviation of the depth noise.
    #[param(unit = "m", default = "1 mm", min = "0 mm", max = "20 mm")]
    pub noise: f64,
    /// Images per second.
    #[param(unit = "Hz", default = "30 Hz", above = "0 Hz", max = "120 Hz")]
    pub rate: f64,
    /// Pressure of the supply.
    #[param(unit = "Pa", default = "15 psi", min = "0 psi", max = "30 psi")]
    pub supply: f64,
}

kind!(
    Rig,
    RigParams,
    Kind {
        name: "rig.three_bladders",
        about: "Three bladders under a head, seen by a depth camera.",
        role: Role::Source,
        inputs: &[takes("datagram", Diagnostics::KIND, Policy::Queue(16))],
        outputs: &[
            sends("depth", DepthImage::KIND, FrameRule::Named("camera")),
            sends("truth", Pose::KIND, FrameRule::Named("couch")),
        ],
        timer: Timer::Required,
    }
);

#[derive(Clone, Params)]
pub struct DepthParams {
    /// Depths nearer than this are dropped.
    #[param(unit = "m", default = "200 mm", min = "0 mm")]
    pub near: f64,
    /// Depths farther than this are dropped.
    #[param(unit = "m", default = "2 m", max = "20 m")]
    pub far: f64,
    /// Every which pixel is taken.
    #[param(unit = "px", default = "1 px", min = "1 px", max = "16 px")]
    pub stride: u32,
}

kind!(
    Depth,
    DepthParams,
    Kind {
        name: "ingest.depth",
        about: "Depth images to point clouds.",
        role: Role::Operator,
        inputs: &[needs("image", DepthImage::KIND, Policy::Queue(4))],
        outputs: &[sends("cloud", PointCloud::KIND, FrameRule::Key)],
        timer: Timer::No,
    },
    fit: |params| match params.far > params.near {
        true => Ok(()),
        false => Err(ParamConflict {
            params: &["near", "far"],
            reason: format!("`far` is {} m and must be greater than `near`, {} m", params.far, params.near),
            help: "raise `far`, or lower `near`",
        }),
    }
);

#[derive(Clone, Params)]
pub struct FaceParams {
    /// Edge of a voxel.
    #[param(unit = "m", default = "4 mm", min = "0.5 mm", max = "50 mm")]
    pub leaf: f64,
    /// Greatest distance from the plane.
    #[param(unit = "m", default = "8 mm", min = "0.1 mm", max = "50 mm")]
    pub plane_tolerance: f64,
    /// Hypotheses tried for the plane.
    #[param(default = 500, min = 1, max = 100000)]
    pub iterations: u32,
    /// Network that finds the face.
    #[param(file)]
    pub model: Option<String>,
    /// Whether the hull is cut away.
    #[param(default = true)]
    pub crop: bool,
}

kind!(
    Face,
    FaceParams,
    Kind {
        name: "segment.face",
        about: "The face out of a cloud.",
        role: Role::Operator,
        inputs: &[needs("cloud", PointCloud::KIND, Policy::Queue(4))],
        outputs: &[
            sends("face", PointCloud::KIND, FrameRule::SameAs("cloud")),
            sends("diagnostics", Diagnostics::KIND, FrameRule::None),
        ],
        timer: Timer::No,
    },
    laps: &["voxel", "plane"]
);

kind!(
    Header,
    (),
    Kind {
        name: "track.head",
        about: "The pose of the head against a captured reference.",
        role: Role::Operator,
        inputs: &[
            needs("face", PointCloud::KIND, Policy::Queue(4)),
            takes("command", ConsoleCommand::KIND, Policy::Queue(16)),
        ],
        outputs: &[sends("pose", Pose::KIND, FrameRule::KeyOr("face"))],
        timer: Timer::No,
    }
);

#[derive(Clone, Params)]
pub struct KalmanParams {
    /// Spectral density of the acceleration noise.
    #[param(unit = "m2/s3", default = "10 mm2/s3", above = "0 mm2/s3")]
    pub jerk: f64,
    /// Gate on the normalised innovation, in degrees of freedom.
    #[param(default = 11.3, above = 0)]
    pub gate: f64,
}

kind!(
    Kalman,
    KalmanParams,
    Kind {
        name: "estimate.kalman",
        about: "Constant-velocity filter of a pose.",
        role: Role::Operator,
        inputs: &[needs("measurement", Pose::KIND, Policy::Queue(8))],
        outputs: &[sends("state", Track::KIND, FrameRule::SameAs("measurement"))],
        timer: Timer::Optional,
    }
);

pub(crate) use kind;

const ALL: &[Stage] = &[
    Stage::of::<others::Valves>(),
    Stage::of::<others::Controller>(),
    Stage::of::<Rig>(),
    Stage::of::<Depth>(),
    Stage::of::<Face>(),
    Stage::of::<Header>(),
    Stage::of::<Kalman>(),
    Stage::of::<others::Target>(),
    Stage::of::<others::Mrac>(),
    Stage::of::<others::Fuse>(),
    Stage::of::<others::Images>(),
    Stage::of::<others::Counts>(),
    Stage::of::<others::Console>(),
    Stage::of::<others::Taker>(),
];

/// All of them.
pub fn registry() -> Registry {
    Registry::new(&[ALL, &stillpoint_pipeline::STAGES[1..]])
}
