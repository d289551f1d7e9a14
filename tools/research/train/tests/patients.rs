//! Patients as data: they repeat and differ by seed, and what predicts a sine is told from what does not.

#![allow(clippy::unwrap_used, clippy::panic)]

use nalgebra::{DMatrix, DVector};
use stillpoint_train::TrainError;
use stillpoint_train::dataset::{Cut, Dataset, Sample};
use stillpoint_train::fit::{Optimiser, Options, errors, fit};
use stillpoint_train::linear::Linear;
use stillpoint_train::patient_card::{PatientCard, Prediction, predictions};
use stillpoint_train::patients::Patients;

const AHEAD: [usize; 2] = [1, 2];

fn few(irregularity: f64) -> Patients {
    Patients { count: 10, seconds: 40.0, irregularity, seed: 5, ..Patients::default() }
}

fn cut(window: usize) -> Cut {
    Cut { window, ahead: AHEAD.to_vec(), every: 2, from_newest: true, test: 0.2, ..Cut::default() }
}

#[test]
fn a_seed_repeats_to_the_bit_and_patients_and_seeds_differ() {
    let patients = few(1.0);
    let runs = patients.record().unwrap();
    assert_eq!((runs.len(), runs[0].len()), (10, 200));
    assert_eq!(patients.record().unwrap(), runs);
    let other = Patients { seed: 6, ..patients }.record().unwrap();
    for (number, (run, other)) in runs.iter().zip(&other).enumerate() {
        assert_ne!(run, other);
        assert!(runs[..number].iter().all(|before| before != run), "{number}");
    }
    // Who nods turns by a degree or so; who only breathes does not.
    let widest = |run: &[Sample]| {
        let pitch = run.iter().map(|sample| sample.pose[1]);
        pitch.clone().fold(f64::MIN, f64::max) - pitch.fold(f64::MAX, f64::min)
    };
    for (number, run) in runs.iter().enumerate() {
        assert_eq!(widest(run) > 1.0, Patients::nods(number), "{number}: {}", widest(run));
    }
}

#[test]
fn windows_are_counted_from_the_newest_pose_and_changes_from_there_to_each_time_ahead() {
    let runs = few(1.0).record().unwrap();
    let data = Dataset::new(&runs, cut(20)).unwrap();
    let test = data.test();
    assert_eq!((data.inputs(), data.outputs()), (2, 4));
    assert_eq!(test.ends.first(), Some(&(8, 19)));
    // 200 samples, of which 20 are the first window and two are ahead.
    assert_eq!(test.count, 2 * 90);
    for window in [0, 37, test.count - 1] {
        let (run, last) = test.ends[window];
        let (pose, samples) = (|k: usize| &runs[run][k].pose, &test.inputs[window * 40..(window + 1) * 40]);
        for (place, value) in samples.iter().enumerate() {
            let due = pose(last - 19 + place / 2)[place % 2] - pose(last)[place % 2];
            assert!((f64::from(*value) - due).abs() < 1e-5, "{window} {place}: {value} {due}");
        }
        for (place, change) in test.changes[window * 4..(window + 1) * 4].iter().enumerate() {
            let due = pose(last + AHEAD[place / 2])[place % 2] - pose(last)[place % 2];
            let change = f64::from(*change) * data.scale()[place];
            assert!((change - due).abs() < 1e-5, "{window} {place}: {change} {due}");
        }
    }
}

/// Least squares by the singular values of all rows, which is another way than the normal equations.
#[test]
fn least_squares_are_those_of_the_closed_form() {
    let data = Dataset::new(&few(1.0).record().unwrap(), cut(10)).unwrap();
    let (train, test) = (data.training(), data.test());
    let matrix = |inputs: &[f32]| {
        // The newest pose is zero, and makes a column of zeros.
        DMatrix::from_fn(
            inputs.len() / 20,
            19,
            |i, j| if j == 18 { 1.0 } else { f64::from(inputs[i * 20 + j]) },
        )
    };
    let (rows, unseen) = (matrix(&train.inputs), matrix(&test.inputs));
    let found = Linear::new(&data, &data.training()).unwrap().errors(&test);
    let svd = rows.svd(true, true);
    for (place, found) in found.iter().enumerate() {
        let of = |changes: &[f32]| {
            DVector::from_iterator(
                changes.len() / 4,
                changes.iter().skip(place).step_by(4).map(|v| f64::from(*v)),
            )
        };
        let weights = svd.solve(&of(&train.changes), 0.0).unwrap();
        let error = &unseen * weights - of(&test.changes);
        let due = (error.norm_squared() / test.count as f64).sqrt();
        assert!((found - due).abs() < 1e-3 * due, "{place}: {found} {due}");
    }
}

