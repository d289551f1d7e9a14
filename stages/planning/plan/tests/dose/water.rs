//! What must hold in a box of water.

use super::phantom::{Phantom, column, cube, on_axis, ones};
use std::num::NonZeroUsize;
use stillpoint_plan::dose::{BixelSpec, DoseParams, Fluence, Machine};

/// The generic machine with the kernels of one distance to the skin.
fn machine_of_one_ssd() -> Machine {
    let mut file = Machine::shipped().unwrap().file().clone();
    file.ssd_mm = vec![900.0];
    for component in &mut file.kernels_per_mm2 {
        component.truncate(17);
        component.drain(..16);
    }
    Machine::new(file).unwrap()
}

#[test]
fn dose_on_the_axis_of_a_field_follows_the_tables_of_the_machine() {
    // The skin is 100 mm before the isocentre.
    let phantom = Phantom { target_half_mm: 40.0, ..Phantom::water(cube(81, 2.5)) };
    let phantom = Phantom { isocentre_mm: [0.0, -1.25, 0.0], ..phantom };
    let params = DoseParams { cutoff_mm: 150.0, ..phantom.params() };
    let beam = phantom.engine(Machine::shipped().unwrap(), params).beam(0.0).unwrap();
    let far =
        beam.bixels_mm.iter().fold([0.0_f64; 2], |far, b| [far[0].max(b[0].abs()), far[1].max(b[1].abs())]);
    let field_mm = far.map(|place| 2.0 * place + 10.0);
    assert_eq!(beam.bixels_mm.len() as f64, field_mm[0] / 10.0 * field_mm[1] / 10.0);

    let dose = ones(&beam);
    let depths: Vec<f64> = (0..80).map(|y| 1.25 + 2.5 * f64::from(y)).collect();
    let expected = on_axis(Machine::shipped().unwrap().file(), field_mm, 900.0, &depths);
    for (y, expected) in expected.into_iter().enumerate() {
        let dose = dose[phantom.grid.index([40, y, 40])];
        assert!((dose - expected).abs() < 0.003 * expected, "{} mm deep: {dose}, {expected}", depths[y]);
    }
}

#[test]
fn dose_falls_with_the_square_of_the_distance_from_the_source() {
    let near = Phantom::water(cube(41, 5.0));
    let far = Phantom { isocentre_mm: [0.0, -60.0, 0.0], ..Phantom::water(cube(41, 5.0)) };
    let [near_dose, far_dose] = [&near, &far].map(|phantom| {
        let beam = phantom.engine(machine_of_one_ssd(), phantom.params()).beam(0.0).unwrap();
        column(&beam, [0.0, 0.0])
    });
    for y in 0..41 {
        let voxel = near.grid.index([20, y, 20]);
        let distance = 1000.0 + near.grid.centre_mm([20, y, 20])[1];
        let ratio = (distance / (distance + 60.0)).powi(2);
        assert!((far_dose[voxel] / near_dose[voxel] - ratio).abs() < 1e-4, "{y}");
    }
}

#[test]
fn beside_the_axis_the_distance_from_the_source_counts_and_not_its_part_along_the_axis() {
    let phantom = Phantom { target_half_mm: 85.0, ..Phantom::water(cube(41, 5.0)) };
    let params = DoseParams { cutoff_mm: 15.0, ..phantom.params() };
    let beam = phantom.engine(machine_of_one_ssd(), params).beam(0.0).unwrap();
    let place = [80.0, 0.0];
    let [on, neighbour] = [[0.0, 0.0], place].map(|bixel| column(&beam, bixel));
    // The skin is at y = -102.5 mm. Without the inverse square the dose depends on the depth along the ray alone.
    let skin = 102.5;
    let bare = |y: usize| {
        let centre = phantom.grid.centre_mm([20, y, 20]);
        (centre[1] + skin, on[phantom.grid.index([20, y, 20])] * (1000.0 + centre[1]).powi(2))
    };
    let distance = libm::hypot(1000.0, place[0]);
    let depth = skin * distance / 1000.0;
    let ((d0, before), (d1, after)) = (bare(20), bare(21));
    let part = (depth - d0) / (d1 - d0);
    let expected = before.powf(1.0 - part) * after.powf(part) / (distance * distance);
    // The middle of the isocentre plane, 80 mm beside the axis, lies on the axis of the bixel there.
    let found = neighbour[phantom.grid.index([36, 20, 20])];
    assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}: {}", found / expected);
}

