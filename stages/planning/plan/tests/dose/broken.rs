//! Broken machine files, 10,000 in the long campaign: refused or used, never a panic. Broken dose files are tested beside
//! their reader.

use super::phantom::{Phantom, cube};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::TestRunner;
use std::cell::Cell;
use stillpoint_plan::dose::{
    ArcLimits, Collimator, DoseParams, EngineName, FreeRange, Machine, MachineFile, PencilsOf, PointKernels,
    Superposition,
};

fn small() -> MachineFile {
    MachineFile {
        provenance: "a test".into(),
        energy_mv: 6.0,
        sad_mm: 1000.0,
        scd_mm: 500.0,
        m_per_mm: 0.005,
        betas_per_mm: vec![0.3, 0.02, 0.004],
        penumbra_fwhm_at_iso_mm: 5.0,
        primary_fluence_r_mm_value: vec![[0.0, 1.0], [100.0, 1.1]],
        kernel_pos_mm: vec![0.0, 10.0, 100.0],
        ssd_mm: vec![900.0, 950.0],
        kernels_per_mm2: vec![vec![vec![1.0, 0.1, 0.0]; 2]; 3],
        hu_to_density: vec![[-1000.0, 0.0], [0.0, 1.0], [1000.0, 1.5]],
        collimator: Some(Collimator::generic()),
        superposition: Some(superposition()),
        free_angles: Some(vec![FreeRange { couch_deg: [-20.0, 20.0], gantry_deg: [300.0, 60.0] }]),
        arc: Some(ArcLimits::generic()),
        pencils_of: PencilsOf::Start,
    }
}

fn superposition() -> Superposition {
    let kernels = |depths_mm: Vec<f64>| PointKernels {
        edges_deg: vec![0.0, 60.0, 180.0],
        cones: vec![2, 3],
        shell_mm: 10.0,
        energy: vec![vec![vec![0.3, 0.1], vec![0.2, 0.1]]; depths_mm.len()],
        depths_mm,
    };
    Superposition {
        provenance: "a test".into(),
        gray_per_mev_g: 30.0,
        energy_mev: vec![1.0, 3.0],
        photons: vec![0.6, 0.4],
        attenuation_per_mm: vec![0.007, 0.004],
        charged_share: vec![0.5, 0.7],
        primary: kernels(vec![0.0, 250.0]),
        scatter: kernels(vec![70.0]),
    }
}

fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }
}

#[test]
fn broken_machine_files_are_refused_or_give_a_dose() {
    let text = small().to_json().unwrap();
    let numbers: Vec<(usize, usize)> = {
        let digit = |c: char| c.is_ascii_digit() || c == '.';
        let starts = text.char_indices().filter(|&(i, c)| digit(c) && !text[..i].ends_with(digit));
        starts.map(|(i, _)| (i, i + text[i..].find(|c| !digit(c)).unwrap())).collect()
    };
    let words = prop::sample::select(vec![
        "0",
        "-1",
        "1e308",
        "-1e-308",
        "1e400",
        "null",
        "[]",
        "{}",
        "\"x\"",
        "99999999999999999999",
        "0.005",
        "1000",
        "",
    ]);
    let harm = prop_oneof![
        6 => (any::<Index>(), words.clone()).prop_map(|(at, word)| (0, at, word)),
        1 => (any::<Index>(), words.clone()).prop_map(|(at, word)| (1, at, word)),
        1 => (any::<Index>(), words).prop_map(|(at, word)| (2, at, word)),
    ];
    let phantom = Phantom { target_half_mm: 6.0, ..Phantom::water(cube(5, 10.0)) };
    let (refused, used) = (Cell::new(0), Cell::new(0));
    TestRunner::new(config())
        .run(&prop::collection::vec(harm, 1..3), |harms| {
            let mut broken = text.clone();
            for (kind, at, word) in harms {
                match kind {
                    0 => {
                        let (start, end) = numbers[at.index(numbers.len())];
                        broken.replace_range(start.min(broken.len())..end.min(broken.len()), word);
                    }
                    1 => broken.insert_str(at.index(broken.len() + 1), word),
                    _ => broken.truncate(at.index(broken.len() + 1)),
                }
            }
            match Machine::from_json(&broken) {
                Err(fault) => {
                    prop_assert!(!fault.to_string().is_empty());
                    refused.set(refused.get() + 1);
                }
                Ok(machine) => {
                    for engine in EngineName::ALL {
                        let params = DoseParams { cutoff_mm: 10.0, engine, ..phantom.params() };
                        let engine = phantom.engine_or_fault(machine.clone(), params);
                        if let Ok(beam) = engine.and_then(|engine| engine.beam(45.0)) {
                            prop_assert!(
                                beam.dose.view().value.iter().all(|value| value.is_finite() && *value > 0.0)
                            );
                        }
                    }
                    used.set(used.get() + 1);
                }
            }
            Ok(())
        })
        .unwrap();
    let (refused, used) = (refused.get(), used.get());
    assert!(
        refused > used / 10 && used > refused / 100,
        "{refused} refused, {used} used: the harm is one-sided"
    );
}
