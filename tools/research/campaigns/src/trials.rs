//! The trials of each set of gains in a search. A trial is a run of the default pipeline without its camera, with a
//! disturbance or a fault.

use super::course::{Course, RunSpec, from_model, worst};
use super::laws::{self, Law};
use super::robust::{self, LEAD};
use super::step::{self, MOVES, WITHIN};
use stillpoint::EMBEDDED;

/// A reference model, and the times at which a run with it is judged: session time, s.
#[derive(Clone, Copy)]
struct Pace {
    /// Rise time of the reference model from 10 % to 90 %, s.
    rise: f64,
    /// Time after the step from which the head must be at the target, s.
    from: f64,
    /// Length of the run after the step, s.
    seconds: f64,
}

const FAST: Pace = Pace { rise: 5.0, from: robust::FROM, seconds: 30.0 };
const SLOW: Pace = Pace { rise: 20.0, from: step::FROM, seconds: 55.0 };
/// Cost of a valve that is fully open all the time, in units of the tolerance.
const EFFORT: f64 = 0.1;
/// Cost of a head that is not held at the target, per tolerance of error: more than the cost of any head that is held.
const LOST: f64 = 100.0;
/// Replacement of camera and tracker: the true pose of the tracked point every 100 ms, with the noise that was measured
/// of the tracker.
const NOISE: &str = "  head:
    use: bench.noise
    inputs: { pose: rig.truth }
    params:
      point: [2 mm, -70 mm, 46 mm]
      position: [0.008 mm, 0.004 mm, 0.004 mm]
      angles: [0.002 deg, 0.008 deg, 0.006 deg]
      keep: 20
      reported: true

";

/// Replacements in the pipeline's text: old text and new text.
type Changes = &'static [(&'static str, &'static str)];

/// A disturbance or a fault of a run.
pub struct Trial {
    /// Name in the printed table.
    pub name: &'static str,
    pace: Pace,
    changes: Changes,
    sets: &'static [&'static str],
}

/// Delay of the poses: the latency of perception with images.
const SEEING: (&str, &str) = ("from: head.pose,", "from: head.pose, delay: 18 ms,");
const LATE: Changes = &[("delay: 18 ms", "delay: 118 ms")];
const MEASURED: Changes = &[(
    "      disarm: console.disarm\n",
    "      disarm: console.disarm\n      measured: { from: rig.state, delay: 5 ms }\n",
)];

/// White noise on each pose, 0.5 % of the step. The covariance of the pose does not contain it.
const NOISY: Changes = &[
    (
        "operators:\n",
        "operators:\n  noise: { use: bench.noise, inputs: { pose: head.pose }, params: { \
         position: [0.058 mm, 0.058 mm, 0.058 mm], angles: [0.0068 deg, 0.05 deg, 0 deg] } }\n",
    ),
    ("from: head.pose", "from: noise.pose"),
];

/// Names of the disturbances and faults, with the pace of their runs and their changes of the pipeline.
const KINDS: [(&str, Pace, Changes); COUNT] = [
    ("push", SLOW, &[]),
    ("lost", FAST, &[]),
    ("late", FAST, LATE),
    ("heavy", SLOW, &[]),
    ("noise", FAST, NOISY),
    // Without measured pressures, a stuck valve and a leak end the run as a fault.
    ("stuck", FAST, MEASURED),
    ("leak", FAST, MEASURED),
];

pub const COUNT: usize = 7;

/// The trials of the search.
pub const TRAINING: [Trial; COUNT] = trials([
    &[
        "rig.head_mass=4 kg",
        "rig.pushes=[{ at: 12 s, shift: [0 mm, 0 mm, 1.2 mm], turn: [-0.6 deg, 0.9 deg, 0 deg] }]",
    ],
    &["head.lost=0.1"],
    &[],
    &["rig.head_mass=5.5 kg", "rig.faults=[{ kind: weak_supply, left: 0.85, at: 4700 ms }]"],
    &[],
    &["rig.faults=[{ kind: stuck_valve, which: 0, at: 4700 ms }]"],
    &["rig.faults=[{ kind: leak, which: 1, diameter: 0.3 mm, at: 4700 ms }]"],
]);