#[test]
fn water_behind_lung_gets_the_dose_of_its_radiological_depth() {
    let mut phantom = Phantom::water(cube(41, 5.0));
    let half = Machine::shipped().unwrap();
    // Ten voxels of density 0.5 behind ten of water.
    for voxel in 0..phantom.grid.len() {
        if (10..20).contains(&phantom.grid.voxel(voxel)[1]) {
            phantom.hu[voxel] = -500;
        }
    }
    assert_eq!((half.density(-500.0), half.density(0.0)), (0.5, 1.0));
    let water = Phantom::water(cube(41, 5.0));
    let [lung_dose, water_dose] = [&phantom, &water].map(|phantom| {
        column(&phantom.engine(machine_of_one_ssd(), phantom.params()).beam(0.0).unwrap(), [0.0, 0.0])
    });
    for y in 21..35 {
        // 25 mm of water are missing, so a voxel has the depth of that five before it, from farther away.
        let at = |y| phantom.grid.index([20, y, 20]);
        let distance = |y| 1000.0 + phantom.grid.centre_mm([20, y, 20])[1];
        let ratio = (distance(y - 5) / distance(y)).powi(2);
        assert!((lung_dose[at(y)] / water_dose[at(y - 5)] - ratio).abs() < 1e-4 * ratio, "{y}");
    }
}

#[test]
fn dose_of_a_symmetric_box_is_symmetric() {
    let phantom = Phantom::water(cube(41, 5.0));
    let dose = ones(&phantom.engine(Machine::shipped().unwrap(), phantom.params()).beam(0.0).unwrap());
    let most = dose.iter().copied().fold(0.0, f64::max);
    for voxel in 0..phantom.grid.len() {
        let [x, y, z] = phantom.grid.voxel(voxel);
        for mirrored in [[40 - x, y, z], [x, y, 40 - z], [z, y, x]] {
            let difference = dose[voxel] - dose[phantom.grid.index(mirrored)];
            assert!(difference.abs() < 1e-4 * most, "{:?}: {difference}", [x, y, z]);
        }
    }
}

#[test]
fn a_quarter_turn_of_the_gantry_turns_the_dose_by_a_quarter() {
    let phantom = Phantom::water(cube(41, 5.0));
    let engine = phantom.engine(Machine::shipped().unwrap(), phantom.params());
    let [front, left, back, right] = [0.0, 90.0, 180.0, 270.0].map(|deg| ones(&engine.beam(deg).unwrap()));
    let most = front.iter().copied().fold(0.0, f64::max);
    let at = |dose: &[f64], voxel| dose[phantom.grid.index(voxel)];
    for (voxel, expected) in front.iter().enumerate() {
        let [x, y, z] = phantom.grid.voxel(voxel);
        // The source moves from -y over +x to +y: what was at (x, y) is then at (-y, x).
        for turned in [at(&left, [40 - y, x, z]), at(&back, [40 - x, 40 - y, z]), at(&right, [y, 40 - x, z])]
        {
            assert!((turned - expected).abs() < 1e-4 * most, "{:?}: {turned}, {expected}", [x, y, z]);
        }
    }
    // The half that faces the source gets more.
    assert!(at(&left, [35, 20, 20]) > 1.2 * at(&left, [5, 20, 20]));
}

#[test]
fn nine_bixels_give_what_one_of_three_times_their_width_gives() {
    let phantom = Phantom::water(cube(41, 5.0));
    let wide = DoseParams { bixels: BixelSpec::of_width(30.0), cutoff_mm: 120.0, ..phantom.params() };
    let narrow = DoseParams { bixels: BixelSpec::of_width(10.0), ..wide };
    let [wide, narrow] =
        [wide, narrow].map(|params| phantom.engine(Machine::shipped().unwrap(), params).beam(30.0).unwrap());
    let expected = column(&wide, [0.0, 0.0]);
    let mut sum = vec![0.0; expected.len()];
    for x in [-10.0, 0.0, 10.0] {
        for z in [-10.0, 0.0, 10.0] {
            sum.iter_mut().zip(column(&narrow, [x, z])).for_each(|(sum, dose)| *sum += dose);
        }
    }
    let most = expected.iter().copied().fold(0.0, f64::max);
    let worst = sum.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 2e-3 * most, "{worst} of {most}");
}

