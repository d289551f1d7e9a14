//! `stillpoint-research hold`: how near a head is held that breathes, nods and coughs.

use clap::{Args, ValueEnum};
use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_rig::involuntary::{Habit, Involuntary};

use super::course::{Course, Point, RunSpec};
use super::laws::{self, Law, Runs};
use super::step::WITHIN;
use stillpoint::jobs;
use stillpoint::{Ended, Exit, Failure, print_json};

/// Time from which a hold is judged, s.
const FROM: f64 = 10.0;
/// A head that is this near to its target is held: mm and degrees.
const NEAR: [f64; 2] = [0.4, 0.2];
/// Time after a cough from which the head between eight bladders is judged, s.
const CALM: f64 = 1.0;
/// The pipeline with eight bladders.
const SIX: &str = include_str!("../../../../examples/head-6dof.yaml");

/// The heads that are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Body {
    /// The default pipeline, with three bladders.
    Three,
    /// `examples/head-6dof.yaml`, with eight bladders.
    Eight,
}

/// Hold the simulated head where it is while the person breathes, drifts, nods and coughs, from camera to valve. Figures
/// are from 10 s on and by the truth.
#[derive(Args)]
pub struct Hold {
    /// First seed.
    #[arg(long, default_value_t = 1)]
    first_seed: u64,
    /// Number of seeds. A seed determines the noise of the camera, the drift and the coughs.
    #[arg(long, default_value_t = 5, value_parser = super::at_least::<u64>(1))]
    seeds: u64,
    /// Length of a run, s.
    #[arg(long, default_value_t = 120.0, value_parser = super::positive)]
    seconds: f64,
    /// The head and its bladders.
    #[arg(long, value_enum, default_value = "three")]
    body: Body,
    /// A law that replaces the law of the default pipeline.
    #[arg(long, value_enum, conflicts_with = "body")]
    law: Option<Law>,
    #[command(flatten)]
    runs: Runs,
}

/// Figures of one run.
#[derive(Clone, Debug, Serialize)]
struct Held {
    seed: u64,
    /// Root mean square of truth - target: z in mm, pitch and roll in degrees, then x and y in mm and yaw in degrees,
    /// which are NaN if the rig does not move them.
    rms: [f64; 6],
    /// The same between coughs: from 1 s after a cough on.
    calm: [f64; 6],
    /// Greatest distance from 1 s after a cough on, in the same order.
    worst_calm: [f64; 6],
    /// Fraction of the time within 0.4 mm and 0.2 degrees of the target in all coordinates that the rig moves.
    near: f64,
    /// The same of the same head and person whose valves nobody arms, so that they stay shut.
    near_without: f64,
    /// Fraction of the time with the beam on.
    beam: f64,
    /// Number of coughs that ended 2 s before the end of the run or earlier.
    coughs: usize,
    /// Longest time from the end of a cough until the head stays within 0.5 mm and 0.2 degrees for half a second, s.
    recovered: f64,
    /// Force of the bladder that pushed least, N.
    least_force: f64,
    /// Least distance of a contact of the rig from its friction cone, N; 0 where one slid or there is no friction.
    least_margin: f64,
    /// Part of the contacts that slid, in the mean over the ticks.
    sliding: f64,
    /// Greatest pressure, Pa.
    pressure: f64,
    /// Names of the rules that were broken.
    broken: Vec<&'static str>,
}

