//! What patients do: height and pitch of a head that nothing orders, as a tracker sees it.
//!
//! The patients are those of the rigs ([`Involuntary`]): every second one breathes and drifts, the others nod and cough
//! too. Each has a seed and an irregularity of its own.

use nalgebra::DMatrix;
use stillpoint_control::effect::Effect;
use stillpoint_control::harmonic::{CHANNELS, Position};
use stillpoint_control::periodic::Periodic;
use stillpoint_mechanics::random::Random;
use stillpoint_rig::involuntary::{Habit, Involuntary};

use crate::TrainError;
use crate::dataset::Sample;
use crate::excite;

/// Whom and how the data show.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Patients {
    /// Patients, a run each.
    pub count: usize,
    /// Length of a run, s.
    pub seconds: f64,
    /// Standard deviation of the measured height and pitch, in parts of [`SCALE`].
    pub noise: [f64; 2],
    /// The patients' irregularity is drawn from 0 up to this.
    pub irregularity: f64,
    /// Of all random numbers.
    pub seed: u64,
}

impl Default for Patients {
    fn default() -> Self {
        Self { count: 150, seconds: 100.0, noise: [0.01, 0.005], irregularity: 1.0, seed: 1 }
    }
}

/// What counts as one in height and pitch: 1 mm and 1 degree.
pub const SCALE: [f64; 2] = [1e-3, core::f64::consts::PI / 180.0];
/// From sample to sample, s.
pub const SAMPLE_TIME: f64 = 0.2;
/// Time before a run in which tones are followed already, s: with a window of 12 s they have seen the 20 s that they use.
const LEAD: f64 = 8.0;
/// From tick to tick of a law, s, and ticks between two poses.
const TICK: f64 = 0.02;
const TICKS: usize = 5;
/// Proportional gain of the law that answers the tones, 1/s: that of `pipeline.yaml`.
const GAIN: f64 = 2.37;
/// Parts in which a speed is summed up to a change.
const PARTS: usize = 8;

impl Patients {
    /// Whether the patient of this number nods and coughs, and not only breathes and drifts.
    #[must_use]
    pub fn nods(number: usize) -> bool {
        number % 2 == 1
    }

    /// Whether a patient coughs between two samples of its run, both within.
    #[must_use]
    pub fn coughs(&self, number: usize, samples: core::ops::RangeInclusive<usize>) -> bool {
        let (person, ticks) = (self.person(number), (SAMPLE_TIME / TICK).round() as usize);
        (samples.start() * ticks..=samples.end() * ticks).any(|tick| person.coughs(LEAD + TICK * tick as f64))
    }

    fn person(&self, number: usize) -> Involuntary {
        let mut random = Random::stream(self.seed, number as u64);
        let habit = if Self::nods(number) { Habit::Nods } else { Habit::Breathes };
        let seed = (random.uniform() * (1u64 << 53) as f64) as u64;
        Involuntary { habit, seed, strength: 1.0, irregularity: random.between(0.0, self.irregularity) }
    }

    /// Where the head is seen at each pose of a law, from the lead on, in parts of [`SCALE`].
    fn poses(&self, number: usize) -> Vec<[f64; 2]> {
        let person = self.person(number);
        let mut noise = Random::stream(!self.seed, number as u64);
        let count = ((LEAD + self.seconds) / (TICK * TICKS as f64)).round() as usize;
        let pose = |k: usize| {
            let true_pose = truth(&person, TICK * (k * TICKS) as f64);
            [0, 1].map(|i| true_pose[i] + self.noise[i] * noise.normal())
        };
        (0..count).map(pose).collect()
    }

