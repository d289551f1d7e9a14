//! A step of the recurrent network, and of the adaptive law with it.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Matrix3;
use std::hint::black_box;
use stillpoint_control::effect::Effect;
use stillpoint_control::features::{Features, Learned};
use stillpoint_control::mrac::{Mrac, MracDesign};
use stillpoint_control::predictor::Predictor;
use stillpoint_control::projection::Ball;
use stillpoint_control::tracking::Errors;

/// The network that comes with the project.
const SHIPPED: &[u8] = include_bytes!("../data/controller-3dof.safetensors");

fn benches(criterion: &mut Criterion) {
    let Ok(predictor) = Predictor::from_safetensors(SHIPPED) else { return };
    let network = predictor.network();
    let (mut memory, mut y) = (network.memory(), [0.0; 3]);
    criterion.bench_function("network/step", |b| {
        b.iter(|| {
            network.step(black_box(&[0.1; 9]), &mut memory);
            network.output(&memory, &mut y);
            y[0]
        });
    });
    criterion.bench_function("network/window", |b| {
        b.iter(|| {
            memory.clear();
            for _ in 0..predictor.window() {
                network.step(black_box(&[0.1; 9]), &mut memory);
            }
            memory.hidden()[0]
        });
    });
    let features = [
        ("tanh", Features::Tanh),
        ("lstm", Features::Learned(Box::new(Learned::new(predictor.clone(), predictor.scale())))),
    ];
    for (name, features) in features {
        let b = Matrix3::new(1.15, 0.79, 0.79, 4.6, -6.9, -6.9, 0.0, 1.1, -1.1);
        let Ok(effect) = Effect::new(nalgebra::DMatrix::from_iterator(3, 3, b.iter().copied())) else {
            return;
        };
        let design = MracDesign {
            feedback: 2.37,
            learning: [0.05, 0.05, 1.0],
            leak: 0.0005,
            ball: Ball { radius: 1.0, shell: 0.1 },
            dead_zone: vec![0.0; 3],
        };
        let Ok(mut law) = Mrac::design(design, effect, features) else { return };
        let mut net = [0.0; 3];
        let errors = Errors { seen: &[0.01; 3], predicted: &[0.01; 3], speed: &[0.1; 3] };
        criterion.bench_function(&format!("mrac/{name}"), |b| {
            // A sample time of the network each step: the window is gone over each time.
            b.iter(|| {
                law.step(black_box(&[0.1; 3]), black_box(&[0.11; 3]), black_box(&errors), 0.1, &mut net)
            });
        });
    }
}

criterion_group!(group, benches);
criterion_main!(group);
