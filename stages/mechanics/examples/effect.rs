//! What the bladders of the rigs do, as `plant.bladders` of a controller takes it, and how far they take a head.
//!
//! `cargo run -p stillpoint-mechanics --example effect`

#![allow(clippy::print_stdout)]

use nalgebra::{SMatrix, SVector};
use stillpoint_mechanics::plant::equilibrium::EquilibriumError;
use stillpoint_mechanics::plant::layouts::START_GAP;
use stillpoint_mechanics::plant::{Limits, OneDof, Plant, SixDof, ThreeDof};

fn show<const D: usize, const B: usize>(name: &str, channels: [&str; D], effect: &SMatrix<f64, D, B>) {
    println!("{name}: full duty of each bladder's inlet");
    for column in effect.column_iter() {
        let parts = channels.iter().zip(column.iter()).map(|(channel, rate)| match *channel {
            "x" | "y" | "z" => format!("{channel}: {:.4} mm/s", rate * 1e3),
            _ => format!("{channel}: {:.4} deg/s", rate.to_degrees()),
        });
        println!("  - {{ {} }}", parts.collect::<Vec<_>>().join(", "));
    }
}

/// How far a rig can take each coordinate alone from its rest, down and up.
fn ranges<const D: usize, const B: usize, const N: usize>(
    plant: &Plant<D, B, N>,
    channels: [&str; D],
    rest: &SVector<f64, D>,
) {
    let wanted = SVector::repeat(20.0);
    for (i, channel) in channels.iter().enumerate() {
        let (step, scale, unit) =
            if channel.len() == 1 { (1e-4, 1e3, "mm") } else { (1e-3, 1f64.to_degrees(), "deg") };
        let far = |sign: f64| {
            let pose = |n: u32| {
                let mut pose = *rest;
                pose[i] += sign * step * f64::from(n);
                pose
            };
            let held =
                (1..2000).take_while(|n| plant.reach(&pose(*n), &Limits::RIG, &wanted).is_ok()).count();
            sign * step * held as f64 * scale
        };
        println!("  {channel} alone: {:.1} to {:.1} {unit}", far(-1.0), far(1.0));
    }
}

fn main() -> Result<(), EquilibriumError> {
    let one = OneDof::rig(5.0);
    show("rig.one_bladder", ["z"], &one.effect(&one.start_air(), SVector::repeat(START_GAP))?);
    ranges(&one, ["z"], &one.equilibrium(&one.start_air(), SVector::repeat(START_GAP))?);
    let three = ThreeDof::rig(5.0);
    let effect = three.effect(&three.start_air(), SVector::zeros())?;
    show("rig.three_bladders", ["z", "pitch", "roll"], &effect);
    ranges(&three, ["z", "pitch", "roll"], &three.equilibrium(&three.start_air(), SVector::zeros())?);
    let eight = SixDof::rig(5.0);
    let effect = eight.effect(&eight.start_air(), SVector::zeros())?;
    show("rig.eight_bladders", ["x", "y", "z", "pitch", "roll", "yaw"], &effect);
    ranges(&eight, ["x", "y", "z", "pitch", "roll", "yaw"], &SVector::zeros());
    Ok(())
}
