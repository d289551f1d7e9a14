//! The forward pass, the model file, and the sets that follow from them.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use proptest::prelude::*;
use stillpoint_network::eye::{Eye, PAIR, STRUCTURE, TARGET};
use stillpoint_network::groups::leave_out;
use stillpoint_network::model::{ModelError, TAPS, place};
use stillpoint_network::{Group, Judgement, Model, ModelFileError, Sizes};
use stillpoint_plan::beams::{Prior, Ring, set_of_prior};

const SIZES: Sizes = Sizes { structure: 3, ring: 4, angle: 5, neighbour: 2, pair: 3, set: 4, layers: 2 };

/// Numbers without order: the same for the same seed.
fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1_u64 << 24) as f32 * 2.0 - 1.0
    }
}

fn model(seed: u64) -> Model {
    model_of(SIZES, seed)
}

fn model_of(sizes: Sizes, seed: u64) -> Model {
    let mut next = noise(seed);
    let mut values = |(name, shape): (&'static str, Vec<usize>)| -> Vec<f32> {
        let scale = name.ends_with(".scale");
        (0..shape.iter().product()).map(|_| if scale { 1.5 + 0.5 * next() } else { next() }).collect()
    };
    let numbers = sizes.tensors().into_iter().map(&mut values).collect();
    Model::new(sizes, numbers).unwrap()
}

fn eye(seed: u64, angles: usize) -> Eye {
    let mut next = noise(seed);
    let mut pairs = vec![[0.0; PAIR]; angles * angles];
    for a in 0..angles {
        for b in a..angles {
            let found = [0.0; PAIR].map(|_| next());
            pairs[a * angles + b] = found;
            pairs[b * angles + a] = found;
        }
    }
    Eye {
        angles,
        target: (0..angles).map(|_| [0.0; TARGET].map(|_| next())).collect(),
        structures: (0..2).map(|_| (0..angles).map(|_| [0.0; STRUCTURE].map(|_| next())).collect()).collect(),
        pairs,
    }
}

/// What the network says, written a second time.
struct Naive {
    single: Vec<[f64; 2]>,
    pair: Vec<[f64; 2]>,
    /// The value of a set.
    value: f64,
}

