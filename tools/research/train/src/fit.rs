//! Descent, validation and early stop.

use candle_core::Tensor;
use candle_nn::optim::{AdamW, Optimizer, ParamsAdamW, SGD};
use stillpoint_control::lstm::Lstm;
use stillpoint_mechanics::random::Random;

use crate::TrainError;
use crate::dataset::{Batch, Dataset};
use crate::network::{Dropout, Network};

/// How the gradient is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Optimiser {
    /// w -= alpha times the mean gradient of a batch: (4.40) with eta 1, for eta below 1 is a decay of the weights and no
    /// acceleration (SCIENCE E9).
    Sgd,
    /// Adam with decoupled decay of the weights (Loshchilov and Hutter, 2019).
    AdamW,
}

/// How a network is trained.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Options {
    /// How the gradient is followed.
    pub optimiser: Optimiser,
    pub learning_rate: f64,
    /// Windows of a batch.
    pub batch: usize,
    /// Probability with which a number between layers is dropped.
    pub dropout: f64,
    /// Cells of each layer.
    pub hidden: Vec<usize>,
    pub epochs: usize,
    /// Epochs without a better validation after which training stops.
    pub patience: usize,
    /// Of weights, order and dropout.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            optimiser: Optimiser::Sgd,
            learning_rate: 5e-3,
            batch: 50,
            dropout: 0.3,
            hidden: vec![9, 6, 6],
            epochs: 200,
            patience: 20,
            seed: 1,
        }
    }
}

/// What an epoch brought.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Epoch {
    /// Its number, from 1.
    pub number: usize,
    /// Mean loss of its batches, with dropout.
    pub training: f64,
    /// Loss over the runs that are not trained on, without dropout.
    pub validation: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The network of the best epoch.
    pub network: Lstm,
    pub epochs: Vec<Epoch>,
    /// Number of the best.
    pub best: usize,
    /// Root mean square of the prediction error of each channel over the validation runs, as a fraction of the root
    /// mean square of the change.
    pub left: Vec<f64>,
}

/// The best epoch so far.
struct Best {
    loss: f64,
    number: usize,
    numbers: Vec<Vec<f32>>,
}

enum Descent {
    Sgd(SGD),
    AdamW(AdamW),
}

impl Descent {
    fn new(options: &Options, network: &Network) -> Result<Self, TrainError> {
        let lr = options.learning_rate;
        Ok(match options.optimiser {
            Optimiser::Sgd => Self::Sgd(SGD::new(network.vars(), lr)?),
            Optimiser::AdamW => {
                Self::AdamW(AdamW::new(network.vars(), ParamsAdamW { lr, ..ParamsAdamW::default() })?)
            }
        })
    }

    fn step(&mut self, loss: &Tensor) -> Result<(), TrainError> {
        match self {
            Self::Sgd(sgd) => sgd.backward_step(loss)?,
            Self::AdamW(adam) => adam.backward_step(loss)?,
        }
        Ok(())
    }
}

/// Trains a network, and calls `done` after each epoch.
///
/// # Errors
/// Options that cannot be, or a descent that leaves the finite numbers.
pub fn fit(data: &Dataset, options: &Options, mut done: impl FnMut(&Epoch)) -> Result<Fitted, TrainError> {
    let Options { batch, dropout: probability, learning_rate, ref hidden, .. } = *options;
    let odd_cells = hidden.iter().find(|cells| !(1..=4096).contains(*cells));
    for (what, value, must, holds) in [
        (
            "the batch",
            batch as f64,
            "from 1 to the windows that there are",
            (1..=data.counts().0).contains(&batch),
        ),
        ("the dropout", probability, "from 0 to 0.9", (0.0..=0.9).contains(&probability)),
        (
            "the learning rate",
            learning_rate,
            "above 0, up to 10",
            learning_rate > 0.0 && learning_rate <= 10.0,
        ),
        ("the number of epochs", options.epochs as f64, "at least 1", options.epochs > 0),
        ("the number of layers", hidden.len() as f64, "from 1 to 16", (1..=16).contains(&hidden.len())),
        (
            "the number of cells of a layer",
            odd_cells.map_or(f64::NAN, |cells| *cells as f64),
            "from 1 to 4096",
            odd_cells.is_none(),
        ),
    ] {
        if !holds {
            return Err(TrainError::Option { what, value, must });
        }
    }
    let network = Network::new(data.inputs(), hidden, data.outputs(), options.seed)?;
    let mut descent = Descent::new(options, &network)?;
    let validation = data.validation();
    let mut epochs: Vec<Epoch> = Vec::new();
    let mut best: Option<Best> = None;
    for number in 1..=options.epochs {
        let mut random = Random::stream(options.seed, number as u64);
        let (mut sum, mut batches) = (0.0, 0usize);
        // The order is drawn first, then what is dropped.
        let all: Vec<_> = data.batches(batch, &mut random).collect();
        for given in &all {
            let dropout = (probability > 0.0).then_some(Dropout { probability, random: &mut random });
            let predicted = network.forward(&given.inputs, data.window(), dropout)?;
            let loss = network.loss(&predicted, &given.changes)?;
            descent.step(&loss)?;
            sum += f64::from(loss.to_scalar::<f32>()?);
            batches += 1;
        }
        let loss = validated(&network, data, &validation)?;
        let epoch = Epoch { number, training: sum / batches.max(1) as f64, validation: loss };
        if !(epoch.training.is_finite() && epoch.validation.is_finite()) {
            return Err(TrainError::RanAway(number));
        }
        done(&epoch);
        epochs.push(epoch);
        if best.as_ref().is_none_or(|best| loss < best.loss) {
            best = Some(Best { loss, number, numbers: network.numbers()? });
        }
        if best.as_ref().is_some_and(|best| number - best.number >= options.patience) {
            break;
        }
    }
    let best = best.ok_or(TrainError::RanAway(0))?;
    let network = network.plain(&best.numbers).map_err(|e| TrainError::Predictor(e.into()))?;
    let hold = validation.errors(data.outputs(), |_, _, predicted| predicted.fill(0.0));
    let left = errors(&network, &validation).iter().zip(&hold).map(|(error, hold)| error / hold).collect();
    Ok(Fitted { network, epochs, best: best.number, left })
}

/// The loss over windows that are not trained on, some of them at a time, because tensors keep all steps in memory.
fn validated(network: &Network, data: &Dataset, batch: &Batch) -> Result<f64, TrainError> {
    const ROWS: usize = 2000;
    let (width, outputs) = (data.inputs() * data.window(), data.outputs());
    let mut sum = 0.0;
    for (inputs, changes) in batch.inputs.chunks(ROWS * width).zip(batch.changes.chunks(ROWS * outputs)) {
        let predicted = network.forward(inputs, data.window(), None)?;
        let loss = f64::from(network.loss(&predicted, changes)?.to_scalar::<f32>()?);
        sum += loss * (changes.len() / outputs) as f64;
    }
    Ok(sum / batch.count as f64)
}

/// The root mean square of the error of a network for each change, in parts of the change's scale, by the plain code that
/// controllers run. A batch has windows of samples of as many numbers as the network has inputs.
#[must_use]
pub fn errors(network: &Lstm, batch: &Batch) -> Vec<f64> {
    let (mut memory, mut x) = (network.memory(), vec![0.0; network.inputs()]);
    batch.errors(network.outputs(), |_, window, predicted| {
        memory.clear();
        for sample in window.chunks_exact(x.len()) {
            x.iter_mut().zip(sample).for_each(|(x, value)| *x = f64::from(*value));
            network.step(&x, &mut memory);
        }
        network.output(&memory, predicted);
    })
}