/// Held-out trials of the same kinds with other values, for the gains that the search has found.
pub const HELD_OUT: [Trial; COUNT] = trials([
    &[
        "rig.head_mass=3 kg",
        "rig.pushes=[{ at: 12 s, shift: [0 mm, 0 mm, -1 mm], turn: [0.6 deg, -0.6 deg, 0 deg] }]",
    ],
    &["head.lost=0.1"],
    &[],
    &["rig.head_mass=6 kg", "rig.faults=[{ kind: weak_supply, left: 0.8, at: 5900 ms }]"],
    &[],
    &["rig.faults=[{ kind: stuck_valve, which: 2, at: 5900 ms }]"],
    &["rig.faults=[{ kind: leak, which: 2, diameter: 0.3 mm, at: 5900 ms }]"],
]);

/// Makes the trials. `sets` holds the parameters of each trial.
const fn trials(sets: [&'static [&'static str]; COUNT]) -> [Trial; COUNT] {
    const NONE: Trial = Trial { name: "", pace: FAST, changes: &[], sets: &[] };
    let mut trials = [NONE; COUNT];
    let mut i = 0;
    while i < COUNT {
        let (name, pace, changes) = KINDS[i];
        trials[i] = Trial { name, pace, changes, sets: sets[i] };
        i += 1;
    }
    trials
}

impl Trial {
    /// The plan of this trial with a law, a seed, and gains as `operator.param=value`.
    pub fn plan(&self, law: Law, seed: u64, gains: &[String]) -> RunSpec {
        let mut plan = without_camera(laws::plan(Some(law), &format!("{} s", self.pace.rise), seed));
        plan.changes.extend(self.changes.iter().map(|(from, to)| ((*from).to_owned(), (*to).to_owned())));
        let sets = [MOVES].into_iter().chain(self.sets.iter().copied());
        plan.sets.extend(sets.map(str::to_owned).chain(gains.iter().cloned()));
        RunSpec { seconds: LEAD + self.pace.seconds, ..plan }
    }

    /// Cost of a run of this trial.
    pub fn cost(&self, course: &Course) -> f64 {
        cost(course, &self.pace)
    }
}

/// A plan of the default pipeline whose poses are the truth at the point that the tracker follows, every 100 ms, with the
/// noise and the latency of the tracker.
pub fn without_camera(mut plan: RunSpec) -> RunSpec {
    // The run fails with an error if the pipeline lacks these texts.
    let between = |from: &str, to: &str| {
        let (from, to) = (EMBEDDED.find(from)?, EMBEDDED.find(to)?);
        EMBEDDED.get(from..to).map(str::to_owned)
    };
    let camera = between("  cloud:", "  filter:").unwrap_or_default();
    let changes = [
        (camera.as_str(), NOISE),
        ("      reference: head.report\n", ""),
        ("[cloud, face, head, filter]", "[head, filter]"),
        (", repeat: 3 s }, { at: 1 s, say: confirm, repeat: 500 ms }", " }"),
        (", report: { from: head.report, delay: 20 ms }", ""),
        ("head.report, ", ""),
        (", report: head.report", ""),
        SEEING,
    ];
    plan.changes.extend(changes.map(|(from, to)| (from.to_owned(), to.to_owned())));
    plan.sets.retain(|set| !set.contains(".latency="));
    let sets = ["rig.camera.width=16 px", "rig.camera.height=16 px", "rig.camera.focal_length=14 px"];
    let sets = sets.iter().chain(&["valves.reference=waived", "gate.tracker=waived"]);
    plan.sets.extend(sets.map(|s| (*s).to_owned()));
    plan
}

