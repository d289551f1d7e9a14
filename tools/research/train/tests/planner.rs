//! The training of the prior of beams: agreement with the plain network, overfitting, resuming, broken checkpoints.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use candle_core::{Device, Tensor, Var};
use serde_json::Value;
use stillpoint_mechanics::random::Random;
use stillpoint_network::eye::{PAIR, STRUCTURE, TARGET};
use stillpoint_network::patient::{Body, Table};
use stillpoint_network::{Coarseness, Due, Eye, Game, Group, Model, Patient, Rules, Sizes};
use stillpoint_plan::beams::Ring;
use stillpoint_train::TrainError;
use stillpoint_train::planner::{
    Checkpoint, Done, Example, Network, Options, Players, Progress, Ready, Schedule, Training, Weights, loss,
    scales, train,
};

const ANGLES: usize = 90;
const COARSE: Coarseness = Coarseness { grid_mm: 10.0, bixel_mm: 20.0 };
const TINY: Sizes = Sizes { structure: 4, ring: 8, angle: 8, neighbour: 4, pair: 8, set: 6, layers: 2 };

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

/// Legal sets of five beams, drawn.
fn drawn(count: usize, random: &mut Random) -> Vec<Vec<u16>> {
    let ring = Ring::new(90, 5).unwrap();
    let mut sets = Vec::new();
    while sets.len() < count {
        let mut set: Vec<u16> = Vec::new();
        while set.len() < 5 && !ring.legal(&set).is_empty() {
            let beam = (random.uniform() * 90.0) as u16;
            if ring.fits(beam, &set) {
                set.push(beam);
            }
        }
        set.sort_unstable();
        if set.len() == 5 && !sets.contains(&set) {
            sets.push(set);
        }
    }
    sets
}

/// A patient whose costs follow from its features by a rule that the network does not know.
fn example(seed: u64) -> Example {
    let mut random = Random::new(seed);
    let eye = eye(&mut random);
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
    let patient = Patient { body: Body::Pelvis(seed), table: Table::Plain, coarse: COARSE };
    let due = Due { name: String::new(), patient, seed, rules: Rules::OPENING };
    Example::new(eye.clone(), &[&game(&due, None, 150, cost)]).unwrap()
}

/// A game whose costs follow this rule.
fn game(due: &Due, network: Option<String>, sets: usize, cost: impl Fn(&[u16]) -> f64) -> Game {
    let rotations: Vec<f64> = (0..18).map(|r| cost(&[0, 18, 36, 54, 72].map(|b| b + r))).collect();
    let sets: Vec<(Vec<u16>, f64)> =
        drawn(sets, &mut Random::new(due.seed)).into_iter().map(|set| (set.clone(), cost(&set))).collect();
    let proposed: Vec<f64> = sets.iter().take(due.rules.proposed).map(|(_, cost)| *cost).collect();
    let text = serde_json::json!({
        "version": 1, "rules": due.rules, "patient": due.patient, "seed": due.seed, "network": network,
        "class": null, "rotations": rotations, "proposed": proposed, "sets": sets,
    });
    Game::from_bytes(&serde_json::to_vec(&text).unwrap()).unwrap()
}

fn options(passes: usize) -> Options {
    Options {
        sizes: TINY,
        weights: Weights { mse: 100.0, ce: 0.3, lambda: 1e-6 },
        rate: 1e-2,
        passes,
        sets: 64,
        states: 4,
        seed: 3,
        without: Vec::new(),
    }
}

/// Passes over examples, validated with the same.
fn trained(examples: &[Example], passes: usize) -> Training {
    trained_by(options(passes), examples)
}

fn trained_by(options: Options, examples: &[Example]) -> Training {
    let passes = options.passes;
    let mut training = Training::new(String::new(), options, scales(examples)).unwrap();
    let ready: Vec<Ready> = examples.iter().map(|e| training.ready(e.clone()).unwrap()).collect();
    for _ in 0..passes {
        training.pass(&ready.iter().collect::<Vec<_>>(), &ready).unwrap();
    }
    training
}

