//! Calibration of a beam, its bytes, and what is refused.

use std::num::NonZeroUsize;
use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;
use stillpoint_plan::dose::{
    Anatomy, BixelSpec, DoseEngine, DoseError, DoseParams, EngineName, Machine, MachineFile,
};

/// A box of water with a block of lung, skin at 900 mm for gantry 0.
pub fn engine(spacing_mm: f64, bixel_mm: f64, lung: bool, machine: Machine) -> Result<DoseEngine, DoseError> {
    let counts = [260.0, 240.0, 260.0].map(|mm: f64| (mm / spacing_mm).round() as usize);
    let origin_mm = [-130.0, -100.0, -130.0].map(|mm| mm + 0.5 * spacing_mm);
    let grid = Grid { counts, spacing_mm: [spacing_mm; 3], origin_mm };
    let hu: Vec<i16> = (0..grid.len())
        .map(|voxel| {
            let [x, y, _] = grid.centre_mm(grid.voxel(voxel));
            if lung && (-60.0..40.0).contains(&y) && x > -20.0 { -750 } else { 0 }
        })
        .collect();
    let all = Mask::from_fn(grid.len(), |_| true);
    let target =
        Mask::from_fn(grid.len(), |v| grid.centre_mm(grid.voxel(v)).iter().all(|mm| mm.abs() < 28.0));
    let anatomy = Anatomy { grid, hu: &hu, external: &all, target: &target, isocentre_mm: [0.0; 3] };
    let params = DoseParams {
        grid,
        bixels: BixelSpec::of_width(bixel_mm),
        engine: EngineName::Superposition,
        ..DoseParams::over(&grid, spacing_mm)
    };
    DoseEngine::new(&anatomy, machine, params)
}

#[test]
fn one_unit_of_weight_on_the_reference_field_gives_1_gray() {
    let engine = engine(4.0, 10.0, false, Machine::shipped().unwrap()).unwrap();
    let grid = engine.params().grid;
    let near: Vec<u32> = (0..grid.len())
        .filter(|voxel| grid.centre_mm(grid.voxel(*voxel)).iter().all(|mm| mm.abs() < 3.0))
        .map(|voxel| voxel as u32)
        .collect();
    assert_eq!(near.len(), 2);
    let places = || (-5..5).map(|i| 10.0 * f64::from(i) + 5.0);
    let bixels: Vec<[f64; 2]> = places().flat_map(|x| places().map(move |z| [x, z])).collect();
    let dose = engine.within(&near).weighted_bixels(0.0, &bixels, &[1.0; 100]).unwrap();
    let mean = near.iter().map(|voxel| f64::from(dose[*voxel as usize])).sum::<f64>() / 2.0;
    assert!((mean - 1.0).abs() < 0.005, "{mean}");
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let engine = engine(10.0, 20.0, true, Machine::shipped().unwrap()).unwrap();
    let angles = [0.0, 40.0, 130.0, 270.0];
    let on = |threads| engine.beams(&angles, NonZeroUsize::new(threads).unwrap()).unwrap();
    let one = on(1);
    assert!(one.iter().all(|beam| beam.dose.view().value.iter().all(|dose| *dose > 0.0)));
    assert!(on(2) == one && on(3) == one);
}

#[test]
fn a_machine_without_kernels_is_refused_with_the_remedy() {
    let file = MachineFile { superposition: None, ..Machine::shipped().unwrap().file().clone() };
    let fault = engine(10.0, 20.0, false, Machine::new(file).unwrap()).unwrap_err();
    assert_eq!(fault, DoseError::NoKernels);
    assert!(fault.to_string().contains("--engine pencil"));
}

#[test]
fn damaged_kernels_are_refused_with_their_place() {
    let fault = |change: &dyn Fn(&mut stillpoint_plan::dose::Superposition)| {
        let mut file = Machine::shipped().unwrap().file().clone();
        change(file.superposition.as_mut().unwrap());
        Machine::new(file).unwrap_err().to_string()
    };
    assert!(fault(&|s| s.photons[3] = f64::NAN).contains("superposition.photons"));
    assert!(fault(&|s| s.attenuation_per_mm.truncate(5)).contains("superposition.attenuation_per_mm"));
    assert!(fault(&|s| s.energy_mev.clear()).contains("superposition.energy_mev"));
    assert!(fault(&|s| s.primary.energy[1][2][3] = -0.1).contains("superposition.primary.energy"));
    assert!(fault(&|s| s.primary.energy[0].clear()).contains("superposition.primary.energy"));
    assert!(fault(&|s| s.scatter.cones[0] = 0).contains("1 to 100 cones"));
    assert!(fault(&|s| s.scatter.edges_deg[0] = 5.0).contains("begin at 0 degrees"));
    assert!(fault(&|s| s.scatter.depths_mm.push(90.0)).contains("superposition.scatter"));
    assert!(fault(&|s| s.gray_per_mev_g = 0.0).contains("superposition.gray_per_mev_g"));
}
