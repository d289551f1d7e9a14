//! A case as the training takes it: its features, its sets with their costs, and what the policy should say.

use stillpoint_network::Eye;
use stillpoint_network::eye::{PAIR, STRUCTURE, TARGET};
use stillpoint_plan::dose::Machine;
use stillpoint_random::Random;

use super::gather::SolvedCase;
use super::problem::{Problem, plan, ring};
use crate::TrainError;

/// Temperature of the policy's target, in `ln(cost / best)`.
const TEMPERATURE: f64 = 0.02;

/// A case to train on or to validate with.
#[derive(Clone, Debug)]
pub struct Example {
    /// Seed of the varied pelvis.
    pub seed: u64,
    /// Its features.
    pub eye: Eye,
    /// Sets of beams.
    pub sets: Vec<Vec<u16>>,
    /// `ln(cost / reference)` of each set; the reference is the geometric mean over the rotations of equal beams.
    pub logs: Vec<f64>,
    /// How good each set is: 1 for the best, falling with the temperature.
    good: Vec<f64>,
}

/// States of the policy: beams that are kept, and what should be added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct States {
    /// Beams kept, the same number in each.
    pub kept: Vec<Vec<u16>>,
    /// For each state and angle its probability.
    pub pi: Vec<Vec<f32>>,
    /// For each state and angle whether it may be added.
    pub legal: Vec<Vec<bool>>,
}

/// The examples of solved cases.
pub fn examples(solved: &[SolvedCase], mut done: impl FnMut()) -> Result<Vec<Example>, TrainError> {
    let machine = Machine::shipped().map_err(plan)?;
    let mut all = Vec::new();
    for case in solved {
        let problem = Problem::of_seed(case.seed, case.by.coarse)?;
        let angles = usize::from(ring()?.count());
        let eye = Eye::of_case(&problem.case, &problem.wanted, &machine, angles).map_err(plan)?;
        all.push(Example::new(eye, case)?);
        done();
    }
    Ok(all)
}

impl Example {
    /// Of features and solved sets.
    pub fn new(eye: Eye, case: &SolvedCase) -> Result<Self, TrainError> {
        let sound = |cost: &f64| cost.is_finite() && *cost > 0.0;
        if case.sets.is_empty() || case.rotations.is_empty() || !case.sets.iter().all(|(_, c)| sound(c)) {
            return Err(TrainError::Plan(format!(
                "the solved sets of seed {} have costs that are not positive",
                case.seed
            )));
        }
        let reference =
            case.rotations.iter().map(|c| libm::log(*c)).sum::<f64>() / case.rotations.len() as f64;
        let logs: Vec<f64> = case.sets.iter().map(|(_, cost)| libm::log(*cost) - reference).collect();
        let best = logs.iter().copied().fold(f64::INFINITY, f64::min);
        let good = logs.iter().map(|log| libm::exp((best - log) / TEMPERATURE)).collect();
        let sets = case.sets.iter().map(|(set, _)| set.clone()).collect();
        Ok(Self { seed: case.seed, eye, sets, logs, good })
    }

    /// `count` states that keep `kept` beams of sets that are drawn by how good they are.
    pub fn states(&self, count: usize, kept: usize, random: &mut Random) -> Result<States, TrainError> {
        let ring = ring()?;
        let sum: f64 = self.good.iter().sum();
        let mut states = States::default();
        for _ in 0..count {
            let mut left = sum * random.uniform();
            let drawn = self.good.iter().position(|good| {
                left -= good;
                left <= 0.0
            });
            let mut beams = self.sets[drawn.unwrap_or(0)].clone();
            random.shuffle(&mut beams);
            beams.truncate(kept);
            let mut pi = vec![0.0; self.eye.angles];
            for (set, good) in self.sets.iter().zip(&self.good) {
                if beams.iter().all(|beam| set.contains(beam)) {
                    set.iter().filter(|b| !beams.contains(b)).for_each(|b| pi[usize::from(*b)] += good);
                }
            }
            let whole: f64 = pi.iter().sum();
            states.pi.push(pi.into_iter().map(|p| (p / whole) as f32).collect());
            states.legal.push((0..ring.count()).map(|beam| ring.fits(beam, &beams)).collect());
            states.kept.push(beams);
        }
        Ok(states)
    }
}

/// Mean and standard deviation of the features over examples: target, structure, pair.
pub fn scales(examples: &[Example]) -> Vec<Vec<f32>> {
    let target = moments(TARGET, examples.iter().flat_map(|e| e.eye.target.iter().map(|f| &f[..])));
    let rows = examples.iter().flat_map(|e| e.eye.structures.iter().flatten().map(|f| &f[..]));
    let structure = moments(STRUCTURE, rows);
    let pair = moments(PAIR, examples.iter().flat_map(|e| e.eye.pairs.iter().map(|f| &f[..])));
    [target, structure, pair].into_iter().flatten().collect()
}

fn moments<'a>(width: usize, rows: impl Iterator<Item = &'a [f32]>) -> [Vec<f32>; 2] {
    let (mut sum, mut squares, mut count) = (vec![0.0_f64; width], vec![0.0_f64; width], 0_usize);
    for row in rows {
        for ((sum, square), value) in sum.iter_mut().zip(&mut squares).zip(row) {
            *sum += f64::from(*value);
            *square += f64::from(*value) * f64::from(*value);
        }
        count += 1;
    }
    let n = count.max(1) as f64;
    let mean: Vec<f64> = sum.iter().map(|s| s / n).collect();
    let spread = |(square, mean): (&f64, &f64)| {
        let deviation = libm::sqrt((square / n - mean * mean).max(0.0));
        // A feature that never changes stays as it is.
        if deviation > 1e-6 { deviation as f32 } else { 1.0 }
    };
    let scale = squares.iter().zip(&mean).map(spread).collect();
    [mean.iter().map(|m| *m as f32).collect(), scale]
}
