//! Patients at whom no beam can aim: the error says why.

use super::phantom::{Phantom, cube};
use stillpoint_patient::case::Mask;
use stillpoint_plan::dose::{Anatomy, DoseEngine, DoseError, Machine};

#[test]
fn an_outline_of_air_is_called_that() {
    let grid = cube(8, 10.0);
    let air = Phantom { hu: vec![-1000; grid.len()], ..Phantom::water(grid) };
    let fault = air.engine_or_fault(Machine::shipped().unwrap(), air.params()).unwrap_err();
    assert_eq!(fault, DoseError::Air { greatest: 0.0 });
    assert!(fault.to_string().contains("nothing but air"));
}

#[test]
fn a_target_outside_of_the_outline_is_called_that() {
    let grid = cube(8, 10.0);
    let phantom = Phantom::water(grid);
    let half = |low: bool| Mask::from_fn(grid.len(), |i| (grid.voxel(i)[0] < 4) == low);
    let anatomy = Anatomy {
        grid,
        hu: &phantom.hu,
        external: &half(true),
        target: &half(false),
        isocentre_mm: [20.0, 0.0, 0.0],
    };
    let fault = DoseEngine::new(&anatomy, Machine::shipped().unwrap(), phantom.params()).unwrap_err();
    assert_eq!(fault, DoseError::TargetOutside);
}
