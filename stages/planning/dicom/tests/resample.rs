//! Images that are unevenly spaced or of a tilted gantry become an even volume where that is asked for, and only there.

use std::path::Path;

use dicom_core::VR;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_dicom::{Request, import_folder};
use stillpoint_patient::case::{Case, Imported, NameTable};

use crate::fixture::{contour, ct, file, put, rectangle, structure_set};
use crate::import::request;

const COLUMNS: usize = 12;
const ROWS: usize = 9;
const PTV: [f64; 4] = [-1.0, 5.0, -1.5, 4.5];

/// An image at this z of its corner, tilted by this angle, whose pixels have the value of this function of y and z.
fn image(number: usize, z_mm: f64, degrees: f64, hu: impl Fn(f64, f64) -> f64) -> InMemDicomObject {
    let (s, c) = degrees.to_radians().sin_cos();
    let mut object = ct(number);
    put(&mut object, tags::IMAGE_POSITION_PATIENT, VR::DS, format!("-10\\-12\\{z_mm}"));
    put(&mut object, tags::IMAGE_ORIENTATION_PATIENT, VR::DS, format!("1\\0\\0\\0\\{c:.9}\\{s:.9}"));
    let pixels: Vec<u16> = (0..ROWS)
        .flat_map(|row| {
            let along = 3.0 * row as f64;
            let value = hu(-12.0 + along * c, z_mm + along * s);
            std::iter::repeat_n(((value + 1000.0) / 10.0).round() as u16, COLUMNS)
        })
        .collect();
    put(&mut object, tags::PIXEL_DATA, VR::OW, dicom_core::PrimitiveValue::U16(pixels.into()));
    object
}

fn import(
    images: Vec<InMemDicomObject>,
    regions: Vec<(&str, &str, Vec<InMemDicomObject>)>,
    resample: bool,
) -> Result<Imported, String> {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: String, object: &InMemDicomObject| {
        std::fs::write(Path::new(folder.path()).join(name), file(object)).unwrap();
    };
    images.iter().enumerate().for_each(|(i, object)| write(format!("{i}.dcm"), object));
    write("rs.dcm".to_owned(), &structure_set(regions));
    let names = NameTable::shipped().unwrap();
    import_folder(folder.path(), &Request { resample, ..request(&names) }).map_err(|e| e.to_string())
}

/// The value of each voxel beside that of the function at its centre: the largest difference.
fn worst(case: &Case, hu: impl Fn(f64, f64) -> f64) -> f64 {
    let grid = case.grid();
    let [nx, ny, nz] = grid.counts;
    let at = |axis: usize, i: usize| grid.origin_mm[axis] + grid.spacing_mm[axis] * i as f64;
    let mut worst: f64 = 0.0;
    for (k, j) in (0..nz).flat_map(|k| (0..ny).map(move |j| (k, j))) {
        let found = f64::from(case.hu()[nx * (j + ny * k)]);
        worst = worst.max((found - hu(at(1, j), at(2, k))).abs());
    }
    worst
}

fn ramp(y: f64, z: f64) -> f64 {
    10.0 * y + 4.0 * (z - 100.0)
}

#[test]
fn uneven_images_are_resampled_with_consent_alone_and_hold_what_was_measured() {
    // Every 2.5 mm, with one image missing and one out of place.
    let at_mm: Vec<f64> = (0..24)
        .filter(|i| *i != 9)
        .map(|i| 100.0 + 2.5 * f64::from(i) + if i == 15 { 0.8 } else { 0.0 })
        .collect();
    let images = || at_mm.iter().enumerate().map(|(i, &z)| image(i, z, 0.0, ramp)).collect::<Vec<_>>();
    let ptv = || {
        let planes = at_mm.iter().filter(|z| (110.0..140.0).contains(*z));
        vec![("PTV", "PTV", planes.map(|&z| contour(z, &rectangle(PTV))).collect())]
    };
    let refused = import(images(), ptv(), false).unwrap_err();
    assert!(refused.contains("`--resample`") && refused.contains("5.000 mm from the next"), "{refused}");
    let Imported { case, notes, .. } = import(images(), ptv(), true).unwrap();
    let notes = notes.join("\n");
    assert!(notes.contains("resampled") && notes.contains("neighbours are up to 5.000 mm apart"), "{notes}");
    assert_eq!(case.grid().counts[2], 24);
    assert!((case.grid().spacing_mm[2] - 2.5).abs() < 1e-9);
    // Values are stored in steps of 10.
    assert!(worst(&case, ramp) <= 5.5, "{}", worst(&case, ramp));
    // The slice between its neighbours is filled, as in the images: 12 slices of 36 mm2.
    let volume = case.volume_cm3(case.structure("PTV").unwrap());
    assert!((volume - 12.0 * 36.0 * 2.5 / 1000.0).abs() < 1e-9, "{volume}");
    assert!(!notes.contains("no contour"), "{notes}");
}

