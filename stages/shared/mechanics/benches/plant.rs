//! A step of the plants, with contacts that stay and with contacts that roll.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::SVector;
use std::hint::black_box;
use stillpoint_mechanics::plant::grip::Grip;
use stillpoint_mechanics::plant::layouts::{START_GAP, rolling};
use stillpoint_mechanics::plant::rigs::{RIGS, RigPlant, UsePlant};
use stillpoint_mechanics::plant::{Drive, State};

const STEP: f64 = 1e-3;

struct Steps<'c> {
    criterion: &'c mut Criterion,
    name: &'static str,
}

impl UsePlant for Steps<'_> {
    type Made = ();

    fn with<const D: usize, const B: usize, const N: usize>(self, rig: RigPlant<D, B, N>) {
        let RigPlant { plant, air, guess, channels } = rig;
        let Ok(rest) = plant.equilibrium(&air, guess) else { return };
        let (state, mut drive) = (State::at_rest(rest, air), plant.idle());
        drive.duty[0] = [0.2, 0.0];
        drive.force = SVector::repeat(0.1);
        self.criterion.bench_function(&format!("plant/{}/fixed", self.name), |b| {
            b.iter(|| plant.advance(black_box(&state), &drive, STEP));
        });
        let Some(contacts) = rolling(&channels, 5.0, &plant.shell) else { return };
        let plant = plant.with_rolling(contacts.clone());
        let mut grip = Grip::<B>::new(0.5, &plant.shell, START_GAP);
        self.criterion.bench_function(&format!("plant/{}/rolling", self.name), |b| {
            b.iter(|| {
                let held = Some(grip.held(&contacts, &state.position));
                let next = plant.advance(black_box(&state), &Drive { held, ..drive }, STEP);
                let pressed = plant.bladders(&next.position, &next.air);
                grip.advance(&contacts, &state.position, &next.position, &pressed)
            });
        });
    }
}

fn benches(criterion: &mut Criterion) {
    for rig in &RIGS {
        rig.with(5.0, Steps { criterion, name: rig.name });
    }
}

criterion_group!(plants, benches);
criterion_main!(plants);
