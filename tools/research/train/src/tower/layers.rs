//! Stem, blocks and heads of the tower.

use candle_core::{Tensor, Var};
use stillpoint_mechanics::random::Random;

use super::convolution::convolve;
use super::planes::PLANES;
use crate::TrainError;
use crate::device::device;

/// Fewest slices that are halved.
const HALVED_FROM: usize = 8;
/// Added to the variance of a batch.
const EPSILON: f64 = 1e-5;

/// Shape of the tower.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TowerConfig {
    pub planes: usize,
    /// Filters of the stem and of the first stage; stage `l` has `l` times as many.
    pub filters: usize,
    /// Width of the stem's kernel: odd.
    pub stem: usize,
    /// Blocks of each stage.
    pub blocks: Vec<usize>,
    /// Angles: outputs of the policy.
    pub angles: usize,
}

impl Default for TowerConfig {
    fn default() -> Self {
        Self { planes: PLANES, filters: 64, stem: 7, blocks: vec![3, 4, 6, 3], angles: 90 }
    }
}

/// A block: its filters before and after, and whether it halves the plane.
struct Block {
    before: usize,
    after: usize,
    halves: bool,
}

impl TowerConfig {
    fn all_blocks(&self) -> Vec<Block> {
        let mut blocks = Vec::new();
        let mut before = self.filters;
        for (stage, count) in self.blocks.iter().enumerate() {
            let after = self.filters * (stage + 1);
            for place in 0..*count {
                blocks.push(Block { before, after, halves: stage > 0 && place == 0 });
                before = after;
            }
        }
        blocks
    }

    /// Name and shape of each tensor that is trained, in order.
    pub fn tensors(&self) -> Vec<(String, Vec<usize>)> {
        let mut all = Vec::new();
        let mut convolution = |name: String, out: usize, into: usize, width: usize| {
            all.push((format!("{name}.kernel"), vec![out, into, width, width, width]));
            all.push((format!("{name}.norm.scale"), vec![out]));
            all.push((format!("{name}.norm.shift"), vec![out]));
        };
        convolution("stem".into(), self.filters, self.planes, self.stem);
        for (place, block) in self.all_blocks().iter().enumerate() {
            convolution(format!("block.{place}.1"), block.after, block.before, 3);
            convolution(format!("block.{place}.2"), block.after, block.after, 3);
            if block.before != block.after || block.halves {
                convolution(format!("block.{place}.skip"), block.after, block.before, 1);
            }
        }
        let last = self.filters * self.blocks.len().max(1);
        for (name, out) in [("policy", self.angles), ("value", 1)] {
            all.push((format!("{name}.weight"), vec![out, last]));
            all.push((format!("{name}.bias"), vec![out]));
        }
        all
    }

    /// How many numbers are trained.
    pub fn parameters(&self) -> usize {
        self.tensors().iter().map(|(_, shape)| shape.iter().product::<usize>()).sum()
    }
}

/// The tower with its numbers. Norms are over the batch, in training and in use.
pub struct Tower {
    config: TowerConfig,
    vars: Vec<Var>,
}

impl Tower {
    /// A tower whose kernels begin as He et al. (2015) say, from a seed.
    pub fn new(config: TowerConfig, seed: u64) -> Result<Self, TrainError> {
        let sound = config.planes > 0 && config.filters > 0 && config.stem % 2 == 1 && config.angles > 0;
        if !sound || config.blocks.is_empty() {
            let must = "planes, filters, angles and stages at least 1, and a stem of odd width";
            return Err(TrainError::Option { what: "the shape of the tower", value: 0.0, must });
        }
        let mut random = Random::new(seed);
        let mut vars = Vec::new();
        for (name, shape) in config.tensors() {
            let inputs: usize = shape.iter().skip(1).product();
            let numbers: Vec<f32> = match name {
                _ if name.ends_with(".scale") => vec![1.0; shape[0]],
                _ if shape.len() == 1 => vec![0.0; shape[0]],
                _ => {
                    let deviation = libm::sqrt(2.0 / inputs as f64);
                    (0..shape.iter().product()).map(|_| (deviation * random.normal()) as f32).collect()
                }
            };
            vars.push(Var::from_tensor(&Tensor::from_vec(numbers, shape, device()?)?)?);
        }
        Ok(Self { config, vars })
    }

    /// All that is trained, in the order of [`TowerConfig::tensors`].
    pub fn vars(&self) -> &[Var] {
        &self.vars
    }

    /// Logits of the policy `(batch, angles)` and values between 0 and 1 `(batch)`, of `(batch, planes, slices, rows,
    /// columns)`.
    pub fn forward(&self, x: &Tensor) -> Result<(Tensor, Tensor), TrainError> {
        let mut at = 0;
        let half = self.config.stem / 2;
        let mut x = self.convolution(x, &mut at, true, half)?.relu()?;
        for block in self.config.all_blocks() {
            let first = self.convolution(&x, &mut at, block.halves, 1)?.relu()?;
            let second = self.convolution(&first, &mut at, false, 1)?;
            let skip = match block.before != block.after || block.halves {
                true => self.convolution(&x, &mut at, block.halves, 0)?,
                false => x,
            };
            x = (second + skip)?.relu()?;
        }
        let (batch, channels, ..) = x.dims5()?;
        let pooled = x.reshape((batch, channels, ()))?.mean(2)?;
        let mut head = || -> Result<Tensor, TrainError> {
            let out = pooled.matmul(&self.vars[at].t()?)?.broadcast_add(&self.vars[at + 1])?;
            at += 2;
            Ok(out)
        };
        let (policy, value) = (head()?, head()?);
        Ok((policy, candle_nn::ops::sigmoid(&value)?.squeeze(1)?))
    }

    /// A convolution with its norm over the batch.
    fn convolution(
        &self,
        x: &Tensor,
        at: &mut usize,
        halves: bool,
        padding: usize,
    ) -> Result<Tensor, TrainError> {
        let [kernel, scale, shift] = [0, 1, 2].map(|i| &self.vars[*at + i]);
        *at += 3;
        let stride = if halves { 2 } else { 1 };
        // Along slices only where there are enough.
        let along = if halves && x.dim(2)? >= HALVED_FROM { 2 } else { 1 };
        let y = convolve(x, kernel, [along, stride], padding)?;
        let (batch, filters, slices, rows, columns) = y.dims5()?;
        let flat = y.transpose(0, 1)?.reshape((filters, batch * slices * rows * columns))?;
        let centred = flat.broadcast_sub(&flat.mean_keepdim(1)?)?;
        let deviation = (centred.sqr()?.mean_keepdim(1)? + EPSILON)?.sqrt()?;
        let normed = centred.broadcast_div(&deviation)?;
        let scaled = normed
            .broadcast_mul(&scale.reshape((filters, 1))?)?
            .broadcast_add(&shift.reshape((filters, 1))?)?;
        Ok(scaled.reshape((filters, batch, slices, rows, columns))?.transpose(0, 1)?.contiguous()?)
    }
}
