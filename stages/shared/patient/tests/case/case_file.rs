//! Cases: what is refused, and that files give back what was written.

use proptest::prelude::*;
use stillpoint_patient::Grid;
use stillpoint_patient::case::{
    Case, CaseParts, Mask, Prescription, Role, content_hash, from_bytes, read, to_bytes, write,
};

use super::small::{GRID, case, case_as_read, parts};

fn refusal(change: impl FnOnce(&mut CaseParts)) -> String {
    let mut parts = parts();
    change(&mut parts);
    Case::new(parts).unwrap_err().to_string()
}

#[test]
fn a_case_comes_back_from_its_file_with_its_hash() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.case");
    let case = case();
    let hash = write(&case, &path).unwrap();
    let repeated = read(&path).unwrap();
    assert_eq!((repeated.name(), repeated.hu(), repeated.grid()), (case.name(), case.hu(), case.grid()));
    assert_eq!(repeated.structures(), case.structures());
    assert_eq!(repeated.isocentre_mm(), case.isocentre_mm());
    assert_eq!((repeated.uids(), repeated.fractions()), (case.uids(), case.fractions()));
    assert_eq!(
        (repeated.prescription(), repeated.reference_dose_gy()),
        (case.prescription(), case.reference_dose_gy())
    );
    assert_eq!(repeated.provenance(), case.provenance());
    assert_eq!(content_hash(&repeated).unwrap(), hash);
    assert_eq!(to_bytes(&repeated).unwrap().0, std::fs::read(&path).unwrap());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no half-written file stays");
}

#[test]
fn a_case_file_is_for_its_owner_alone() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.case");
    write(&case(), &path).unwrap();
    assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
}

#[test]
fn the_isocentre_is_the_centroid_of_the_prescribed_targets_or_of_all_each_voxel_once() {
    let is_at = |case: &Case, expected: [f64; 3]| {
        case.isocentre_mm().iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12)
    };
    // The targets hold voxels 5 to 8: (1,1,0), (2,1,0), (3,1,0), (0,2,0); that with a prescription the first three.
    assert!(is_at(&case(), [-6.0 + 3.0 * 2.0, 0.1 + 2.5, -1e3 / 7.0]));
    let without = Case::new(CaseParts { prescription: Vec::new(), ..parts() }).unwrap();
    assert!(is_at(&without, [-6.0 + 3.0 * 1.5, 0.1 + 2.5 * 1.25, -1e3 / 7.0]));
}

#[test]
fn parts_that_do_not_fit_together_are_refused_with_what_to_do() {
    assert!(refusal(|p| p.name = "a/b".to_owned()).contains("is not a name for a case"));
    assert!(refusal(|p| p.name = String::new()).contains("is not a name for a case"));
    assert!(refusal(|p| p.structures[1].name = "x\ny".to_owned()).contains("is not a name for a structure"));
    assert!(refusal(|p| p.structures[1].name = "Body".to_owned()).contains("rename one"));
    assert!(refusal(|p| p.structures[3].role = Role::External).contains("both outlines"));
    assert!(refusal(|p| p.structures[3].mask = Mask::empty(25)).contains("Rectum has 25 values"));
    assert!(refusal(|p| p.hu.truncate(23)).contains("the CT has 23 values, but the grid has 24"));
    assert!(refusal(|p| p.grid = Grid { counts: [4, 0, 2], ..GRID }).contains("voxels"));
    assert!(refusal(|p| p.grid = Grid { counts: [usize::MAX, 3, 2], ..GRID }).contains("voxels"));
    assert!(refusal(|p| p.grid = Grid { spacing_mm: [3.0, f64::NAN, 1.0], ..GRID }).contains("spacing"));
    assert!(refusal(|p| p.grid = Grid { spacing_mm: [3.0, -2.5, 1.0], ..GRID }).contains("spacing"));
    assert!(refusal(|p| p.grid = Grid { origin_mm: [f64::INFINITY, 0.0, 0.0], ..GRID }).contains("origin"));
    assert!(refusal(|p| p.isocentre_mm = Some([0.0, 0.0, 0.0])).contains("outside the images"));
    assert!(refusal(|p| p.isocentre_mm = Some([f64::NAN; 3])).contains("outside the images"));
    assert!(refusal(|p| p.fractions = Some(0)).contains("0 fractions"));
    assert!(refusal(|p| p.reference_dose_gy.as_mut().unwrap()[9] = -1.0).contains("voxel [1, 2, 0]"));
    let prescribe = |structure: &str, dose_gy| Prescription { structure: structure.to_owned(), dose_gy };
    assert!(refusal(|p| p.prescription[0] = prescribe("Nothing", 1.0)).contains("no structure of that name"));
    assert!(refusal(|p| p.prescription[0] = prescribe("Rectum", 1.0)).contains("not a target"));
    assert!(refusal(|p| p.prescription[0] = prescribe("PTV", f64::NAN)).contains("NaN Gy"));
    assert!(refusal(|p| p.prescription.push(prescribe("PTV", 1.0))).contains("another dose already"));
    let no_target = refusal(|p| {
        p.prescription.clear();
        p.structures.iter_mut().filter(|s| s.role == Role::Target).for_each(|s| s.role = Role::Organ);
    });
    assert!(no_target.contains("give the isocentre"));
}

#[test]
fn every_cut_and_every_changed_byte_of_a_case_file_is_noticed() {
    let (bytes, _) = to_bytes(&case()).unwrap();
    for end in 0..bytes.len() {
        assert!(from_bytes(&bytes[..end]).is_err(), "cut at {end}");
    }
    for place in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[place] ^= 1;
        // Two bytes of each zlib header say how hard the packer tried; what they hold does not reach the case.
        if let Ok(repeated) = from_bytes(&changed) {
            assert_eq!(repeated, case_as_read(), "byte {place}");
        }
    }
    let mut longer = bytes;
    longer.push(0);
    assert!(from_bytes(&longer).unwrap_err().to_string().contains("1 bytes follow"));
}

proptest! {
    #[test]
    fn numbers_come_back_to_the_last_bit(
        spacing in prop::array::uniform3(0.01..100.0_f64),
        origin in prop::array::uniform3(-1e5..1e5_f64),
        dose in 1e-3..200.0_f64,
    ) {
        let mut parts = parts();
        parts.grid = Grid { spacing_mm: spacing, origin_mm: origin, ..GRID };
        parts.prescription[0].dose_gy = dose;
        let case = Case::new(parts).unwrap();
        let repeated = from_bytes(&to_bytes(&case).unwrap().0).unwrap();
        prop_assert_eq!(repeated.grid(), case.grid());
        prop_assert_eq!(repeated.isocentre_mm(), case.isocentre_mm());
        prop_assert_eq!(repeated.prescription(), case.prescription());
    }
}
