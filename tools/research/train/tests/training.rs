//! Training: the tensors say what the plain network says, gradients are those of the vectors, and a network learns.

#![allow(clippy::unwrap_used, clippy::panic)]

use serde_json::Value;
use stillpoint_train::TrainError;
use stillpoint_train::dataset::{Cut, Dataset, Sample};
use stillpoint_train::excite::{Excitation, record};
use stillpoint_train::fit::{Optimiser, Options, fit};
use stillpoint_train::linear;
use stillpoint_train::network::Network;

const VECTORS: &str =
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/vectors/e_lstm.json"));

fn flat(value: &Value) -> Vec<f32> {
    match value {
        Value::Array(items) => items.iter().flat_map(flat).collect(),
        number => vec![number.as_f64().unwrap() as f32],
    }
}

#[test]
fn outputs_and_gradients_are_those_of_the_vectors() {
    let file: Value = serde_json::from_str(VECTORS).unwrap();
    let case = file["cases"].as_array().unwrap().iter().find(|c| c["id"] == "forward").unwrap();
    let (given, out) = (&case["in"], &case["out"]);
    let network = Network::new(9, &[9, 6, 6], 3, 1).unwrap();
    let mut tensors = Vec::new();
    for layer in given["layers"].as_array().unwrap() {
        tensors.extend([flat(&layer["Wih"]), flat(&layer["Whh"]), flat(&layer["b"])]);
    }
    tensors.extend([flat(&given["fc"]["W"]), flat(&given["fc"]["b"])]);
    network.set(&tensors).unwrap();
    let predicted = network.forward_all(&flat(&given["x"]), 6).unwrap();
    let expected = flat(&out["y"]);
    for (found, expected) in predicted.flatten_all().unwrap().to_vec1::<f32>().unwrap().iter().zip(&expected)
    {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
    // (4.39) sums over the steps; the loss here is the mean over rows, of which there are six.
    let loss = (network.loss(&predicted, &flat(&given["target"])).unwrap() * 6.0).unwrap();
    assert!(
        (loss.to_scalar::<f32>().unwrap() - out["loss_half_sum_sq"].as_f64().unwrap() as f32).abs() < 1e-4
    );
    let gradients = loss.backward().unwrap();
    let vars = network.vars();
    let gradient = |place: usize| -> Vec<f32> {
        gradients.get(&vars[place]).unwrap().flatten_all().unwrap().to_vec1().unwrap()
    };
    let expected = &out["grad_central_difference"];
    for (name, found) in [
        ("fc.b", gradient(10)),
        ("l0.Wih[0,:]", gradient(0)[..9].to_vec()),
        ("l2.Whh[7,:]", gradient(7)[42..48].to_vec()),
        ("l1.b[0:4]", gradient(5)[..4].to_vec()),
    ] {
        for (found, expected) in found.iter().zip(flat(&expected[name])) {
            assert!((found - expected).abs() < 1e-5 + 1e-4 * expected.abs(), "{name}: {found} {expected}");
        }
    }
}

fn few(seed: u64) -> Vec<Vec<Sample>> {
    record(&Excitation { runs: 5, seconds: 20.0, seed, ..Excitation::default() }, |_| {}).unwrap()
}

#[test]
fn the_plain_network_says_what_the_tensors_say() {
    let network = Network::new(9, &[9, 6, 6], 3, 7).unwrap();
    let plain = network.plain(&network.numbers().unwrap()).unwrap();
    let numbers: Vec<f32> = (0..54).map(|i| (i as f32 * 0.7).sin()).collect();
    let predicted =
        network.forward(&numbers, 6, None).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let (mut memory, mut y) = (plain.memory(), [0.0; 3]);
    for sample in numbers.chunks_exact(9) {
        let sample: Vec<f64> = sample.iter().map(|v| f64::from(*v)).collect();
        plain.step(&sample, &mut memory);
    }
    plain.output(&memory, &mut y);
    for (a, b) in predicted.iter().zip(y) {
        assert!((f64::from(*a) - b).abs() < 1e-6, "{a} {b}");
    }
    assert_eq!(plain.parameters(), 1401);
}

#[test]
fn a_network_learns_how_the_rig_moves_and_the_same_seed_learns_the_same() {
    let data = Dataset::new(&few(3), Cut::default()).unwrap();
    let options = Options {
        optimiser: Optimiser::AdamW,
        learning_rate: 1e-2,
        epochs: 6,
        dropout: 0.0,
        ..Options::default()
    };
    let mut received = 0;
    let first = fit(&data, &options, |_| received += 1).unwrap();
    assert_eq!((received, first.epochs.len()), (6, 6));
    let (begin, best) = (first.epochs[0].validation, first.epochs[first.best - 1].validation);
    assert!(best < 0.8 * begin, "{begin} to {best}");
    assert!(first.left.iter().all(|left| *left < 1.0), "{:?}", first.left);
    assert_eq!(fit(&data, &options, |_| {}).unwrap(), first);
}

#[test]
fn least_squares_leave_nothing_of_a_linear_motion_and_little_of_the_rigs() {
    let random = |run: u64, i: usize| ((run as f64 + 1.3) * (i as f64 + 0.7) * 12.9898).sin();
    let run = |number: u64| -> Vec<Sample> {
        let mut pose = vec![0.0; 3];
        let step = |i: usize| {
            let duty: Vec<f64> = (0..6).map(|v| 0.1 * random(number, 7 * i + v).abs()).collect();
            let now = Sample { pose: pose.clone(), duty };
            for (channel, value) in pose.iter_mut().enumerate() {
                *value += 0.3 * (now.duty[2 * channel] - now.duty[2 * channel + 1]) - 0.1 * *value;
            }
            now
        };
        (0..100).map(step).collect()
    };
    let data = Dataset::new(&(0..5).map(run).collect::<Vec<_>>(), Cut::default()).unwrap();
    let left = linear::left(&data).unwrap();
    assert!(left.iter().all(|left| *left < 1e-3), "{left:?}");

    let data = Dataset::new(&few(3), Cut::default()).unwrap();
    let left = linear::left(&data).unwrap();
    assert!(left.iter().all(|left| (0.01..0.5).contains(left)), "{left:?}");
}

#[test]
fn training_stops_where_validation_does_not_get_better() {
    let data = Dataset::new(&few(4), Cut::default()).unwrap();
    // A learning rate of next to nothing: no epoch is better than the first but by rounding.
    let options = Options { learning_rate: 1e-12, epochs: 50, patience: 3, ..Options::default() };
    let fitted = fit(&data, &options, |_| {}).unwrap();
    assert!(fitted.epochs.len() <= 10, "{}", fitted.epochs.len());
}

#[test]
fn what_cannot_be_trained_on_is_refused() {
    let still = vec![vec![Sample { pose: vec![0.0; 3], duty: vec![0.0; 6] }; 400]; 5];
    assert!(matches!(Dataset::new(&still, Cut::default()), Err(TrainError::Still(_))));
    assert!(matches!(Dataset::new(&few(1)[..1], Cut::default()), Err(TrainError::TooLittle { .. })));
    assert!(matches!(
        Dataset::new(&few(1), Cut { validation: 1.0, ..Cut::default() }),
        Err(TrainError::Option { .. })
    ));
    let data = Dataset::new(&few(1), Cut::default()).unwrap();
    for options in [
        Options { learning_rate: f64::NAN, ..Options::default() },
        Options { dropout: 1.0, ..Options::default() },
        Options { batch: 0, ..Options::default() },
        Options { epochs: 0, ..Options::default() },
        Options { hidden: vec![], ..Options::default() },
        Options { hidden: vec![8, 0], ..Options::default() },
        Options { hidden: vec![1 << 40], ..Options::default() },
    ] {
        assert!(matches!(fit(&data, &options, |_| {}), Err(TrainError::Option { .. })), "{options:?}");
    }
    let wild = Excitation { mass: [20.0, 30.0], ..Excitation::default() };
    assert!(matches!(record(&wild, |_| {}), Err(TrainError::Option { .. })));
}
