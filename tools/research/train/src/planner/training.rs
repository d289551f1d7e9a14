//! The descent: passes over examples, with a checkpoint from which it resumes to the bit.

use std::path::Path;

use candle_core::Tensor;
use serde::{Deserialize, Serialize};
use stillpoint_mechanics::random::Random;
use stillpoint_network::groups::leave_out;
use stillpoint_network::model::{TAPS, WIDEST};
use stillpoint_network::{Group, Model, Sizes};

use super::adam::Adam;
use super::checkpoint::Checkpoint;
use super::examples::Example;
use super::loss::{Weights, loss};
use super::network::{Loaded, Network};
use crate::TrainError;
use crate::device::device;

/// Stream of the states by which a pass is validated: the same after every pass.
const VALIDATION: u64 = u64::MAX - 1;

/// How the network is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Options {
    /// Widths of its layers.
    pub sizes: Sizes,
    /// Weights of the loss.
    pub weights: Weights,
    /// Learning rate of the first pass; it falls to a twentieth along a half wave of a cosine.
    pub rate: f64,
    /// All passes of the training.
    pub passes: usize,
    /// Sets of a patient in a step.
    pub sets: usize,
    /// States of the policy in a step.
    pub states: usize,
    /// Of first numbers, order and draws.
    pub seed: u64,
    /// Groups of features that are left out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub without: Vec<Group>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            sizes: Sizes::default(),
            weights: Weights { mse: 3000.0, ce: 0.03, lambda: 3e-4 },
            rate: 3e-3,
            passes: 24,
            sets: 96,
            states: 8,
            seed: 1,
            without: Vec::new(),
        }
    }
}

/// What a pass over the examples brought.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pass {
    /// Its number, from 1.
    pub number: usize,
    pub examples: usize,
    /// Mean loss of its steps.
    pub training: f64,
    /// Loss over the examples that are not trained on.
    pub validation: f64,
    /// Mean percent by which the solved set of the best value, of those examples, costs more than the best solved set.
    pub above_percent: f64,
}

/// An example, ready for the descent.
pub struct Ready {
    example: Example,
    loaded: Loaded,
}

/// A training between two passes.
pub struct Training {
    /// What is trained on; a checkpoint of another training is refused.
    about: String,
    options: Options,
    network: Network,
    adam: Adam,
    passes: Vec<Pass>,
}

impl Training {
    /// Before the first pass. `about` says what is trained on; `scales` are means and scales of the features.
    ///
    /// # Errors
    /// An option that cannot be.
    pub fn new(about: String, options: Options, mut scales: Vec<Vec<f32>>) -> Result<Self, TrainError> {
        check(&options)?;
        leave_out(&options.without, &mut scales);
        let network = Network::new(options.sizes, scales, options.seed)?;
        let adam = Adam::new(network.vars());
        Ok(Self { about, options, network, adam, passes: Vec::new() })
    }

    /// Goes on where the training of this checkpoint stood.
    ///
    /// # Errors
    /// The file cannot be read, or is of a training with other options.
    pub fn resume(&mut self, checkpoint: &Path) -> Result<(), TrainError> {
        let found = Checkpoint::read(checkpoint)?;
        if (&found.about, &found.options) != (&self.about, &self.options) {
            let why = "it is of a training with other patients, games or options; give another folder, or the same command";
            return Err(TrainError::File { path: checkpoint.to_owned(), why: why.to_owned() });
        }
        self.network.set(&found.numbers)?;
        (self.adam, self.passes) = (found.adam, found.passes);
        Ok(())
    }

