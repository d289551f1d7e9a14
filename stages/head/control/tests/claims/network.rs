//! The recurrent network against the vectors, its file, and its features.

use std::collections::BTreeMap;

use proptest::prelude::*;
use serde_json::Value;
use stillpoint_control::channels::{Channel, Channels};
use stillpoint_control::lstm::{Layer, Lstm, NetworkError};
use stillpoint_control::predictor::{Meaning, Predictor, PredictorError};
use stillpoint_control::tensor_file::TensorFileError;

use super::vectors::{assert_all_close, assert_close, cases, matrix, number, numbers, vectors};
use stillpoint_mechanics::random::Random;

/// The numbers of a matrix, row by row.
fn rows(value: &Value) -> Vec<f64> {
    matrix(value).transpose().iter().copied().collect()
}

fn network(given: &Value) -> Lstm {
    let layers = given["layers"].as_array().unwrap();
    let layer = |l: &Value| {
        let inputs = l["Wih"][0].as_array().unwrap().len();
        Layer::new(inputs, rows(&l["Wih"]), rows(&l["Whh"]), numbers(&l["b"])).unwrap()
    };
    Lstm::new(layers.iter().map(layer).collect(), rows(&given["fc"]["W"]), numbers(&given["fc"]["b"]))
        .unwrap()
}

#[test]
fn the_network_follows_the_vectors() {
    let all = cases(vectors!("e_lstm"));
    let case = all.iter().find(|c| c["id"] == "forward").unwrap();
    let (given, out) = (&case["in"], &case["out"]);
    assert_eq!(given["gate_order"], "i,f,g,o");
    let network = network(given);
    let mut memory = network.memory();
    let mut loss = 0.0;
    for (k, x) in given["x"].as_array().unwrap().iter().enumerate() {
        network.step(&numbers(x), &mut memory);
        let mut y = [0.0; 3];
        network.output(&memory, &mut y);
        assert_all_close(case, &format!("y[{k}]"), &y, &out["y"][k]);
        loss += numbers(&given["target"][k]).iter().zip(y).map(|(t, y)| 0.5 * (y - t) * (y - t)).sum::<f64>();
    }
    assert_close(case, "loss", loss, number(&out["loss_half_sum_sq"]));
    for place in 0..3 {
        let (h, c) = memory.layer(place).unwrap();
        assert_all_close(case, "h_last", h, &out["h_last"][place]);
        assert_all_close(case, "c_last", c, &out["c_last"][place]);
    }
    assert_eq!(network.parameters() as f64, number(&out["n_params"]));
}

#[test]
fn the_count_of_numbers_is_the_vectors() {
    let all = cases(vectors!("e_lstm"));
    let case = all.iter().find(|c| c["id"] == "counts").unwrap();
    let hidden: Vec<usize> = numbers(&case["in"]["hidden"]).into_iter().map(|v| v as usize).collect();
    for (given, expected) in
        case["in"]["list_in_out_biases"].as_array().unwrap().iter().zip(numbers(&case["out"]["n"]))
    {
        let given = numbers(given);
        // This network has one bias for each gate; two of them add as many again.
        let second: usize = if given[2] == 2.0 { hidden.iter().map(|h| 4 * h).sum() } else { 0 };
        let found = zeros(given[0] as usize, &hidden, given[1] as usize).parameters() + second;
        assert_eq!(found as f64, expected);
    }
}

fn zeros(inputs: usize, hidden: &[usize], outputs: usize) -> Lstm {
    made(inputs, hidden, outputs, &mut || 0.0)
}

fn made(inputs: usize, hidden: &[usize], outputs: usize, number: &mut dyn FnMut() -> f64) -> Lstm {
    let mut below = inputs;
    let mut layers = Vec::new();
    for h in hidden {
        let mut many = |n: usize| (0..n).map(|_| number()).collect::<Vec<f64>>();
        layers.push(Layer::new(below, many(4 * h * below), many(4 * h * h), many(4 * h)).unwrap());
        below = *h;
    }
    let w = (0..outputs * below).map(|_| number()).collect();
    Lstm::new(layers, w, (0..outputs).map(|_| number()).collect()).unwrap()
}

/// A predictor of random numbers for the rig of three bladders.
pub fn predictor() -> Predictor {
    let mut random = Random::new(3);
    // Numbers that a float of four bytes keeps.
    let network = made(9, &[9, 6, 6], 3, &mut || f64::from((0.4 * random.normal()) as f32));
    Predictor::new(network, meaning()).unwrap()
}

