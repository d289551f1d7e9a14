//! The network: its numbers, and the forward pass in plain code.
//!
//! For each angle: an embedding of each structure at risk, summed over them (so that their number and order do not matter);
//! with the features of the target through circular convolutions over the ring with symmetric taps, two by default (so that
//! a mirrored patient gets mirrored answers), and beside the mean over the ring through a dense layer. For each pair of angles: a
//! perceptron over the pair's features and both angles, symmetric in them. Each of the two gives two numbers, for the value
//! and for the policy. What a set costs beyond the sum of its parts, a perceptron says over the means of what is known of its
//! angles and of its pairs.

use serde::{Deserialize, Serialize};

use crate::eye::{Eye, PAIR, STRUCTURE, TARGET};
use crate::groups::{Group, left_out};
use crate::judgement::{Judgement, SetHead};

/// Distances of the taps of each convolution, in steps of the ring; a network has as many of them as it has layers.
pub const TAPS: [[usize; 3]; 4] = [[0, 1, 2], [0, 4, 8], [0, 1, 2], [0, 4, 8]];
/// Layers of the default network.
const LAYERS: usize = 2;

/// Widths of the layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sizes {
    /// Embedding of a structure at risk.
    pub structure: usize,
    /// Channels of the convolutions.
    pub ring: usize,
    /// What is known of an angle at last.
    pub angle: usize,
    /// What of it goes into pairs.
    #[serde(rename = "beside")]
    pub neighbour: usize,
    /// Hidden layer of the pairs' perceptron.
    pub pair: usize,
    /// Hidden layer of the sets' perceptron.
    pub set: usize,
    /// Convolutions over the ring, 1 to 4. Files of the default depth do not name it.
    #[serde(default = "default_layers", skip_serializing_if = "is_default_depth")]
    pub layers: usize,
}

fn default_layers() -> usize {
    LAYERS
}

fn is_default_depth(layers: &usize) -> bool {
    *layers == LAYERS
}

impl Default for Sizes {
    fn default() -> Self {
        Self { structure: 16, ring: 32, angle: 24, neighbour: 12, pair: 24, set: 16, layers: LAYERS }
    }
}

/// Greatest width of a layer.
pub const WIDEST: usize = 512;

/// Places in [`Sizes::tensors`] up to the first convolution. [`Sizes::behind`] has those behind the last one.
#[allow(missing_docs)]
pub mod place {
    pub const TARGET_MEAN: usize = 0;
    pub const TARGET_SCALE: usize = 1;
    pub const STRUCTURE_MEAN: usize = 2;
    pub const STRUCTURE_SCALE: usize = 3;
    pub const PAIR_MEAN: usize = 4;
    pub const PAIR_SCALE: usize = 5;
    /// The first tensor that training sets.
    pub const TRAINED: usize = 6;
    pub const STRUCTURE_1: usize = 6;
    pub const STRUCTURE_2: usize = 8;
    /// The first convolution over the ring; each has four tensors.
    pub const RING: usize = 10;
}

/// Places in [`Sizes::tensors`] behind the last convolution.
#[allow(missing_docs)]
#[derive(Clone, Copy, Debug)]
pub struct Behind {
    pub angle: usize,
    pub single: usize,
    pub neighbour: usize,
    pub pair_1: usize,
    pub pair_2: usize,
    pub set_angle: usize,
    pub set_pair: usize,
    pub set_bias: usize,
    pub set_out: usize,
}

/// Names of the tensors of each convolution.
const OF_RING: [[&str; 4]; 4] = [
    ["ring.1.tap.0", "ring.1.tap.1", "ring.1.tap.2", "ring.1.bias"],
    ["ring.2.tap.0", "ring.2.tap.1", "ring.2.tap.2", "ring.2.bias"],
    ["ring.3.tap.0", "ring.3.tap.1", "ring.3.tap.2", "ring.3.bias"],
    ["ring.4.tap.0", "ring.4.tap.1", "ring.4.tap.2", "ring.4.bias"],
];

