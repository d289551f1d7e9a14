//! The residual tower: its convolution against a naive one, its shapes, its heads, its input planes.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use candle_core::{Device, Tensor, Var};
use stillpoint_mechanics::random::Random;
use stillpoint_patient::case::phantom;
use stillpoint_plan::beams::Ring;
use stillpoint_train::planner::{Adam, Weights, loss};
use stillpoint_train::tower::{PLANES, Tower, TowerConfig, convolve, planes};

const SIZE: usize = 64;

/// Shape of an array of five axes, and its numbers.
struct Array {
    shape: [usize; 5],
    values: Vec<f32>,
}

impl Array {
    fn random(shape: [usize; 5], seed: u64) -> Self {
        let mut random = Random::new(seed);
        Self { shape, values: (0..shape.iter().product()).map(|_| random.normal() as f32).collect() }
    }

    fn zeros(shape: [usize; 5]) -> Self {
        Self { shape, values: vec![0.0; shape.iter().product()] }
    }

    fn at(&self, at: [usize; 5]) -> usize {
        at.iter().zip(self.shape).fold(0, |place, (i, n)| place * n + i)
    }

    fn var(&self) -> Var {
        Var::from_tensor(&Tensor::from_slice(&self.values, &self.shape[..], &Device::Cpu).unwrap()).unwrap()
    }
}

