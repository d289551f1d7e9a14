//! `stillpoint bench tune`: the laws after the same search, with the same number of runs, on disturbances that none has seen.

use clap::Args;
use serde::Serialize;
use stillpoint_pipeline::operator::Registry;

use super::course::{Course, Plan, from_model};
use super::crew;
use super::laws::Law;
use super::search::{ROUND, search};
use super::step::WITHIN;
use crate::exit::{Ended, Exit, Failure, print_json};

/// A loop without images: what the tracker was seen to be off by, on the truth. A pose is as late as what lies between a
/// frame and the valves makes it: seeing, datagrams, and duties that grow no faster than they may.
const PIPELINE: &str = "
stillpoint: 1
name: law-alone
frames:
  camera: { parent: couch, at: [0 mm, -480 mm, 590 mm], rotation: [-135 deg, 0 deg, 0 deg] }
operators:
  rig:
    use: rig.three_bladders
    every: 10 ms
    frame: camera
    inputs: { duties: { from: law.duties, delay: 4 ms } }
    params: { camera: { every: 10 s, width: 16 px, height: 16 px, focal_length: 14 px } }
  head:
    use: bench.noise
    inputs: { pose: rig.truth }
    params: { position: [0.02 mm, 0.05 mm, 0.01 mm], angles: [0.025 deg, 0.01 deg, 0.006 deg], keep: 10, told: true }
  filter: { use: estimate.kalman, inputs: { measurement: { from: head.pose, delay: 40 ms } }, params: { follow: pose } }
  target:
    use: control.target
    every: 100 ms
    inputs: { state: filter.state }
    params: { moves: [{ at: 2 s, z: 11.5 mm, pitch: 1.35 deg, roll: 10 deg }] }
  law: { use: LAW, every: 20 ms, inputs: { state: filter.state, target: target.reference }, params: { rise: 5 s } }
";
/// Rise of the reference model in it, s.
const RISE: f64 = 5.0;
/// Session time of a run, s.
const SECONDS: f64 = 30.0;
/// When something happens to the head, s: it has come to its place.
const STRUCK: &str = "15 s";
/// How a pose comes 100 ms later.
const LATE: [&str; 2] = ["delay: 40 ms", "delay: 140 ms"];
/// What a valve that is open all the time costs, in what is allowed to be off.
const EFFORT: f64 = 0.1;
/// Seeds of the held-out runs begin here.
const HELD_OUT: u64 = 1000;

/// Tune PI, LQI and MRAC with the same search and the same number of runs, and compare them on seeds, masses and
/// disturbances that the search has not seen. A run costs the root mean square of the truth less the reference model, in
/// parts of 0.5 mm, 0.2 degrees and 0.2 degrees, and a little for open valves.
#[derive(Args)]
pub struct Tune {
    /// Rounds of the search, of 8 places each.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// Held-out seeds, four runs each.
    #[arg(long, default_value_t = 4)]
    held_out: u64,
    /// Seed of the search.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One law alone.
    #[arg(long, value_enum)]
    law: Option<Law>,
    /// Runs at a time.
    #[arg(long)]
    threads: Option<usize>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// A parameter that is searched on a logarithmic scale.
struct Dial {
    name: &'static str,
    unit: &'static str,
    least: f64,
    most: f64,
    /// Where the search begins.
    start: f64,
}

const fn dial(name: &'static str, unit: &'static str, least: f64, most: f64, start: f64) -> Dial {
    Dial { name, unit, least, most, start }
}

/// What is searched: all gains of a law that are not given by the plant or the reference model.
fn dials(law: Law) -> &'static [Dial] {
    const PI: &[Dial] =
        &[dial("proportional", " 1/s", 0.1, 10.0, 1.0), dial("integral", "", 0.01, 10.0, 0.15)];
    const LQG: &[Dial] = &[
        dial("integral_weight", "", 1e-3, 100.0, 0.1),
        dial("effort_weight", "", 1e-2, 1e3, 10.0),
        dial("drift", "", 1e-3, 100.0, 1.0),
    ];
    const MRAC: &[Dial] = &[
        dial("feedback", "", 0.3, 30.0, 3.0),
        dial("learning_pose", "", 1e-6, 1.0, 1e-4),
        dial("learning_target", "", 1e-6, 1.0, 1e-4),
        dial("learning_features", "", 1e-6, 1.0, 1e-4),
        dial("leak", " 1/s", 1e-4, 1.0, 0.02),
    ];
    match law {
        Law::Pi => PI,
        Law::Lqg => LQG,
        Law::Mrac => MRAC,
    }
}

