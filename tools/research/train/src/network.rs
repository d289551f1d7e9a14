//! The network of `stillpoint_control::lstm` as tensors, with gradients (4.40).

use candle_core::{D, DType, Device, Tensor, Var};
use stillpoint_control::lstm::{Layer, Lstm, NetworkError};
use stillpoint_mechanics::random::Random;

use crate::TrainError;
use crate::device::device;

/// A layer: rows in the order i, f, g, o.
struct Cells {
    w_ih: Var,
    w_hh: Var,
    bias: Var,
    hidden: usize,
}

/// A network whose numbers can be trained.
pub struct Network {
    layers: Vec<Cells>,
    w: Var,
    bias: Var,
    inputs: usize,
    device: Device,
}

/// Drops numbers between layers while the network trains: each with this probability, the others made up for it.
pub struct Dropout<'a> {
    /// From 0 to below 1.
    pub probability: f64,
    pub(crate) random: &'a mut Random,
}

impl Network {
    /// A network of layers of these sizes. Numbers begin uniformly within 1 over the root of the cells of their layer.
    ///
    /// # Errors
    /// An operation on tensors failed.
    pub fn new(inputs: usize, hidden: &[usize], outputs: usize, seed: u64) -> Result<Self, TrainError> {
        let device = device()?.clone();
        let mut random = Random::stream(seed, u64::MAX);
        let mut uniform = |rows: usize, columns: usize, cells: usize| -> Result<Var, TrainError> {
            let bound = 1.0 / libm::sqrt(cells as f64);
            let numbers: Vec<f32> =
                (0..rows * columns).map(|_| random.between(-bound, bound) as f32).collect();
            Ok(Var::from_tensor(&Tensor::from_vec(numbers, (rows, columns), &device)?)?)
        };
        let (mut layers, mut below) = (Vec::new(), inputs);
        for &h in hidden {
            let (w_ih, w_hh) = (uniform(4 * h, below, h)?, uniform(4 * h, h, h)?);
            layers.push(Cells { w_ih, w_hh, bias: uniform(1, 4 * h, h)?, hidden: h });
            below = h;
        }
        let (w, bias) = (uniform(outputs, below, below)?, uniform(1, outputs, below)?);
        Ok(Self { layers, w, bias, inputs, device })
    }

    /// All that is trained.
    #[must_use]
    pub fn vars(&self) -> Vec<Var> {
        let layers = self.layers.iter().flat_map(|l| [&l.w_ih, &l.w_hh, &l.bias]);
        layers.chain([&self.w, &self.bias]).cloned().collect()
    }

    /// What it says after windows of `window` samples each, a row for each window.
    ///
    /// # Errors
    /// An operation on tensors failed.
    pub fn forward(
        &self,
        numbers: &[f32],
        window: usize,
        dropout: Option<Dropout<'_>>,
    ) -> Result<Tensor, TrainError> {
        let hidden = self.hidden(numbers, window, dropout)?;
        let last = hidden.last().ok_or(NetworkError::Empty).map_err(|e| TrainError::Predictor(e.into()))?;
        self.predicted(last)
    }

    /// What it says after each sample of windows of `window` samples: the windows after the first sample, then the
    /// windows after the second, and so on.
    ///
    /// # Errors
    /// An operation on tensors failed.
    pub fn forward_all(&self, numbers: &[f32], window: usize) -> Result<Tensor, TrainError> {
        let predicted: Result<Vec<Tensor>, _> =
            self.hidden(numbers, window, None)?.iter().map(|h| self.predicted(h)).collect();
        Ok(Tensor::cat(&predicted?, 0)?)
    }

    fn predicted(&self, hidden: &Tensor) -> Result<Tensor, TrainError> {
        Ok(hidden.matmul(&self.w.t()?)?.broadcast_add(&self.bias)?)
    }

    /// The last layer's hidden state after each sample of the windows.
    fn hidden(
        &self,
        numbers: &[f32],
        window: usize,
        mut dropout: Option<Dropout<'_>>,
    ) -> Result<Vec<Tensor>, TrainError> {
        let rows = numbers.len() / (window * self.inputs);
        let x = Tensor::from_slice(numbers, (rows, window, self.inputs), &self.device)?;
        let mut steps: Vec<Tensor> =
            (0..window).map(|t| x.narrow(1, t, 1)?.squeeze(1)).collect::<Result<_, _>>()?;
        for (place, layer) in self.layers.iter().enumerate() {
            if let Some(dropout) = dropout.as_mut().filter(|_| place > 0) {
                steps = steps.iter().map(|x| dropout.applied(x)).collect::<Result<_, _>>()?;
            }
            steps = layer.over(&steps)?;
        }
        Ok(steps)
    }