#[test]
fn contours_between_the_images_are_kept_where_an_image_is_missing() {
    // The set was drawn on all images; one was lost since.
    let at_mm = (0..24).filter(|i| *i != 9).map(|i| 100.0 + 2.5 * f64::from(i));
    let images = at_mm.enumerate().map(|(i, z)| image(i, z, 0.0, ramp)).collect();
    let planes = (4..16).map(|i| contour(100.0 + 2.5 * f64::from(i), &rectangle(PTV))).collect();
    let Imported { case, notes, .. } = import(images, vec![("PTV", "PTV", planes)], true).unwrap();
    let volume = case.volume_cm3(case.structure("PTV").unwrap());
    assert!((volume - 12.0 * 36.0 * 2.5 / 1000.0).abs() < 1e-9, "{volume}");
    assert!(!notes.iter().any(|note| note.contains("left out")), "{notes:?}");
}

#[test]
fn even_images_are_the_same_with_and_without_consent() {
    let images = || (0..8).map(|i| image(i, 100.0 + 2.5 * i as f64, 0.0, ramp)).collect::<Vec<_>>();
    let ptv = || vec![("PTV", "PTV", vec![contour(107.5, &rectangle(PTV)), contour(110.0, &rectangle(PTV))])];
    let [plain, consented] = [false, true].map(|resample| import(images(), ptv(), resample).unwrap());
    assert_eq!(plain.case, consented.case);
    assert_eq!(plain.notes, consented.notes);
}

#[test]
fn a_wide_hole_is_not_filled_in() {
    let images = [0.0, 2.5, 5.0, 15.0, 17.5].iter().enumerate().map(|(i, z)| image(i, 100.0 + z, 0.0, ramp));
    let refused = import(images.collect(), vec![("PTV", "PTV", vec![contour(102.5, &rectangle(PTV))])], true);
    let refused = refused.unwrap_err();
    assert!(refused.contains("10.000 mm from the next") && refused.contains("not bridged"), "{refused}");
}

/// Contours of a block that is square to the patient, drawn on tilted images.
fn tilted_block(z_mm: &[f64], degrees: f64, [low, high]: [f64; 2]) -> Vec<InMemDicomObject> {
    let tan = degrees.to_radians().tan();
    let z = |corner_mm: f64, y: f64| corner_mm + (y + 12.0) * tan;
    z_mm.iter()
        .filter_map(|&corner_mm| {
            // The part of this image's rectangle that is between the planes of the block.
            let within = |y: f64| (low..=high).contains(&z(corner_mm, y));
            let ys: Vec<f64> = (0..=600).map(|i| -1.5 + 0.01 * f64::from(i)).filter(|&y| within(y)).collect();
            let (first, last) = (*ys.first()?, *ys.last()?);
            let mut object = contour(0.0, &rectangle([-1.0, 5.0, first, last]));
            let points = rectangle([-1.0, 5.0, first, last]);
            let text: Vec<String> =
                points.iter().map(|[x, y]| format!("{x}\\{y}\\{:.6}", z(corner_mm, *y))).collect();
            put(&mut object, tags::CONTOUR_DATA, VR::DS, text.join("\\"));
            Some(object)
        })
        .collect()
}

#[test]
fn images_of_a_tilted_gantry_become_slices_across_the_patient() {
    for degrees in [-15.0, 20.0] {
        let z_mm: Vec<f64> = (0..40).map(|i| 100.0 + 1.25 * f64::from(i)).collect();
        let images = || z_mm.iter().enumerate().map(|(i, &z)| image(i, z, degrees, ramp)).collect::<Vec<_>>();
        let block = [118.0, 133.0];
        let ptv = || vec![("PTV", "PTV", tilted_block(&z_mm, degrees, block))];
        let refused = import(images(), ptv(), false).unwrap_err();
        assert!(refused.contains("tilted gantry") && refused.contains("`--resample`"), "{refused}");
        let Imported { case, notes, .. } = import(images(), ptv(), true).unwrap();
        let notes = notes.join("\n");
        assert!(notes.contains(&format!("tilted by {degrees:.1} degrees")), "{notes}");
        let c = degrees.to_radians().cos();
        assert!((case.grid().spacing_mm[1] - 3.0 * c).abs() < 1e-6);
        assert!(worst(&case, ramp) <= 6.0, "{}", worst(&case, ramp));
        let volume = case.volume_cm3(case.structure("PTV").unwrap());
        let drawn = 6.0 * 6.0 * (block[1] - block[0]) / 1000.0;
        assert!((volume / drawn - 1.0).abs() < 0.2, "{volume} of {drawn}");
        // Its slices are those of the block, wherever they are in y.
        let grid = case.grid();
        let [nx, ny, _] = grid.counts;
        let mask = &case.structure("PTV").unwrap().mask;
        for index in (0..grid.len()).filter(|&i| mask.contains(i)) {
            let z = grid.origin_mm[2] + grid.spacing_mm[2] * (index / (nx * ny)) as f64;
            assert!((block[0] - 1.3..=block[1] + 1.3).contains(&z), "{z}");
        }
    }
}

#[test]
fn a_target_in_the_corner_of_tilted_images_is_refused_with_its_size() {
    let z_mm: Vec<f64> = (0..40).map(|i| 100.0 + 1.25 * f64::from(i)).collect();
    let images = z_mm.iter().enumerate().map(|(i, &z)| image(i, z, 20.0, |_, _| 0.0)).collect::<Vec<_>>();
    let ptv = vec![("PTV", "PTV", tilted_block(&z_mm, 20.0, [104.0, 112.0]))];
    let refused = import(images, ptv, true).unwrap_err();
    assert!(refused.contains("\"PTV\" reaches") && refused.contains("toward the feet"), "{refused}");
}
