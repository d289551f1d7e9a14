//! The Rust side of `hop.py`: a source of clouds, and an operator that doubles them, as `Double` in `hop.py` does.

use stillpoint_operator::samples::{CloudShape, Point, PointCloud, Sample};
use stillpoint_operator::*;

const POINTS: usize = 100_000;

#[derive(Clone, Params)]
struct NoParams {}

/// Sends the same cloud at each tick.
struct Source {
    points: Vec<Point>,
}

impl Operator for Source {
    type Params = NoParams;
    const KIND: Kind = Kind {
        name: "hop.source",
        about: "Clouds of 1.2 MB.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output { name: "cloud", sample: PointCloud::KIND, frame: FrameRule::Key, about: "The cloud." }],
        timer: Timer::Required,
    };

    fn new(_: NoParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let point = |i| Point { xyz: [i as f32, 2.0 * i as f32, -(i as f32)] };
        Ok(Self { points: (0..POINTS).map(point).collect() })
    }

    fn capacities(_: &NoParams) -> Vec<usize> {
        vec![POINTS]
    }

    fn step(&mut self, _: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let shape = CloudShape { width: POINTS as u32, height: 1, reserved: 0, length: POINTS as u32 };
        outputs.send_slice::<PointCloud>(0, &shape, &self.points)
    }
}

/// Doubles a cloud into the memory of the sample that it sends.
struct Double;

impl Operator for Double {
    type Params = NoParams;
    const KIND: Kind = Kind {
        name: "hop.double",
        about: "Twice the coordinates.",
        role: Role::Operator,
        inputs: &[Input {
            name: "cloud",
            sample: PointCloud::KIND,
            policy: Policy::Queue(4),
            required: true,
            about: "A cloud.",
        }],
        outputs: &[Output {
            name: "twice",
            sample: PointCloud::KIND,
            frame: FrameRule::SameAs("cloud"),
            about: "The cloud, doubled.",
        }],
        timer: Timer::No,
    };

    fn new(_: NoParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn capacities(_: &NoParams) -> Vec<usize> {
        vec![POINTS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(cloud) = activation.input::<PointCloud>(0) else { return Ok(()) };
        let count = cloud.elements.len();
        let mut sample = outputs.open::<PointCloud>(0, count)?;
        *sample.body() = *cloud.body;
        for (to, from) in sample.elements().iter_mut().zip(cloud.elements) {
            to.xyz = from.xyz.map(|coordinate| 2.0 * coordinate);
        }
        sample.finish(count)
    }
}

const STAGES: &[Stage] = &[Stage::of::<Source>(), Stage::of::<Double>()];

fn main() -> std::process::ExitCode {
    program::main(STAGES)
}