impl Dial {
    fn place(&self, value: f64) -> f64 {
        (value / self.least).ln() / (self.most / self.least).ln()
    }

    /// The value at a place, with three digits: what is printed is what was tried.
    fn value(&self, place: f64) -> f64 {
        let value = self.least * (self.most / self.least).powf(place);
        let digits = 10f64.powi(2 - value.log10().floor() as i32);
        (value * digits).round() / digits
    }
}

/// What happens in a run, one of four.
fn conditions(seed: u64, held_out: bool) -> [Plan; 4] {
    let set = |sets: &[&str]| {
        let both = [format!("seed={seed}"), format!("rig.seed={seed}")];
        let sets = both.into_iter().chain(sets.iter().map(|s| (*s).to_owned())).collect();
        Plan { sets, seconds: SECONDS, ..Plan::of(PIPELINE.to_owned()) }
    };
    let late = |plan: Plan| Plan { changes: vec![LATE.map(str::to_owned).into()], ..plan };
    let (light, heavy) = if held_out { ("3 kg", "6 kg") } else { ("4 kg", "5.5 kg") };
    let bladder = if held_out { 2 } else { 1 };
    let push = if held_out {
        "[0 mm, 0 mm, -3 mm], turn: [2 deg, -2 deg, 0 deg]"
    } else {
        "[0 mm, 0 mm, 4 mm], turn: [-2 deg, 3 deg, 0 deg]"
    };
    [
        set(&["rig.motion=nods", "head.lost=0.1"]),
        set(&[
            "rig.motion=breathes",
            &format!("rig.head_mass={light}"),
            &format!("rig.pushes=[{{ at: {STRUCK}, shift: {push} }}]"),
        ]),
        set(&[
            "rig.motion=breathes",
            &format!("rig.faults=[{{ kind: leak, which: {bladder}, diameter: 0.3 mm, at: {STRUCK} }}]"),
        ]),
        late(set(&["rig.motion=nods", &format!("rig.head_mass={heavy}")])),
    ]
}

#[derive(Serialize)]
struct Row {
    law: Law,
    /// Parameters as `--set` takes them.
    found: Vec<String>,
    /// Cost in training, before and after.
    started: f64,
    trained: f64,
    /// Cost on what was held out, before and after.
    held_out_before: f64,
    held_out: f64,
    /// The same by what happens: nothing, a push, a leak, a late pose.
    by_condition: [f64; 4],
    runs: usize,
}

impl Tune {
    /// Does it.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let laws = self.law.map_or_else(|| Law::ALL.to_vec(), |law| vec![law]);
        let rows = laws.iter().map(|law| self.tuned(*law, registry)).collect::<Result<Vec<_>, _>>()?;
        if self.json {
            print_json(&rows)?
        } else {
            print(&rows)
        }
        Ok(Exit::Done)
    }

    fn tuned(&self, law: Law, registry: &Registry) -> Result<Row, Failure> {
        let dials = dials(law);
        let start: Vec<f64> = dials.iter().map(|d| d.place(d.start)).collect();
        let mut runs = 0;
        let mut cost = |places: &[Vec<f64>], seeds: &[u64], held_out: bool| {
            let one = |place: &Vec<f64>| {
                let sets = sets(law, place);
                let all = seeds.iter().flat_map(|seed| conditions(*seed, held_out));
                all.map(|mut plan| {
                    plan.sets.extend(sets.iter().cloned());
                    plan.changes.push(("LAW".to_owned(), law.kind().to_owned()));
                    plan
                })
                .collect::<Vec<_>>()
            };
            let jobs: Vec<Plan> = places.iter().flat_map(one).collect();
            runs += jobs.len();
            crew::each(&jobs, crew::threads(self.threads), |plan| run(plan, registry))
        };
        let train = |costs: &[f64]| costs.chunks(4).map(mean).collect::<Vec<_>>();
        let mut started = f64::NAN;
        let (best, trained) = search(&start, self.rounds.max(1), self.seed, |places| {
            let costs = train(&cost(places, &[self.seed], false)?);
            if started.is_nan() {
                started = costs[0];
            }
            Ok::<_, Failure>(costs)
        })?;
        let seeds: Vec<u64> = (0..self.held_out.max(1)).map(|i| HELD_OUT + i).collect();
        let before = cost(&[start], &seeds, true)?;
        let after = cost(std::slice::from_ref(&best), &seeds, true)?;
        let of = |condition: usize| after.iter().skip(condition).step_by(4).copied().collect::<Vec<_>>();
        Ok(Row {
            law,
            found: sets(law, &best),
            started,
            trained,
            held_out_before: mean(&before),
            held_out: mean(&after),
            by_condition: std::array::from_fn(|i| mean(&of(i))),
            runs: self.rounds.max(1) * ROUND * 4,
        })
    }
}

