//! Data that were not made by stillpoint: scans of a water tank, and depth doses and profiles of a Monte Carlo program.

use std::fmt::Write as _;

use stillpoint_plan::dose::Machine;
use stillpoint_plan::measured::{Bounds, Fitted, Measured, fit, read};
use stillpoint_plan::monte_carlo::{Phantom, Setting, VOXEL_MM, reference};

use super::tank::{HEADER, machine_of};

#[allow(clippy::print_stdout)] // The numbers of docs/results/dose.md.
fn print(fitted: &Fitted) {
    for residual in &fitted.residuals {
        println!(
            "{}: rms {:.4} largest {:?} local {:?} mm {:?} build-up {:?} shift {:.2}",
            residual.name,
            residual.rms,
            residual.largest,
            residual.largest_local,
            residual.largest_mm,
            residual.build_up,
            residual.shift_mm
        );
    }
    println!(
        "mean energy {:?} penumbra {} fluence {:?}",
        fitted.mean_energy_mev,
        fitted.machine.file().penumbra_fwhm_at_iso_mm,
        fitted.machine.file().primary_fluence_r_mm_value
    );
}

#[test]
fn scans_of_a_real_machine_are_fitted_to_one_percent() {
    let mut measured = Measured::default();
    for (name, bytes) in [
        ("depth_dose.mcc", include_bytes!("../../../data/measured/depth_dose.mcc").as_slice()),
        ("profiles.mcc", include_bytes!("../../../data/measured/profiles.mcc")),
    ] {
        measured.add(read(name, bytes).unwrap()).unwrap();
    }
    let fitted = fit(&Machine::shipped().unwrap(), &measured, Bounds::default()).unwrap();
    print(&fitted);
    assert_eq!(fitted.missed().count(), 0);
    let depth_dose = &fitted.residuals[0];
    assert!(
        depth_dose.rms < 0.003 && depth_dose.largest.0.abs() < 0.01,
        "{} {:?}",
        depth_dose.rms,
        depth_dose.largest
    );
    assert!(fitted.has_penumbra && fitted.residuals.len() == 3);
}

/// Depth doses and profiles of the Monte Carlo program in water.
fn monte_carlo(fields_cm: &[u32]) -> Measured {
    let mut text = HEADER.to_owned();
    for &field_cm in fields_cm {
        let reference = reference(Setting { phantom: Phantom::Water, field_cm }).unwrap().unwrap();
        let side = 10 * field_cm;
        for (i, dose) in reference.axis.iter().enumerate() {
            let depth = (i as f64 + 0.5) * VOXEL_MM;
            // The phantom ends at 300 mm: before its end, scatter from beyond is missing.
            if depth > 270.0 {
                break;
            }
            writeln!(text, "depth_dose,{side},{side},900,{depth},0,{dose}").unwrap();
        }
        for profile in &reference.profiles {
            let places =
                profile.dose.iter().enumerate().map(|(i, dose)| ((i as f64 + 0.5) * VOXEL_MM, *dose));
            let all: Vec<(f64, f64)> =
                places.clone().rev().map(|(x, dose)| (-x, dose)).chain(places).collect();
            for (x, dose) in all {
                writeln!(text, "profile_x,{side},{side},900,{},{x},{dose}", profile.depth_mm).unwrap();
            }
        }
    }
    let mut measured = read("monte-carlo.csv", text.as_bytes()).unwrap();
    measured.state_energy(6.0, "--energy").unwrap();
    measured
}

#[test]
fn monte_carlo_is_fitted_from_another_spectrum() {
    let measured = monte_carlo(&[5]);
    let fitted = fit(&machine_of(0.4, |_| {}), &measured, Bounds::default()).unwrap();
    print(&fitted);
    assert_eq!(fitted.missed().count(), 0);
    // The start is not near, so the fit found it.
    let apart = |found: f64, expected: f64| (found - expected).abs();
    let [before, after] = fitted.mean_energy_mev;
    // The shipped spectrum is that of the reference.
    let shipped = Machine::shipped().unwrap();
    let section = shipped.file().superposition.as_ref().unwrap();
    let parts = section.photons.iter().zip(&section.energy_mev);
    let reference: f64 = parts.map(|(part, energy)| part * energy).sum();
    assert!(apart(after, reference) < 0.5 * apart(before, reference), "{before} {after} {reference}");
}
