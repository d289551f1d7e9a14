//! Epochs, validation and checkpoints.

use std::path::Path;

use candle_core::{Device, Tensor};
use serde::{Deserialize, Serialize};
use stillpoint_network::{Model, Sizes};
use stillpoint_random::Random;

use super::adam::Adam;
use super::checkpoint::Checkpoint;
use super::examples::{Example, scales};
use super::gather::BEAMS;
use super::loss::{Weights, loss};
use super::network::{Loaded, Network};
use crate::TrainError;

/// Stream of the states by which an epoch is validated: the same in every epoch.
const VALIDATION: u64 = u64::MAX - 1;

/// How the network is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Widths of its layers.
    pub sizes: Sizes,
    /// Weights of the loss.
    pub weights: Weights,
    /// Learning rate of the first epoch; it falls to a twentieth along a half wave of a cosine.
    pub rate: f64,
    /// Epochs.
    pub epochs: usize,
    /// Sets of a case in a step.
    pub sets: usize,
    /// States of the policy in a step.
    pub states: usize,
    /// Of weights, order and draws.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            sizes: Sizes::default(),
            weights: Weights { mse: 3000.0, ce: 0.03, lambda: 3e-4 },
            rate: 3e-3,
            epochs: 24,
            sets: 96,
            states: 8,
            seed: 1,
        }
    }
}

/// What an epoch brought.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Its number, from 1.
    pub number: usize,
    /// Mean loss of its steps.
    pub training: f64,
    /// Loss over the cases that are not trained on.
    pub validation: f64,
    /// Mean percent by which the solved set of the best value, of those cases, costs more than the best solved set.
    pub above_percent: f64,
}

/// A trained network.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The network of the epoch with the least validation loss.
    pub model: Model,
    /// All epochs.
    pub epochs: Vec<Epoch>,
    /// Number of the best.
    pub best: usize,
}

/// Trains a network, and calls `done` after each epoch. With a checkpoint, a training that was cut off resumes after its last
/// epoch with the same numbers as if it had not been.
pub fn fit(
    train: &[Example],
    validate: &[Example],
    options: &Options,
    checkpoint: Option<&Path>,
    mut done: impl FnMut(&Epoch),
) -> Result<Fitted, TrainError> {
    check(train, validate, options)?;
    let network = Network::new(options.sizes, scales(train), options.seed)?;
    let loaded = |all: &[Example]| all.iter().map(|e| network.load(e)).collect::<Result<Vec<Loaded>, _>>();
    let (trained_on, validated_on) = (loaded(train)?, loaded(validate)?);
    let mut adam = Adam::new(network.vars());
    let mut epochs: Vec<Epoch> = Vec::new();
    let mut best = (0, network.numbers()?);
    if let Some(path) = checkpoint.filter(|path| path.exists()) {
        let found = Checkpoint::read(path)?;
        if found.options != *options {
            let why =
                "it is of a training with other options; give another folder, or the same options".to_owned();
            return Err(TrainError::File { path: path.to_owned(), why });
        }
        network.set(&found.numbers)?;
        (adam, epochs, best) = (found.adam, found.epochs, found.best);
    }
    for number in epochs.len() + 1..=options.epochs {
        let mut random = Random::stream(options.seed, number as u64);
        let part = number as f64 / options.epochs as f64;
        let rate = options.rate * (0.05 + 0.475 * (1.0 + libm::cos(core::f64::consts::PI * part)));
        let mut order: Vec<usize> = (0..train.len()).collect();
        random.shuffle(&mut order);
        let mut sum = 0.0;
        for case in order {
            let found = step_loss(&network, &train[case], &trained_on[case], options, &mut random)?;
            adam.step(network.vars(), &found.backward()?, rate)?;
            sum += f64::from(found.to_scalar::<f32>()?);
        }
        let mut random = Random::stream(options.seed, VALIDATION);
        let (mut validation, mut above) = (0.0, 0.0);
        for (example, x) in validate.iter().zip(&validated_on) {
            let found = step_loss(&network, example, x, options, &mut random)?;
            validation += f64::from(found.to_scalar::<f32>()?) / validate.len() as f64;
            above += above_percent(&network, example, x)? / validate.len() as f64;
        }
        let epoch = Epoch { number, training: sum / train.len() as f64, validation, above_percent: above };
        if !(epoch.training.is_finite() && epoch.validation.is_finite()) {
            return Err(TrainError::RanAway(number));
        }
        done(&epoch);
        epochs.push(epoch);
        let least = epochs.iter().filter(|e| e.number == best.0).map(|e| e.validation).next();
        if least.is_none_or(|least| validation < least) {
            best = (number, network.numbers()?);
        }
        if let Some(path) = checkpoint {
            let (epochs, numbers) = (epochs.clone(), network.numbers()?);
            let adam = adam.clone();
            Checkpoint { options: options.clone(), epochs, numbers, adam, best: best.clone() }.write(path)?;
        }
    }
    Ok(Fitted { model: network.model(&best.1)?, epochs, best: best.0 })
}

