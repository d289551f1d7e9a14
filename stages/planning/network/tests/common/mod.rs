//! A network and patients that games are played with in tests: small, and soon solved.

use stillpoint_network::patient::{Body, Table};
use stillpoint_network::{Coarseness, Model, Patient, Sizes};

/// The varied pelvis of a seed, with doses of this spacing.
pub fn patient(seed: u64, grid_mm: f64) -> Patient {
    let coarse = Coarseness { grid_mm, bixel_mm: 2.0 * grid_mm };
    Patient { body: Body::Varied(seed), table: Table::Plain, coarse }
}

/// Numbers without meaning.
pub fn model() -> Model {
    let sizes = Sizes { structure: 3, ring: 4, angle: 4, neighbour: 2, pair: 3, set: 2, layers: 2 };
    let mut state = 1_u32;
    let mut next = |scale: bool| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let unit = (state >> 8) as f32 / (1 << 24) as f32;
        if scale { 1.0 + unit } else { unit - 0.5 }
    };
    let mut some = |(name, shape): (&str, Vec<usize>)| -> Vec<f32> {
        (0..shape.iter().product()).map(|_| next(name.ends_with(".scale"))).collect()
    };
    let numbers = sizes.tensors().into_iter().map(&mut some).collect();
    Model::new(sizes, numbers).unwrap()
}
