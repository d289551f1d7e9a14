//! `stillpoint-research robust`: the dissertation's step with disturbances and faults.

use clap::Args;
use serde::Serialize;
use stillpoint_operator::Registry;

use super::cases::Case;
use super::course::{Course, Point, STEP, worst};
use super::laws::{self, Law};
use super::paired_median::{self, median};
use super::step::{MOVES, WITHIN};
use super::trials::without_camera;
use stillpoint::jobs;
use stillpoint::{Ended, Exit, Failure, print_json};

/// Maximum pressure of a bladder of the rig, Pa: the limit of `actuate.valves`.
const PRESSURE: f64 = 40e3;
/// Maximum duty.
const DUTY: f64 = 1.0;
/// Tolerance of the gate plus the standard deviation that it permits: mm, degrees, degrees. With the beam on the error
/// of the truth must not exceed it.
const ASTRAY: [f64; 3] = [1.0 + 0.5, 0.5 + 0.3, 0.5 + 0.3];
/// Latest time of the step after the start of the run, s.
pub const LEAD: f64 = 4.0;
/// Time after the step from which the head must be at the target, s. The reference model rises in 5 s.
pub const FROM: f64 = 20.0;
/// Length of the last part of a run, s. The beam in this part decides between degraded and gated.
const LAST: f64 = 10.0;

/// Move the simulated head along the dissertation's step, from camera to valve, with a fault or a deviation from the
/// model of the law. Report for each case whether the head was tracked, degraded but safe, or gated and safe. Faults
/// happen while the head moves. Errors and pressures are the true ones of the rig, not estimates.
#[derive(Args)]
pub struct Robust {
    /// Number of seeds. A seed determines the noise of the camera, the motion of the person, and the time of the fault.
    /// The default is 5, and 1 with `--quick`.
    #[arg(long, value_parser = super::at_least::<u64>(1))]
    seeds: Option<u64>,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    first_seed: u64,
    /// Length of a run after the step, s. The default is 60, and 30 with `--quick`.
    #[arg(long, value_parser = super::positive)]
    seconds: Option<f64>,
    /// Run only the cases whose names begin with this text.
    #[arg(long = "case", value_name = "NAME")]
    cases: Vec<String>,
    /// A law that replaces the law of the pipeline.
    #[arg(long, value_enum)]
    law: Option<Law>,
    /// Override a parameter of the pipeline: `--set operator.param=value`.
    #[arg(long = "set", value_name = "OPERATOR.PARAM=VALUE")]
    sets: Vec<String>,
    /// A short measurement: one seed and 30 s unless they are given, a quarter of the pixels.
    #[arg(long)]
    quick: bool,
    /// Leave out camera and tracker: the poses are the truth every 100 ms, with the noise and the latency of the tracker.
    #[arg(long)]
    no_camera: bool,
    /// Number of runs at the same time.
    #[arg(long, value_parser = super::at_least::<usize>(1))]
    threads: Option<usize>,
    /// Compare with another law: a file that this measurement wrote with `--json` for the same cases and seeds. Says for
    /// each case which law is nearer in the median over the seeds.
    #[arg(long = "beside", value_name = "FILE", conflicts_with = "json")]
    paired_median: Option<std::path::PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The outcome of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The head stayed within 0.5 mm, 0.2 degrees and 0.2 degrees of the target from 20 s after the step on.
    Tracked,
    /// The head left this tolerance, and the beam was on for a part of the last 10 s.
    DegradedButSafe,
    /// The head left this tolerance, and the beam was off during the last 10 s.
    GatedAndSafe,
    /// The pressure, a duty or the error with the beam on exceeded its limit.
    Unsafe,
}

impl Verdict {
    fn words(self) -> &'static str {
        match self {
            Self::Tracked => "tracked",
            Self::DegradedButSafe => "degraded but safe",
            Self::GatedAndSafe => "gated and safe",
            Self::Unsafe => "NOT SAFE",
        }
    }
}

