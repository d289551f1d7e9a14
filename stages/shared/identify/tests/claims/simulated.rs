//! Systems that are known: what the fit finds of them, and how sure it says to be.

use nalgebra::{DVector, dvector};
use proptest::prelude::*;
use stillpoint_identify::{Companion, FitError, Record, Stability, fit};
use stillpoint_mechanics::random::Random;

/// An input that switches at random, as valves do, and the output of `model` with innovations of this deviation.
fn record(model: &Companion, noise: f64, samples: usize, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut random = Random::new(seed);
    let (mut level, mut x) = (1.0, model.start.clone());
    let (mut u, mut y) = (Vec::new(), Vec::new());
    for _ in 0..samples {
        if random.uniform() < 0.05 {
            level = -level;
        }
        let e = noise * random.normal();
        u.push(level);
        y.push(x[0] + e);
        x = model.a() * &x + &model.input * level + &model.gain * e;
    }
    (u, y)
}

/// Poles 0.95 and 0.7, gain 4.
fn bladder() -> Companion {
    Companion {
        last: dvector![-0.665, 1.65],
        input: dvector![0.02, 0.047],
        gain: dvector![0.4, 0.35],
        start: dvector![0.3, 0.2],
    }
}

fn dc_gain(model: &Companion) -> f64 {
    let n = model.order();
    ((nalgebra::DMatrix::identity(n, n) - model.a()).try_inverse().unwrap() * &model.input)[0]
}

#[test]
fn stated_deviations_are_those_of_the_estimates() {
    let truth = bladder();
    let gain = dc_gain(&truth);
    let (mut inside, mut scores) = (0, Vec::new());
    let runs = 60;
    for seed in 0..runs {
        let (u, y) = record(&truth, 0.05, 1500, seed);
        let found = fit(&Record { input: &u, output: &y }, 2).unwrap();
        let slow = found.poles[1].re;
        scores.push((slow.value - 0.95) / slow.sd);
        inside += u32::from((found.dc_gain.unwrap().value - gain).abs() < 1.96 * found.dc_gain.unwrap().sd);
    }
    // 95 % of 60 is 57; a binomial number is 50 or more in all but one of a thousand such tests.
    assert!(inside >= 50, "{inside} of {runs}");
    let mean_square = scores.iter().map(|s| s * s).sum::<f64>() / scores.len() as f64;
    assert!((0.5..1.7).contains(&mean_square), "{mean_square}");
}

#[test]
fn noise_variance_and_parameter_deviations_are_those_of_the_normal_equations() {
    let (u, y) = record(&bladder(), 0.05, 1500, 4);
    let found = fit(&Record { input: &u, output: &y }, 2).unwrap();
    let errors = found.model.predict(&u, &y).errors;
    let variance = errors.iter().map(|e| e * e).sum::<f64>() / (1500.0 - 8.0);
    assert!((found.noise_variance / variance - 1.0).abs() < 1e-9, "{} {variance}", found.noise_variance);
    assert!((found.noise_variance / 0.0025 - 1.0).abs() < 0.15, "{}", found.noise_variance);
    let covariance = found.model.normal(&u, &y).matrix.try_inverse().unwrap() * variance;
    for (i, sd) in found.parameter_sd.iter().enumerate() {
        let due = covariance[(i, i)].sqrt();
        assert!((sd / due - 1.0).abs() < 1e-3, "parameter {i}: {sd} {due}");
    }
}

#[test]
fn errors_of_the_true_order_are_noise_and_those_of_a_lower_one_are_not() {
    let (mut whites, mut crosses) = (0, 0);
    let runs = 40;
    for seed in 0..runs {
        let (u, y) = record(&bladder(), 0.05, 2000, 100 + seed);
        let record = Record { input: &u, output: &y };
        let [white, cross] = fit(&record, 2).unwrap().residuals;
        whites += u32::from(white.passes());
        crosses += u32::from(cross.passes());
        let [white, cross] = fit(&record, 1).unwrap().residuals;
        assert!(!white.passes() || !cross.passes(), "{white:?} {cross:?}");
    }
    // 99 of 100 pass.
    assert!(whites >= 37 && crosses >= 37, "{whites} {crosses} of {runs}");
}

#[test]
fn noise_that_bends_the_arx_start_does_not_bend_the_fit() {
    // Noise of the measurement alone: K = 0, the worst case for ARX.
    let truth = Companion { gain: dvector![0.0, 0.0], ..bladder() };
    let (u, y) = record(&truth, 0.3, 4000, 5);
    let found = fit(&Record { input: &u, output: &y }, 2).unwrap();
    assert!(
        (found.poles[1].re.value - 0.95).abs() < 3.0 * found.poles[1].re.sd && found.poles[1].re.sd < 0.01
    );
    assert!((found.dc_gain.unwrap().value / dc_gain(&truth) - 1.0).abs() < 0.05, "{:?}", found.dc_gain);
    let (a, _) = stillpoint_identify::arx(&u, &y, 2).unwrap();
    assert!((a[1] - 0.665).abs() > 0.2, "the ARX start is bent: {a}");
}