#[test]
fn a_tiny_network_overfits_two_patients() {
    let cases = [example(1), example(2)];
    let training = trained(&cases, 60);
    let (first, last) = (training.passes()[0], training.passes()[59]);
    // The loss of the policy falls no lower than the entropy of what it should say.
    assert!(last.validation < 0.85 * first.validation, "{first:?} {last:?}");
    // It ranks the sets that it has seen: the one that it takes is nearly the best.
    assert!(last.above_percent < 0.25 * first.above_percent.max(4.0), "{first:?} {last:?}");
    // And it finds a set that no random set reaches.
    let ring = Ring::new(90, 5).unwrap();
    let judged = training.model().unwrap().judge(&cases[0].eye);
    let best = judged.best_sets(ring, 5, 1).unwrap();
    let of = |set: &[u16]| judged.value(&set.iter().map(|b| usize::from(*b)).collect::<Vec<_>>());
    let least = cases[0].sets.iter().map(|set| of(set)).fold(f64::INFINITY, f64::min);
    assert!(of(best[0].beams()) <= least + 1e-6);
}

#[test]
fn the_tensors_say_what_the_plain_network_says() {
    agrees(options(2));
    agrees(Options { sizes: Sizes { layers: 1, ..TINY }, without: vec![Group::Overlap], ..options(2) });
    agrees(Options {
        sizes: Sizes { layers: 4, ..TINY },
        without: vec![Group::Ways, Group::Fit],
        ..options(2)
    });
}

fn agrees(options: Options) {
    let case = example(4);
    let model = trained_by(options.clone(), std::slice::from_ref(&case)).model().unwrap();
    assert_eq!((model.sizes(), model.without()), (options.sizes, options.without));
    let fixed: Vec<Vec<f32>> = model.numbers()[..6].to_vec();
    let network = Network::new(options.sizes, fixed, 1).unwrap();
    network.set(&model.numbers()[6..]).unwrap();
    let predicted = network.forward(&network.load(&case).unwrap()).unwrap();
    let judged = model.judge(&case.eye);
    let sets: Vec<&Vec<u16>> = case.sets.iter().take(20).collect();
    let values = predicted.values(&sets).unwrap().to_vec1::<f32>().unwrap();
    for (set, value) in sets.iter().zip(values) {
        let plain = judged.value(&set.iter().map(|b| usize::from(*b)).collect::<Vec<_>>());
        assert!((plain - f64::from(value)).abs() < 1e-4, "{plain} {value}");
    }
    let mut random = Random::new(1);
    for retained in 0..5 {
        let states = case.states(2, retained, &mut random).unwrap();
        let logits = predicted.logits(&states).unwrap().to_vec2::<f32>().unwrap();
        for ((retained, legal), row) in states.retained.iter().zip(&states.legal).zip(logits) {
            let retained: Vec<usize> = retained.iter().map(|b| usize::from(*b)).collect();
            for (angle, logit) in row.into_iter().enumerate().filter(|(a, _)| legal[*a]) {
                assert!((judged.logit(angle, &retained) - f64::from(logit)).abs() < 1e-4);
            }
        }
        let sums = states.pi.iter().map(|row| row.iter().sum::<f32>());
        assert!(sums.into_iter().all(|sum| (sum - 1.0).abs() < 1e-5));
    }
}

/// Players that make costs up, and fail at the game of this number.
struct Faked {
    until: usize,
    played: usize,
}

impl Players for Faked {
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError> {
        // In the opposite order: nothing may depend on when a game ends.
        for (place, due) in due.iter().enumerate().rev() {
            if self.played == self.until {
                return Err(TrainError::Plan("cut off".to_owned()));
            }
            self.played += 1;
            let hash = network.map(|network| network.hash().unwrap());
            // Sets near the front are dear, and every game is a little different.
            let cost = |set: &[u16]| {
                let front: f64 = set.iter().map(|b| (f64::from(*b) * 0.07).cos()).sum();
                1000.0 + 50.0 * front + (due.seed % 7) as f64
            };
            done(place, game(due, hash, 20, cost))?;
        }
        Ok(())
    }
}

fn schedule() -> Schedule {
    let pelvis = |seed| Patient { body: Body::Pelvis(seed), table: Table::Plain, coarse: COARSE };
    Schedule {
        train: vec![pelvis(1), pelvis(2)],
        validate: vec![pelvis(3)],
        test: vec![pelvis(3)],
        rounds: vec![vec![pelvis(1), pelvis(2)], vec![pelvis(2), pelvis(1)]],
        start: 2,
        passes: 1,
        end: 2,
        buffer: 3,
        opening: Rules::OPENING,
        game: Rules::SELF_PLAY,
        reference: Rules::REFERENCE,
        exam: Rules::EXAM,
        seed: 5,
    }
}

