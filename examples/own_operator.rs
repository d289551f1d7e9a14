//! An operator from nothing: how fast a position moves.

use stillpoint_operator::*;
use stillpoint_samples::{Diagnostics, Metric, Pose, Sample};

/// What the config may say. Defaults, units, ranges, editor help and the reference page come from here.
#[derive(Clone, Params)]
struct SpeedParams {
    /// Speeds below this are sent as zero.
    #[param(unit = "m/s", default = "1 mm/s", min = "0 mm/s")]
    threshold: f64,
}

/// What one activation leaves to the next: acquisition time, ns, and position, m, of the last sample.
struct Speed {
    threshold: f64,
    last: Option<(u64, [f64; 3])>,
}

const POSITION: Input = Input {
    name: "position",
    sample: Pose::KIND,
    policy: Policy::Queue(4),
    required: true,
    about: "Where it is.",
};
const SPEED: Output =
    Output { name: "speed", sample: Diagnostics::KIND, frame: FrameRule::None, about: "Speed in m/s." };

impl Operator for Speed {
    type Params = SpeedParams;
    const KIND: Kind = Kind {
        name: "my.speed",
        about: "How fast a position moves.",
        role: Role::Operator,
        inputs: &[POSITION],
        outputs: &[SPEED],
        timer: Timer::No,
    };

    fn new(params: SpeedParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { threshold: params.threshold, last: None })
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(sample) = activation.input::<Pose>(0) else { return Ok(()) };
        let Some(at) = sample.first().map(|pose| pose.position) else { return Ok(()) };
        let Some((before, from)) = self.last.replace((sample.header.origin, at)) else { return Ok(()) };
        let moved: f64 = at.iter().zip(from).map(|(to, from)| (to - from) * (to - from)).sum();
        let speed = moved.sqrt() / (sample.header.origin.saturating_sub(before).max(1) as f64 * 1e-9);
        let sent = if speed < self.threshold { 0.0 } else { speed };
        outputs.send_slice::<Diagnostics>(0, &(), &[Metric::new("speed_m_s", sent)])
    }
}

/// The list of this family: one line per kind.
pub const MY_STAGES: &[Stage] = &[Stage::of::<Speed>()];
