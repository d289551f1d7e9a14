//! The training of the prior of beams: agreement with the plain network, overfitting, resuming, broken checkpoints.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use candle_core::{Device, Tensor, Var};
use serde_json::Value;
use stillpoint_network::Eye;
use stillpoint_network::Sizes;
use stillpoint_network::eye::{PAIR, STRUCTURE, TARGET};
use stillpoint_plan::beams::Ring;
use stillpoint_random::Random;
use stillpoint_train::planner::{
    Checkpoint, Coarseness, Epoch, Example, Fitted, Gather, Network, Options, SolvedCase, Weights, fit, loss,
};

const ANGLES: usize = 90;
const TINY: Sizes = Sizes { structure: 4, ring: 8, angle: 8, beside: 4, pair: 8 };

fn eye(random: &mut Random) -> Eye {
    let mut next = || random.normal() as f32;
    // Smooth around the ring, as the features of a patient are.
    let mut smooth = || {
        let (a, b, c) = (next(), next(), next());
        move |angle: usize| {
            let turn = core::f32::consts::TAU * angle as f32 / ANGLES as f32;
            a * turn.cos() + b * turn.sin() + 0.5 * c * (2.0 * turn).cos()
        }
    };
    let target: Vec<_> = (0..TARGET).map(|_| smooth()).collect();
    let structures: Vec<Vec<_>> = (0..2).map(|_| (0..STRUCTURE).map(|_| smooth()).collect()).collect();
    let mut pairs = vec![[0.0; PAIR]; ANGLES * ANGLES];
    for a in 0..ANGLES {
        for b in 0..ANGLES {
            let apart = core::f32::consts::TAU * a.abs_diff(b) as f32 / ANGLES as f32;
            pairs[a * ANGLES + b] = std::array::from_fn(|k| ((k + 1) as f32 * apart).cos());
        }
    }
    Eye {
        angles: ANGLES,
        target: (0..ANGLES).map(|a| std::array::from_fn(|k| target[k](a))).collect(),
        structures: structures
            .iter()
            .map(|s| (0..ANGLES).map(|a| std::array::from_fn(|k| s[k](a))).collect())
            .collect(),
        pairs,
    }
}

/// A case whose costs follow from its features by a rule that the network does not know.
fn example(seed: u64) -> Example {
    let mut random = Random::new(seed);
    let eye = eye(&mut random);
    let ring = Ring::new(90, 5).unwrap();
    let cost = |set: &[u16]| {
        let singles: f32 = set.iter().map(|b| eye.target[usize::from(*b)][0]).sum();
        let mut pairs = 0.0;
        for (i, a) in set.iter().enumerate() {
            pairs += set[..i]
                .iter()
                .map(|b| eye.pairs[usize::from(*a) * ANGLES + usize::from(*b)][1])
                .sum::<f32>();
        }
        1000.0 * f64::from(0.1 * singles + 0.03 * pairs).exp()
    };
    let mut sets = Vec::new();
    for _ in 0..150 {
        let key = (random.uniform() * 1e9) as u64;
        let mut set: Vec<u16> = Vec::new();
        let mut draws = Random::new(key);
        while set.len() < 5 {
            let beam = (draws.uniform() * 90.0) as u16;
            if ring.fits(beam, &set) && set.iter().all(|b| *b != beam) {
                set.push(beam);
            }
            if ring.legal(&set).is_empty() {
                set.clear();
            }
        }
        set.sort_unstable();
        let found = cost(&set);
        sets.push((set, found));
    }
    let rotations: Vec<f64> = (0..18).map(|r| cost(&[0, 18, 36, 54, 72].map(|b| b + r))).collect();
    let text = serde_json::json!({
        "version": 1,
        "by": Gather { coarse: Coarseness { grid_mm: 8.0, bixel_mm: 14.0 }, exchange: 0, annealing: 0, random: 150 },
        "seed": seed, "class": 1000.0, "rotations": rotations, "sets": sets,
    });
    let solved: SolvedCase = serde_json::from_value(text).unwrap();
    Example::new(eye.clone(), &solved).unwrap()
}

fn options(epochs: usize) -> Options {
    Options {
        sizes: TINY,
        weights: Weights { mse: 100.0, ce: 0.3, lambda: 1e-6 },
        rate: 1e-2,
        epochs,
        sets: 64,
        states: 4,
        seed: 3,
    }
}

#[test]
fn a_tiny_network_overfits_two_cases() {
    let cases = [example(1), example(2)];
    let mut seen: Vec<Epoch> = Vec::new();
    let fitted = fit(&cases, &cases, &options(60), None, |epoch| seen.push(*epoch)).unwrap();
    let (first, last) = (seen[0], seen[fitted.best - 1]);
    assert!(last.validation < 0.75 * first.validation, "{first:?} {last:?}");
    // It ranks the sets that it has seen: the one that it takes is nearly the best.
    assert!(last.above_percent < 0.25 * first.above_percent.max(4.0), "{first:?} {last:?}");
    // And it finds a set that no random set reaches.
    let ring = Ring::new(90, 5).unwrap();
    let judged = fitted.model.judge(&cases[0].eye);
    let best = judged.best_sets(ring, 5, 1).unwrap();
    let of = |set: &[u16]| judged.value(&set.iter().map(|b| usize::from(*b)).collect::<Vec<_>>());
    let least = cases[0].sets.iter().map(|set| of(set)).fold(f64::INFINITY, f64::min);
    assert!(of(best[0].beams()) <= least + 1e-6);
}

