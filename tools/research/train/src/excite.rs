//! Data of a head on three bladders: held and moved by a PI loop, with a bounded multi-sine on its valves.
//!
//! An excitation must last to be persistent (SCIENCE E10: a signal in L2 is not), and it is for a rig, never for a
//! person.

use nalgebra::{DMatrix, Vector3};
use stillpoint_control::effect::Effect;
use stillpoint_control::pi::{Pi, PiGains};
use stillpoint_control::reference::{ReferenceModel, pole_of_rise};
use stillpoint_control::tracking::Errors;
use stillpoint_control::valves::{clip, split};
use stillpoint_mechanics::plant::{State, ThreeDof};
use stillpoint_mechanics::random::Random;

use crate::TrainError;
use crate::dataset::Sample;

/// What is recorded of the rig.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Excitation {
    /// Runs, each of another head.
    pub runs: usize,
    /// Length of a run, s.
    pub seconds: f64,
    /// From sample to sample, s.
    pub sample_time: f64,
    /// Least and greatest mass of the head, kg.
    pub mass: [f64; 2],
    /// Amplitude of the multi-sine, in parts of full opening.
    pub amplitude: f64,
    /// Standard deviation of the pose, in parts of each channel's scale.
    pub noise: f64,
    /// Of all random numbers.
    pub seed: u64,
}

impl Default for Excitation {
    fn default() -> Self {
        Self {
            runs: 30,
            seconds: 60.0,
            sample_time: 0.1,
            mass: [3.5, 6.0],
            amplitude: 0.08,
            noise: 0.002,
            seed: 1,
        }
    }
}

/// What counts as one in height, pitch and roll, m and rad: the dissertation's step.
pub const SCALE: [f64; 3] = [0.0115, 0.023_561_944_901_923_45, 0.174_532_925_199_432_95];

/// Sines on each bladder, and between which frequencies, Hz.
const SINES: usize = 6;
const FREQUENCIES: [f64; 2] = [0.03, 2.0];
/// Between which parts of the scale the head is sent.
const TARGETS: [[f64; 2]; 3] = [[-0.3, 1.2], [-1.5, 1.5], [-1.0, 1.0]];
/// How long it is left there, s.
const STAY: [f64; 2] = [3.0, 12.0];
/// Air of the bladders under a head of 5 kg at the start of the reference run, kg.
const AIR: [f64; 3] = [8.516e-4, 7.166e-4, 7.166e-4];
/// Pressure at which the flow of an inlet counts, Pa.
const NOMINAL: f64 = 10e3;
/// Length of a step of the rig's equations, s.
const STEP: f64 = 1e-3;

struct Sine {
    amplitude: f64,
    frequency: f64,
    phase: f64,
}

/// Records the runs, one list of samples each, and calls `done` after each run.
///
/// # Errors
/// A head that the bladders do not bear, or an option that cannot be.
pub fn record(excitation: &Excitation, mut done: impl FnMut(usize)) -> Result<Vec<Vec<Sample>>, TrainError> {
    let Excitation { seconds, sample_time, mass, amplitude, noise, .. } = *excitation;
    for (what, value, must, holds) in [
        ("the sample time", sample_time, "from 1 ms to 10 s", (STEP..=10.0).contains(&sample_time)),
        ("the length of a run", seconds, "from 1 s to 1 h", (1.0..=3600.0).contains(&seconds)),
        ("the least mass", mass[0], "from 1 kg", mass[0] >= 1.0 && mass[0] <= mass[1]),
        ("the greatest mass", mass[1], "up to 10 kg", mass[1] <= 10.0),
        ("the amplitude", amplitude, "from 0 to 1", (0.0..=1.0).contains(&amplitude)),
        ("the noise", noise, "from 0 to 1", (0.0..=1.0).contains(&noise)),
    ] {
        if !holds {
            return Err(TrainError::Option { what, value, must });
        }
    }
    let mut runs = Vec::with_capacity(excitation.runs);
    for number in 0..excitation.runs {
        runs.push(run(excitation, number)?);
        done(number);
    }
    Ok(runs)
}

fn run(excitation: &Excitation, number: usize) -> Result<Vec<Sample>, TrainError> {
    let Excitation { seconds, sample_time, mass, amplitude, noise, seed, .. } = *excitation;
    let mut random = Random::stream(seed, number as u64);
    let rig = |e: &dyn std::fmt::Display| TrainError::Rig(e.to_string());
    let plant = ThreeDof::rig(random.between(mass[0], mass[1]));
    let air = Vector3::from(AIR).map(|kg| kg * random.between(0.97, 1.05));
    let start = plant.equilibrium(&air, Vector3::new(0.008, 0.037, 0.0)).map_err(|e| rig(&e))?;
    let slopes = plant.pose_by_air(&air, start).map_err(|e| rig(&e))? * plant.inlet_flow(NOMINAL);
    let effect =
        Effect::new(DMatrix::from_fn(3, 3, |i, j| slopes[(i, j)] / SCALE[i])).map_err(|e| rig(&e))?;
    let mut law = Pi::new(PiGains { proportional: 1.0, integral: 0.15 }, effect);
    let mut model = ReferenceModel::new(pole_of_rise(2.0), 3);
    let sines = sines(&mut random, amplitude);
    let mut state = State::at_rest(start, air);
    let (mut target, mut until) = ([0.0; 3], 0.0);
    let (mut net, mut duty) = ([0.0; 3], [0.0; 6]);
    let steps = (sample_time / STEP).round().max(1.0) as usize;
    let count = (seconds / sample_time).round() as usize;
    let mut samples = Vec::with_capacity(count);
    for k in 0..count {
        let t = k as f64 * sample_time;
        if t >= until {
            target = TARGETS.map(|[low, high]| random.between(low, high));
            until = t + random.between(STAY[0], STAY[1]);
        }
        let pose: [f64; 3] =
            std::array::from_fn(|i| (state.position[i] - start[i]) / SCALE[i] + noise * random.normal());
        model.advance(&target, sample_time);
        let error: [f64; 3] = std::array::from_fn(|i| pose[i] - model.at()[i]);
        // The excitation needs no feed-forward, and the pose is of this moment.
        law.step(&Errors { seen: &error, predicted: &error, speed: &[0.0; 3] }, sample_time, &mut net);
        for (v, sines) in net.iter_mut().zip(&sines) {
            let wave = |s: &Sine| s.amplitude * libm::sin(std::f64::consts::TAU * s.frequency * t + s.phase);
            *v += sines.iter().map(wave).sum::<f64>();
        }
        clip(&mut net);
        let _ = split(&net, &mut duty);
        samples.push(Sample { pose: pose.to_vec(), duty: duty.to_vec() });
        let mut drive = plant.idle();
        drive.duty = std::array::from_fn(|j| [duty[2 * j], duty[2 * j + 1]]);
        for _ in 0..steps {
            state = plant.advance(&state, &drive, sample_time / steps as f64);
        }
    }
    Ok(samples)
}

/// Sines of frequencies spread evenly over the octaves, so that their sum stays within twice the amplitude.
fn sines(random: &mut Random, amplitude: f64) -> [Vec<Sine>; 3] {
    std::array::from_fn(|_| {
        let one = |i: usize| {
            let part = (i as f64 + random.uniform()) / SINES as f64;
            let frequency = FREQUENCIES[0] * libm::pow(FREQUENCIES[1] / FREQUENCIES[0], part);
            let amplitude = amplitude * 2.0 / SINES as f64;
            Sine { amplitude, frequency, phase: random.between(0.0, std::f64::consts::TAU) }
        };
        (0..SINES).map(one).collect()
    })
}
