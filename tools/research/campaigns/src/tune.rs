//! `stillpoint-research tune`: tunes each law with the same search, and compares the laws on held-out disturbances.

use clap::Args;
use serde::Serialize;
use stillpoint_operator::Registry;

use super::course::{Course, RunSpec};
use super::laws::{self, Law};
use super::search::{ROUND, search};
use super::trials::{COUNT, HELD_OUT, TRAINING, Trial, held};
use stillpoint::jobs;
use stillpoint::{Ended, Exit, Failure, print_json};

/// First seed of the held-out runs.
const FIRST_HELD_OUT: u64 = 1000;
/// Laws that are tuned by default.
const SEARCHED: [Law; 3] = [Law::Pi, Law::Lqg, Law::Mrac];

/// Tune PI, LQI and MRAC with the same search and the same number of runs, and compare them on seeds, masses and faults
/// that the search has not seen. The cost of a set of gains is that of its worst run: the root mean square of truth
/// minus reference model, in units of 0.5 mm, 0.2 degrees and 0.2 degrees, plus a small cost of open valves. A run in
/// which the head exceeds these tolerances after the rise costs more than any run in which it does not. The model rises
/// in 5 s, and in 20 s in two of the seven runs.
#[derive(Args)]
pub struct Tune {
    /// Number of rounds of the search, with 8 sets of gains each.
    #[arg(long, default_value_t = 5, value_parser = super::at_least::<usize>(1))]
    rounds: usize,
    /// Number of held-out seeds, with seven runs each.
    #[arg(long, default_value_t = 4, value_parser = super::at_least::<u64>(1))]
    held_out: u64,
    /// Seed of the search.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Tune only this law.
    #[arg(long, value_enum)]
    law: Option<Law>,
    /// Number of runs at the same time.
    #[arg(long, value_parser = super::at_least::<usize>(1))]
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
    /// Value at which the search begins.
    start: f64,
}

const fn dial(name: &'static str, unit: &'static str, least: f64, most: f64, start: f64) -> Dial {
    Dial { name, unit, least, most, start }
}

/// The parameters of the search: all gains of a law that neither the plant nor the reference model determines.
fn dials(law: Law) -> &'static [Dial] {
    const PI: &[Dial] =
        &[dial("proportional", " 1/s", 0.1, 10.0, 1.0), dial("integral", "", 0.01, 10.0, 0.15)];
    const LQG: &[Dial] = &[
        dial("integral_weight", "", 1e-3, 100.0, 0.1),
        dial("effort_weight", "", 1e-2, 1e3, 10.0),
        dial("drift", "", 1e-3, 100.0, 1.0),
    ];
    const MRAC: &[Dial] = &[
        dial("feedback", " 1/s", 0.3, 10.0, 2.37),
        dial("learn_pose", "", 1e-4, 10.0, 1e-3),
        dial("learn_target", "", 1e-4, 10.0, 1e-3),
        dial("learn_features", "", 1e-2, 30.0, 1.0),
        dial("leak", " 1/s", 1e-4, 1.0, 5e-4),
    ];
    match law {
        Law::Pi => PI,
        Law::Lqg => LQG,
        Law::Mrac | Law::MracLstm => MRAC,
    }
}

impl Dial {
    fn place(&self, value: f64) -> f64 {
        (value / self.least).ln() / (self.most / self.least).ln()
    }

    /// Value at a place from 0 to 1, rounded to three digits, so that the printed value is the one that was tried.
    fn value(&self, place: f64) -> f64 {
        let value = self.least * (self.most / self.least).powf(place);
        let digits = 10f64.powi(2 - value.log10().floor() as i32);
        (value * digits).round() / digits
    }
}

#[derive(Serialize)]
struct Row {
    law: Law,
    /// Best parameters, in the form of the option `--set`.
    found: Vec<String>,
    /// Cost of the worst run of the search with the first parameters.
    started: f64,
    /// The same with the best parameters.
    trained: f64,
    /// Held-out runs with the first parameters.
    before: HeldOut,
    /// Held-out runs with the best parameters.
    after: HeldOut,
    /// Number of runs of the search.
    runs: usize,
}

#[derive(Serialize)]
struct HeldOut {
    /// Greatest cost of a run.
    worst: f64,
    /// Number of runs in which the head was held.
    held: usize,
    runs: usize,
    /// Greatest cost of the runs of each trial.
    by_trial: [f64; COUNT],
}

impl HeldOut {
    /// Summary of the costs of all trials of the first seed, then of the next seed, and so on.
    fn of(costs: &[f64]) -> Self {
        let of = |trial: usize| worst(costs.iter().skip(trial).step_by(COUNT));
        Self {
            worst: worst(costs),
            held: costs.iter().filter(|c| held(**c)).count(),
            runs: costs.len(),
            by_trial: std::array::from_fn(of),
        }
    }
}