fn check(train: &[Example], validate: &[Example], options: &Options) -> Result<(), TrainError> {
    for (what, found) in [("train on", train.len()), ("validate on", validate.len())] {
        if found == 0 {
            return Err(TrainError::TooLittle { what, found, needed: 1 });
        }
    }
    for (what, value, must, holds) in [
        ("the learning rate", options.rate, "above 0, up to 1", options.rate > 0.0 && options.rate <= 1.0),
        ("the number of epochs", options.epochs as f64, "at least 1", options.epochs > 0),
        ("the number of sets of a step", options.sets as f64, "at least 1", options.sets > 0),
        ("the number of states of a step", options.states as f64, "at least 1", options.states > 0),
        ("the widest layer", 0.0, "from 1 to 512", options.sizes.are_sound()),
    ] {
        if !holds {
            return Err(TrainError::Option { what, value, must });
        }
    }
    Ok(())
}

/// The loss of one case: some of its sets, and states that keep a drawn number of beams.
fn step_loss(
    network: &Network,
    example: &Example,
    x: &Loaded,
    options: &Options,
    random: &mut Random,
) -> Result<Tensor, TrainError> {
    let mut chosen: Vec<usize> = (0..example.sets.len()).collect();
    random.shuffle(&mut chosen);
    chosen.truncate(options.sets);
    let sets: Vec<&Vec<u16>> = chosen.iter().map(|i| &example.sets[*i]).collect();
    // zeta = cost / (cost + reference) lies between 0 and 1; v is the network's, from its logarithm.
    let zeta: Vec<f32> = chosen.iter().map(|i| (1.0 / (1.0 + libm::exp(-example.logs[*i]))) as f32).collect();
    let zeta = Tensor::from_vec(zeta, sets.len(), &Device::Cpu)?;
    let kept = ((BEAMS as f64 * random.uniform()) as usize).min(BEAMS - 1);
    let states = example.states(options.states, kept, random)?;
    let width = states.pi.first().map_or(0, Vec::len);
    let pi = Tensor::from_vec(states.pi.concat(), (states.pi.len(), width), &Device::Cpu)?;
    let said = network.forward(x)?;
    let v = candle_nn::ops::sigmoid(&said.values(&sets)?)?;
    let psi: Vec<Tensor> = network.vars().iter().map(|v| v.as_tensor().clone()).collect();
    loss((&zeta, &v), (&pi, &said.logits(&states)?), &psi, options.weights)
}

fn above_percent(network: &Network, example: &Example, x: &Loaded) -> Result<f64, TrainError> {
    let sets: Vec<&Vec<u16>> = example.sets.iter().collect();
    let values = network.forward(x)?.values(&sets)?.to_vec1::<f32>()?;
    let chosen = values.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
    let best = example.logs.iter().copied().fold(f64::INFINITY, f64::min);
    Ok(100.0 * (libm::exp(example.logs[chosen] - best) - 1.0))
}
