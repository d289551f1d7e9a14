//! Set-ups of the patient beside the planned one.

use std::num::NonZeroUsize;

use stillpoint_patient::case::phantom;
use stillpoint_plan::beams::{Evaluated, Ring};
use stillpoint_plan::dose::Machine;
use stillpoint_plan::evaluation::OnGrid;
use stillpoint_plan::recipe::{PlanRequest, PointScheme, SetupSpec, plan};

use crate::dose::phantom::{Phantom, column, cube};

#[test]
fn a_patient_who_is_moved_takes_the_dose_where_he_was_planned_to_take_it_elsewhere() {
    let phantom = Phantom::water(cube(31, 5.0));
    let planned = phantom.engine(Machine::shipped().unwrap(), phantom.params());
    let moved = planned.shifted([10.0, 0.0, -5.0]).unwrap();
    // At gantry 0 the beam runs along y. Two voxels to the left: what lies at x - 10 was under what is at x now.
    let (before, after) = (planned.beam(0.0).unwrap(), moved.beam(0.0).unwrap());
    assert_eq!(before.bixels_mm, after.bixels_mm, "bixels stay in the room");
    let (before, after) = (column(&before, [0.0, 0.0]), column(&after, [0.0, 0.0]));
    let grid = phantom.grid;
    for y in 2..28 {
        let [was, is] = [before[grid.index([15, y, 15])], after[grid.index([13, y, 16])]];
        assert!((was - is).abs() < 2e-3 * was, "{y}: {was} {is}");
    }
    assert!(planned.shifted([f64::NAN, 0.0, 0.0]).is_err() && planned.shifted([0.0, 60.0, 0.0]).is_err());
}

#[test]
fn voxels_that_are_left_out_get_no_dose_and_the_others_the_same() {
    let phantom = Phantom::water(cube(21, 5.0));
    let engine = phantom.engine(Machine::shipped().unwrap(), phantom.params());
    let some: Vec<u32> = (0..phantom.grid.len() as u32).filter(|v| v % 3 == 0).collect();
    let (all, part) = (engine.beam(0.0).unwrap(), engine.within(&some).beam(0.0).unwrap());
    for bixel in all.bixels_mm.iter().copied() {
        let (all, part) = (column(&all, bixel), column(&part, bixel));
        for (voxel, dose) in part.iter().enumerate() {
            let expected = if voxel % 3 == 0 { all[voxel] } else { 0.0 };
            assert!((dose - expected).abs() <= 1e-6 * expected, "{voxel}");
        }
    }
}

#[test]
fn a_plan_for_all_set_ups_covers_the_target_better_in_the_worst_of_them() {
    let errors_mm = vec![[8.0, 0.0, 0.0], [-8.0, 0.0, 0.0], [0.0, 0.0, 8.0], [0.0, 0.0, -8.0]];
    let ring = Ring::new(10, 1).unwrap();
    let points = PointScheme::EveryVoxel;
    let spec = SetupSpec { grid_mm: 8.0, points, ring, ..SetupSpec::shipped().unwrap() };
    let threads = NonZeroUsize::new(2).unwrap();
    let beams = [0, 2, 4, 6, 8];
    let angles = beams.map(|beam| ring.angle_deg(beam)).to_vec();
    let request = PlanRequest { threads, ..PlanRequest::of_angles(angles) };
    let planned = |spec: SetupSpec| plan(phantom(0).unwrap(), spec, &request).unwrap();
    let (robust, nominal) = (planned(SetupSpec { errors_mm, ..spec.clone() }), planned(spec));
    let doses = &robust.doses.solved;
    let case = &robust.setup.case;
    let grid = robust.setup.engine().params().grid;
    let setups = robust.setup.engines().len();
    assert_eq!(setups, 5);
    let (robust, nominal) = (robust.best(), nominal.best());
    let on_grid = OnGrid::new(case, &grid);
    let worst = |plan: &Evaluated| {
        let d98 = |setup: usize| {
            let figures = on_grid.evaluate(&doses.dose(plan, setup)).figures(&[]);
            figures.iter().find(|f| f.name == "PTV").unwrap().d98_gy
        };
        (0..setups).map(d98).fold(f64::INFINITY, f64::min)
    };
    assert!(worst(robust) > worst(nominal) + 1.0, "{} {}", worst(robust), worst(nominal));
}
