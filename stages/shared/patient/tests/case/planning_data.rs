//! Cases from the planning data: a scanned phantom, real patients, synthetic pelves.

use std::path::{Path, PathBuf};

use stillpoint_patient::case::{Case, Imported, NameTable, Role, from_bytes, import_described, to_bytes};
use stillpoint_testing::reference;

fn import(json: &Path) -> Case {
    let Imported { case, notes, .. } = import_described(json, &NameTable::shipped().unwrap()).unwrap();
    // Published patients have metal, and outlines that leave out the airways or end beside an organ: that is said.
    let is_of_patients = |note: &String| {
        ["has holes of", "more than 3000 HU", "leaves the outline", "outside of the outline", "count as air"]
            .iter()
            .any(|words| note.contains(words))
    };
    assert!(notes.iter().all(is_of_patients), "{}: {notes:?}", json.display());
    case
}

#[test]
fn every_case_of_the_data_is_read_with_its_isocentre_at_the_centroid() {
    let Some(root) = reference::folder("planning") else { return };
    let cases = |folder: &str| {
        let all = std::fs::read_dir(root.join(folder)).unwrap().map(|entry| entry.unwrap().path());
        let mut files: Vec<PathBuf> = all.filter(|p| p.extension().is_some_and(|e| e == "json")).collect();
        files.sort();
        assert!(!files.is_empty(), "{folder}");
        files.into_iter().take(16)
    };
    for file in ["tg119", "openkbp", "pelvis_000", "pelvis"].into_iter().flat_map(cases) {
        let case = import(&file);
        let body = case.external().unwrap();
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for index in (0..case.grid().len()).filter(|&i| case.targets().any(|t| t.mask.contains(i))) {
            count += 1.0;
            for (s, c) in sum.iter_mut().zip(case.grid().centre_mm(case.grid().voxel(index))) {
                *s += c;
            }
        }
        for (sum, given) in sum.iter().zip(case.isocentre_mm()) {
            assert!((sum / count - given).abs() < 1e-6, "{}", file.display());
        }
        // Tissue is inside the outline: its mean is near water, and lighter outside.
        let mean = |inside: bool| {
            let hu: Vec<_> = (0..case.grid().len()).filter(|&i| body.mask.contains(i) == inside).collect();
            hu.iter().map(|&i| f64::from(case.hu()[i])).sum::<f64>() / hu.len() as f64
        };
        assert!((-250.0..250.0).contains(&mean(true)), "{}: {}", file.display(), mean(true));
        assert!(mean(false) < -800.0, "{}: {}", file.display(), mean(false));
        assert!(!case.prescription().is_empty() && case.fractions().is_some());
    }
}

#[test]
fn a_real_patient_keeps_its_reference_dose_through_the_case_file() {
    let Some(root) = reference::folder("planning") else { return };
    let case = import(&root.join("openkbp/openkbp_1.json"));
    let repeated = from_bytes(&to_bytes(&case).unwrap().0).unwrap();
    assert_eq!(repeated.structures(), case.structures());
    assert_eq!(repeated.hu(), case.hu());
    let dose = repeated.reference_dose_gy().unwrap();
    assert_eq!(case.reference_dose_gy().unwrap(), dose);
    let ptv = repeated.structure("PTV70").unwrap();
    assert_eq!(ptv.role, Role::Target);
    let mean = ptv.mask.indices().map(|i| f64::from(dose[i])).sum::<f64>() / ptv.mask.count() as f64;
    assert!((65.0..75.0).contains(&mean), "{mean} Gy");
}
