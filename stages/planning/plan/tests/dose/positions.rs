//! Patients in other positions: the same anatomy on the couch gets the same dose.

use std::path::Path;

use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, CaseParts, Mask, PatientPosition, Structure, phantom};
use stillpoint_plan::dose::{DoseEngine, DoseParams, Machine};

/// The voxel that a voxel becomes when the patient is turned: the axes whose sign is negative run backwards.
fn turned(grid: &Grid, signs: [f64; 3], index: usize) -> usize {
    let voxel = grid.voxel(index);
    grid.index([0, 1, 2].map(|a| if signs[a] > 0.0 { voxel[a] } else { grid.counts[a] - 1 - voxel[a] }))
}

fn turned_grid(grid: &Grid, signs: [f64; 3]) -> Grid {
    let last = |a: usize| grid.origin_mm[a] + (grid.counts[a] - 1) as f64 * grid.spacing_mm[a];
    Grid { origin_mm: [0, 1, 2].map(|a| if signs[a] > 0.0 { grid.origin_mm[a] } else { -last(a) }), ..*grid }
}

/// The patient who lies in this position and whose body is on the couch where that of `case` is, head first supine.
fn mirrored(case: &Case, position: PatientPosition) -> Case {
    let (grid, signs) = (case.grid(), position.signs());
    let place = |index| turned(grid, signs, index);
    let structure = |s: &Structure| Structure {
        mask: Mask::from_fn(grid.len(), |i| s.mask.contains(place(i))),
        ..s.clone()
    };
    let isocentre_mm = case.isocentre_mm();
    let parts = CaseParts {
        name: position.term().to_owned(),
        grid: turned_grid(grid, signs),
        hu: (0..grid.len()).map(|i| case.hu()[place(i)]).collect(),
        structures: case.structures().iter().map(structure).collect(),
        isocentre_mm: Some([0, 1, 2].map(|a| signs[a] * isocentre_mm[a])),
        prescription: case.prescription().to_vec(),
        fractions: case.fractions(),
        reference_dose_gy: None,
        uids: None,
        provenance: String::new(),
    };
    Case::new(parts).unwrap().lying(position)
}

/// Dose of all bixels with different weights, and where the bixels are.
fn dose(case: &Case, grid: Grid, gantry_deg: f64) -> (Vec<f64>, Vec<[f64; 2]>) {
    let params = DoseParams { grid, ..DoseParams::over(case.grid(), 8.0) };
    let engine = DoseEngine::of_case(case, Machine::shipped().unwrap(), params).unwrap();
    let beam = engine.beam(gantry_deg).unwrap();
    let mut dose = vec![0.0; grid.len()];
    let columns = beam.dose.view();
    for (bixel, place) in beam.bixels_mm.iter().enumerate() {
        let weight = 1.0 + 0.01 * place[0] + 0.003 * place[1];
        let (rows, values) = columns.column(bixel);
        for (row, value) in rows.iter().zip(values) {
            dose[*row as usize] += weight * f64::from(*value);
        }
    }
    (dose, beam.bixels_mm)
}

#[test]
fn the_same_body_on_the_couch_gets_the_same_dose_in_every_position() {
    let case = phantom(0).unwrap();
    // Every third voxel of the image: no voxel of the dose grid lies as near to one of the image as to another.
    let image = *case.grid();
    let grid = Grid {
        counts: image.counts.map(|n| n.div_ceil(3)),
        spacing_mm: image.spacing_mm.map(|s| 3.0 * s),
        ..image
    };
    for gantry_deg in [0.0, 48.0, 270.0] {
        let (expected, bixels) = dose(&case, grid, gantry_deg);
        let largest = expected.iter().copied().fold(0.0, f64::max);
        for position in PatientPosition::ALL {
            let signs = position.signs();
            let (found, places) = dose(&mirrored(&case, position), turned_grid(&grid, signs), gantry_deg);
            assert_eq!(places, bixels, "{position}, {gantry_deg}");
            let square: f64 = (0..grid.len())
                .map(|i| (found[turned(&grid, signs, i)] - expected[i]) / largest)
                .map(|difference| difference * difference)
                .sum();
            let rms = (square / grid.len() as f64).sqrt();
            println!("{position}, {gantry_deg}: rms {:.1e} of the largest dose", rms);
            assert!(rms < 1e-9, "{position}, {gantry_deg}: {rms}");
            // The supine patient's own voxels would get another dose: the test tells the positions apart.
            if position != PatientPosition::HeadFirstSupine && gantry_deg == 48.0 {
                let (wrong, _) = dose(
                    &mirrored(&case, position).lying(PatientPosition::HeadFirstSupine),
                    turned_grid(&grid, signs),
                    gantry_deg,
                );
                let far = (0..grid.len())
                    .any(|i| (wrong[turned(&grid, signs, i)] - expected[i]).abs() > 0.2 * largest);
                assert!(far, "{position}");
            }
        }
    }
}

#[test]
fn a_case_keeps_its_position_in_its_file() {
    let case = phantom(1).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path: &Path = &folder.path().join("a.case");
    for position in PatientPosition::ALL {
        let lying = case.clone().lying(position);
        let hash = stillpoint_patient::case::write(&lying, path).unwrap();
        assert_eq!(stillpoint_patient::case::read(path).unwrap().position(), position);
        let same = hash == stillpoint_patient::case::content_hash(&case).unwrap();
        assert_eq!(same, position.is_default(), "a case that says no position keeps its hash");
    }
}
