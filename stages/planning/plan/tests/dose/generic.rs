//! The machine that comes with the project.

use super::phantom::on_axis;
use std::path::Path;
use stillpoint_plan::dose::{Machine, MachineFile};

#[test]
fn shipped_machine_file_is_what_its_generator_makes() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/generic_6mv.json");
    let machine = Machine::shipped().unwrap();
    // Spectrum and kernels come from a program of their own: `tools/research/kernels`.
    let superposition = machine.file().superposition.clone();
    assert!(superposition.is_some());
    let made = MachineFile { superposition, ..MachineFile::generic_6mv() };
    assert_eq!(machine.file(), &made);
    let made = made.to_json().unwrap();
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let shipped = std::fs::read_to_string(&path).unwrap();
    assert_eq!(shipped, made, "data/generic_6mv.json is not current: run the tests with BLESS=1");
    assert!(shipped.len() < 100_000);
}

/// Percent of the greatest dose at depths of 50, 100 and 200 mm, and the depth of the greatest, mm; skin at 1000 mm.
fn depth_dose(field_mm: f64) -> ([f64; 3], usize) {
    let depths: Vec<f64> = (0..=300).map(f64::from).collect();
    let dose = on_axis(Machine::shipped().unwrap().file(), [field_mm; 2], 1000.0, &depths);
    let top = (0..dose.len()).max_by(|&a, &b| dose[a].total_cmp(&dose[b])).unwrap();
    ([50, 100, 200].map(|depth| 100.0 * dose[depth] / dose[top]), top)
}

#[test]
fn generic_machine_lies_where_beams_of_6_mv_do() {
    let ([at_50, at_100, at_200], top) = depth_dose(100.0);
    assert!((14..=17).contains(&top), "maximum at {top} mm");
    assert!((85.0..88.0).contains(&at_50), "{at_50} % at 50 mm");
    assert!((65.0..68.0).contains(&at_100), "{at_100} % at 100 mm");
    assert!((37.0..40.0).contains(&at_200), "{at_200} % at 200 mm");
    // Larger fields are more penetrating.
    let (small, large) = (depth_dose(50.0).0[1], depth_dose(200.0).0[1]);
    assert!(small < at_100 - 2.0 && large > at_100 + 2.0, "{small}, {at_100}, {large}");

    let machine = Machine::shipped().unwrap();
    let at = |field: f64, ssd: f64, depth: f64| on_axis(machine.file(), [field; 2], ssd, &[depth])[0];
    let tissue_phantom_ratio = at(100.0, 800.0, 200.0) / at(100.0, 900.0, 100.0);
    assert!((0.66..0.70).contains(&tissue_phantom_ratio), "{tissue_phantom_ratio}");
    for (field, range) in [(50.0, 0.93..0.96), (200.0, 1.03..1.06)] {
        let output = at(field, 900.0, 100.0) / at(100.0, 900.0, 100.0);
        assert!(range.contains(&output), "{field} mm: {output}");
    }
}

#[test]
fn one_unit_of_weight_on_the_reference_field_gives_1_gray() {
    let dose = on_axis(Machine::shipped().unwrap().file(), [100.0; 2], 900.0, &[100.0])[0];
    assert!((dose - 1.0).abs() < 0.002, "{dose}");
}