/// One pole here; the input's effect is 0.1.
fn one_pole(at: f64) -> Companion {
    Companion { last: dvector![at], input: dvector![0.1], gain: dvector![0.5], start: dvector![0.0] }
}

#[test]
fn a_pole_outside_the_circle_is_unstable_and_has_no_dc_gain() {
    let (u, y) = record(&one_pole(1.05), 0.05, 100, 3);
    let found = fit(&Record { input: &u, output: &y }, 1).unwrap();
    assert!((found.poles[0].modulus.value - 1.05).abs() < 0.005, "{:?}", found.poles);
    assert_eq!((found.poles[0].stability(), found.dc_gain), (Stability::Unstable, None));
}

#[test]
fn an_integrator_is_told_from_a_stable_and_from_an_unstable_pole() {
    let runs = 40;
    let count = |at: f64, due: Stability| {
        let is_time = |seed: &u64| {
            let (u, y) = record(&one_pole(at), 0.05, 400, 200 + seed);
            fit(&Record { input: &u, output: &y }, 1).unwrap().poles[0].stability() == due
        };
        (0..runs).filter(is_time).count()
    };
    assert_eq!(count(0.9, Stability::Stable), 40);
    // 95 of 100 intervals hold the true modulus.
    let integrators = count(1.0, Stability::Integrating);
    assert!(integrators >= 33, "{integrators} of {runs}");
}

#[test]
fn units_change_nothing_but_the_units() {
    let (u, y) = record(&bladder(), 0.05, 1000, 8);
    let (large, small): (Vec<f64>, Vec<f64>) =
        (u.iter().map(|v| v * 1e7).collect(), y.iter().map(|v| v * 1e-3).collect());
    let a = fit(&Record { input: &u, output: &y }, 2).unwrap();
    let b = fit(&Record { input: &large, output: &small }, 2).unwrap();
    assert!((a.poles[0].re.value - b.poles[0].re.value).abs() < 1e-9);
    assert!((a.dc_gain.unwrap().value / (b.dc_gain.unwrap().value * 1e10) - 1.0).abs() < 1e-9);
    assert!((a.dc_gain.unwrap().sd / (b.dc_gain.unwrap().sd * 1e10) - 1.0).abs() < 1e-6);
    assert!((a.fit_percent - b.fit_percent).abs() < 1e-9);
}

#[test]
fn records_that_determine_nothing_are_refused() {
    let (u, y) = record(&bladder(), 0.05, 100, 1);
    let of = |u: &[f64], y: &[f64], n| fit(&Record { input: u, output: y }, n).unwrap_err();
    assert_eq!(of(&u, &y, 0), FitError::Order(0));
    assert_eq!(of(&u, &y[1..], 1), FitError::Lengths { input: 100, output: 99 });
    assert_eq!(of(&u[..30], &y[..30], 2), FitError::TooShort { order: 2, needed: 40, found: 30 });
    assert_eq!(of(&[1.0; 100], &y, 1), FitError::Constant("input"));
    assert_eq!(of(&u, &[0.0; 100], 1), FitError::Constant("output"));
    let bad: Vec<f64> = y.iter().enumerate().map(|(k, v)| if k == 7 { f64::NAN } else { *v }).collect();
    assert!(matches!(of(&u, &bad, 1), FitError::NotFinite { what: "output", place: 7, .. }));
}

proptest! {
    #[test]
    fn gradient_is_that_of_finite_differences(
        last in prop::array::uniform3(-0.3..0.3f64),
        input in prop::array::uniform3(-1.0..1.0f64),
        gain in prop::array::uniform3(-0.3..0.3f64),
        start in prop::array::uniform3(-1.0..1.0f64),
        seed in 0u64..1000,
    ) {
        let mut random = Random::new(seed);
        let u: Vec<f64> = (0..40).map(|_| random.normal()).collect();
        let y: Vec<f64> = (0..40).map(|_| random.normal()).collect();
        let vector = |a: [f64; 3]| DVector::from_vec(a.to_vec());
        let model = Companion { last: vector(last), input: vector(input), gain: vector(gain), start: vector(start) };
        let normal = model.normal(&u, &y);
        prop_assert!((normal.loss - model.predict(&u, &y).loss).abs() < 1e-12 * normal.loss);
        let theta = model.parameters();
        for i in 0..theta.len() {
            let h = 1e-6;
            let at = |d: f64| {
                let mut moved = theta.clone();
                moved[i] += d;
                Companion::from_parameters(&moved).predict(&u, &y).loss
            };
            let slope = (at(h) - at(-h)) / (2.0 * h);
            prop_assert!((slope - normal.gradient[i]).abs() < 1e-5 * (1.0 + slope.abs()), "{i}: {slope} {}", normal.gradient[i]);
        }
    }

    #[test]
    fn any_record_gives_a_model_or_a_reason(
        u in prop::collection::vec(-1e9..1e9f64, 0..80),
        y in prop::collection::vec(-1e-3..1e9f64, 0..80),
        order in 0usize..4,
    ) {
        let n = u.len().min(y.len());
        if let Ok(found) = fit(&Record { input: &u[..n], output: &y[..n] }, order) {
            prop_assert!(found.loss.is_finite() && found.model.parameters().iter().all(|p| p.is_finite()));
        }
    }
}
