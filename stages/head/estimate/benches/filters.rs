//! Time of a step of the filter, with 1, 3 and 6 channels, and of fusing two tracks of a pose by each of the three rules.
//!
//! `cargo bench -p stillpoint-estimate`

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Isometry3, SMatrix, SVector};
use stillpoint_estimate::cross::{CrossCovariance, Side, Update};
use stillpoint_estimate::fusion::{cross_covariance, fused, intersection, inverse_variance, joint};
use stillpoint_estimate::{Kalman, KalmanParams, Manifold, Measurement, Outcome, ProcessNoise};
use stillpoint_mechanics::random::Random;

/// From frame to frame, ns.
const FRAME: u64 = 33_333_333;
/// Measurements that come by turns.
const MEASUREMENTS: usize = 64;
/// Standard deviations of two sensors, m or rad.
const SD: [f64; 2] = [0.5e-3, 0.8e-3];

fn filter<const N: usize, X: Manifold<N>>() -> Option<Kalman<N, X>> {
    let params = KalmanParams {
        process: ProcessNoise::per_step(0.05),
        open_sd: SVector::repeat(1.0),
        initial_velocity_sd: SVector::repeat(0.1),
        gate: f64::INFINITY,
        horizon: 500_000_000,
    };
    Kalman::new(params).map_err(|error| eprintln!("no filter: {error}")).ok()
}

/// Measurements about the origin, evenly spread within twice their deviation.
fn measurements<const N: usize, X: Manifold<N>>(sd: f64, seed: u64) -> Vec<Measurement<N, X>> {
    let mut random = Random::new(seed);
    let mut noise = |_, _| 4.0 * sd * (random.uniform() - 0.5);
    let covariance = SMatrix::from_diagonal_element(sd * sd);
    let one = |_| Measurement { position: X::origin().plus(&SVector::from_fn(&mut noise)), covariance };
    (0..MEASUREMENTS).map(one).collect()
}

fn step<const N: usize, X: Manifold<N>>(criterion: &mut Criterion, name: &str) {
    let Some(mut filter) = filter::<N, X>() else { return };
    let measurements = measurements::<N, X>(SD[0], 1);
    let mut frame = 0;
    criterion.bench_function(name, |b| {
        b.iter(|| {
            frame += 1;
            filter.step(frame * FRAME, Some(black_box(&measurements[frame as usize % MEASUREMENTS])))
        });
    });
}

fn kalman(criterion: &mut Criterion) {
    step::<1, SVector<f64, 1>>(criterion, "kalman, 1 channel");
    step::<3, SVector<f64, 3>>(criterion, "kalman, 3 channels");
    step::<6, Isometry3<f64>>(criterion, "kalman, 6 channels of a pose");
}

fn fusion(criterion: &mut Criterion) {
    let (Some(first), Some(second)) = (filter::<6, Isometry3<f64>>(), filter()) else { return };
    let mut filters = [first, second];
    let measured = [measurements(SD[0], 1), measurements(SD[1], 2)];
    let mut cross = CrossCovariance::<6, 12>::new(ProcessNoise::per_step(0.05));
    let mut updates = Vec::new();
    for frame in 0..MEASUREMENTS {
        let time = (frame as u64 + 1) * FRAME;
        for (side, (filter, measured)) in filters.iter_mut().zip(&measured).enumerate() {
            let side = if side == 0 { Side::First } else { Side::Second };
            let update = match filter.step(time, Some(&measured[frame])) {
                Ok(Outcome::Updated(i)) => Update::Gain([i.position_gain, i.velocity_gain]),
                _ => Update::Start,
            };
            cross.record(side, time, update);
            updates = vec![(Side::First, update), (Side::Second, update)];
        }
    }
    let mut now = MEASUREMENTS as u64 * FRAME;
    let p12 = cross.at(now);
    let [Some(a), Some(b)] = filters.each_ref().map(|filter| filter.state().copied()) else { return };
    let (p1, p2) = (joint::<6, 12, _>(&a), joint::<6, 12, _>(&b));
    let mut group = criterion.benchmark_group("fuse, 6 channels of a pose");
    group.bench_function("cross covariance, a frame of both", |bench| {
        bench.iter(|| {
            now += FRAME;
            updates.iter().for_each(|(side, update)| cross.record(*side, now, *update));
            cross.at(black_box(now))
        });
    });
    group.bench_function("weighed by the cross covariance", |bench| {
        bench.iter(|| {
            cross_covariance(black_box(&p1), black_box(&p2), black_box(&p12)).map(|w| fused(&a, &b, &w))
        });
    });
    group.bench_function("weighed by the inverse variances", |bench| {
        bench.iter(|| inverse_variance(black_box(&p1), black_box(&p2)).map(|w| fused(&a, &b, &w)));
    });
    group.bench_function("covariance intersection", |bench| {
        bench.iter(|| intersection(black_box(&p1), black_box(&p2)).map(|w| fused(&a, &b, &w)));
    });
    group.finish();
}

criterion_group!(benches, kalman, fusion);
criterion_main!(benches);
