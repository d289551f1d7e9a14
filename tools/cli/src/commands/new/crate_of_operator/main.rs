//! An operator in a program of its own: a pipeline names it with `use: { program: target/release/NAME, kind: my.KIND }`.
//!
//! Change it, then: `cargo test`, `cargo build --release`, `stillpoint check`, `stillpoint run`.

use stillpoint_operator::samples::{Pose, Sample};
use stillpoint_operator::*;

/// What the pipeline file may say. Defaults, units, ranges and messages of `stillpoint check` come from here.
#[derive(Clone, Params)]
struct SmoothParams {
    /// Weight of a new position against the positions before it.
    #[param(default = 0.2, min = 0.0, max = 1.0)]
    weight: f64,
}

/// What one activation leaves to the next: the smoothed position, m.
struct Smooth {
    weight: f64,
    position: Option<[f64; 3]>,
}

impl Operator for Smooth {
    type Params = SmoothParams;
    const KIND: Kind = Kind {
        name: "my.KIND",
        about: "Smooths the position of a pose.",
        role: Role::Operator,
        inputs: &[Input {
            name: "pose",
            sample: Pose::KIND,
            policy: Policy::Queue(4),
            required: true,
            about: "The pose.",
        }],
        outputs: &[Output {
            name: "pose",
            sample: Pose::KIND,
            frame: FrameRule::SameAs("pose"),
            about: "The pose with the smoothed position.",
        }],
        timer: Timer::No,
    };

    fn new(params: SmoothParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { weight: params.weight, position: None })
    }

    /// One activation. The outputs depend on nothing but the parameters, the state and the activation: so it replays.
    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let sample = activation.input::<Pose>(0);
        let Some(mut pose) = sample.as_ref().and_then(|sample| sample.first()).copied() else {
            return Ok(());
        };
        let before = self.position.unwrap_or(pose.position);
        for (new, old) in pose.position.iter_mut().zip(before) {
            *new = old + self.weight * (*new - old);
        }
        self.position = Some(pose.position);
        outputs.send::<Pose>(0, &pose)
    }
}

/// The kinds of this program: one line each.
const STAGES: &[Stage] = &[Stage::of::<Smooth>()];

fn main() -> std::process::ExitCode {
    program::main(STAGES)
}

#[cfg(test)]
mod tests {
    use super::Smooth;
    use stillpoint_operator::bench::Bench;
    use stillpoint_operator::samples::{Pose, PoseElement};

    /// A pose at this height, m.
    fn at(z: f64) -> PoseElement {
        PoseElement { position: [0.0, 0.0, z], orientation: [1.0, 0.0, 0.0, 0.0], covariance: [0.0; 36] }
    }

    #[test]
    fn a_step_of_the_position_is_smoothed_and_a_restart_forgets() {
        let mut bench = Bench::new::<Smooth>("weight: 0.5").unwrap();
        let mut height = |z| {
            let left = bench.feed::<Pose>(0, &(), &[at(z)]);
            left.sent::<Pose>(0)[0].first().unwrap().position[2]
        };
        assert_eq!([height(0.0), height(1.0), height(1.0)], [0.0, 0.5, 0.75]);
        bench.restart().unwrap();
        let left = bench.feed::<Pose>(0, &(), &[at(2.0)]);
        assert_eq!(left.sent::<Pose>(0)[0].first().unwrap().position[2], 2.0);
    }

    #[test]
    fn a_weight_above_one_is_refused() {
        let refused = Bench::new::<Smooth>("weight: 2").err().unwrap().to_string();
        assert!(refused.contains("the nearest allowed value is `1.0`"), "{refused}");
    }
}