/// The network number by number, in f64, from the names of the tensors.
fn naive(model: &Model, eye: &Eye, set: &[usize]) -> Naive {
    let named: Vec<(&str, Vec<usize>, &Vec<f32>)> =
        model.sizes().tensors().into_iter().zip(model.numbers()).map(|((n, s), v)| (n, s, v)).collect();
    let get = |name: &str| named.iter().find(|(n, _, _)| *n == name).unwrap();
    let number = |name: &str, row: usize, column: usize| {
        let (_, shape, values) = get(name);
        f64::from(values[row * shape.get(1).copied().unwrap_or(1) + column])
    };
    let layer = |name: &str, x: &[f64], rectify: bool| -> Vec<f64> {
        let rows = get(&format!("{name}.weight")).1[0];
        (0..rows)
            .map(|r| {
                let sum: f64 = (0..x.len()).map(|c| number(&format!("{name}.weight"), r, c) * x[c]).sum();
                let sum = sum + number(&format!("{name}.bias"), r, 0);
                if rectify { sum.max(0.0) } else { sum }
            })
            .collect()
    };
    let scaled = |kind: &str, x: &[f32]| -> Vec<f64> {
        let of = |(i, v): (usize, &f32)| {
            (f64::from(*v) - number(&format!("{kind}.mean"), i, 0)) / number(&format!("{kind}.scale"), i, 0)
        };
        x.iter().enumerate().map(of).collect()
    };
    let n = eye.angles as isize;
    let mut x: Vec<Vec<f64>> = Vec::new();
    for a in 0..eye.angles {
        let mut sum = vec![0.0; SIZES.structure];
        for s in &eye.structures {
            let y = layer("structure.2", &layer("structure.1", &scaled("structure", &s[a]), true), true);
            sum.iter_mut().zip(y).for_each(|(s, y)| *s += y);
        }
        x.push([scaled("target", &eye.target[a]), sum].concat());
    }
    for (place, taps) in TAPS.iter().take(model.sizes().layers).enumerate() {
        let name = format!("ring.{}", place + 1);
        let mut y = Vec::new();
        for a in 0..n {
            let mut out = Vec::new();
            for r in 0..SIZES.ring {
                let mut sum = number(&format!("{name}.bias"), r, 0);
                for (tap, distance) in taps.iter().enumerate() {
                    let d = *distance as isize;
                    for at in if d == 0 { vec![a] } else { vec![a - d, a + d] } {
                        let from = &x[at.rem_euclid(n) as usize];
                        sum += (0..from.len())
                            .map(|c| number(&format!("{name}.tap.{tap}"), r, c) * from[c])
                            .sum::<f64>();
                    }
                }
                out.push(sum.max(0.0));
            }
            y.push(out);
        }
        x = y;
    }
    let mean: Vec<f64> = (0..SIZES.ring).map(|c| x.iter().map(|x| x[c]).sum::<f64>() / n as f64).collect();
    let angles: Vec<Vec<f64>> = x.iter().map(|x| layer("angle", &[&x[..], &mean].concat(), true)).collect();
    let single: Vec<[f64; 2]> =
        angles.iter().map(|h| layer("single", h, false)).map(|v| [v[0], v[1]]).collect();
    let neighbour: Vec<Vec<f64>> = angles
        .iter()
        .map(|h| {
            (0..SIZES.neighbour)
                .map(|r| (0..h.len()).map(|c| number("beside.weight", r, c) * h[c]).sum())
                .collect()
        })
        .collect();
    let mut pair = vec![[0.0; 2]; eye.angles * eye.angles];
    let mut hidden_of = vec![Vec::new(); eye.angles * eye.angles];
    for a in 0..eye.angles {
        for b in 0..eye.angles {
            if a != b {
                let mut input = scaled("pair", &eye.pairs[a * eye.angles + b]);
                input.extend((0..SIZES.neighbour).map(|i| neighbour[a][i] + neighbour[b][i]));
                input.extend((0..SIZES.neighbour).map(|i| (neighbour[a][i] - neighbour[b][i]).abs()));
                let hidden = layer("pair.1", &input, true);
                let out = layer("pair.2", &hidden, false);
                pair[a * eye.angles + b] = [out[0], out[1]];
                hidden_of[a * eye.angles + b] = hidden;
            }
        }
    }
    let pairs: Vec<usize> = (0..set.len())
        .flat_map(|i| (0..i).map(move |j| (i, j)))
        .map(|(i, j)| set[i] * eye.angles + set[j])
        .collect();
    let (beams, couples) = (set.len() as f64, pairs.len() as f64);
    let mut value = set.iter().map(|a| single[*a][0]).sum::<f64>() / beams;
    value += pairs.iter().map(|at| pair[*at][0]).sum::<f64>() / couples;
    for unit in 0..SIZES.set {
        let mut sum = number("set.1.bias", unit, 0);
        for (place, tensor) in set.iter().map(|a| &angles[*a]).map(|h| (h, "set.1.angle")) {
            sum += (0..place.len()).map(|c| number(tensor, unit, c) * place[c]).sum::<f64>() / beams;
        }
        for hidden in pairs.iter().map(|at| &hidden_of[*at]) {
            sum +=
                (0..hidden.len()).map(|c| number("set.1.pair", unit, c) * hidden[c]).sum::<f64>() / couples;
        }
        value += number("set.2.weight", 0, unit) * sum.max(0.0);
    }
    Naive { single, pair, value }
}

#[test]
fn the_forward_pass_is_that_of_a_naive_network() {
    for (seed, layers) in [(1, 2), (2, 2), (3, 2), (4, 1), (5, 3), (6, 4)] {
        let (model, eye) = (model_of(Sizes { layers, ..SIZES }, seed), eye(seed + 10, 20));
        let set = [1, 6, 11, 17];
        let Naive { single, pair, value } = naive(&model, &eye, &set);
        let judged = model.judge(&eye);
        let found = judged.value(&set);
        assert!((found - value).abs() < 1e-3 * (1.0 + value.abs()), "{found} {value}");
        let near = |a: &[[f32; 2]], b: &[[f64; 2]]| {
            for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
                assert!((f64::from(*a) - b).abs() < 1e-3 * (1.0 + b.abs()), "{a} {b}");
            }
        };
        near(judged.single(), &single);
        near(judged.pair(), &pair);
        assert!(single.iter().flatten().any(|v| v.abs() > 0.01));
    }
}