/// A sine in each channel, of another frequency, size and phase in each run.
fn sines() -> Vec<Vec<Sample>> {
    let run = |number: usize| {
        let draw = |k: usize| (12.9898 * (number * 7 + k) as f64).sin();
        let pose = |k: usize| {
            let angle = std::f64::consts::TAU * (0.25 + 0.05 * draw(0)) * 0.2 * k as f64 + 3.0 * draw(1);
            vec![(1.0 + 0.4 * draw(2)) * angle.sin(), (1.0 + 0.4 * draw(3)) * angle.cos()]
        };
        (0..150).map(|k| Sample { pose: pose(k), duty: Vec::new() }).collect()
    };
    (0..20).map(run).collect()
}

#[test]
fn a_small_network_and_least_squares_predict_sines_that_they_have_not_seen() {
    let data = Dataset::new(&sines(), cut(20)).unwrap();
    let fitted = fit(&data, &small(10), |_| {}).unwrap();
    let test = data.test();
    let hold = test.errors(4, |_, _, predicted| predicted.fill(0.0));
    let linear = Linear::new(&data, &data.training()).unwrap().errors(&test);
    for (place, network) in errors(&fitted.network, &test).iter().enumerate() {
        assert!(*network < 0.3 * hold[place], "{place}: {network} of {}", hold[place]);
        assert!(linear[place] < 0.1 * hold[place], "{place}: {} of {}", linear[place], hold[place]);
    }
}

fn small(epochs: usize) -> Options {
    Options {
        optimiser: Optimiser::AdamW,
        learning_rate: 1e-2,
        hidden: vec![8],
        dropout: 0.0,
        epochs,
        ..Options::default()
    }
}

#[test]
fn the_card_has_the_errors_of_all_predictions_and_tones_follow_a_regular_breath() {
    let patients = Patients { noise: [0.002, 0.001], ..few(0.0) };
    let data = Dataset::new(&patients.record().unwrap(), cut(20)).unwrap();
    let options = small(1);
    let fitted = fit(&data, &options, |_| {}).unwrap();
    let found = predictions(&fitted.network, &data, &patients, &AHEAD).unwrap();
    let groups = found.iter().map(|p| p.windows).step_by(4).sum::<usize>();
    assert_eq!(groups, data.test().count);
    for p in found.iter().filter(|p| p.patients == "breathe" && p.channel == "pitch") {
        assert!(p.tones < 0.2 * p.hold && p.tones < 0.5 * p.velocity && p.velocity < p.hold, "{p:?}");
    }
    // The errors of the table are those of the batch, in mm.
    let batch = data.test().only(|run, _| !Patients::nods(run));
    let height = errors(&fitted.network, &batch)[0] * data.scale()[0];
    assert!((found[0].network - height).abs() < 1e-12, "{height} {:?}", found[0]);
    let height = Linear::new(&data, &data.training()).unwrap().errors(&batch)[0] * data.scale()[0];
    assert!((found[0].linear - height).abs() < 1e-12, "{height} {:?}", found[0]);
    let text = PatientCard::of(&fitted, &data, &patients, &options, found.clone()).markdown();
    let row = |p: &Prediction| {
        format!("| {:.4}, {:.1} % |", p.network, 100.0 * (1.0 - (p.network / p.hold).powi(2)))
    };
    assert!(found.iter().all(|p| text.contains(&row(p))), "{text}");
}

#[test]
fn patients_and_cuts_that_cannot_be_are_refused() {
    let refused = |patients: Patients| matches!(patients.record(), Err(TrainError::Option { .. }));
    assert!(refused(few(1.5)) && refused(few(f64::NAN)));
    assert!(refused(Patients { seconds: 0.0, ..few(1.0) }));
    assert!(refused(Patients { noise: [0.0, f64::NAN], ..few(1.0) }));
    let runs = few(1.0).record().unwrap();
    for cut in [
        Cut { ahead: vec![], ..cut(20) },
        Cut { ahead: vec![0, 1], ..cut(20) },
        Cut { every: 0, ..cut(20) },
        Cut { window: 0, ..cut(20) },
        Cut { test: 0.9, ..cut(20) },
    ] {
        assert!(matches!(Dataset::new(&runs, cut.clone()), Err(TrainError::Option { .. })), "{cut:?}");
    }
}
