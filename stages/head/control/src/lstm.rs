//! A recurrent network of long short-term memory (4.26), (4.39), SCIENCE E8: one step of it, without a heap.
//!
//! ```text
//! (i, f, g, o) = W_ih x + W_hh h + b,   c' = sigma(f) c + sigma(i) tanh(g),   h' = sigma(o) tanh(c')
//! ```

/// One layer. Matrices are row by row; rows stand in the order i, f, g, o, `hidden` of each.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    inputs: usize,
    hidden: usize,
    w_ih: Vec<f64>,
    w_hh: Vec<f64>,
    bias: Vec<f64>,
}

/// Layers one above the other, and a linear map of the last hidden state.
#[derive(Clone, Debug, PartialEq)]
pub struct Lstm {
    layers: Vec<Layer>,
    outputs: usize,
    w: Vec<f64>,
    bias: Vec<f64>,
}

/// Numbers that do not make a network.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NetworkError {
    /// There is no layer, or one without inputs or cells.
    #[error("a network needs at least one layer, of at least one input and one cell")]
    Empty,
    /// A matrix of another size.
    #[error("{what} has {found} numbers where {expected} are expected")]
    Size {
        /// Name of the quantity.
        what: String,
        found: usize,
        /// Numbers that it must have.
        expected: usize,
    },
    /// A number that is none.
    #[error("{0} has a number that is not finite")]
    NotFinite(String),
}

fn checked(what: impl Fn() -> String, numbers: &[f64], expected: usize) -> Result<(), NetworkError> {
    if numbers.len() != expected {
        return Err(NetworkError::Size { what: what(), found: numbers.len(), expected });
    }
    if numbers.iter().any(|v| !v.is_finite()) {
        return Err(NetworkError::NotFinite(what()));
    }
    Ok(())
}

impl Layer {
    /// A layer of `inputs` inputs and as many cells as a quarter of `bias`.
    ///
    /// # Errors
    /// [`NetworkError`].
    pub fn new(inputs: usize, w_ih: Vec<f64>, w_hh: Vec<f64>, bias: Vec<f64>) -> Result<Self, NetworkError> {
        let hidden = bias.len() / 4;
        if inputs == 0 || hidden == 0 {
            return Err(NetworkError::Empty);
        }
        checked(|| "the bias of a layer".into(), &bias, 4 * hidden)?;
        checked(|| "the input weights of a layer".into(), &w_ih, 4 * hidden * inputs)?;
        checked(|| "the recurrent weights of a layer".into(), &w_hh, 4 * hidden * hidden)?;
        Ok(Self { inputs, hidden, w_ih, w_hh, bias })
    }

    #[must_use]
    pub fn hidden(&self) -> usize {
        self.hidden
    }

    fn step(&self, x: &[f64], gates: &mut [f64], h: &mut [f64], c: &mut [f64]) {
        let rows = self.w_ih.chunks_exact(self.inputs).zip(self.w_hh.chunks_exact(self.hidden));
        for ((gate, bias), (w_ih, w_hh)) in gates.iter_mut().zip(&self.bias).zip(rows) {
            *gate = bias + dot(w_ih, x) + dot(w_hh, h);
        }
        let n = self.hidden;
        for j in 0..n {
            let [i, f, g, o] = [gates[j], gates[n + j], gates[2 * n + j], gates[3 * n + j]];
            c[j] = sigmoid(f) * c[j] + sigmoid(i) * libm::tanh(g);
            h[j] = sigmoid(o) * libm::tanh(c[j]);
        }
    }
}

