//! Operators for loads: samples of any size, and a consumer that only counts them.

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_samples::{CloudShape, PointCloud, Sample};

/// Parameters of [`Bulk`].
#[derive(Clone, Params)]
pub struct BulkParams {
    /// Points of each sample.
    #[param(default = 100000, min = 1, max = 1000000)]
    pub points: usize,
}

/// Sends a cloud at each tick.
pub struct Bulk(BulkParams);

impl Operator for Bulk {
    type Params = BulkParams;
    const KIND: Kind = Kind {
        name: "kit.bulk",
        about: "Sends a cloud at each tick.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[Output {
            name: "cloud",
            sample: PointCloud::KIND,
            frame: FrameRule::None,
            about: "A cloud.",
        }],
        timer: Timer::Required,
    };

    fn new(params: BulkParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self(params))
    }

    fn capacities(params: &BulkParams) -> Vec<usize> {
        vec![params.points]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let count = self.0.points;
        let mut writer = outputs.open::<PointCloud>(0, count)?;
        *writer.body() = CloudShape { width: count as u32, height: 1, ..CloudShape::default() };
        for (i, point) in writer.elements().iter_mut().enumerate() {
            point.xyz = [i as f32, activation.index as f32, 1.0];
        }
        writer.finish(count)
    }
}

/// Takes clouds and sends nothing.
pub struct Drain;

impl Operator for Drain {
    type Params = ();
    const KIND: Kind = Kind {
        name: "kit.drain",
        about: "Takes clouds and sends nothing.",
        role: Role::Operator,
        inputs: &[Input {
            name: "cloud",
            sample: PointCloud::KIND,
            policy: Policy::Queue(2),
            required: true,
            about: "Clouds.",
        }],
        outputs: &[],
        timer: Timer::No,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
        Ok(())
    }
}