/// Root mean square of truth minus reference model, in units of the tolerance, plus a small cost of open valves. A head
/// that exceeds the tolerance after the rise costs more than any head that does not. A failed run costs infinity.
fn cost(course: &Course, pace: &Pace) -> f64 {
    let Some(at) = course.step_at().filter(|_| course.failed.is_empty()) else { return f64::INFINITY };
    let worst = worst(course.since(at + pace.from));
    let astray = (0..3).map(|i| worst[i] / WITHIN[i]).fold(0.0, |a: f64, b| if b <= a { a } else { b });
    if astray.is_nan() || astray > 1.0 {
        return LOST * astray;
    }
    let points = course.since(at);
    let squares: f64 = points
        .iter()
        .map(|p| (0..3).map(|i| (from_model(p, i, at, pace.rise) / WITHIN[i]).powi(2)).sum::<f64>())
        .sum();
    (squares / (3 * points.len()) as f64).sqrt() + EFFORT * course.effort / (LEAD + pace.seconds)
}

/// Whether a cost is that of a run in which the head was held.
pub fn held(cost: f64) -> bool {
    cost < LOST
}

#[cfg(test)]
mod tests {
    use super::super::course::{Point, STEP};
    use super::*;
    use stillpoint::jobs;

    /// Costs of a law with these gains in the trials of these names.
    fn costs(law: Law, gains: &[&str], names: &[&str]) -> Vec<f64> {
        let registry = crate::registry();
        let name = laws::in_pipeline().0;
        let gains: Vec<String> = gains.iter().map(|gain| format!("{name}.{gain}")).collect();
        let trials = names.iter().map(|name| TRAINING.iter().find(|t| t.name == *name).unwrap());
        let run = |t: &&Trial| Ok(t.cost(&Course::of(&t.plan(law, 1, &gains), &registry)?));
        jobs::each(&trials.collect::<Vec<_>>(), 2, run).unwrap()
    }

    #[test]
    fn gains_that_swing_where_poses_come_late_are_no_good_however_near_they_hold_else() {
        let gains = ["proportional=12 1/s", "integral=20"];
        let costs = costs(Law::Pi, &gains, &["lost", "late", "lost"]);
        assert!(costs[0] < 1.0 && held(costs[0]) && !held(costs[1]), "{costs:?}");
        assert_eq!(costs[0], costs[2], "the same once more, to the last bit");
    }

    #[test]
    fn the_gains_of_pi_and_of_the_adaptive_law_hold_fast_and_slow_models() {
        let pi = ["proportional=2.37 1/s", "integral=2.55"];
        for (law, gains) in [(Law::Pi, &pi[..]), (Law::Mrac, &[])] {
            let costs = costs(law, gains, &["stuck", "push", "heavy"]);
            assert!(costs.iter().all(|cost| held(*cost)), "{law:?}: {costs:?}");
        }
    }

    #[test]
    fn a_head_that_is_not_held_costs_more_than_any_that_is() {
        let course = |off: f64, late: f64| {
            let points = (0..1700).map(|k| {
                let time = 0.02 * f64::from(k);
                let target = if time < 3.0 { [0.0; 3] } else { STEP };
                let off = if time < 3.0 + robust::FROM { off } else { late };
                Point { time, moved: target.map(|t| t + off), target, beam: true, ..Point::default() }
            });
            Course { points: points.collect(), ..Course::default() }
        };
        let cost = |course: &Course| cost(course, &FAST);
        assert!(cost(&course(5.0, 0.19)) < LOST && cost(&course(0.1, 0.21)) > LOST);
        assert!(cost(&course(1.0, 0.1)) > cost(&course(0.5, 0.1)));
        assert!(!held(cost(&course(0.0, f64::NAN))) && !held(cost(&Course::default())));
        let failed = Course { failed: vec!["law".to_owned()], ..course(0.1, 0.1) };
        assert_eq!(cost(&failed), f64::INFINITY);
    }
}
