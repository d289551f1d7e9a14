//! What the bladders of the rigs do, as `plant.bladders` of a controller takes it.
//!
//! `cargo run -p stillpoint-mechanics --example effect`

#![allow(clippy::print_stdout)]

use nalgebra::{SMatrix, SVector};
use stillpoint_mechanics::plant::equilibrium::EquilibriumError;
use stillpoint_mechanics::plant::layouts::START_GAP;
use stillpoint_mechanics::plant::{OneDof, SixDof, ThreeDof};

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

fn main() -> Result<(), EquilibriumError> {
    let one = OneDof::rig(5.0);
    show("rig.one_bladder", ["z"], &one.effect(&one.start_air(), SVector::repeat(START_GAP))?);
    let three = ThreeDof::rig(5.0);
    let effect = three.effect(&three.start_air(), SVector::zeros())?;
    show("rig.three_bladders", ["z", "pitch", "roll"], &effect);
    let eight = SixDof::rig(5.0);
    let effect = eight.effect(&eight.start_air(), SVector::zeros())?;
    show("rig.eight_bladders", ["x", "y", "z", "pitch", "roll", "yaw"], &effect);
    let start = eight.bladders(&SVector::zeros(), &eight.start_air());
    println!("at the start: {:?} Pa", start.map(|p| p.pressure.round()));
    Ok(())
}
