//! Curves that the dose engine made with another spectrum give its doses back.

use stillpoint_plan::dose::{Machine, PencilsOf};
use stillpoint_plan::measured::{Bounds, FitError, Fitted, Measured, fit, read};

use super::tank::{HEADER, Scan, Tank, depth_dose_lines, machine_of, profile_lines};

/// Largest difference of two scans from a depth on, as a part of the greatest dose, each with its own scale.
fn largest(ours: &Scan, theirs: &Scan, from_mm: f64) -> f64 {
    let judged = || ours.iter().zip(theirs).filter(|((at, _), _)| *at >= from_mm);
    let both: f64 = judged().map(|((_, a), (_, b))| a * b).sum();
    let scale = both / judged().map(|((_, a), _)| a * a).sum::<f64>();
    let greatest = theirs.iter().map(|(_, dose)| *dose).fold(0.0, f64::max);
    judged().map(|((_, a), (_, b))| (a * scale - b).abs() / greatest).fold(0.0, f64::max)
}

/// What a table of a beam of 5.9 MV has.
fn measured(text: &str) -> Measured {
    let mut measured = Measured::default();
    measured.add(read("curves.csv", text.as_bytes()).unwrap()).unwrap();
    if measured.energy_mv.is_none() {
        measured.state_energy(5.9, "--energy").unwrap();
    }
    measured
}

fn fitted_to(text: &str) -> Fitted {
    fit(&Machine::shipped().unwrap(), &measured(text), Bounds::default()).unwrap()
}

#[test]
fn doses_of_another_spectrum_are_recovered_to_half_a_percent() {
    for power in [-0.35, 0.5] {
        let truth = machine_of(power, |_| {});
        let mut text = HEADER.to_owned();
        for field in [40.0, 100.0] {
            text += &depth_dose_lines(field, 900.0, &Tank::new(&truth, field, 900.0).depth_dose());
        }
        let fitted = fitted_to(&text);
        assert_eq!((fitted.missed().count(), fitted.machine.file().pencils_of), (0, PencilsOf::Start));
        assert!(fitted.machine.file().provenance.contains("no calibration was given"));
        // A field and a distance of the curves, and others.
        for (field, ssd) in [(40.0, 900.0), (60.0, 1000.0)] {
            let scan = |machine: &Machine| Tank::new(machine, field, ssd).depth_dose();
            let expected = scan(&truth);
            let off = largest(&scan(&fitted.machine), &expected, 20.0);
            assert!(off < 0.005, "power {power}, {field} mm at {ssd} mm: {off}");
            let start = largest(&scan(&Machine::shipped().unwrap()), &expected, 20.0);
            assert!(start > 0.01, "the start is as good: {start}");
        }
        // With noise of 0.5 %, the doses are those of the curves without it.
        let fitted = fitted_to(&noisy(&text, 0.005));
        let scan = |machine: &Machine| Tank::new(machine, 40.0, 900.0).depth_dose();
        let off = largest(&scan(&fitted.machine), &scan(&truth), 20.0);
        assert!(off < 0.005, "with noise: {off}");
    }
}

/// The values of a table, each with an error of this standard deviation: sums of twelve even numbers of a generator.
fn noisy(text: &str, sigma: f64) -> String {
    let mut state = 12_345_u64;
    let mut even = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut lines = text.lines();
    let mut out = format!("{}\n", lines.next().unwrap());
    for line in lines {
        let (rest, value) = line.rsplit_once(',').unwrap();
        let error: f64 = (0..12).map(|_| even()).sum::<f64>() - 6.0;
        out += &format!("{rest},{}\n", value.parse::<f64>().unwrap() * (1.0 + sigma * error));
    }
    out
}

#[test]
fn penumbra_fluence_and_calibration_are_recovered() {
    // 4 % less at 60 mm, and a penumbra of 8 mm in place of 5.
    let truth = machine_of(0.2, |file| {
        file.penumbra_fwhm_at_iso_mm = 8.0;
        file.primary_fluence_r_mm_value = vec![[0.0, 1.0], [20.0, 0.99], [60.0, 0.96], [150.0, 0.9]];
    });
    let tank = Tank::new(&truth, 140.0, 900.0);
    let mut text = HEADER.to_owned();
    text += &depth_dose_lines(140.0, 900.0, &tank.depth_dose());
    text += &profile_lines(true, 140.0, 900.0, &tank.profile(true, 100.0, 105.0));
    text += &profile_lines(false, 140.0, 900.0, &tank.profile(false, 50.0, 105.0));
    // Gy for a weight of 1, of which 125 monitor units are made.
    let scan = Tank::new(&truth, 100.0, 900.0).depth_dose();
    for (depth, dose) in [scan[20], scan[33]] {
        text += &format!("calibration,100,100,900,{depth},0,{}\n", dose / 125.0);
    }
    let fitted = fitted_to(&text);
    assert_eq!(
        fitted.missed().count(),
        0,
        "{:?}",
        fitted.residuals.iter().map(|r| r.largest).collect::<Vec<_>>()
    );
    let file = fitted.machine.file();
    assert_eq!(file.energy_mv, 5.9);
    // Voxels of 3 mm widen the edge: their doses are means, and so is the TERMA that they gather.
    assert!((8.0..9.0).contains(&file.penumbra_fwhm_at_iso_mm), "{}", file.penumbra_fwhm_at_iso_mm);
    for radius in [0.0, 20.0, 40.0] {
        let (found, expected) = (fitted.machine.primary_fluence(radius), truth.primary_fluence(radius));
        assert!((found - expected).abs() < 0.004, "{radius} mm: {found} {expected}");
    }
    // The section's scale is that of the fitted spectrum, so monitor units need not be 125, but the doses agree.
    let calibration = fitted.calibration.unwrap();
    assert!(!fitted.machine.file().provenance.contains("no calibration"));
    assert_eq!(file.collimator.as_ref().unwrap().mu_per_weight, calibration.mu_per_weight);
    let ours = Tank::new(&fitted.machine, 100.0, 900.0).depth_dose()[33].1 / calibration.mu_per_weight;
    assert!((ours / (scan[33].1 / 125.0) - 1.0).abs() < 0.005, "{ours} Gy per monitor unit");
    assert!(calibration.largest < 0.005 && calibration.readings == 2, "{calibration:?}");
}

