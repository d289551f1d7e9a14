//! Operators for `bench replay`: a source of point clouds, and an operator whose output depends on the order of its
//! samples, on losses and on random numbers.

use rand::Rng;
use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup, Stage};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{CloudShape, Point, PointCloud, Sample};

/// Kinds of this file.
pub const STAGES: &[Stage] = &[Stage::of::<Cloud>(), Stage::of::<Shift>()];

const CLOUD: Output =
    Output { name: "cloud", sample: PointCloud::KIND, frame: FrameRule::None, about: "The points." };

const fn input(name: &'static str, policy: Policy, required: bool) -> Input {
    Input { name, sample: PointCloud::KIND, policy, required, about: "Points." }
}

/// Parameters of [`Cloud`] and [`Shift`].
#[derive(Clone, Params)]
pub struct CloudParams {
    /// Maximum number of points in a sample.
    #[param(default = 16, min = 1, max = 1000000)]
    points: usize,
}

/// Sends clouds. The z of their first point is a function of the time of the activation.
pub struct Cloud(Vec<Point>);

impl Operator for Cloud {
    type Params = CloudParams;
    const KIND: Kind = Kind {
        name: "bench.cloud",
        about: "Sends clouds.",
        role: Role::Source,
        inputs: &[],
        outputs: &[CLOUD],
        timer: Timer::Required,
    };

    fn new(params: CloudParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let point = |i: usize| Point { xyz: [(i % 320) as f32 * 0.001, (i / 320) as f32 * 0.001, 0.5] };
        Ok(Self((0..params.points).map(point).collect()))
    }

    fn capacities(params: &CloudParams) -> Vec<usize> {
        vec![params.points]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if let Some(first) = self.0.first_mut() {
            first.xyz[2] = (activation.time % 1_000_000_007) as f32;
        }
        outputs.send_slice::<PointCloud>(0, &shape(self.0.len()), &self.0)
    }
}

/// Shifts clouds along x. The shift depends on earlier activations, the other input, random numbers and missed samples.
pub struct Shift {
    moved: f32,
}

impl Operator for Shift {
    type Params = CloudParams;
    const KIND: Kind = Kind {
        name: "bench.shift",
        about: "Moves clouds.",
        role: Role::Operator,
        inputs: &[input("cloud", Policy::Queue(2), true), input("other", Policy::Latest, false)],
        outputs: &[CLOUD],
        timer: Timer::No,
    };

    fn new(_: CloudParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { moved: 0.0 })
    }

    fn capacities(params: &CloudParams) -> Vec<usize> {
        vec![params.points]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(view) = activation.input::<PointCloud>(0) else { return Ok(()) };
        let other = activation.input::<PointCloud>(1).and_then(|v| v.first()).map_or(0.0, |p| p.xyz[2]);
        let chance = (activation.random().next_u32() >> 8) as f32 * 1e-9;
        self.moved = self.moved * 0.5 + chance + other * 1e-9 + activation.missed(0) as f32;
        let mut writer = outputs.open::<PointCloud>(0, view.elements.len())?;
        *writer.body() = shape(view.elements.len());
        for (to, from) in writer.elements().iter_mut().zip(view.elements) {
            to.xyz = [from.xyz[0] + self.moved, from.xyz[1], from.xyz[2]];
        }
        writer.finish(view.elements.len())
    }
}

fn shape(points: usize) -> CloudShape {
    CloudShape { width: points as u32, height: 1, ..CloudShape::default() }
}