impl Hold {
    /// Runs the seeds and prints their figures. Fails if a rule of beam or valves was broken.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let seeds: Vec<u64> = (self.first_seed..self.first_seed.saturating_add(self.seeds)).collect();
        let found = jobs::each(&seeds, jobs::threads(self.runs.threads), |seed| self.run(*seed, registry))?;
        if self.runs.json {
            print_json(&found)?;
        } else {
            print(&found);
        }
        Ok(if found.iter().all(|f| f.broken.is_empty()) { Exit::Done } else { Exit::Failed })
    }

    fn run(&self, seed: u64, registry: &Registry) -> Result<Held, Failure> {
        let (mut plan, script) = match self.body {
            Body::Three => {
                let mut plan = laws::plan(self.law, "5 s", seed);
                plan.sets.push("target.moves=[]".to_owned());
                (plan, "{ at: 500 ms, say: capture, repeat: 3 s }, { at: 1 s, say: confirm, repeat: 500 ms }")
            }
            Body::Eight => {
                let mut plan = RunSpec {
                    text: SIX.replace("data/rig.key", "examples/data/rig.key"),
                    ..RunSpec::from_camera_to_valve()
                };
                plan.sets.extend([format!("seed={seed}"), format!("rig.seed={seed}")]);
                (plan, "{ at: 900 ms, say: confirm, repeat: 500 ms }")
            }
        };
        plan.sets.push("rig.motion=nods".to_owned());
        self.runs.set(&mut plan);
        plan.seconds = self.seconds;
        let course = Course::of(&plan, registry)?;
        if let Some(name) = course.failed.first() {
            return Err(Failure::failed(format!("seed {seed}: {name} failed")));
        }
        let mut free = plan.clone();
        free.sets.push(format!("console.script=[{script}]"));
        let free = Course::of(&free, registry)?;
        let person = Involuntary { habit: Habit::Nods, seed, strength: 1.0, irregularity: 0.0 };
        judge(&course, &free, seed, &person, self.seconds)
            .ok_or_else(|| Failure::failed(format!("seed {seed}: there was no target from {FROM} s on")))
    }
}

/// Truth minus target: z, pitch, roll, x, y, yaw.
fn all(point: &Point) -> [f64; 6] {
    let ([z, pitch, roll], [x, y, yaw]) = (point.error(), point.across);
    [z, pitch, roll, x, y, yaw]
}

/// Fraction of the points within 0.4 mm and 0.2 degrees of the target, in the coordinates that are known.
fn near(points: &[Point]) -> f64 {
    let [mm, degrees] = NEAR;
    let limits = [mm, degrees, degrees, mm, mm, degrees];
    let is_near =
        |p: &&Point| all(p).iter().zip(limits).all(|(off, limit)| off.is_nan() || off.abs() <= limit);
    points.iter().filter(is_near).count() as f64 / points.len() as f64
}

fn judge(course: &Course, free: &Course, seed: u64, person: &Involuntary, seconds: f64) -> Option<Held> {
    let points = course.since(FROM);
    let first = points.first()?;
    let ends = ends(person, first.time, seconds - 2.0);
    let is_calm =
        |p: &&Point| !(0..=(CALM * 20.0) as u32).any(|k| person.coughs(p.time - 0.05 * f64::from(k)));
    let calm: Vec<&Point> = points.iter().filter(is_calm).collect();
    let beam = points.iter().filter(|p| p.beam).count() as f64 / points.len() as f64;
    let worst_calm = std::array::from_fn(|i| {
        calm.iter().map(|p| all(p)[i].abs()).fold(0.0, |a: f64, b| if a.is_nan() || b <= a { a } else { b })
    });
    Some(Held {
        seed,
        rms: root_mean_square(points.iter()),
        calm: root_mean_square(calm.iter().copied()),
        worst_calm,
        near: near(points),
        near_without: near(free.since(FROM)),
        beam,
        coughs: ends.len(),
        recovered: ends.iter().map(|end| recovered(course, *end)).fold(0.0, f64::max),
        least_force: course.least_force,
        least_margin: course.least_margin,
        sliding: course.sliding[0] as f64 / course.sliding[1].max(1) as f64,
        pressure: course.pressure,
        broken: course.monitor.broken(),
    })
}