/// Calls this for every product of the sum: places in the result, the input and the kernel.
fn each(
    x: &Array,
    k: &Array,
    out: [usize; 5],
    strides: [usize; 3],
    padding: usize,
    mut f: impl FnMut([usize; 5], [usize; 5], [usize; 5]),
) {
    let all = |n: [usize; 3]| {
        (0..n[0]).flat_map(move |a| (0..n[1]).flat_map(move |b| (0..n[2]).map(move |c| [a, b, c])))
    };
    for n in 0..out[0] {
        for o in 0..out[1] {
            for [z, y, w] in all([out[2], out[3], out[4]]) {
                for c in 0..x.shape[1] {
                    for [i, j, l] in all([k.shape[2], k.shape[3], k.shape[4]]) {
                        let from = [z * strides[0] + i, y * strides[1] + j, w * strides[2] + l];
                        let inside = (0..3).all(|a| from[a] >= padding && from[a] - padding < x.shape[2 + a]);
                        if inside {
                            let [a, b, d] = from.map(|v| v - padding);
                            f([n, o, z, y, w], [n, c, a, b, d], [o, c, i, j, l]);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn values_and_gradients_are_those_of_a_naive_convolution() {
    for (shape, width, strides, padding, seed) in [
        ([2, 3, 4, 5, 6], 3, [1, 1], 1, 1),
        ([1, 2, 5, 7, 7], 3, [2, 2], 1, 2),
        ([1, 2, 3, 9, 8], 5, [1, 2], 2, 3),
        ([2, 2, 4, 4, 4], 1, [2, 2], 0, 4),
    ] {
        let (x, k) =
            (Array::random(shape, seed), Array::random([4, shape[1], width, width, width], seed + 100));
        let stride = [strides[0], strides[1], strides[1]];
        let size = |axis: usize| (shape[axis + 2] + 2 * padding - width) / stride[axis] + 1;
        let out = [shape[0], 4, size(0), size(1), size(2)];
        let mut due = Array::zeros(out);
        each(&x, &k, out, stride, padding, |o, a, b| {
            let (place, product) = (due.at(o), x.values[x.at(a)] * k.values[k.at(b)]);
            due.values[place] += product;
        });
        let (xv, kv) = (x.var(), k.var());
        let found = convolve(&xv, &kv, strides, padding).unwrap();
        assert_eq!(found.dims(), out);
        let near = |a: Vec<f32>, b: &[f32]| {
            a.iter().zip(b).for_each(|(a, b)| assert!((a - b).abs() < 1e-3, "{a} {b}"))
        };
        near(found.flatten_all().unwrap().to_vec1().unwrap(), &due.values);
        // The gradient of the sum of the result's products with other numbers.
        let pull = Array::random(out, seed + 200);
        let loss = (found * pull.var().as_tensor()).unwrap().sum_all().unwrap();
        let gradients = loss.backward().unwrap();
        let (mut gx, mut gk) = (Array::zeros(shape), Array::zeros(k.shape));
        each(&x, &k, out, stride, padding, |o, a, b| {
            let p = pull.values[pull.at(o)];
            let (i, j) = (gx.at(a), gk.at(b));
            gx.values[i] += p * k.values[k.at(b)];
            gk.values[j] += p * x.values[x.at(a)];
        });
        let of = |v: &Var| gradients.get(v).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        near(of(&xv), &gx.values);
        near(of(&kv), &gk.values);
    }
}

#[test]
fn a_kernel_wider_than_its_input_is_refused() {
    let (x, k) = (Array::zeros([1, 1, 2, 2, 2]).var(), Array::zeros([1, 1, 7, 7, 7]).var());
    assert!(convolve(&x, &k, [1, 1], 1).is_err());
}

/// The 34 layers: a stem, 2 (3 + 4 + 6 + 3) convolutions, and the heads as one.
#[test]
fn the_tower_has_the_shapes_and_the_number_of_parameters_of_its_reading() {
    let config = TowerConfig::default();
    let tensors = config.tensors();
    let shape = |name: &str| tensors.iter().find(|(n, _)| n == name).map(|(_, s)| s.clone()).unwrap();
    let layers = tensors.iter().filter(|(n, _)| n.ends_with(".kernel") && !n.contains("skip")).count();
    assert_eq!(layers + 1, 34);
    assert_eq!(shape("stem.kernel"), [64, 36, 7, 7, 7]);
    assert_eq!(shape("block.0.1.kernel"), [64, 64, 3, 3, 3]);
    assert_eq!(shape("block.3.1.kernel"), [128, 64, 3, 3, 3]);
    assert_eq!(shape("block.3.skip.kernel"), [128, 64, 1, 1, 1]);
    assert_eq!(shape("block.15.2.kernel"), [256, 256, 3, 3, 3]);
    assert_eq!(shape("policy.weight"), [90, 256]);
    assert_eq!(shape("value.weight"), [1, 256]);
    // By hand: stem; stages of 6, 8, 12, 6 convolutions with the first narrower; skips; norms; heads.
    let stage = |l: usize, n: usize| {
        let (a, b) = (64 * l, 64 * (l + 1));
        27 * (a * b + (2 * n - 1) * b * b)
    };
    let kernels = 343 * 36 * 64 + 27 * 6 * 64 * 64 + stage(1, 4) + stage(2, 6) + stage(3, 3);
    let skips = 64 * 128 + 128 * 192 + 192 * 256;
    let norms = 2 * (64 + 6 * 64 + 9 * 128 + 13 * 192 + 7 * 256);
    assert_eq!(config.parameters(), kernels + skips + norms + 91 * 256 + 91);
    assert_eq!(config.parameters(), 26_675_291);
}

fn tiny() -> TowerConfig {
    TowerConfig { planes: 3, filters: 2, stem: 3, blocks: vec![1, 2], angles: 6 }
}

#[test]
fn a_tiny_tower_gives_both_heads_and_learns() {
    let tower = Tower::new(tiny(), 1).unwrap();
    let shapes: Vec<Vec<usize>> = tower.vars().iter().map(|v| v.dims().to_vec()).collect();
    assert_eq!(shapes, tiny().tensors().into_iter().map(|(_, s)| s).collect::<Vec<_>>());
    let mut random = Random::new(2);
    let numbers: Vec<f32> = (0..2 * 3 * 8 * 8 * 8).map(|_| random.normal() as f32).collect();
    let x = Tensor::from_vec(numbers, (2, 3, 8, 8, 8), &Device::Cpu).unwrap();
    let zeta = Tensor::new(&[0.2_f32, 0.8], &Device::Cpu).unwrap();
    let pi = Tensor::new(&[[0.0_f32, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.5, 0.5]], &Device::Cpu)
        .unwrap();
    let mut adam = Adam::new(tower.vars());
    let weights = Weights { mse: 1.0, ce: 0.9, lambda: 0.0 };
    let mut losses = Vec::new();
    for _ in 0..30 {
        let (logits, v) = tower.forward(&x).unwrap();
        assert_eq!((logits.dims(), v.dims()), (&[2, 6][..], &[2][..]));
        let loss = loss((&zeta, &v), (&pi, &logits), &[], weights).unwrap();
        adam.step(tower.vars(), &loss.backward().unwrap(), 0.02).unwrap();
        losses.push(loss.to_scalar::<f32>().unwrap());
    }
    assert!(losses[29] < 0.7 * losses[0], "{losses:?}");
}

#[test]
fn a_tower_that_cannot_be_is_refused() {
    assert!(Tower::new(TowerConfig { stem: 4, ..tiny() }, 1).is_err());
    assert!(Tower::new(TowerConfig { blocks: Vec::new(), ..tiny() }, 1).is_err());
}

#[test]
fn the_planes_are_structures_beams_and_history_in_their_order() {
    let (case, ring) = (phantom(0).unwrap(), Ring::new(90, 5).unwrap());
    let set = [0, 10, 20, 40, 60];
    let slices = 12;
    let found = planes(&case, ring, &set, &[vec![5, 15, 25, 45, 65]], slices);
    let plane = slices * SIZE * SIZE;
    assert_eq!(found.len(), PLANES * plane);
    let count =
        |number: usize| found[number * plane..(number + 1) * plane].iter().filter(|v| **v > 0.0).count();
    assert!(count(1) > count(0) && count(0) > 20, "the outline is larger than the target");
    assert!((2..6).all(|organ| count(organ) > 0));
    assert!((6..16).all(|beam| count(beam) > 20), "five beams and the five before");
    assert!((16..36).all(|beam| count(beam) == 0), "no sets before those");
    // The first beam comes from the front: y is low there.
    let rows = (0..plane).filter(|i| found[6 * plane + i] > 0.0).map(|i| i / SIZE % SIZE);
    assert!(rows.max().unwrap() <= SIZE / 2 + 2);
}