impl Tune {
    /// Tunes the laws and prints the comparison.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let laws = self.law.map_or_else(|| SEARCHED.to_vec(), |law| vec![law]);
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
        let costs = |places: &[Vec<f64>], seeds: &[u64], trials: &[Trial; COUNT]| {
            let one = |place: &Vec<f64>| {
                let sets = sets(law, place);
                let all = seeds.iter().flat_map(|seed| trials.iter().map(move |t| (*seed, t)));
                all.map(|(seed, trial)| (trial, trial.plan(law, seed, &sets))).collect::<Vec<_>>()
            };
            let jobs: Vec<(&Trial, RunSpec)> = places.iter().flat_map(one).collect();
            jobs::each(&jobs, jobs::threads(self.threads), |(trial, plan)| {
                Ok(trial.cost(&Course::of(plan, registry)?))
            })
        };
        let mut started = f64::NAN;
        let rounds = self.rounds;
        let (best, trained) = search(&start, rounds, self.seed, |places| {
            let costs = costs(places, &[self.seed], &TRAINING)?;
            let costs: Vec<f64> = costs.chunks(COUNT).map(worst).collect();
            if started.is_nan() {
                started = costs[0];
            }
            Ok::<_, Failure>(costs)
        })?;
        let seeds: Vec<u64> = (0..self.held_out).map(|i| FIRST_HELD_OUT + i).collect();
        Ok(Row {
            law,
            found: sets(law, &best),
            started,
            trained,
            before: HeldOut::of(&costs(&[start], &seeds, &HELD_OUT)?),
            after: HeldOut::of(&costs(&[best], &seeds, &HELD_OUT)?),
            runs: rounds * ROUND * COUNT,
        })
    }
}

fn sets(law: Law, place: &[f64]) -> Vec<String> {
    let (name, _) = laws::in_pipeline();
    let both = dials(law).iter().zip(place);
    both.map(|(dial, place)| format!("{name}.{}={}{}", dial.name, dial.value(*place), dial.unit)).collect()
}

/// The greatest cost; NaN if one is NaN.
fn worst<'c>(costs: impl IntoIterator<Item = &'c f64>) -> f64 {
    costs.into_iter().fold(0.0, |most: f64, cost| if most.is_nan() || *cost <= most { most } else { *cost })
}

fn print(rows: &[Row]) {
    outln!(
        "the worst run: root mean square of truth less reference model, in parts of 0.5 mm, 0.2 degrees, 0.2 degrees;\n\
         from 100 on the head was not held, and it is the greatest distance from the target in hundredths of these"
    );
    out!(
        "{:<6} {:>5} {:>8} {:>8}   {:<14} {:>5} {:>8}  ",
        "law",
        "runs",
        "start",
        "trained",
        "held out",
        "held",
        "worst"
    );
    outln!("{}", HELD_OUT.iter().map(|t| format!(" {:>7}", t.name)).collect::<String>());
    for r in rows {
        let law = format!("{:?}", r.law).to_lowercase();
        out!("{law:<6} {:>5} {:>8.3} {:>8.3}   ", r.runs, r.started, r.trained);
        line("as it began", &r.before);
        out!("{:<32}", "");
        line("found", &r.after);
        outln!("       {}", r.found.join("  "));
    }
}

fn line(what: &str, of: &HeldOut) {
    let by = of.by_trial.iter().map(|cost| format!(" {cost:>7.3}")).collect::<String>();
    outln!("{what:<14} {:>2}/{:<2} {:>8.3}  {by}", of.held, of.runs, of.worst);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dial_gives_back_where_it_begins() {
        for dial in Law::ALL.into_iter().flat_map(dials) {
            let (place, value) = (dial.place(dial.start), dial.value(dial.place(dial.start)));
            assert!((0.0..=1.0).contains(&place) && (value / dial.start - 1.0).abs() < 5e-3, "{}", dial.name);
        }
    }

    #[test]
    fn a_place_costs_what_its_worst_run_does_and_no_number_is_worse_than_any() {
        assert_eq!(worst(&[0.1, 3.0, 0.2]), 3.0);
        assert!(worst(&[0.1, f64::NAN, 0.2]).is_nan() && worst(&[f64::NAN, 0.2]).is_nan());
        let of = HeldOut::of(
            &[[0.5; COUNT], [[0.1; COUNT - 1].as_slice(), &[120.0]].concat().try_into().unwrap()].concat(),
        );
        assert_eq!((of.held, of.runs, of.worst), (2 * COUNT - 1, 2 * COUNT, 120.0));
        assert_eq!((of.by_trial[0], of.by_trial[COUNT - 1]), (0.5, 120.0));
    }
}
