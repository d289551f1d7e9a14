//! Nothing changes a volume in silence: what is cut is refused, and what is united, repeated or missing is said.

use dicom_core::VR;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_dicom::{Request, import_folder};
use stillpoint_patient::case::{Imported, NameTable};

use crate::fixture::{contour, ct, file, put, rectangle, structure_set};
use crate::import::request;

/// Slices at 100 to 157.5 mm.
const SLICES: usize = 24;
const PTV: [f64; 4] = [-1.0, 5.0, -1.5, 4.5];
/// Area of that rectangle, mm2.
const AREA_MM2: f64 = 36.0;

fn planes(at_mm: impl IntoIterator<Item = f64>, corners: [f64; 4]) -> Vec<InMemDicomObject> {
    at_mm.into_iter().map(|z| contour(z, &rectangle(corners))).collect()
}

fn import(
    regions: Vec<(&str, &str, Vec<InMemDicomObject>)>,
    allowed_cut_cm3: f64,
) -> Result<Imported, String> {
    let folder = tempfile::tempdir().unwrap();
    for slice in 0..SLICES {
        std::fs::write(folder.path().join(format!("{slice}.dcm")), file(&ct(slice))).unwrap();
    }
    std::fs::write(folder.path().join("rs.dcm"), file(&structure_set(regions))).unwrap();
    let names = NameTable::shipped().unwrap();
    import_folder(folder.path(), &Request { allowed_cut_cm3, ..request(&names) }).map_err(|e| e.to_string())
}

/// The PTV's volume, and what is said of it.
fn ptv(contours: Vec<InMemDicomObject>) -> (f64, Vec<String>) {
    let Imported { case, notes, .. } = import(vec![("PTV", "PTV", contours)], 0.0).unwrap();
    // What is said of the outline, which is made from the images, is no word of the contours.
    let of_contours = notes.into_iter().filter(|note| !note.contains("the outline"));
    (case.volume_cm3(case.structure("PTV").unwrap()), of_contours.collect())
}

fn every(step_mm: f64, from_mm: f64, count: usize) -> impl Iterator<Item = f64> + Clone {
    (0..count).map(move |i| from_mm + step_mm * i as f64)
}

#[test]
fn a_target_that_the_scan_ends_in_is_refused_with_its_size() {
    let message = import(vec![("PTV", "PTV", planes(every(2.5, 140.0, 12), PTV))], 1e6).unwrap_err();
    // Planes up to 167.5 mm; slices end at 158.75 mm.
    assert!(message.contains(r#""PTV" reaches 8.8 mm beyond the images toward the head"#), "{message}");
    assert!(message.contains("0.36 of its 1.08 cm3") && message.contains("give the whole scan"), "{message}");
    let feet = import(vec![("CTV", "CTV", planes(every(2.5, 90.0, 12), PTV))], 1e6).unwrap_err();
    assert!(feet.contains(r#""CTV" reaches 8.8 mm beyond the images toward the feet"#), "{feet}");
    let neighbour = planes(every(2.5, 110.0, 12), [7.0, 23.0, -1.5, 4.5]);
    let message = import(vec![("PTV", "PTV", neighbour)], 1e6).unwrap_err();
    assert!(message.contains("beyond their sides") && message.contains("1.80 of its 2.88 cm3"), "{message}");
}

#[test]
fn an_organ_that_the_scan_ends_in_needs_leave_of_that_size() {
    let regions = || {
        vec![
            ("PTV", "PTV", planes(every(2.5, 110.0, 12), PTV)),
            ("Rectum", "ORGAN", planes(every(2.5, 140.0, 12), PTV)),
            ("Body", "EXTERNAL", planes(every(2.5, 90.0, 30), [-9.0, 11.0, -12.0, 12.0])),
        ]
    };
    let message = import(regions(), 0.0).unwrap_err();
    assert!(
        message.contains(r#""Rectum" reaches 8.8 mm"#) && message.contains("--allow-cut 0.36cm3"),
        "{message}"
    );
    assert!(!message.contains("Body"), "{message}");
    assert!(import(regions(), 0.35).is_err());
    let Imported { case, notes, .. } = import(regions(), 0.36).unwrap();
    assert!((case.volume_cm3(case.structure("Rectum").unwrap()) - 0.72).abs() < 1e-9);
    let notes = notes.join("\n");
    assert!(notes.contains(r#""Rectum" reaches"#) && notes.contains(r#""Body" reaches"#), "{notes}");
}

#[test]
fn planes_far_apart_stand_for_their_distance_and_are_said() {
    let (volume, notes) = ptv(planes(every(15.0, 112.5, 3), PTV));
    assert!((volume - AREA_MM2 * 45.0 / 1000.0).abs() < 1e-9, "{volume}");
    let expected = r#""PTV": contours are 15.0 mm apart, and each represents all of that distance: 1.62 cm3 (for a slice each 0.27 cm3)"#;
    assert_eq!(notes, [expected]);
    let (volume, notes) = ptv(planes([110.0, 140.0], PTV));
    assert!((volume - AREA_MM2 * 5.0 / 1000.0).abs() < 1e-9, "{volume}");
    let expected = r#""PTV": contours are 30.0 mm apart, and each represents a slice: 0.18 cm3 (with the space between them 1.17 cm3)"#;
    assert_eq!(notes, [expected]);
}

#[test]
fn planes_that_are_missing_are_said_with_both_volumes() {
    let whole: Vec<f64> = every(2.5, 110.0, 16).collect();
    let (volume, notes) = ptv(planes(whole.clone(), PTV));
    assert_eq!((format!("{volume:.2}"), notes), ("1.44".to_owned(), Vec::new()));
    let missing = whole.iter().enumerate().filter(|(i, _)| !(5..10).contains(i)).map(|(_, z)| *z);
    let (volume, notes) = ptv(planes(missing, PTV));
    assert_eq!(format!("{volume:.2}"), "0.99");
    let expected = r#""PTV": there is no contour between 120.0 and 135.0 mm, and that gap stays empty: 0.99 cm3 (filled 1.44 cm3); where it is not a gap, draw the missing contours"#;
    assert_eq!(notes, [expected]);
}

#[test]
fn contours_that_overlap_are_united_and_contours_given_twice_count_once() {
    let heights = every(2.5, 110.0, 12);
    let twice = [planes(heights.clone(), PTV), planes(heights.clone(), PTV)].concat();
    let (volume, notes) = ptv(twice.clone());
    assert_eq!(format!("{volume:.2}"), "1.08");
    assert_eq!(
        notes,
        [r#""PTV": 12 contours repeat another and count once: 1.08 cm3 (by exclusive or 0.00 cm3)"#]
    );
    let other = [1.0, 7.0, -1.5, 4.5];
    let (volume, notes) = ptv([planes(heights.clone(), PTV), planes(heights, other)].concat());
    assert_eq!(format!("{volume:.2}"), "1.44");
    let expected =
        r#""PTV": contours overlap on 12 planes and are united: 1.44 cm3 (by exclusive or 0.72 cm3)"#;
    assert_eq!(notes, [expected]);
    let xor = twice.into_iter().map(|mut item| {
        put(&mut item, tags::CONTOUR_GEOMETRIC_TYPE, VR::CS, "CLOSEDPLANAR_XOR");
        item
    });
    let regions = vec![("PTV", "PTV", planes([110.0], PTV)), ("Bladder", "ORGAN", xor.collect())];
    let notes = import(regions, 0.0).unwrap().notes.join("\n");
    assert!(notes.contains(r#""Bladder" holds no voxel"#), "{notes}");
}