#[test]
fn every_place_has_its_tensor_at_any_depth() {
    for layers in 1..=4 {
        let sizes = Sizes { layers, ..SIZES };
        let tensors = sizes.tensors();
        let named = |place: usize, name: &str| assert_eq!(tensors[place].0, name);
        let at = sizes.behind();
        named(place::TRAINED, "structure.1.weight");
        named(place::RING, "ring.1.tap.0");
        named(at.angle - 1, &format!("ring.{layers}.bias"));
        named(at.angle, "angle.weight");
        named(at.single, "single.weight");
        named(at.neighbour, "beside.weight");
        named(at.pair_1, "pair.1.weight");
        named(at.pair_2, "pair.2.weight");
        named(at.set_angle, "set.1.angle");
        named(at.set_pair, "set.1.pair");
        named(at.set_bias, "set.1.bias");
        named(at.set_out, "set.2.weight");
        assert_eq!(at.set_out + 1, tensors.len());
    }
}

#[test]
fn a_turned_ring_and_a_mirrored_ring_get_turned_and_mirrored_answers() {
    let (model, eye) = (model(5), eye(6, 20));
    let judged = model.judge(&eye);
    for (turn, mirror) in [(7, false), (0, true), (3, true)] {
        let to = |a: usize| if mirror { (20 + turn - a) % 20 } else { (a + turn) % 20 };
        let mut other = eye.clone();
        for a in 0..20 {
            other.target[to(a)] = eye.target[a];
            for (s, t) in eye.structures.iter().zip(&mut other.structures) {
                t[to(a)] = s[a];
            }
            for b in 0..20 {
                other.pairs[to(a) * 20 + to(b)] = eye.pairs[a * 20 + b];
            }
        }
        let other = model.judge(&other);
        let set = [0, 4, 9, 15];
        let turned = set.map(to);
        assert!((judged.value(&set) - other.value(&turned)).abs() < 1e-4);
        assert!((judged.logit(2, &set) - other.logit(to(2), &turned)).abs() < 1e-4);
    }
}

#[test]
fn the_order_of_structures_does_not_matter() {
    let (model, eye) = (model(5), eye(6, 20));
    let mut other = eye.clone();
    other.structures.reverse();
    let difference = model.judge(&eye).value(&[1, 7, 13]) - model.judge(&other).value(&[1, 7, 13]);
    assert!(difference.abs() < 1e-5);
}

#[test]
fn the_best_set_has_the_least_value_of_all() {
    // Small enough to look at every set.
    let judged: Judgement = model(8).judge(&eye(9, 12));
    let ring = Ring::new(12, 2).unwrap();
    let mut least = f64::INFINITY;
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if ring.set(&[a, b, c]).is_ok() {
                    least = least.min(judged.value(&[a, b, c].map(usize::from)));
                }
            }
        }
    }
    let best = judged.best_sets(ring, 3, 4).unwrap();
    assert_eq!(best.len(), 4);
    let of = |i: usize| judged.value(&best[i].beams().iter().map(|b| usize::from(*b)).collect::<Vec<_>>());
    assert!((of(0) - least).abs() < 1e-9);
    assert!(of(0) <= of(1) && of(1) <= of(2) && of(2) <= of(3));
}

#[test]
fn it_is_a_prior_for_rings_of_any_count() {
    let judged = model(8).judge(&eye(9, 90));
    for (count, gap) in [(90, 5), (36, 2), (18, 1)] {
        let ring = Ring::new(count, gap).unwrap();
        let set = set_of_prior(&judged, ring, 5).unwrap();
        assert_eq!(set.beams().len(), 5);
        let scores = judged.scores(ring, &set.beams()[..4], &ring.legal(&set.beams()[..4]));
        assert!(scores.iter().all(|s| s.is_finite()));
    }
}

#[test]
fn a_model_file_is_read_as_it_was_written_and_has_one_form() {
    let model = model(3);
    let bytes = model.to_safetensors().unwrap();
    assert_eq!(bytes, model.to_safetensors().unwrap());
    assert_eq!(Model::from_safetensors(&bytes).unwrap(), model);
}

#[test]
fn numbers_that_make_no_network_are_refused() {
    let good = model(3);
    let mut numbers = good.numbers().to_vec();
    numbers[7][0] = f32::NAN;
    assert!(matches!(
        Model::new(SIZES, numbers.clone()),
        Err(ModelError::Number { name: "structure.1.bias", at: 0, .. })
    ));
    numbers[7].push(0.0);
    assert!(matches!(Model::new(SIZES, numbers.clone()), Err(ModelError::Length { .. })));
    numbers.pop();
    assert!(matches!(Model::new(SIZES, numbers.clone()), Err(ModelError::Tensors { .. })));
    for sizes in [Sizes { ring: 0, ..SIZES }, Sizes { layers: 0, ..SIZES }, Sizes { layers: 5, ..SIZES }] {
        assert!(matches!(Model::new(sizes, numbers.clone()), Err(ModelError::Sizes(_))));
    }
    let mut flat = good.numbers().to_vec();
    flat[1][2] = 0.0;
    assert!(matches!(Model::new(SIZES, flat), Err(ModelError::Number { name: "target.scale", at: 2, .. })));
}