/// Figures of one run.
#[derive(Clone, Debug, Serialize)]
pub struct Found {
    /// Outcome of the run.
    pub verdict: Verdict,
    /// Greatest |truth - target| from 20 s after the step on: mm, degrees, degrees.
    pub worst: [f64; 3],
    /// Root mean square of truth - target from 20 s after the step on: mm, degrees, degrees.
    pub rms: [f64; 3],
    /// Fraction of the last 10 s with the beam on.
    pub beam: f64,
    /// Greatest |truth - target| with the beam on: mm, degrees, degrees.
    pub astray: [f64; 3],
    /// Greatest pressure in the rig, Pa.
    pub pressure: f64,
    /// Greatest duty that was sent.
    pub duty: f64,
    /// Time in each state of actuation, s, by the name of the state.
    pub states: std::collections::BTreeMap<&'static str, f64>,
    /// Names of the limits that were exceeded.
    pub passed: Vec<&'static str>,
}

#[derive(Serialize)]
struct Row {
    case: String,
    /// Worst verdict of all seeds.
    verdict: Verdict,
    found: Vec<Found>,
}

impl Robust {
    /// Runs the cases and prints their verdicts. Fails if a run was unsafe.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let chosen =
            |c: &Case| self.cases.is_empty() || self.cases.iter().any(|name| c.name.starts_with(name));
        let cases: Vec<Case> = Case::all().into_iter().filter(chosen).collect();
        if cases.is_empty() {
            let names: Vec<String> = Case::all().into_iter().map(|c| c.name).collect();
            return Err(Failure::wrong(format!("there is no such case; there are {}", names.join(", "))));
        }
        let other = self.paired_median.as_deref().map(paired_median::read).transpose()?;
        let count = self.seeds.unwrap_or(if self.quick { 1 } else { 5 });
        let seeds = self.first_seed..self.first_seed.saturating_add(count);
        let seconds = self.seconds.unwrap_or(if self.quick { 30.0 } else { 60.0 });
        let jobs: Vec<(&Case, u64)> =
            cases.iter().flat_map(|c| seeds.clone().map(move |seed| (c, seed))).collect();
        let found = jobs::each(&jobs, jobs::threads(self.threads), |(case, seed)| {
            let mut case = (*case).clone();
            case.sets.extend(self.sets.iter().cloned());
            let seen = match (self.no_camera, self.quick) {
                (true, _) => Seen::Truth,
                (false, true) => Seen::Small,
                (false, false) => Seen::Full,
            };
            run(&case, *seed, self.law, seconds, seen, registry)
        })?;
        let rows: Vec<Row> = cases
            .iter()
            .zip(found.chunks(count as usize))
            .map(|(case, found)| Row {
                case: case.name.clone(),
                verdict: found.iter().map(|f| f.verdict).max().unwrap_or(Verdict::Unsafe),
                found: found.to_vec(),
            })
            .collect();
        if self.json {
            print_json(&rows)?;
        } else {
            print(&rows);
        }
        if let Some(other) = other {
            let this: Vec<paired_median::Row> =
                serde_json::to_value(&rows).and_then(serde_json::from_value).map_err(Failure::failed)?;
            paired_median::print(&this, &other)?;
        }
        let good = rows.iter().all(|r| r.verdict != Verdict::Unsafe);
        Ok(if good { Exit::Done } else { Exit::Failed })
    }
}

/// What the poses come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seen {
    /// The camera of the pipeline.
    Full,
    /// The same with a quarter of the pixels.
    Small,
    /// The truth.
    Truth,
}

fn run(
    case: &Case,
    seed: u64,
    law: Option<Law>,
    seconds: f64,
    seen: Seen,
    registry: &Registry,
) -> Result<Found, Failure> {
    let mut plan = laws::plan(law, "5 s", seed);
    let mut case = case.clone();
    match seen {
        Seen::Full => {}
        Seen::Small => plan.sets.extend(laws::small()),
        Seen::Truth => {
            plan = without_camera(plan);
            case = case.without_camera();
        }
    }
    plan.changes.extend(case.changes.iter().cloned());
    plan.sets.extend(case.sets.iter().cloned());
    plan.sets.push(MOVES.to_owned());
    if let Some(fault) = &case.fault {
        // The time of the fault depends on the seed, so that the valves have other openings when it happens.
        let at = 3500 + 400 * (seed % 8);
        plan.sets.push(format!("rig.faults=[{{ {fault}, at: {at} ms }}]"));
    }
    plan.seconds = LEAD + seconds;
    let course = Course::of(&plan, registry)?;
    if let Some(name) = course.failed.first() {
        return Err(Failure::failed(format!("{}, seed {seed}: {name} failed", case.name)));
    }
    judge(&course).ok_or_else(|| Failure::failed(format!("{}, seed {seed}: no step came", case.name)))
}