#[test]
fn open_field_fluence_scales_each_bixel_by_its_distance_from_the_axis() {
    let phantom = Phantom::water(cube(21, 5.0));
    let machine = Machine::shipped().unwrap();
    let [uniform, open] = [Fluence::Uniform, Fluence::OpenField].map(|fluence| {
        phantom.engine(machine.clone(), DoseParams { fluence, ..phantom.params() }).beam(10.0).unwrap()
    });
    for (place, &[x, z]) in uniform.bixels_mm.iter().enumerate() {
        let expected = machine.primary_fluence(libm::hypot(x, z));
        let (uniform, open) = (uniform.dose.view().column(place).1, open.dose.view().column(place).1);
        assert!(uniform.iter().zip(open).all(|(u, o)| (f64::from(o / u) - expected).abs() < 1e-6));
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let phantom = Phantom::water(cube(25, 5.0));
    let engine = phantom.engine(Machine::shipped().unwrap(), phantom.params());
    let angles = [0.0, 17.0, 33.0, 120.0, 300.0];
    let one = engine.beams(&angles, NonZeroUsize::MIN).unwrap();
    assert_eq!(one.iter().map(|beam| beam.angles.gantry_deg).collect::<Vec<_>>(), angles);
    for threads in [2, 3, 8] {
        let several = engine.beams(&angles, NonZeroUsize::new(threads).unwrap()).unwrap();
        let bits = |beam: &stillpoint_plan::dose::BeamInfluence| {
            beam.dose.view().value.iter().map(|value| value.to_bits()).collect::<Vec<_>>()
        };
        assert!(one.iter().zip(&several).all(|(a, b)| a == b && bits(a) == bits(b)));
    }
}

#[test]
fn no_bixel_reaches_beyond_its_cutoff_nor_outside_the_patient() {
    let phantom = Phantom::water(cube(41, 5.0));
    let engine =
        phantom.engine(Machine::shipped().unwrap(), DoseParams { cutoff_mm: 20.0, ..phantom.params() });
    let beam = engine.beam(0.0).unwrap();
    let dose = column(&beam, [0.0, 0.0]);
    for (voxel, dose) in dose.iter().enumerate() {
        let [x, y, z] = phantom.grid.centre_mm(phantom.grid.voxel(voxel));
        let neighbour = libm::hypot(x, z) * 1000.0 / (1000.0 + y);
        assert_eq!(*dose > 0.0, neighbour <= 20.0, "{:?}: {dose}", [x, y, z]);
    }
}

#[test]
fn what_cannot_be_planned_on_is_refused_with_its_reason() {
    let phantom = Phantom::water(cube(11, 5.0));
    let fault = |change: &dyn Fn(&mut Phantom, &mut DoseParams)| {
        let (mut phantom, mut params) = (Phantom::water(phantom.grid), phantom.params());
        change(&mut phantom, &mut params);
        phantom.engine_or_fault(Machine::shipped().unwrap(), params).unwrap_err().to_string()
    };
    assert_eq!(
        fault(&|p, _| p.hu.truncate(7)),
        "the image has 7 values, but the image's grid has 1331 voxels"
    );
    assert_eq!(
        fault(&|_, params| params.bixels.width_mm = f64::NAN),
        "the width of a bixel is NaN; it must be from 1 to 100 (lengths in mm, angles in degrees)"
    );
    assert_eq!(
        fault(&|p, _| p.target_half_mm = -1.0),
        "the target has no voxel; there is nothing to place bixels on"
    );
    assert!(fault(&|p, _| p.isocentre_mm = [0.0, 950.0, 0.0]).contains("too near to the source"));
    assert!(
        fault(&|_, params| params.grid.counts[1] = usize::MAX).contains("must have at least one and at most")
    );
    assert_eq!(
        fault(&|p, params| *params = DoseParams::over(&p.grid, f64::NAN)),
        "the spacing of voxels is NaN; it must be from 0.1 to 100 (lengths in mm, angles in degrees)"
    );
    assert_eq!(
        fault(&|_, params| params.grid.origin_mm = [0.0, 0.0, 200.0]),
        "the external contour holds no voxel of the dose grid; check that both are in the same place"
    );
    let engine = phantom.engine(Machine::shipped().unwrap(), phantom.params());
    assert_eq!(
        engine.beam(400.0).unwrap_err().to_string(),
        "the gantry angle is 400; it must be from 0 to 360 (lengths in mm, angles in degrees)"
    );
}
