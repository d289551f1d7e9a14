//! What the bladders of the rigs do, as `plant.bladders` of a controller takes it, and how far they take a head.
//!
//! `cargo run -p stillpoint-mechanics --example effect`

#![allow(clippy::print_stdout)]

use nalgebra::SVector;
use stillpoint_mechanics::plant::Limits;
use stillpoint_mechanics::plant::equilibrium::EquilibriumError;
use stillpoint_mechanics::plant::rigs::{RIGS, RigPlant, UsePlant};

/// Coordinates of a head: name, unit, what of that unit one m or rad is, and the step of the search.
const CHANNELS: [(&str, &str, f64, f64); 6] = [
    ("x", "mm", 1e3, 1e-4),
    ("y", "mm", 1e3, 1e-4),
    ("z", "mm", 1e3, 1e-4),
    ("pitch", "deg", 180.0 / std::f64::consts::PI, 1e-3),
    ("roll", "deg", 180.0 / std::f64::consts::PI, 1e-3),
    ("yaw", "deg", 180.0 / std::f64::consts::PI, 1e-3),
];

struct Show;

impl UsePlant for Show {
    type Made = Result<(), EquilibriumError>;

    fn with<const D: usize, const B: usize, const N: usize>(self, rig: RigPlant<D, B, N>) -> Self::Made {
        let RigPlant { plant, air, guess, channels } = rig;
        for column in plant.effect(&air, guess)?.column_iter() {
            let part = |(channel, rate): (&usize, &f64)| {
                let (name, unit, scale, _) = CHANNELS[*channel];
                format!("{name}: {:.4} {unit}/s", rate * scale)
            };
            let parts: Vec<String> = channels.iter().zip(column.iter()).map(part).collect();
            println!("  - {{ {} }}", parts.join(", "));
        }
        let rest = plant.equilibrium(&air, guess)?;
        let requested = SVector::repeat(20.0);
        for (i, channel) in channels.iter().enumerate() {
            let (name, unit, scale, step) = CHANNELS[*channel];
            let far = |sign: f64| {
                let held = |n: &u32| {
                    let mut pose = rest;
                    pose[i] += sign * step * f64::from(*n);
                    plant.reach(&pose, &Limits::RIG, &requested).is_ok()
                };
                sign * step * (1..2000).take_while(held).count() as f64 * scale
            };
            println!("  {name} alone: {:.1} to {:.1} {unit}", far(-1.0), far(1.0));
        }
        Ok(())
    }
}

fn main() -> Result<(), EquilibriumError> {
    for rig in &RIGS {
        println!("{}: full duty of each bladder's inlet", rig.kind);
        rig.with(5.0, Show)?;
    }
    Ok(())
}
