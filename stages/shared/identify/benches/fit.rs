//! Time of a prediction-error fit: a bladder of second order, a record of 4,000 samples whose input switches at random.
//!
//! `cargo bench -p stillpoint-identify`

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::dvector;
use stillpoint_identify::{Companion, Record, fit};
use stillpoint_mechanics::random::Random;

const SAMPLES: usize = 4000;

/// Input and output of a system with poles 0.95 and 0.7, gain 4, whose innovations are even within 0.1.
fn record() -> (Vec<f64>, Vec<f64>) {
    let system = Companion {
        last: dvector![-0.665, 1.65],
        input: dvector![0.02, 0.047],
        gain: dvector![0.4, 0.35],
        start: dvector![0.3, 0.2],
    };
    let mut random = Random::new(5);
    let mut uniform = || random.uniform();
    let (mut level, mut x) = (1.0, system.start.clone());
    let (mut input, mut output) = (Vec::new(), Vec::new());
    for _ in 0..SAMPLES {
        if uniform() < 0.05 {
            level = -level;
        }
        let innovation = 0.2 * (uniform() - 0.5);
        input.push(level);
        output.push(x[0] + innovation);
        x = system.a() * &x + &system.input * level + &system.gain * innovation;
    }
    (input, output)
}

fn fits(criterion: &mut Criterion) {
    let (input, output) = record();
    let mut group = criterion.benchmark_group("fit of 4,000 samples");
    group.sample_size(10);
    for order in [1, 2, 4] {
        group.bench_function(format!("order {order}"), |b| {
            b.iter(|| fit(&Record { input: black_box(&input), output: black_box(&output) }, order).is_ok());
        });
    }
    group.finish();
}

criterion_group!(benches, fits);
criterion_main!(benches);