fn meaning() -> Meaning {
    Meaning {
        channels: Channels::new(&[Channel::Z, Channel::Pitch, Channel::Roll]).unwrap(),
        scale: vec![0.0115, 0.02356, 0.1745],
        change: vec![0.01, 0.02, 0.03],
        ahead: vec![1],
        duty_scale: 0.1,
        bladders: 3,
        sample_time: 100_000_000,
        window: 6,
    }
}

#[test]
fn a_predictor_comes_back_from_its_file() {
    let predictor = predictor();
    let more = BTreeMap::from([("trained_on".to_owned(), "nothing".to_owned())]);
    let bytes = predictor.to_safetensors(&more);
    assert_eq!(Predictor::from_safetensors(&bytes).unwrap(), predictor);
    assert!(bytes.len() < 8000, "{}", bytes.len());
}

#[test]
fn a_network_without_bladders_and_with_two_times_ahead_comes_back_and_others_are_refused() {
    let made = |outputs| made(2, &[4], outputs, &mut || 0.25);
    let meaning = Meaning {
        channels: Channels::new(&[Channel::Z, Channel::Pitch]).unwrap(),
        scale: vec![1e-3, 0.0175],
        change: vec![0.1, 0.2, 0.3, 0.4],
        ahead: vec![1, 2],
        bladders: 0,
        ..meaning()
    };
    let predictor = Predictor::new(made(4), meaning.clone()).unwrap();
    assert_eq!(Predictor::from_safetensors(&predictor.to_safetensors(&BTreeMap::new())).unwrap(), predictor);
    assert!(Predictor::new(made(2), meaning.clone()).is_err());
    for ahead in [vec![], vec![0, 1], vec![1]] {
        assert!(Predictor::new(made(4), Meaning { ahead, ..meaning.clone() }).is_err());
    }
}

#[test]
fn a_file_of_something_else_is_refused_with_what_is_wrong() {
    let bytes = predictor().to_safetensors(&BTreeMap::new());
    let text = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        let mut other = bytes.clone();
        other[at..at + to.len()].copy_from_slice(to.as_bytes());
        Predictor::from_safetensors(&other).unwrap_err().to_string()
    };
    for (from, to, words) in [
        (
            "\"stillpoint_predictor\":\"1\"",
            "\"stillpoint_predictor\":\"9\"",
            "is 9; this build reads version 1",
        ),
        ("output.weight", "output.weighs", "`output.weight` is missing"),
        ("\"dtype\":\"F32\"", "\"dtype\":\"I32\"", "is neither F32 nor F64"),
        ("\"shape\":[36,9]", "\"shape\":[36,8]", "invalid shape, data type, or offset"),
        ("z,pitch,roll", "z,pitch,rool", "names a channel that does not exist"),
        ("\"bladders\":\"3\"", "\"bladders\":\"2\"", "has 9 numbers where 7 are expected"),
        ("\"window\":\"6\"", "\"window\":\"x\"", "is not a number"),
    ] {
        let error = text(from, to);
        assert!(error.contains(words), "{error}");
    }
    assert!(matches!(
        Predictor::from_safetensors(&bytes[..100]),
        Err(PredictorError::File(TensorFileError::Form(_)))
    ));
    assert!(matches!(
        Predictor::from_safetensors(b"abc"),
        Err(PredictorError::File(TensorFileError::Form(_)))
    ));
    let nan = Layer::new(1, vec![f64::NAN; 4], vec![0.0; 4], vec![0.0; 4]);
    assert!(matches!(nan, Err(NetworkError::NotFinite(_))));
}

proptest! {
    #[test]
    fn no_broken_file_is_more_than_refused(
        cut in 0..8000usize, changes in prop::collection::vec((0..8000usize, any::<u8>()), 0..8),
    ) {
        let mut bytes = whole().to_vec();
        for (at, byte) in changes {
            let at = at % bytes.len();
            bytes[at] = byte;
        }
        if cut < bytes.len() {
            bytes.truncate(cut);
        }
        let _ = Predictor::from_safetensors(&bytes);
    }
}

fn whole() -> &'static [u8] {
    static BYTES: std::sync::OnceLock<Vec<u8>> = std::sync::OnceLock::new();
    BYTES.get_or_init(|| predictor().to_safetensors(&BTreeMap::new()))
}