impl Lstm {
    /// A network of these layers, and a linear map to as many outputs as `bias` has numbers.
    ///
    /// # Errors
    /// [`NetworkError`].
    pub fn new(layers: Vec<Layer>, w: Vec<f64>, bias: Vec<f64>) -> Result<Self, NetworkError> {
        let Some(last) = layers.last() else { return Err(NetworkError::Empty) };
        for pair in layers.windows(2) {
            checked(
                || "the input weights of a layer above another".into(),
                &pair[1].w_ih,
                4 * pair[1].hidden * pair[0].hidden,
            )?;
        }
        checked(|| "the output weights".into(), &w, bias.len() * last.hidden)?;
        checked(|| "the output bias".into(), &bias, bias.len())?;
        Ok(Self { outputs: bias.len(), layers, w, bias })
    }

    /// Numbers of a sample that goes in.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |l| l.inputs)
    }

    /// Numbers that come out.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Cells of the last layer.
    #[must_use]
    pub fn features(&self) -> usize {
        self.layers.last().map_or(0, |l| l.hidden)
    }

    /// Numbers that training sets: `sum 4 h (in + h + 1)` and the linear map.
    #[must_use]
    pub fn parameters(&self) -> usize {
        let layers = self.layers.iter().map(|l| l.w_ih.len() + l.w_hh.len() + l.bias.len()).sum::<usize>();
        layers + self.w.len() + self.bias.len()
    }

    /// All numbers by name and shape, as files have them.
    pub(crate) fn tensors(&self) -> Vec<(String, Vec<usize>, &[f64])> {
        let mut tensors: Vec<(String, Vec<usize>, &[f64])> = Vec::new();
        for (i, l) in self.layers.iter().enumerate() {
            tensors.push((format!("lstm.{i}.weight_ih"), vec![4 * l.hidden, l.inputs], &l.w_ih));
            tensors.push((format!("lstm.{i}.weight_hh"), vec![4 * l.hidden, l.hidden], &l.w_hh));
            tensors.push((format!("lstm.{i}.bias"), vec![4 * l.hidden], &l.bias));
        }
        tensors.push(("output.weight".into(), vec![self.outputs, self.features()], &self.w));
        tensors.push(("output.bias".into(), vec![self.outputs], &self.bias));
        tensors
    }

    #[must_use]
    pub fn memory(&self) -> Memory {
        let zeros = |l: &Layer| vec![0.0; l.hidden];
        Memory {
            h: self.layers.iter().map(zeros).collect(),
            c: self.layers.iter().map(zeros).collect(),
            gates: vec![0.0; 4 * self.layers.iter().map(|l| l.hidden).max().unwrap_or(0)],
        }
    }

    /// One step from a sample `x` of [`inputs`](Self::inputs) numbers. It does not allocate.
    pub fn step(&self, x: &[f64], memory: &mut Memory) {
        let Memory { h, c, gates } = memory;
        for (place, layer) in self.layers.iter().enumerate() {
            let (below, own) = h.split_at_mut(place);
            let x = below.last().map_or(x, |h| &h[..]);
            layer.step(x, &mut gates[..4 * layer.hidden], &mut own[0], &mut c[place]);
        }
    }

    /// What the network says after a step: [`outputs`](Self::outputs) numbers.
    pub fn output(&self, memory: &Memory, y: &mut [f64]) {
        let rows = self.w.chunks_exact(self.features().max(1));
        for ((y, bias), row) in y.iter_mut().zip(&self.bias).zip(rows) {
            *y = bias + dot(row, memory.hidden());
        }
    }
}

/// What a network remembers from step to step.
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    h: Vec<Vec<f64>>,
    c: Vec<Vec<f64>>,
    gates: Vec<f64>,
}

impl Memory {
    pub fn clear(&mut self) {
        self.h.iter_mut().chain(&mut self.c).for_each(|v| v.fill(0.0));
    }

    /// The hidden state of the last layer.
    #[must_use]
    pub fn hidden(&self) -> &[f64] {
        self.h.last().map_or(&[], |h| h)
    }

    /// Hidden and cell state of layer `place`.
    #[must_use]
    pub fn layer(&self, place: usize) -> Option<(&[f64], &[f64])> {
        Some((self.h.get(place)?, self.c.get(place)?))
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-x))
}
