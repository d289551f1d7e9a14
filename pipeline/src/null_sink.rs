//! `sink.null`: takes samples of the common types and only counts them. It ends a chain for measurements and trials.

use stillpoint_operator::{Activation, Operator, Outputs, Setup, Stage};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{
    ConsoleCommand, DepthImage, Diagnostics, Health, Metric, PointCloud, Pose, Sample, SampleKind, Track,
};

/// Entry of `sink.null` in the list of kinds.
pub const STAGE: Stage = Stage::of::<SinkNull>();

const COUNTS: usize = 0;
const INPUTS: usize = 7;
const NAMES: [&str; INPUTS] = ["cloud", "image", "pose", "track", "diagnostics", "command", "health"];

const fn takes(port: usize, sample: &'static SampleKind, queue: u32) -> Input {
    let about = "Samples to count.";
    Input { name: NAMES[port], sample, policy: Policy::Queue(queue), required: false, about }
}

/// Counts samples by input; a sample that was missed is not counted.
pub struct SinkNull {
    taken: [u64; INPUTS],
}

impl Operator for SinkNull {
    type Params = ();
    const KIND: Kind = Kind {
        name: "sink.null",
        about: "Counts clouds, images, poses, tracks, diagnostics, commands and health, and does nothing else.",
        role: Role::Operator,
        inputs: &[
            takes(0, PointCloud::KIND, 1),
            takes(1, DepthImage::KIND, 1),
            takes(2, Pose::KIND, 4),
            takes(3, Track::KIND, 4),
            takes(4, Diagnostics::KIND, 4),
            takes(5, ConsoleCommand::KIND, 16),
            takes(6, Health::KIND, 4),
        ],
        outputs: &[Output {
            name: "counts",
            sample: Diagnostics::KIND,
            frame: FrameRule::None,
            about: "Samples taken so far, by input.",
        }],
        timer: Timer::No,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { taken: [0; INPUTS] })
    }

    fn capacities((): &()) -> Vec<usize> {
        vec![INPUTS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        for (taken, brought) in self.taken.iter_mut().zip(activation.inputs) {
            *taken += u64::from(brought.sample.is_some_and(|s| !s.held));
        }
        let metrics: [Metric; INPUTS] = std::array::from_fn(|i| Metric::new(NAMES[i], self.taken[i] as f64));
        outputs.send_slice::<Diagnostics>(COUNTS, &(), &metrics)
    }
}