#[test]
fn the_tensors_say_what_the_plain_network_says() {
    let case = example(4);
    let fitted: Fitted =
        fit(std::slice::from_ref(&case), std::slice::from_ref(&case), &options(2), None, |_| ()).unwrap();
    let fixed: Vec<Vec<f32>> = fitted.model.numbers()[..6].to_vec();
    let network = Network::new(TINY, fixed, 1).unwrap();
    network.set(&fitted.model.numbers()[6..]).unwrap();
    let said = network.forward(&network.load(&case).unwrap()).unwrap();
    let judged = fitted.model.judge(&case.eye);
    let sets: Vec<&Vec<u16>> = case.sets.iter().take(20).collect();
    let values = said.values(&sets).unwrap().to_vec1::<f32>().unwrap();
    for (set, value) in sets.iter().zip(values) {
        let plain = judged.value(&set.iter().map(|b| usize::from(*b)).collect::<Vec<_>>());
        assert!((plain - f64::from(value)).abs() < 1e-4, "{plain} {value}");
    }
    let mut random = Random::new(1);
    for kept in 0..5 {
        let states = case.states(2, kept, &mut random).unwrap();
        let logits = said.logits(&states).unwrap().to_vec2::<f32>().unwrap();
        for ((kept, legal), row) in states.kept.iter().zip(&states.legal).zip(logits) {
            let kept: Vec<usize> = kept.iter().map(|b| usize::from(*b)).collect();
            for (angle, logit) in row.into_iter().enumerate().filter(|(a, _)| legal[*a]) {
                assert!((judged.logit(angle, &kept) - f64::from(logit)).abs() < 1e-4);
            }
        }
        let sums = states.pi.iter().map(|row| row.iter().sum::<f32>());
        assert!(sums.into_iter().all(|sum| (sum - 1.0).abs() < 1e-5));
    }
}

#[test]
fn a_training_that_was_cut_off_resumes_to_the_bit() {
    let (train, validate) = ([example(5), example(6)], [example(7)]);
    let whole = fit(&train, &validate, &options(6), None, |_| ()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("training.safetensors");
    // Cut off in the fourth epoch: the checkpoint is that of the third.
    let cut = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        fit(&train, &validate, &options(6), Some(&path), |epoch| assert!(epoch.number < 4, "cut off"))
    }));
    assert!(cut.is_err());
    assert_eq!(Checkpoint::read(&path).unwrap().epochs.len(), 3);
    let mut resumed_at = Vec::new();
    let resumed = fit(&train, &validate, &options(6), Some(&path), |e| resumed_at.push(e.number)).unwrap();
    assert_eq!(resumed_at, [4, 5, 6]);
    assert_eq!(resumed, whole);
    let other = fit(&train, &validate, &options(7), Some(&path), |_| ()).unwrap_err().to_string();
    assert!(other.contains("other options"), "{other}");
    for end in [0, 7, 100, 2000] {
        let bytes = std::fs::read(&path).unwrap();
        let broken = folder.path().join("broken");
        std::fs::write(&broken, &bytes[..end.min(bytes.len() - 1)]).unwrap();
        assert!(Checkpoint::read(&broken).is_err());
    }
}

#[test]
fn options_that_cannot_be_are_refused() {
    let case = [example(8)];
    let refused = |options: Options| fit(&case, &case, &options, None, |_| ()).unwrap_err().to_string();
    assert!(refused(Options { rate: 0.0, ..options(1) }).contains("learning rate"));
    assert!(refused(options(0)).contains("epochs"));
    assert!(fit(&[], &case, &options(1), None, |_| ()).unwrap_err().to_string().contains("train on"));
}

#[test]
fn loss_and_gradients_are_those_of_the_vectors() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/vectors/g_loss.json");
    let vectors: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let cases = vectors["cases"].as_array().unwrap();
    assert!(cases.len() >= 4);
    for case in cases {
        let list =
            |v: &Value| v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<f64>>();
        let input = |name: &str| &case["in"][name];
        let row = |name: &str| {
            Tensor::from_vec(list(input(name)), (1, list(input(name)).len()), &Device::Cpu).unwrap()
        };
        let scalar =
            |name: &str| Tensor::from_vec(vec![input(name).as_f64().unwrap()], 1, &Device::Cpu).unwrap();
        let (logits, v) =
            (Var::from_tensor(&row("logits")).unwrap(), Var::from_tensor(&scalar("v")).unwrap());
        let number = |name: &str| input(name).as_f64().unwrap();
        let weights = Weights { mse: number("w_mse"), ce: number("w_ce"), lambda: number("lambda") };
        let found = loss((&scalar("zeta"), &v), (&row("pi"), &logits), &[row("psi")], weights).unwrap();
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-10, "{}: {a} {b}", case["id"]);
        near(found.to_scalar::<f64>().unwrap(), case["out"]["total"].as_f64().unwrap());
        let gradients = found.backward().unwrap();
        let of = |var: &Var| gradients.get(var).unwrap().flatten_all().unwrap().to_vec1::<f64>().unwrap();
        of(&logits).into_iter().zip(list(&case["out"]["grad_logits"])).for_each(|(a, b)| near(a, b));
        near(of(&v)[0], case["out"]["grad_v"].as_f64().unwrap());
    }
}