    /// Mean over the windows of half the sum of squares (4.39).
    ///
    /// # Errors
    /// An operation on tensors failed.
    pub fn loss(&self, predicted: &Tensor, changes: &[f32]) -> Result<Tensor, TrainError> {
        let (rows, outputs) = predicted.dims2()?;
        let expected = Tensor::from_slice(changes, (rows, outputs), &self.device)?;
        Ok(((predicted - expected)?.sqr()?.sum_all()? * (0.5 / rows as f64))?)
    }

    /// The numbers as they are now.
    ///
    /// # Errors
    /// An operation on tensors failed.
    pub fn numbers(&self) -> Result<Vec<Vec<f32>>, TrainError> {
        self.vars().iter().map(|v| Ok(v.flatten_all()?.to_vec1::<f32>()?)).collect()
    }

    /// Puts these numbers in, in the order and the sizes of [`numbers`](Self::numbers).
    ///
    /// # Errors
    /// Numbers of other sizes.
    pub fn set(&self, numbers: &[Vec<f32>]) -> Result<(), TrainError> {
        for (var, numbers) in self.vars().iter().zip(numbers) {
            var.set(&Tensor::from_slice(numbers, var.dims(), &self.device)?)?;
        }
        Ok(())
    }

    /// The network that runs without tensors, with the numbers of [`numbers`](Self::numbers).
    ///
    /// # Errors
    /// Numbers that make no network.
    pub fn plain(&self, numbers: &[Vec<f32>]) -> Result<Lstm, NetworkError> {
        let wide = |v: &[f32]| v.iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
        let (mut layers, mut below) = (Vec::new(), self.inputs);
        let (of_layers, output) = numbers.split_at(3 * self.layers.len());
        for (layer, n) in self.layers.iter().zip(of_layers.chunks_exact(3)) {
            layers.push(Layer::new(below, wide(&n[0]), wide(&n[1]), wide(&n[2]))?);
            below = layer.hidden;
        }
        let [w, bias] = output else { return Err(NetworkError::Empty) };
        Lstm::new(layers, wide(w), wide(bias))
    }
}

impl Cells {
    /// The hidden states over the steps of a window, from an empty memory.
    fn over(&self, steps: &[Tensor]) -> Result<Vec<Tensor>, TrainError> {
        let Some(first) = steps.first() else { return Ok(Vec::new()) };
        let (w_ih, w_hh) = (self.w_ih.t()?, self.w_hh.t()?);
        let zeros = Tensor::zeros((first.dim(0)?, self.hidden), DType::F32, first.device())?;
        let (mut h, mut c) = (zeros.clone(), zeros);
        let mut hidden = Vec::with_capacity(steps.len());
        for x in steps {
            let gates = (x.matmul(&w_ih)? + h.matmul(&w_hh)?)?.broadcast_add(&self.bias)?;
            let gate = |place: usize| gates.narrow(D::Minus1, place * self.hidden, self.hidden);
            let sigmoid = |x: Tensor| candle_nn::ops::sigmoid(&x);
            let (i, f, g, o) = (sigmoid(gate(0)?)?, sigmoid(gate(1)?)?, gate(2)?.tanh()?, sigmoid(gate(3)?)?);
            c = ((f * &c)? + (i * g)?)?;
            h = (o * c.tanh()?)?;
            hidden.push(h.clone());
        }
        Ok(hidden)
    }
}

impl Dropout<'_> {
    fn applied(&mut self, x: &Tensor) -> Result<Tensor, TrainError> {
        let retained = (1.0 / (1.0 - self.probability)) as f32;
        let one = |_| if self.random.uniform() < self.probability { 0.0 } else { retained };
        let mask: Vec<f32> = (0..x.elem_count()).map(one).collect();
        Ok((x * Tensor::from_vec(mask, x.dims(), x.device())?)?)
    }
}
