//! The network of `stillpoint_network` as tensors, with gradients.

use candle_core::{D, Tensor, Var};
use stillpoint_mechanics::random::Random;
use stillpoint_network::model::{TAPS, place};
use stillpoint_network::{Model, Sizes};

use super::examples::{Example, States};
use crate::TrainError;
use crate::device::device;

/// What a beam that may not be added gets for a logit.
const FORBIDDEN: f32 = -1e4;

/// A network whose numbers can be trained.
pub struct Network {
    sizes: Sizes,
    /// Means and scales of the features.
    fixed: Vec<Vec<f32>>,
    vars: Vec<Var>,
}

/// An example as tensors.
pub struct Loaded {
    angles: usize,
    target: Tensor,
    /// All structures, one behind the other.
    structures: Tensor,
    /// Pairs `a < b`.
    pairs: Tensor,
    first: Tensor,
    second: Tensor,
    /// For each tap its distances as rows to take.
    turned: Vec<Tensor>,
}

/// What the network says of each angle and of each pair `a < b`.
pub struct Predicted {
    single: Tensor,
    pair: Tensor,
    /// What each angle and each pair adds to the hidden units of a set, their bias, and their weights in the value.
    set: [Tensor; 4],
    angles: usize,
}

impl Network {
    /// A network whose numbers begin uniformly within the root of 3 over the inputs of their layer (He et al., 2015), half of
    /// that in the heads. `fixed` are means and scales of the features.
    pub fn new(sizes: Sizes, fixed: Vec<Vec<f32>>, seed: u64) -> Result<Self, TrainError> {
        let mut random = Random::stream(seed, u64::MAX);
        let mut vars = Vec::new();
        for (name, shape) in sizes.tensors().into_iter().skip(place::TRAINED) {
            let inputs = shape.get(1).copied().unwrap_or(0);
            let head = name.starts_with("single") || name.starts_with("pair.2") || name.starts_with("set.2");
            let bound = match inputs {
                0 => 0.0,
                n => libm::sqrt(3.0 / n as f64) * if head { 0.1 } else { 1.0 },
            };
            let numbers =
                (0..shape.iter().product()).map(|_| random.between(-1.0, 1.0) as f32 * bound as f32);
            let tensor = Tensor::from_vec(numbers.collect::<Vec<f32>>(), shape, device()?)?;
            vars.push(Var::from_tensor(&tensor)?);
        }
        Ok(Self { sizes, fixed, vars })
    }

    /// All that is trained.
    pub fn vars(&self) -> &[Var] {
        &self.vars
    }

    /// The numbers that are trained.
    pub fn numbers(&self) -> Result<Vec<Vec<f32>>, TrainError> {
        self.vars.iter().map(|v| Ok(v.flatten_all()?.to_vec1::<f32>()?)).collect()
    }

    /// Puts numbers in, in the order and the sizes of [`numbers`](Self::numbers).
    pub fn set(&self, numbers: &[Vec<f32>]) -> Result<(), TrainError> {
        for (var, numbers) in self.vars.iter().zip(numbers) {
            var.set(&Tensor::from_slice(numbers, var.dims(), device()?)?)?;
        }
        Ok(())
    }

    /// The network that runs without tensors.
    pub fn model(&self, numbers: &[Vec<f32>]) -> Result<Model, TrainError> {
        let all = self.fixed.iter().chain(numbers).cloned().collect();
        Model::new(self.sizes, all).map_err(|e| TrainError::Plan(e.to_string()))
    }