fn judge(course: &Course) -> Option<Found> {
    let at =
        course.step_at().filter(|_| course.points.last().is_some_and(|p| p.target[2] > 0.9 * STEP[2]))?;
    let end = course.points.last()?.time;
    let held = course.since(at + FROM);
    let (worst, rms) = (worst(held), root_mean_square(held));
    let last = course.since(end - LAST);
    let beam = last.iter().filter(|p| p.beam).count() as f64 / last.len() as f64;
    let beyond = |what: [f64; 3], limit: [f64; 3]| (0..3).any(|i| what[i].is_nan() || what[i] > limit[i]);
    let limits = [
        ("pressure", course.pressure.is_nan() || course.pressure > PRESSURE),
        ("duty", course.duty_broken || course.duty > DUTY),
        ("beam", beyond(course.astray, ASTRAY)),
    ];
    let mut passed: Vec<&str> = limits.iter().filter(|(_, passed)| *passed).map(|(name, _)| *name).collect();
    passed.extend(course.monitor.broken());
    let verdict = match (passed.is_empty(), beyond(worst, WITHIN)) {
        (false, _) => Verdict::Unsafe,
        (true, false) => Verdict::Tracked,
        (true, true) if beam > 0.0 => Verdict::DegradedButSafe,
        (true, true) => Verdict::GatedAndSafe,
    };
    Some(Found {
        verdict,
        worst,
        rms,
        beam,
        astray: course.astray,
        pressure: course.pressure,
        duty: course.duty,
        states: course.states.clone(),
        passed,
    })
}

/// Root mean square of truth - target of the points: mm, degrees, degrees; NaN if there are none.
fn root_mean_square(points: &[Point]) -> [f64; 3] {
    let sum = points.iter().fold([0.0; 3], |sum: [f64; 3], p| {
        let error = p.error();
        std::array::from_fn(|i| sum[i] + error[i] * error[i])
    });
    sum.map(|sum| (sum / points.len() as f64).sqrt())
}

