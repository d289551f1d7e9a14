//! Kinds without effect, one per type of sample: they stand upstream of an operator on a bench, which feeds it by hand.

use stillpoint_operator::{Activation, Operator, Outputs, Setup};
use stillpoint_operator::{FrameRule, Kind, Output, Role, SetupError, Stage, StepError, Timer};
use stillpoint_samples::{DepthImage, PointCloud, Pose, PoseReport, Rejection, Sample, Track};

macro_rules! feed {
    ($name:ident, $kind:literal, $sample:ty, $about:literal) => {
        feed!($name, $kind, $sample, $about, FrameRule::Key);
    };
    ($name:ident, $kind:literal, $sample:ty, $about:literal, $frame:expr) => {
        #[doc = $about]
        pub struct $name;

        impl Operator for $name {
            type Params = ();
            const KIND: Kind = Kind {
                name: $kind,
                about: $about,
                role: Role::Source,
                inputs: &[],
                outputs: &[Output {
                    name: "out",
                    sample: <$sample>::KIND,
                    frame: $frame,
                    about: "What the bench feeds.",
                }],
                timer: Timer::Optional,
            };

            fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
                Ok(Self)
            }

            fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
                Ok(())
            }
        }
    };
}

feed!(FeedImage, "feed.image", DepthImage, "Depth images that a bench feeds.");
feed!(FeedCloud, "feed.cloud", PointCloud, "Clouds that a bench feeds.");
feed!(FeedPose, "feed.pose", Pose, "Poses that a bench feeds.");
feed!(FeedReport, "feed.report", PoseReport, "Reports of poses that a bench feeds.", FrameRule::None);
feed!(FeedTrack, "feed.track", Track, "Tracks that a bench feeds.");
feed!(FeedRejection, "feed.rejection", Rejection, "Rejections that a bench feeds.", FrameRule::None);

/// The kinds of this file.
pub const STAGES: &[Stage] = &[
    Stage::of::<FeedImage>(),
    Stage::of::<FeedCloud>(),
    Stage::of::<FeedPose>(),
    Stage::of::<FeedReport>(),
    Stage::of::<FeedTrack>(),
    Stage::of::<FeedRejection>(),
];