#[test]
fn what_cannot_be_fitted_is_refused_with_the_curve() {
    let truth = machine_of(0.2, |_| {});
    let scan = Tank::new(&truth, 100.0, 900.0).depth_dose();
    let table = |scan: &Scan| format!("{HEADER}{}", depth_dose_lines(100.0, 900.0, scan));
    // A dose that is higher for 3 cm is that of no spectrum.
    let bump = |d: f64| if (120.0..150.0).contains(&d) { 1.08 } else { 1.0 };
    let broken: Scan = scan.iter().map(|&(d, dose)| (d, dose * bump(d))).collect();
    let missed = fitted_to(&table(&broken));
    let curves: Vec<&str> = missed.missed().map(|residual| residual.name.as_str()).collect();
    assert_eq!(curves, ["depth dose, 100 x 100 mm, surface at 900 mm"]);

    // 1.3 % of the greatest dose is more than 4 % of the dose at 290 mm.
    let greatest = scan.iter().map(|(_, dose)| *dose).fold(0.0, f64::max);
    let raised = |d: f64| if d > 285.0 { 0.013 * greatest } else { 0.0 };
    let raised: Scan = scan.iter().map(|&(d, dose)| (d, dose + raised(d))).collect();
    let missed = fitted_to(&table(&raised));
    let residual = &missed.residuals[0];
    assert!(
        residual.largest.0.abs() < 0.02 && residual.beyond_mm.is_some_and(|at| at > 240.0),
        "{residual:?}"
    );

    // Output factors: of water alone, 5 % off, and 5 % off in a field that is not judged.
    let mut with_outputs = format!("{}output,100,100,900,{},0,1\n", table(&scan), scan[33].0);
    for (field, factor) in [(60.0, 1.0), (40.0, 1.05), (20.0, 1.05)] {
        let (depth, dose) = Tank::new(&truth, field, 900.0).depth_dose()[33];
        with_outputs += &format!("output,{field},{field},900,{depth},0,{}\n", factor * dose / scan[33].1);
    }
    let fitted = fitted_to(&with_outputs);
    let missed: Vec<f64> = fitted.missed_outputs().map(|output| output.reading.setup.field_mm[0]).collect();
    assert_eq!(missed, [40.0], "{:?}", fitted.outputs);

    let start = Machine::shipped().unwrap();
    let refusal = |text: &str| fit(&start, &measured(text), Bounds::default()).unwrap_err();
    let without = read("curves.csv", table(&scan).as_bytes()).unwrap();
    assert!(matches!(fit(&start, &without, Bounds::default()), Err(FitError::NoEnergy)));
    // Attenuation of a beam of 18 MV.
    let hard: Scan = scan.iter().map(|&(d, dose)| (d, dose * (0.0017 * d).exp())).collect();
    let fault = refusal(&table(&hard));
    assert!(matches!(fault, FitError::Kernels { .. }), "{fault}");
    let with_energy = table(&scan).replace("value\n", "value,energy_mv\n");
    let with_energy: String = with_energy
        .lines()
        .map(|line| if line.starts_with('d') { format!("{line},15\n") } else { format!("{line}\n") })
        .collect();
    assert!(refusal(&with_energy).to_string().contains("15 MV and the machine to start from 6 MV"));
    let calibrated = |value: f64| format!("{}calibration,100,100,900,100,0,{value}\n", table(&scan));
    assert!(matches!(refusal(&calibrated(1.0)), FitError::CalibrationUnit { .. }));
    for (kind, what) in [("calibration", "calibration"), ("output", "output factor")] {
        let shallow = format!("{}{kind},100,100,900,15,0,0.012\n", table(&scan));
        let lines = shallow.lines().count();
        let fault = refusal(&shallow).to_string();
        let expected = format!("curves.csv, line {lines}: the {what} is 15 mm deep");
        assert!(fault.starts_with(&expected) && fault.contains("100 mm"), "{fault}");
    }
    let twice = calibrated(0.01) + "calibration,100,100,900,50,0,0.01\n";
    assert!(matches!(refusal(&twice), FitError::Calibrations { .. }));
    let output = format!("{}output,50,50,900,100,0,0.93\n", table(&scan));
    assert!(matches!(refusal(&output), FitError::NoReference { .. }));
    let profile =
        profile_lines(true, 100.0, 900.0, &Tank::new(&truth, 100.0, 900.0).profile(true, 100.0, 90.0));
    assert!(matches!(refusal(&format!("{HEADER}{profile}")), FitError::NoDepthDose));
}