    /// An example as tensors.
    pub fn load(&self, example: &Example) -> Result<Loaded, TrainError> {
        let (eye, device) = (&example.eye, device()?);
        let n = eye.angles;
        let scaled = |values: &[f32], first: usize| -> Vec<f32> {
            let of = values.iter().zip(self.fixed[first].iter().zip(&self.fixed[first + 1]));
            of.map(|(v, (mean, scale))| ((v - mean) / scale).clamp(-8.0, 8.0)).collect()
        };
        let matrix = |rows: Vec<Vec<f32>>| -> Result<Tensor, TrainError> {
            let shape = (rows.len(), rows.first().map_or(0, Vec::len));
            Ok(Tensor::from_vec(rows.concat(), shape, device)?)
        };
        let both = || (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
        let index = |all: Vec<usize>| -> Result<Tensor, TrainError> {
            let all: Vec<u32> = all.into_iter().map(|i| i as u32).collect();
            Ok(Tensor::from_vec(all.clone(), all.len(), device)?)
        };
        let mut turned = Vec::new();
        for distance in TAPS.into_iter().take(self.sizes.layers).flatten() {
            turned.push(index((0..n).map(|a| (a + distance) % n).collect())?);
            turned.push(index((0..n).map(|a| (a + n - distance % n) % n).collect())?);
        }
        Ok(Loaded {
            angles: n,
            target: matrix(eye.target.iter().map(|f| scaled(f, place::TARGET_MEAN)).collect())?,
            structures: matrix(
                eye.structures.iter().flatten().map(|f| scaled(f, place::STRUCTURE_MEAN)).collect(),
            )?,
            pairs: matrix(both().map(|(a, b)| scaled(&eye.pairs[a * n + b], place::PAIR_MEAN)).collect())?,
            first: index(both().map(|(a, _)| a).collect())?,
            second: index(both().map(|(_, b)| b).collect())?,
            turned,
        })
    }

    /// What it says of an example.
    pub fn forward(&self, x: &Loaded) -> Result<Predicted, TrainError> {
        let at = |place: usize| -> &Tensor { &self.vars[place - place::TRAINED] };
        let behind = self.sizes.behind();
        let dense = |x: &Tensor, first: usize| -> Result<Tensor, TrainError> {
            Ok(x.matmul(&at(first).t()?)?.broadcast_add(at(first + 1))?)
        };
        let structures = dense(&x.structures, place::STRUCTURE_1)?.relu()?;
        let structures = dense(&structures, place::STRUCTURE_2)?.relu()?;
        let count = structures.dim(0)? / x.angles;
        let summed = structures.reshape((count, x.angles, self.sizes.structure))?.sum(0)?;
        let mut seen = Tensor::cat(&[&x.target, &summed], 1)?;
        let around = |input: &Tensor, first: usize, turned: &[Tensor]| -> Result<Tensor, TrainError> {
            let mut sum = input.matmul(&at(first).t()?)?.broadcast_add(at(first + 3))?;
            for tap in 1..3 {
                let sides = (input.index_select(&turned[2 * tap], 0)?
                    + input.index_select(&turned[2 * tap + 1], 0)?)?;
                sum = (sum + sides.matmul(&at(first + tap).t()?)?)?;
            }
            Ok(sum.relu()?)
        };
        for (layer, turned) in x.turned.chunks_exact(6).enumerate() {
            seen = around(&seen, place::RING + 4 * layer, turned)?;
        }
        let mean = seen.mean_keepdim(0)?.broadcast_as(seen.shape())?;
        let angles = dense(&Tensor::cat(&[&seen, &mean], 1)?, behind.angle)?.relu()?;
        let single = dense(&angles, behind.single)?;
        let neighbour = angles.matmul(&at(behind.neighbour).t()?)?;
        let (a, b) = (neighbour.index_select(&x.first, 0)?, neighbour.index_select(&x.second, 0)?);
        let input = Tensor::cat(&[&x.pairs, &(&a + &b)?, &(&a - &b)?.abs()?], 1)?;
        let hidden = dense(&input, behind.pair_1)?.relu()?;
        let pair = dense(&hidden, behind.pair_2)?;
        let of_angles = angles.matmul(&at(behind.set_angle).t()?)?;
        let of_pairs = hidden.matmul(&at(behind.set_pair).t()?)?;
        let set = [of_angles, of_pairs, at(behind.set_bias).clone(), at(behind.set_out).t()?];
        Ok(Predicted { single, pair, set, angles: x.angles })
    }
}

impl Predicted {
    /// The value of each set, `ln(cost / reference)`. All sets have the same number of beams.
    pub fn values(&self, sets: &[&Vec<u16>]) -> Result<Tensor, TrainError> {
        let beams = sets.first().map_or(0, |set| set.len());
        let singles: Vec<u32> = sets.iter().flat_map(|set| set.iter().map(|b| u32::from(*b))).collect();
        let mut pairs = Vec::new();
        for set in sets {
            for (place, a) in set.iter().enumerate() {
                pairs.extend(set[..place].iter().map(|b| self.place(*a, *b)));
            }
        }
        let each = beams * beams.saturating_sub(1) / 2;
        let mean = |all: &Tensor, places: Vec<u32>, width: usize| -> Result<Tensor, TrainError> {
            let index = Tensor::from_vec(places.clone(), places.len(), device()?)?;
            let taken = all.narrow(1, 0, 1)?.squeeze(1)?.contiguous()?.index_select(&index, 0)?;
            Ok(taken.reshape((sets.len(), width))?.mean(D::Minus1)?)
        };
        let of_set = |all: &Tensor, places: &[u32], width: usize| -> Result<Tensor, TrainError> {
            let index = Tensor::from_slice(places, places.len(), device()?)?;
            let units = all.dim(1)?;
            Ok(all.index_select(&index, 0)?.reshape((sets.len(), width, units))?.mean(1)?)
        };
        let [of_angles, of_pairs, bias, out] = &self.set;
        let hidden = (of_set(of_angles, &singles, beams)? + of_set(of_pairs, &pairs, each)?)?;
        let of_set = hidden.broadcast_add(bias)?.relu()?.matmul(out)?.squeeze(1)?;
        let of_parts = (mean(&self.single, singles, beams)? + mean(&self.pair, pairs, each)?)?;
        Ok((of_parts + of_set)?)
    }

    /// The logits of the policy: a row for each state, a column for each angle.
    pub fn logits(&self, states: &States) -> Result<Tensor, TrainError> {
        let (rows, n) = (states.retained.len(), self.angles);
        let retained = states.retained.first().map_or(0, Vec::len);
        let own = self.single.narrow(1, 1, 1)?.squeeze(1)?.reshape((1, n))?.broadcast_as((rows, n))?;
        let forbidden: Vec<f32> =
            states.legal.iter().flatten().map(|legal| if *legal { 0.0 } else { FORBIDDEN }).collect();
        let mut logits = (own + Tensor::from_vec(forbidden, (rows, n), device()?)?)?;
        if retained > 0 {
            let mut places = Vec::with_capacity(rows * n * retained);
            for beams in &states.retained {
                for a in 0..n as u16 {
                    // A beam beside itself is forbidden, so that any pair stands in for it.
                    places.extend(beams.iter().map(|b| if *b == a { 0 } else { self.place(a, *b) }));
                }
            }
            let index = Tensor::from_vec(places.clone(), places.len(), device()?)?;
            let taken = self.pair.narrow(1, 1, 1)?.squeeze(1)?.contiguous()?.index_select(&index, 0)?;
            logits = (logits + taken.reshape((rows, n, retained))?.mean(D::Minus1)?)?;
        }
        Ok(logits)
    }

    /// The row of a pair.
    fn place(&self, a: u16, b: u16) -> u32 {
        let (a, b, n) = (u32::from(a.min(b)), u32::from(a.max(b)), self.angles as u32);
        a * n - a * (a + 1) / 2 + b - a - 1
    }
}
