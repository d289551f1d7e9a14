//! Readers of measured doses: what they take, what they refuse and where, and broken files.

#![allow(clippy::unwrap_used, clippy::panic)]

mod broken;
mod csv;
mod mcc;
mod w2cad;

use stillpoint_plan::measured::{Curve, Measured, read};

/// A depth dose of a table of this size of step.
fn depth_dose_table(step_mm: f64) -> String {
    let mut text = "kind,field_x_mm,field_y_mm,ssd_mm,depth_mm,off_mm,value\n".to_owned();
    for (depth, dose) in depth_dose(step_mm) {
        text += &format!("depth_dose,100,100,900,{depth},0,{dose}\n");
    }
    text
}

/// Depths and doses like those of a photon beam.
fn depth_dose(step_mm: f64) -> Vec<(f64, f64)> {
    let dose = |d: f64| 100.0 * ((-0.005 * d).exp() - (-0.2 * d).exp());
    (0..=(300.0 / step_mm) as usize).map(|i| i as f64 * step_mm).map(|d| (d, dose(d))).collect()
}

/// Places and doses like those of a profile of 100 mm.
fn profile() -> Vec<(f64, f64)> {
    let dose = |x: f64| 100.0 / (1.0 + ((x.abs() - 50.0) / 2.0).exp());
    (-40..=40).map(|i| 2.0 * f64::from(i)).map(|x| (x, dose(x))).collect()
}

/// The only curve of a file.
fn only(name: &str, text: &str) -> Curve {
    let mut measured = read(name, text.as_bytes()).unwrap_or_else(|fault| panic!("{fault}"));
    assert_eq!(measured.curves.len(), 1);
    measured.curves.remove(0)
}

/// The message of a refused file.
fn fault(text: &str) -> String {
    match read("scan.txt", text.as_bytes()) {
        Ok(Measured { curves, .. }) => panic!("{} curves are read", curves.len()),
        Err(fault) => fault.to_string(),
    }
}

/// Faults contain these pieces.
fn refused(text: &str, pieces: &[&str]) {
    let message = fault(text);
    for piece in pieces {
        assert!(message.contains(piece), "no `{piece}` in: {message}");
    }
}
