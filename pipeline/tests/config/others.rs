//! The other kinds of the tests: control, fusion, images and console.

use stillpoint_operator::ros2::Subscription;
use stillpoint_operator::{Activation, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Kind, Operator, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{
    ConsoleCommand, Datagram, DepthImage, Diagnostics, PointCloud, Pose, Sample, Track,
};

use crate::kinds::{kind, needs, sends, takes};

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

kind!(
    Valves,
    (),
    Kind {
        name: "actuate.valves",
        about: "Duties of valves as datagrams.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[sends("datagram", Datagram::KIND, FrameRule::None)],
        timer: Timer::Required,
    }
);

kind!(
    Controller,
    (),
    Kind {
        name: "rig.controller",
        about: "Takes datagrams.",
        role: Role::Operator,
        inputs: &[needs("datagram", Datagram::KIND, Policy::Queue(16))],
        outputs: &[],
        timer: Timer::No,
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
    #[param(files = "*.png")]
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

/// A source of a topic of ROS 2.
pub struct Taker;

impl Operator for Taker {
    type Params = ();
    const KIND: Kind = Kind {
        name: "ingest.ros2",
        about: "Clouds of a topic of ROS 2.",
        role: Role::Source,
        inputs: &[],
        outputs: &[sends("cloud", PointCloud::KIND, FrameRule::Key)],
        timer: Timer::Required,
    };

    fn subscriptions((): &()) -> Vec<Subscription> {
        let type_name = "sensor_msgs/msg/PointCloud2".to_owned();
        vec![Subscription { topic: "/camera/points".to_owned(), type_name, longest: 1000 }]
    }

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
        Ok(())
    }
}