fn print(rows: &[Row]) {
    outln!(
        "{:<28} {:<18} {:>8} {:>22} {:>22} {:>16} {:>10} {:>22} {:>9} {:>6}  seconds holding, venting, at fault",
        "",
        "",
        "tracked",
        "median of the worst",
        "median of the RMS",
        "worst, mm deg deg",
        "beam",
        "worst with beam on",
        "kPa",
        "duty"
    );
    for row in rows {
        let most = |of: &dyn Fn(&Found) -> f64| row.found.iter().map(of).fold(0.0, f64::max);
        let three = |of: &dyn Fn(&Found) -> [f64; 3]| {
            let [z, pitch, roll] = [0, 1, 2].map(|i| most(&|f| of(f)[i]));
            format!("{z:.2} {pitch:.2} {roll:.2}")
        };
        let beams = row.found.iter().map(|f| f.beam);
        let (least, greatest) = beams.fold((1.0f64, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
        let seconds =
            ["holding", "venting", "fault"].map(|s| most(&|f| f.states.get(s).copied().unwrap_or(0.0)));
        let passed: Vec<&str> = row.found.iter().flat_map(|f| f.passed.iter().copied()).collect();
        let medians = |of: &dyn Fn(&Found) -> [f64; 3]| {
            let [z, pitch, roll] = [0, 1, 2].map(|i| median(row.found.iter().map(|f| of(f)[i])));
            format!("{z:.2} {pitch:.2} {roll:.2}")
        };
        let tracked = row.found.iter().filter(|f| f.verdict == Verdict::Tracked).count();
        outln!(
            "{:<28} {:<18} {:>8} {:>22} {:>22} {:>16} {:>10} {:>22} {:>9.1} {:>6.2}  {:.1}, {:.1}, {:.1} {}",
            row.case,
            row.verdict.words(),
            format!("{tracked}/{}", row.found.len()),
            medians(&|f| f.worst),
            medians(&|f| f.rms),
            three(&|f| f.worst),
            format!("{:.0}-{:.0} %", 100.0 * least, 100.0 * greatest),
            three(&|f| f.astray),
            most(&|f| f.pressure) * 1e-3,
            most(&|f| f.duty),
            seconds[0],
            seconds[1],
            seconds[2],
            passed.join(" ")
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A short run of one case with a quarter of the pixels. It ends 2 s after the head must be at the target.
    fn look(name: &str) -> Found {
        let case = Case::all().into_iter().find(|c| c.name == name).unwrap();
        run(&case, 1, None, FROM + 2.0, Seen::Small, &crate::registry()).unwrap()
    }

    #[test]
    fn whatever_is_broken_no_limit_is_passed() {
        let names = [
            "head of 3 kg",
            "head of 6 kg",
            "stuck inlet of bladder 0",
            "stuck outlet of bladder 1",
            "leak of 0.5 mm in bladder 0",
            "supply 20 % weaker",
            "pose noise of 3 %",
            "10 % of the frames lost",
            "100 ms more of latency",
        ];
        let found = jobs::each(&names, 2, |name| Ok(look(name))).unwrap();
        for (name, found) in names.iter().zip(&found) {
            assert!(found.verdict != Verdict::Unsafe, "{name}: {found:?}");
            assert!(found.pressure > 5e3 && found.duty > 0.1, "{name}: the head was moved: {found:?}");
        }
        // At least one fault prevents tracking. A head whose mass differs from that of the law's model is tracked.
        assert!(found.iter().any(|f| f.verdict != Verdict::Tracked));
        assert_eq!([found[0].verdict, found[1].verdict], [Verdict::Tracked; 2], "{:?}", &found[..2]);
    }

    #[test]
    fn every_case_runs_without_the_camera_and_late_and_lost_poses_stay_what_they_are() {
        for case in Case::all() {
            let found = run(&case, 1, None, 0.5, Seen::Truth, &crate::registry());
            assert!(found.is_ok(), "{}", case.name);
        }
        let all: Vec<Case> = Case::all().into_iter().map(Case::without_camera).collect();
        assert!(all.iter().any(|c| c.sets == ["head.lost=0.1"]));
        assert!(all.iter().any(|c| c.changes.iter().any(|(_, to)| to.contains("delay: 118 ms"))));
    }

    #[test]
    fn a_mean_square_of_nothing_is_no_number() {
        let point = |moved| Point { moved, target: [1.0; 3], ..Point::default() };
        let rms = root_mean_square(&[point([1.0, 2.0, 5.0]), point([1.0, 0.0, 4.0])]);
        assert_eq!(rms, [0.0, 1.0, 12.5f64.sqrt()]);
        assert!(root_mean_square(&[]).iter().all(|v| v.is_nan()));
    }

    #[test]
    fn a_limit_that_is_passed_is_no_good_and_a_head_that_is_off_is_gated_or_degraded() {
        let course = |off: f64, beam: bool| {
            let points = (0..1000).map(|k| {
                let time = 0.1 * f64::from(k);
                let target = if time < 3.0 { [0.0; 3] } else { STEP };
                Point { time, moved: target.map(|t| t + off), target, beam, ..Point::default() }
            });
            Course { points: points.collect(), pressure: 20e3, duty: 0.5, ..Course::default() }
        };
        let verdict = |course: &Course| judge(course).unwrap().verdict;
        assert_eq!(verdict(&course(0.1, true)), Verdict::Tracked);
        assert_eq!(verdict(&course(0.3, true)), Verdict::DegradedButSafe);
        assert_eq!(verdict(&course(0.3, false)), Verdict::GatedAndSafe);
        assert_eq!(verdict(&Course { pressure: 41e3, ..course(0.1, true) }), Verdict::Unsafe);
        assert_eq!(verdict(&Course { duty: 1.01, ..course(0.1, true) }), Verdict::Unsafe);
        assert_eq!(verdict(&Course { duty_broken: true, ..course(0.1, true) }), Verdict::Unsafe);
        assert_eq!(verdict(&Course { astray: [0.0, 0.9, 0.0], ..course(0.1, true) }), Verdict::Unsafe);
        assert_eq!(verdict(&Course { pressure: f64::NAN, ..course(0.1, true) }), Verdict::Unsafe);
    }
}