#[test]
fn files_of_other_networks_are_refused_with_the_reason() {
    let bytes = model(3).to_safetensors().unwrap();
    let text = |from: &str, to: &str| {
        let mut bytes = bytes.clone();
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        Model::from_safetensors(&bytes).unwrap_err()
    };
    assert!(matches!(text("stillpoint_planner", "stillpoint_another"), ModelFileError::Meaning(_)));
    assert!(matches!(text("version\\\":2", "version\\\":9"), ModelFileError::Meaning(_)));
    assert!(matches!(text("ring\\\":4", "ring\\\":5"), ModelFileError::Tensor { .. }));
    assert!(matches!(text("single.bias", "single.bios"), ModelFileError::Tensor { .. }));
    assert!(matches!(Model::from_safetensors(&vec![0; 6 << 20]), Err(ModelFileError::Form(_))));
}

#[test]
fn features_that_are_left_out_change_nothing_that_the_network_says() {
    let (whole, eye) = (model(3), eye(4, 20));
    assert!(whole.without().is_empty());
    for group in Group::ALL {
        let mut numbers = whole.numbers().to_vec();
        leave_out(&[group], &mut numbers);
        let model = Model::new(SIZES, numbers).unwrap();
        assert_eq!(model.without(), [group]);
        let mut other = eye.clone();
        // Each feature of the group, and no other, is another one.
        let mut moved = 0;
        let mut change = |tensor: usize, of: &mut [f32]| {
            for (place, value) in of.iter_mut().enumerate() {
                if model.numbers()[tensor][place] != whole.numbers()[tensor][place] {
                    *value += 0.5;
                    moved += 1;
                }
            }
        };
        other.target.iter_mut().for_each(|f| change(1, f));
        other.structures.iter_mut().flatten().for_each(|f| change(3, f));
        other.pairs.iter_mut().for_each(|f| change(5, f));
        assert!(moved > 0, "{group:?}");
        let of = |model: &Model, eye: &Eye| model.judge(eye).value(&[1, 6, 11, 17]);
        assert_eq!(of(&model, &eye), of(&model, &other), "{group:?}");
        assert_ne!(of(&whole, &eye), of(&whole, &other), "{group:?}");
    }
}

#[test]
fn a_file_says_what_its_network_does_without_and_how_deep_it_is() {
    let mut numbers = model(3).numbers().to_vec();
    leave_out(&[Group::Fit, Group::Apart], &mut numbers);
    let model = Model::new(SIZES, numbers).unwrap();
    let bytes = model.to_safetensors().unwrap();
    assert_eq!(Model::from_safetensors(&bytes).unwrap(), model);
    let swap = |bytes: &[u8], from: &str, to: &str| {
        let mut bytes = bytes.to_vec();
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        Model::from_safetensors(&bytes).unwrap_err()
    };
    let message = swap(&bytes, "apart", "apert").to_string();
    assert!(message.contains("metadata"), "{message}");
    let message = swap(&bytes, "\\\"apart\\\"", "\\\"ways\\\" ").to_string();
    assert!(message.contains("fit, ways are left out, and its scales leave out fit, apart"), "{message}");
    let deep = model_of(Sizes { layers: 4, ..SIZES }, 5).to_safetensors().unwrap();
    assert_eq!(Model::from_safetensors(&deep).unwrap().sizes().layers, 4);
    assert!(matches!(swap(&deep, "layers\\\":4", "layers\\\":3"), ModelFileError::Tensor { .. }));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn broken_files_give_an_error_or_a_sound_model_and_never_a_panic(
        cut in any::<prop::sample::Index>(), flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8), ends in any::<bool>(),
    ) {
        let mut bytes = model(3).to_safetensors().unwrap();
        for (at, value) in flips {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if ends {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(model) = Model::from_safetensors(&bytes) {
            prop_assert!(model.numbers().iter().flatten().all(|v| v.is_finite()));
        }
    }
}
