//! Kinds of operators with the ports and parameters of a small pipeline. They do nothing: only their description counts.

use stillpoint_pipeline::operator::{
    FrameRule, Input, Kind, Output, Policy, Registry, Role, SetupError, Stage, StepError, Timer,
};
use stillpoint_pipeline::{Activation, Choice, Operator, Outputs, Params, Setup};
use stillpoint_samples::{
    ConsoleCommand, DepthImage, Diagnostics, PointCloud, Pose, Sample, SampleKind, Track,
};

macro_rules! kind {
    ($name:ident, $params:ty, $kind:expr) => {
        pub struct $name;
        impl Operator for $name {
            type Params = $params;
            const KIND: Kind = $kind;
            fn new(_: $params, _: &Setup<'_>) -> Result<Self, SetupError> {
                Ok(Self)
            }
            fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
                Ok(())
            }
        }
    };
}

const fn needs(name: &'static str, sample: &'static SampleKind, policy: Policy) -> Input {
    Input { name, sample, policy, required: true, about: "What the operator works on." }
}

const fn takes(name: &'static str, sample: &'static SampleKind, policy: Policy) -> Input {
    Input { required: false, ..needs(name, sample, policy) }
}

const fn sends(name: &'static str, sample: &'static SampleKind, frame: FrameRule) -> Output {
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
    }
);

kind!(
    Head,
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

#[derive(Clone, Params)]
pub struct StepParams {
    /// By how much the target moves.
    #[param(unit = "m")]
    pub by: [f64; 3],
    /// When it moves, after the start.
    #[param(unit = "ns", default = "2 s")]
    pub at: u64,
}

#[derive(Clone, Params)]
pub struct TargetParams {
    /// A step of the target.
    pub step: Option<StepParams>,
    /// Corners of a path that the target follows.
    #[param(unit = "m", default = "[]")]
    pub path: Vec<[f64; 3]>,
    /// What the target is called.
    #[param(default = "rest", choices("rest", "treat"))]
    pub goal: String,
}

kind!(
    Target,
    TargetParams,
    Kind {
        name: "control.target",
        about: "The pose that the head is to have.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[sends("reference", Track::KIND, FrameRule::Key)],
        timer: Timer::Required,
    }
);

#[derive(Clone, Params)]
pub struct MracParams {
    /// Rate of adaptation.
    #[param(min = 0, max = 10)]
    pub gain: f64,
    /// How long a command stays valid.
    #[param(unit = "ns", default = "60 ms", min = "1 ms", max = "1 s")]
    pub watchdog: u64,
}

kind!(
    Mrac,
    MracParams,
    Kind {
        name: "control.mrac",
        about: "Model-reference adaptive control of the bladders.",
        role: Role::Operator,
        inputs: &[
            needs("state", Track::KIND, Policy::Latest),
            needs("target", Track::KIND, Policy::Latest),
            takes("feedback", Diagnostics::KIND, Policy::Latest),
        ],
        outputs: &[sends("command", Diagnostics::KIND, FrameRule::None)],
        timer: Timer::Optional,
    }
);

kind!(
    Fuse,
    (),
    Kind {
        name: "estimate.fuse",
        about: "Two poses in step to one.",
        role: Role::Operator,
        inputs: &[
            needs("a", Pose::KIND, Policy::Sync { within: 5_000_000 }),
            needs("b", Pose::KIND, Policy::Sync { within: 5_000_000 }),
            takes("hint", Pose::KIND, Policy::Latest),
        ],
        outputs: &[sends("pose", Pose::KIND, FrameRule::SameAs("a"))],
        timer: Timer::No,
    }
);

#[derive(Clone, Params)]
pub struct ReplayParams {
    /// Images to send.
    #[param(files)]
    pub images: String,
    /// Weights of the channels.
    #[param(default = "[1, 1]")]
    pub weights: [f32; 2],
    /// Shift of the counts.
    #[param(default = -3, min = -10)]
    pub shift: i64,
}

kind!(
    Images,
    ReplayParams,
    Kind {
        name: "ingest.images",
        about: "Depth images out of a folder.",
        role: Role::Source,
        inputs: &[],
        outputs: &[sends("depth", DepthImage::KIND, FrameRule::Key)],
        timer: Timer::Required,
    }
);

kind!(
    Counts,
    (),
    Kind {
        name: "report.counts",
        about: "How many samples came.",
        role: Role::Operator,
        inputs: &[takes("samples", Diagnostics::KIND, Policy::Queue(4))],
        outputs: &[sends("counts", Diagnostics::KIND, FrameRule::None)],
        timer: Timer::Optional,
    }
);

kind!(
    Console,
    (),
    Kind {
        name: "console",
        about: "What people send.",
        role: Role::Source,
        inputs: &[],
        outputs: &[
            sends("arm", ConsoleCommand::KIND, FrameRule::None),
            sends("capture", ConsoleCommand::KIND, FrameRule::None),
        ],
        timer: Timer::No,
    }
);

const ALL: &[Stage] = &[
    Stage::of::<Rig>(),
    Stage::of::<Depth>(),
    Stage::of::<Face>(),
    Stage::of::<Head>(),
    Stage::of::<Kalman>(),
    Stage::of::<Target>(),
    Stage::of::<Mrac>(),
    Stage::of::<Fuse>(),
    Stage::of::<Images>(),
    Stage::of::<Counts>(),
    Stage::of::<Console>(),
];

/// All of them.
pub fn registry() -> Registry {
    Registry::new(&[ALL])
}