fn root_mean_square<'p>(points: impl Iterator<Item = &'p Point>) -> [f64; 6] {
    let (mut sum, mut count) = ([0.0; 6], 0.0);
    for point in points {
        count += 1.0;
        sum.iter_mut().zip(all(point)).for_each(|(sum, off)| *sum += off * off);
    }
    sum.map(|sum: f64| (sum / count).sqrt())
}

/// Times at which coughs end, s.
fn ends(person: &Involuntary, from: f64, until: f64) -> Vec<f64> {
    let step = 0.01;
    let count = ((until - from) / step).max(0.0) as u32;
    let coughs = |time: f64| (0..10).any(|k| person.coughs(time - step * f64::from(k)));
    (1..count)
        .map(|k| from + step * f64::from(k))
        .filter(|time| coughs(time - step) && !coughs(*time))
        .collect()
}

/// Time after `end` from which the head is within the tolerance for half a second, s; infinity if it never is.
fn recovered(course: &Course, end: f64) -> f64 {
    let is_off =
        |p: &Point| p.error().iter().zip(WITHIN).any(|(off, within)| off.is_nan() || off.abs() > within);
    let mut since = end;
    for point in course.since(end) {
        if is_off(point) {
            since = point.time;
        } else if point.time > since + 0.5 {
            return since - end;
        }
    }
    f64::INFINITY
}

fn print(found: &[Held]) {
    outln!("by the truth, from {FROM} s on: z in mm, pitch, roll in degrees; x, y in mm, yaw in degrees");
    let six = |v: &[f64; 6]| v.iter().map(|v| format!("{v:>7.3}")).collect::<String>();
    for f in found {
        outln!(
            "seed {:>2}: RMS{}; from 1 s after coughs on RMS{}, greatest{}; within {} mm and {} degrees {:.1} % of the time, {:.1} % without holding; beam on {:.1} %; {} coughs, back within {:.2} s; \
             least force {:.1} N, least margin {:.1} N, {:.1} % slid, {:.1} kPa {}",
            f.seed,
            six(&f.rms),
            six(&f.calm),
            six(&f.worst_calm),
            NEAR[0],
            NEAR[1],
            100.0 * f.near,
            100.0 * f.near_without,
            100.0 * f.beam,
            f.coughs,
            f.recovered,
            f.least_force,
            f.least_margin,
            100.0 * f.sliding,
            f.pressure * 1e-3,
            f.broken.join(" ")
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_head_is_near_only_in_all_coordinates_that_its_rig_moves() {
        let across = [f64::NAN; 3];
        let at = |moved: [f64; 3]| Point { moved, across, ..Point::default() };
        let [on, high, turned] = [[0.3, 0.1, -0.1], [0.5, 0.0, 0.0], [0.0, 0.0, 0.3]].map(at);
        let aside = Point { across: [0.0, 0.5, 0.0], ..on };
        assert_eq!([near(&[on]), near(&[on, high]), near(&[turned, aside, on, on])], [1.0, 0.5, 0.5]);
    }

    #[test]
    fn a_cough_ends_once_and_the_head_is_back_when_it_stays_within() {
        let person = Involuntary { habit: Habit::Nods, seed: 7, strength: 1.0, irregularity: 0.0 };
        let ends = ends(&person, 0.0, 600.0);
        assert!((8..=22).contains(&ends.len()), "{ends:?}");
        assert!(ends.windows(2).all(|w| w[1] - w[0] > 1.0), "{ends:?}");
        let end = ends[0];
        let points = (0..500).map(|k| {
            let time = end + 0.01 * f64::from(k);
            let off = if (0.4..0.7).contains(&(time - end)) { 0.6 } else { 0.1 };
            Point { time, moved: [off, 0.0, 0.0], ..Point::default() }
        });
        let course = Course { points: points.collect(), ..Course::default() };
        let found = recovered(&course, end);
        assert!((found - 0.7).abs() < 0.02, "{found}");
        assert_eq!(recovered(&course, end + 4.9), f64::INFINITY, "nothing is known of what follows");
    }
}