fn sets(law: Law, place: &[f64]) -> Vec<String> {
    let both = dials(law).iter().zip(place);
    both.map(|(dial, place)| format!("law.{}={}{}", dial.name, dial.value(*place), dial.unit)).collect()
}

/// What one run costs.
fn run(plan: &Plan, registry: &Registry) -> Result<f64, Failure> {
    let course = Course::of(plan, registry)?;
    let Some(at) = course.step_at() else { return Ok(f64::INFINITY) };
    let points = course.since(at);
    let squares: f64 = points
        .iter()
        .map(|p| (0..3).map(|i| (from_model(p, i, at, RISE) / WITHIN[i]).powi(2)).sum::<f64>())
        .sum();
    let off = (squares / (3 * points.len()) as f64).sqrt();
    let lost = if course.failed.is_empty() { 0.0 } else { f64::INFINITY };
    Ok(off + EFFORT * course.effort / SECONDS + lost)
}

fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

fn print(rows: &[Row]) {
    println!("root mean square of truth less reference model, in parts of 0.5 mm, 0.2 degrees, 0.2 degrees");
    println!(
        "{:<6} {:>6} {:>9} {:>9} {:>9} {:>9}   {:>8} {:>8} {:>8} {:>8}",
        "law", "runs", "start", "trained", "start", "held out", "nods", "push", "leak", "late"
    );
    for r in rows {
        let [nods, push, leak, late] = r.by_condition;
        println!(
            "{:<6} {:>6} {:>9.3} {:>9.3} {:>9.3} {:>9.3}   {nods:>8.3} {push:>8.3} {leak:>8.3} {late:>8.3}",
            format!("{:?}", r.law).to_lowercase(),
            r.runs,
            r.started,
            r.trained,
            r.held_out_before,
            r.held_out
        );
        println!("       {}", r.found.join("  "));
    }
    let best = rows.iter().min_by(|a, b| a.held_out.total_cmp(&b.held_out));
    if let (Some(best), true) = (best, rows.len() > 1) {
        println!("the best on what was held out: {:?}", best.law);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_law_with_gains_that_were_searched_for_costs_less_on_what_was_held_out() {
        let registry = crate::bench::registry(&[]);
        let costs = |sets: &[&str]| {
            let plan = |mut plan: Plan| {
                plan.sets.extend(sets.iter().map(|s| (*s).to_owned()));
                plan.changes.push(("LAW".to_owned(), Law::Pi.kind().to_owned()));
                plan
            };
            let plans = conditions(HELD_OUT, true).map(plan);
            mean(&crew::each(&plans, 2, |plan| run(plan, &registry)).unwrap())
        };
        let (before, after) = (costs(&[]), costs(&["law.proportional=7 1/s", "law.integral=1.6"]));
        assert!(after < 0.5 * before && after < 1.0, "{before} {after}");
        // The same once more, to the last bit.
        assert_eq!(costs(&[]), before);
    }

    #[test]
    fn a_dial_gives_back_where_it_begins() {
        for dial in Law::ALL.into_iter().flat_map(dials) {
            let (place, value) = (dial.place(dial.start), dial.value(dial.place(dial.start)));
            assert!((0.0..=1.0).contains(&place) && (value / dial.start - 1.0).abs() < 5e-3, "{}", dial.name);
        }
    }
}