    /// Writes the checkpoint.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn keep(&self, checkpoint: &Path) -> Result<(), TrainError> {
        let (about, options, passes) = (self.about.clone(), self.options.clone(), self.passes.clone());
        let (numbers, adam) = (self.network.numbers()?, self.adam.clone());
        Checkpoint { about, options, passes, numbers, adam }.write(checkpoint)
    }

    /// The passes until now.
    pub fn passes(&self) -> &[Pass] {
        &self.passes
    }

    /// The network as it stands.
    ///
    /// # Errors
    /// The numbers are not finite.
    pub fn model(&self) -> Result<Model, TrainError> {
        self.network.model(&self.network.numbers()?)
    }

    /// Makes an example ready.
    ///
    /// # Errors
    /// An operation on tensors.
    pub fn ready(&self, example: Example) -> Result<Ready, TrainError> {
        Ok(Ready { loaded: self.network.load(&example)?, example })
    }

    /// A step down the loss for each example, in an order drawn for this pass.
    ///
    /// # Errors
    /// No example, or a loss that is not finite.
    pub fn pass(&mut self, examples: &[&Ready], validate: &[Ready]) -> Result<Pass, TrainError> {
        for (what, found) in [("train on", examples.len()), ("validate on", validate.len())] {
            if found == 0 {
                return Err(TrainError::TooLittle { what, found, needed: 1 });
            }
        }
        let options = &self.options;
        let number = self.passes.len() + 1;
        let mut random = Random::stream(options.seed, number as u64);
        let part = (number as f64 / options.passes as f64).min(1.0);
        let rate = options.rate * (0.05 + 0.475 * (1.0 + libm::cos(core::f64::consts::PI * part)));
        let mut order: Vec<usize> = (0..examples.len()).collect();
        random.shuffle(&mut order);
        let mut sum = 0.0;
        for place in order {
            let found = step_loss(&self.network, examples[place], options, &mut random)?;
            self.adam.step(self.network.vars(), &found.backward()?, rate)?;
            sum += f64::from(found.to_scalar::<f32>()?);
        }
        let mut random = Random::stream(options.seed, VALIDATION);
        let (mut validation, mut above) = (0.0, 0.0);
        for ready in validate {
            let found = step_loss(&self.network, ready, options, &mut random)?;
            validation += f64::from(found.to_scalar::<f32>()?) / validate.len() as f64;
            above += above_percent(&self.network, ready)? / validate.len() as f64;
        }
        let training = sum / examples.len() as f64;
        let pass = Pass { number, examples: examples.len(), training, validation, above_percent: above };
        if !(pass.training.is_finite() && pass.validation.is_finite()) {
            return Err(TrainError::RanAway(number));
        }
        self.passes.push(pass);
        Ok(pass)
    }
}

/// Refuses options that cannot be.
pub fn check(options: &Options) -> Result<(), TrainError> {
    let Sizes { structure, ring, angle, neighbour, pair, set, layers } = options.sizes;
    let wrong =
        [structure, ring, angle, neighbour, pair, set].into_iter().find(|n| !(1..=WIDEST).contains(n));
    for (what, value, must, holds) in [
        ("the learning rate", options.rate, "above 0, up to 1", options.rate > 0.0 && options.rate <= 1.0),
        ("the number of passes", options.passes as f64, "at least 1", options.passes > 0),
        ("the number of sets of a step", options.sets as f64, "at least 1", options.sets > 0),
        ("the number of states of a step", options.states as f64, "at least 1", options.states > 0),
        ("the number of layers", layers as f64, "1 to 4", (1..=TAPS.len()).contains(&layers)),
        ("a width of a layer", wrong.unwrap_or(1) as f64, "1 to 512", wrong.is_none()),
    ] {
        if !holds {
            return Err(TrainError::Option { what, value, must });
        }
    }
    Ok(())
}

/// The loss of one patient: some of its sets, and states that keep a drawn number of beams.
fn step_loss(
    network: &Network,
    ready: &Ready,
    options: &Options,
    random: &mut Random,
) -> Result<Tensor, TrainError> {
    let example = &ready.example;
    let mut chosen: Vec<usize> = (0..example.sets.len()).collect();
    random.shuffle(&mut chosen);
    chosen.truncate(options.sets);
    let sets: Vec<&Vec<u16>> = chosen.iter().map(|i| &example.sets[*i]).collect();
    let (zeta, shift, weight) = example.targets(&chosen);
    let device = device()?;
    let column = |values: Vec<f32>| Tensor::from_vec(values, chosen.len(), device);
    let (zeta, weight) = (column(zeta)?, column(weight)?);
    let beams = sets.first().map_or(1, |set| set.len());
    let retained = ((beams as f64 * random.uniform()) as usize).min(beams - 1);
    let states = example.states(options.states, retained, random)?;
    let width = states.pi.first().map_or(0, Vec::len);
    let pi = Tensor::from_vec(states.pi.concat(), (states.pi.len(), width), device)?;
    let predicted = network.forward(&ready.loaded)?;
    // Which set is better matters, not what a patient costs: the mean is that of the sets themselves.
    let values = predicted.values(&sets)?;
    let off = (values.mean_all()? - shift)?;
    let v = candle_nn::ops::sigmoid(&values.broadcast_sub(&off)?)?;
    let (zeta, v) = ((zeta * &weight)?, (v * &weight)?);
    let psi: Vec<Tensor> = network.vars().iter().map(|v| v.as_tensor().clone()).collect();
    loss((&zeta, &v), (&pi, &predicted.logits(&states)?), &psi, options.weights)
}

fn above_percent(network: &Network, ready: &Ready) -> Result<f64, TrainError> {
    let example = &ready.example;
    let sets: Vec<&Vec<u16>> = example.sets.iter().collect();
    let values = network.forward(&ready.loaded)?.values(&sets)?.to_vec1::<f32>()?;
    let chosen = values.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
    let best = example.logs.iter().copied().fold(f64::INFINITY, f64::min);
    Ok(100.0 * (libm::exp(example.logs[chosen] - best) - 1.0))
}
