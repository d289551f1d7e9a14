//! A patient as the training takes it: its features, its sets with their costs, and what the policy should say.

use std::collections::BTreeMap;

use stillpoint_mechanics::random::Random;
use stillpoint_network::eye::{PAIR, STRUCTURE, TARGET};
use stillpoint_network::game::ring;
use stillpoint_network::{Eye, Game};

use super::plan;
use crate::TrainError;

/// Temperature of the policy's target, in `ln(cost / best)`.
const TEMPERATURE: f64 = 0.02;

/// The weight of a set falls by e for each so much of `ln(cost / best)`, and no lower than this.
const NEAR: f64 = 0.1;
const FAR_WEIGHT: f64 = 0.15;

/// A patient to train on or to validate with.
#[derive(Clone, Debug)]
pub struct Example {
    pub eye: Eye,
    /// Sets of beams, all of the same number.
    pub sets: Vec<Vec<u16>>,
    /// `ln(cost / reference)` of each set; the reference is the geometric mean over the rotations of equal beams that were
    /// solved.
    pub logs: Vec<f64>,
    /// How good each set is: 1 for the best, falling with the temperature.
    good: Vec<f64>,
}

/// States of the policy: beams that are kept, and what should be added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct States {
    /// Beams kept, the same number in each.
    pub retained: Vec<Vec<u16>>,
    /// For each state and angle its probability.
    pub pi: Vec<Vec<f32>>,
    /// For each state and angle whether it may be added.
    pub legal: Vec<Vec<bool>>,
}

impl Example {
    /// Of features and the games of one patient.
    ///
    /// # Errors
    /// The games have no set, no rotation of equal beams, or different numbers of beams.
    pub fn new(eye: Eye, games: &[&Game]) -> Result<Self, TrainError> {
        let mut all: BTreeMap<&[u16], f64> = BTreeMap::new();
        games.iter().flat_map(|game| &game.sets).for_each(|(set, cost)| {
            all.entry(set).or_insert(*cost);
        });
        let rotations: Vec<f64> = games.iter().flat_map(|game| &game.rotations).copied().collect();
        let beams = games.first().map_or(0, |game| game.rules.beams);
        if all.is_empty() || rotations.is_empty() || all.keys().any(|set| set.len() != beams) {
            let patient = games.first().map_or_else(String::new, |game| game.patient.name());
            return Err(TrainError::Plan(format!(
                "the games of {patient} have no rotation, or no sets to compare"
            )));
        }
        let reference = rotations.iter().map(|c| libm::log(*c)).sum::<f64>() / rotations.len() as f64;
        let logs: Vec<f64> = all.values().map(|cost| libm::log(*cost) - reference).collect();
        let best = logs.iter().copied().fold(f64::INFINITY, f64::min);
        let good = logs.iter().map(|log| libm::exp((best - log) / TEMPERATURE)).collect();
        Ok(Self { eye, sets: all.keys().map(|set| set.to_vec()).collect(), logs, good })
    }

    /// `count` states that keep `retained` beams of sets that are drawn by how good they are.
    pub fn states(&self, count: usize, retained: usize, random: &mut Random) -> Result<States, TrainError> {
        let ring = ring().map_err(plan)?;
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
            beams.truncate(retained);
            let mut pi = vec![0.0; self.eye.angles];
            for (set, good) in self.sets.iter().zip(&self.good) {
                if beams.iter().all(|beam| set.contains(beam)) {
                    set.iter().filter(|b| !beams.contains(b)).for_each(|b| pi[usize::from(*b)] += good);
                }
            }
            let whole: f64 = pi.iter().sum();
            states.pi.push(pi.into_iter().map(|p| (p / whole) as f32).collect());
            states.legal.push((0..ring.count()).map(|beam| ring.fits(beam, &beams)).collect());
            states.retained.push(beams);
        }
        Ok(states)
    }
}

impl Example {
    /// Of these sets: zeta = cost / (cost + reference), the mean of the logarithms, and the root of the weight of each in the
    /// loss of the value. Sets near the best weigh more: among them the network has to choose.
    pub fn targets(&self, chosen: &[usize]) -> (Vec<f32>, f64, Vec<f32>) {
        let logs: Vec<f64> = chosen.iter().map(|i| self.logs[*i]).collect();
        let best = self.logs.iter().copied().fold(f64::INFINITY, f64::min);
        let zeta = logs.iter().map(|log| (1.0 / (1.0 + libm::exp(-log))) as f32).collect();
        let weight = |log: &f64| libm::sqrt(FAR_WEIGHT + libm::exp((best - log) / NEAR)) as f32;
        let weights = logs.iter().map(weight).collect();
        let mean = logs.iter().sum::<f64>() / logs.len().max(1) as f64;
        (zeta, mean, weights)
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