#[test]
fn a_self_play_that_was_cut_off_anywhere_resumes_to_the_bit() {
    let schedule = schedule();
    let run = |folder: &std::path::Path, until: usize| {
        let mut players = Faked { until, played: 0 };
        let trained = train(&schedule, &options(1), folder, &mut players, &|_| ());
        (trained, players.played)
    };
    let folder = tempfile::tempdir().unwrap();
    let (whole, played) = run(&folder.path().join("whole"), usize::MAX);
    let whole = whole.unwrap();
    // Openings, and those of the examined patient (twice the same); two rounds of two games and an examination; the last
    // examinations, of which both are one.
    assert_eq!(played, 2 + 1 + 2 * (2 + 1) + 1);
    assert_eq!((whole.passes.len(), whole.strength.len(), whole.tested.len(), whole.games), (6, 3, 1, 6));
    // The buffer holds three games.
    let examples: Vec<usize> = whole.passes.iter().map(|pass| pass.examples).collect();
    assert_eq!(examples, [2, 2, 2, 3, 3, 3]);
    let cut = folder.path().join("cut");
    for until in [1, 1, 2, 1, 2, 0] {
        let (trained, played) = run(&cut, until);
        assert_eq!(trained.unwrap_err().to_string(), "planning: cut off");
        assert_eq!(played, until);
    }
    let (resumed, repeated) = run(&cut, usize::MAX);
    assert_eq!(resumed.unwrap(), whole);
    assert_eq!(repeated, 3, "games that were played are not played again");
    // All of it is there: nothing is played, and nothing is trained.
    let passes = std::sync::Mutex::new(0);
    let count = |reported| {
        if matches!(reported, Progress::Pass(_)) {
            *passes.lock().unwrap() += 1;
        }
    };
    let mut players = Faked { until: 0, played: 0 };
    assert_eq!(train(&schedule, &options(1), &cut, &mut players, &count).unwrap(), whole);
    assert_eq!(passes.into_inner().unwrap(), 0);
    // A game that was damaged is played again, with the weights of its round.
    std::fs::write(cut.join("games/round-000-0001.json"), "{").unwrap();
    let (mended, repeated) = run(&cut, usize::MAX);
    assert_eq!((mended.unwrap(), repeated), (whole, 1));
    let other = Schedule { buffer: 4, ..schedule };
    let refused = train(&other, &options(1), &cut, &mut players, &|_| ()).unwrap_err().to_string();
    assert!(refused.contains("other patients, games or options"), "{refused}");
    for end in [0, 7, 100, 2000] {
        let bytes = std::fs::read(cut.join("training.safetensors")).unwrap();
        let broken = folder.path().join("broken");
        std::fs::write(&broken, &bytes[..end.min(bytes.len() - 1)]).unwrap();
        assert!(Checkpoint::read(&broken).is_err());
    }
}

#[test]
fn options_that_cannot_be_are_refused() {
    let case = [example(8)];
    let refused = |options: Options| match Training::new(String::new(), options, scales(&case)) {
        Ok(_) => panic!("not refused"),
        Err(why) => why.to_string(),
    };
    assert!(refused(Options { rate: 0.0, ..options(1) }).contains("learning rate"));
    assert!(refused(options(0)).contains("passes"));
    assert!(refused(Options { sizes: Sizes { layers: 5, ..TINY }, ..options(1) }).contains("layers"));
    let mut training = Training::new(String::new(), options(1), scales(&case)).unwrap();
    assert!(training.pass(&[], &[]).unwrap_err().to_string().contains("train on"));

    // A training refuses them before a game is played.
    let folder = tempfile::tempdir().unwrap();
    for wrong in
        [Options { rate: 2.0, ..options(1) }, Options { sizes: Sizes { layers: 0, ..TINY }, ..options(1) }]
    {
        let mut players = Faked { until: usize::MAX, played: 0 };
        let why = train(&schedule(), &wrong, folder.path(), &mut players, &|_| ()).unwrap_err().to_string();
        assert!(players.played == 0 && why.contains("must be"), "{why}");
    }
}

#[test]
fn loss_and_gradients_are_those_of_the_vectors() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/vectors/g_loss.json");
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