impl Sizes {
    /// Name and shape of every tensor, in order. Matrices have a row for each output.
    pub fn tensors(&self) -> Vec<(&'static str, Vec<usize>)> {
        let Self { structure, ring, angle, neighbour, pair, set, layers } = *self;
        let mut all = vec![
            ("target.mean", vec![TARGET]),
            ("target.scale", vec![TARGET]),
            ("structure.mean", vec![STRUCTURE]),
            ("structure.scale", vec![STRUCTURE]),
            ("pair.mean", vec![PAIR]),
            ("pair.scale", vec![PAIR]),
            ("structure.1.weight", vec![structure, STRUCTURE]),
            ("structure.1.bias", vec![structure]),
            ("structure.2.weight", vec![structure, structure]),
            ("structure.2.bias", vec![structure]),
        ];
        for (layer, names) in OF_RING.iter().take(layers).enumerate() {
            let seen = if layer == 0 { TARGET + structure } else { ring };
            let shape = |tap: usize| if tap < 3 { vec![ring, seen] } else { vec![ring] };
            all.extend(names.iter().enumerate().map(|(tap, name)| (*name, shape(tap))));
        }
        all.extend([
            ("angle.weight", vec![angle, 2 * ring]),
            ("angle.bias", vec![angle]),
            ("single.weight", vec![2, angle]),
            ("single.bias", vec![2]),
            ("beside.weight", vec![neighbour, angle]),
            ("pair.1.weight", vec![pair, PAIR + 2 * neighbour]),
            ("pair.1.bias", vec![pair]),
            ("pair.2.weight", vec![2, pair]),
            ("pair.2.bias", vec![2]),
            ("set.1.angle", vec![set, angle]),
            ("set.1.pair", vec![set, pair]),
            ("set.1.bias", vec![set]),
            ("set.2.weight", vec![1, set]),
        ]);
        all
    }

    /// The places of [`tensors`](Self::tensors) that depend on the number of convolutions.
    pub fn behind(&self) -> Behind {
        let angle = place::RING + 4 * self.layers;
        Behind {
            angle,
            single: angle + 2,
            neighbour: angle + 4,
            pair_1: angle + 5,
            pair_2: angle + 7,
            set_angle: angle + 9,
            set_pair: angle + 10,
            set_bias: angle + 11,
            set_out: angle + 12,
        }
    }

    /// Whether every width is from 1 to [`WIDEST`], and the depth from 1 to 4.
    pub fn are_sound(&self) -> bool {
        let Self { structure, ring, angle, neighbour, pair, set, layers } = *self;
        let widths = [structure, ring, angle, neighbour, pair, set];
        widths.iter().all(|width| (1..=WIDEST).contains(width)) && (1..=TAPS.len()).contains(&layers)
    }
}

/// A network with its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    sizes: Sizes,
    numbers: Vec<Vec<f32>>,
}

/// Why numbers make no network.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum ModelError {
    /// A width that cannot be.
    #[error("the widths {0:?} are not all from 1 to {WIDEST}, or the layers not from 1 to 4")]
    Sizes(Sizes),
    /// Another number of tensors.
    #[error("there are {found} tensors, and the network has {expected}")]
    Tensors {
        /// Number that was given.
        found: usize,
        /// Number that is expected.
        expected: usize,
    },
    /// A tensor of another size.
    #[error("the tensor `{name}` has {found} numbers, and {expected} are expected")]
    Length {
        /// Name of the entry.
        name: &'static str,
        /// Number that was given.
        found: usize,
        /// Number that is expected.
        expected: usize,
    },
    /// A number that is infinite or none, or a scale that is not positive.
    #[error("the tensor `{name}` has {value} at place {at}: numbers must be finite, and scales positive")]
    Number {
        /// Name of the entry.
        name: &'static str,
        /// Offset in the file, bytes.
        at: usize,
        /// Its value.
        value: f32,
    },
}

impl Model {
    /// The network of these numbers, in the order of [`Sizes::tensors`].
    pub fn new(sizes: Sizes, numbers: Vec<Vec<f32>>) -> Result<Self, ModelError> {
        if !sizes.are_sound() {
            return Err(ModelError::Sizes(sizes));
        }
        let tensors = sizes.tensors();
        if numbers.len() != tensors.len() {
            return Err(ModelError::Tensors { found: numbers.len(), expected: tensors.len() });
        }
        for ((name, shape), values) in tensors.into_iter().zip(&numbers) {
            let expected = shape.iter().product();
            if values.len() != expected {
                return Err(ModelError::Length { name, found: values.len(), expected });
            }
            let scale = name.ends_with(".scale");
            let wrong = |v: &f32| !v.is_finite() || (scale && *v <= 0.0);
            if let Some(at) = values.iter().position(wrong) {
                return Err(ModelError::Number { name, at, value: values[at] });
            }
        }
        Ok(Self { sizes, numbers })
    }

    /// Its widths.
    pub fn sizes(&self) -> Sizes {
        self.sizes
    }

    /// Its numbers, in the order of [`Sizes::tensors`].
    pub fn numbers(&self) -> &[Vec<f32>] {
        &self.numbers
    }

    /// The groups of features that it was trained without.
    pub fn without(&self) -> Vec<Group> {
        left_out(&self.numbers)
    }

    /// How many numbers training sets.
    pub fn parameters(&self) -> usize {
        self.numbers[place::TRAINED..].iter().map(Vec::len).sum()
    }