    /// The samples of each patient, without valves.
    ///
    /// # Errors
    /// A length or noise that cannot be.
    pub fn record(&self) -> Result<Vec<Vec<Sample>>, TrainError> {
        let noise = self.noise[0].max(self.noise[1]);
        for (what, value, must, holds) in [
            ("the length of a run", self.seconds, "from 1 s to 1 h", (1.0..=3600.0).contains(&self.seconds)),
            ("the noise", noise, "from 0 to 1", self.noise.iter().all(|n| (0.0..=1.0).contains(n))),
            ("the irregularity", self.irregularity, "from 0 to 1", (0.0..=1.0).contains(&self.irregularity)),
        ] {
            if !holds {
                return Err(TrainError::Option { what, value, must });
            }
        }
        let sample = |pose: [f64; 2]| Sample { pose: pose.to_vec(), duty: Vec::new() };
        let run = |number| sampled(&self.poses(number)).map(sample).collect();
        Ok((0..self.count).map(run).collect())
    }

    /// How the tones of a law predict this patient: for each sample the changes of height and pitch to the first number of
    /// samples ahead, then to the next, in parts of [`SCALE`].
    ///
    /// The tones are those of `plant.motion: learned`: poses ten times a second, a search at each tick, and answers by
    /// valves that do what they are told, beside proportional feedback. A change is the integral of the speed that the law
    /// would order against.
    ///
    /// # Errors
    /// None for two channels.
    pub fn tones(&self, number: usize, ahead: &[usize]) -> Result<Vec<Vec<f64>>, TrainError> {
        let poses = self.poses(number);
        // In the scales of the law.
        let law: [f64; 2] = std::array::from_fn(|i| SCALE[i] / excite::SCALE[i]);
        let plain = Effect::new(DMatrix::identity(2, 2)).map_err(|e| TrainError::Rig(e.to_string()))?;
        let mut periodic = Periodic::new(2, plain.decoupling());
        let (mut ordered, mut rates) = ([0.0; 2], [0.0; CHANNELS]);
        let mut predicted = Vec::with_capacity(poses.len());
        for (k, pose) in poses.iter().enumerate() {
            let (mut value, mut error) = ([0.0; CHANNELS], [0.0; CHANNELS]);
            for i in 0..2 {
                value[i] = law[i] * pose[i];
                error[i] = value[i] + ordered[i];
            }
            for tick in 0..TICKS {
                let time = TICK * (k * TICKS + tick) as f64;
                if tick == 0 {
                    periodic.see(Position { time, value, ..Position::default() }, &error);
                }
                periodic.search(TICK);
                if tick == 0 {
                    predicted
                        .push(changes(&periodic, time, ahead).map(|(i, change)| change / law[i]).collect());
                }
                periodic.rates(time + 0.5 * TICK, &mut rates);
                for i in 0..2 {
                    ordered[i] -= TICK * (rates[i] + GAIN * (value[i] + ordered[i]));
                }
            }
        }
        Ok(sampled(&predicted).collect())
    }
}

/// Of poses with their lead, those of the samples.
fn sampled<T: Clone>(poses: &[T]) -> impl Iterator<Item = T> {
    let (lead, step) =
        ((LEAD / (TICK * TICKS as f64)) as usize, (SAMPLE_TIME / (TICK * TICKS as f64)).round());
    poses.iter().skip(lead).step_by(step as usize).cloned()
}

/// Height and pitch that a person would give a free head, in parts of [`SCALE`].
fn truth(person: &Involuntary, time: f64) -> [f64; 2] {
    let (translation, angles) = person.offset(time);
    [translation.z / SCALE[0], angles.x / SCALE[1]]
}

/// The changes of each channel from a time on, as tones have them, with the channels.
fn changes(periodic: &Periodic, time: f64, ahead: &[usize]) -> impl Iterator<Item = (usize, f64)> {
    ahead.iter().flat_map(move |ahead| {
        let (length, mut sum, mut rates) = (SAMPLE_TIME * *ahead as f64, [0.0; 2], [0.0; CHANNELS]);
        for part in 0..PARTS {
            periodic.rates(time + length * (part as f64 + 0.5) / PARTS as f64, &mut rates);
            sum.iter_mut().zip(rates).for_each(|(sum, rate)| *sum += rate * length / PARTS as f64);
        }
        sum.into_iter().enumerate()
    })
}