    /// What the network says of a case.
    pub fn judge(&self, eye: &Eye) -> Judgement {
        let (angles, at) = (self.angles(eye), self.sizes.behind());
        let neighbour: Vec<Vec<f32>> = angles
            .iter()
            .map(|h| product(&self.numbers[at.neighbour], h, vec![0.0; self.sizes.neighbour]))
            .collect();
        let single = angles.iter().map(|h| two(&self.dense(at.single, h))).collect();
        let (count, width) = (eye.angles, self.sizes.set);
        let in_set = |layer: usize, x: &[f32]| product(&self.numbers[layer], x, vec![0.0; width]);
        let of_angles = angles.iter().flat_map(|h| in_set(at.set_angle, h)).collect();
        let mut of_pairs = vec![0.0; count * count * width];
        let mut pair = vec![[0.0; 2]; count * count];
        let mut input = vec![0.0; PAIR + 2 * self.sizes.neighbour];
        for a in 0..count {
            for b in a + 1..count {
                self.scaled(place::PAIR_MEAN, &eye.pairs[a * count + b], &mut input[..PAIR]);
                for (i, (x, y)) in neighbour[a].iter().zip(&neighbour[b]).enumerate() {
                    input[PAIR + i] = x + y;
                    input[PAIR + self.sizes.neighbour + i] = (x - y).abs();
                }
                let hidden = rectified(self.dense(at.pair_1, &input));
                let predicted = two(&self.dense(at.pair_2, &hidden));
                let known = in_set(at.set_pair, &hidden);
                for place in [a * count + b, b * count + a] {
                    pair[place] = predicted;
                    of_pairs[width * place..width * (place + 1)].copy_from_slice(&known);
                }
            }
        }
        let (bias, out) = (self.numbers[at.set_bias].clone(), self.numbers[at.set_out].clone());
        Judgement::new(single, pair, SetHead { bias, out, angles: of_angles, pairs: of_pairs })
    }

    /// What is known of each angle.
    fn angles(&self, eye: &Eye) -> Vec<Vec<f32>> {
        let count = eye.angles;
        let mut seen: Vec<Vec<f32>> = Vec::with_capacity(count);
        for a in 0..count {
            let mut x = vec![0.0; TARGET + self.sizes.structure];
            self.scaled(place::TARGET_MEAN, &eye.target[a], &mut x[..TARGET]);
            for of_structure in &eye.structures {
                let mut input = [0.0; STRUCTURE];
                self.scaled(place::STRUCTURE_MEAN, &of_structure[a], &mut input);
                let first = rectified(self.dense(place::STRUCTURE_1, &input));
                let second = rectified(self.dense(place::STRUCTURE_2, &first));
                x[TARGET..].iter_mut().zip(second).for_each(|(sum, value)| *sum += value);
            }
            seen.push(x);
        }
        for (layer, taps) in TAPS.into_iter().take(self.sizes.layers).enumerate() {
            seen = self.around(place::RING + 4 * layer, taps, &seen);
        }
        let mut mean = vec![0.0; self.sizes.ring];
        for of_angle in &seen {
            mean.iter_mut().zip(of_angle).for_each(|(sum, value)| *sum += value / count as f32);
        }
        let last = self.sizes.behind().angle;
        seen.iter().map(|of_angle| rectified(self.dense(last, &[&of_angle[..], &mean].concat()))).collect()
    }

    /// A circular convolution with symmetric taps, rectified.
    fn around(&self, first: usize, taps: [usize; 3], x: &[Vec<f32>]) -> Vec<Vec<f32>> {
        let count = x.len();
        let one = |a: usize| {
            let mut sum = self.numbers[first + 3].clone();
            for (tap, distance) in taps.into_iter().enumerate() {
                let weights = &self.numbers[first + tap];
                sum = product(weights, &x[(a + distance) % count], sum);
                if distance > 0 {
                    sum = product(weights, &x[(a + count - distance % count) % count], sum);
                }
            }
            rectified(sum)
        };
        (0..count).map(one).collect()
    }

    fn dense(&self, first: usize, x: &[f32]) -> Vec<f32> {
        product(&self.numbers[first], x, self.numbers[first + 1].clone())
    }

    fn scaled(&self, mean: usize, features: &[f32], out: &mut [f32]) {
        let with = self.numbers[mean].iter().zip(&self.numbers[mean + 1]);
        for ((out, value), (mean, scale)) in out.iter_mut().zip(features).zip(with) {
            *out = ((value - mean) / scale).clamp(-8.0, 8.0);
        }
    }
}

/// `sum + weights x`, the weights row by row.
fn product(weights: &[f32], x: &[f32], mut sum: Vec<f32>) -> Vec<f32> {
    for (sum, row) in sum.iter_mut().zip(weights.chunks_exact(x.len())) {
        *sum += row.iter().zip(x).map(|(w, x)| w * x).sum::<f32>();
    }
    sum
}

fn rectified(mut x: Vec<f32>) -> Vec<f32> {
    x.iter_mut().for_each(|x| *x = x.max(0.0));
    x
}

fn two(x: &[f32]) -> [f32; 2] {
    [x[0], x[1]]
}
