//! Cases from the DICOM files of the planning data.

use stillpoint_dicom::{DataSet, Rois, import_folder};
use stillpoint_patient::case::{Imported, NameTable, Role, Uid, import_described};
use stillpoint_testing::reference;

use crate::import::request;

#[test]
fn the_dicom_folder_and_the_nrrd_files_of_one_case_agree() {
    let Some(root) = reference::folder("planning") else { return };
    let names = NameTable::shipped().unwrap();
    let Imported { case, notes, .. } =
        import_folder(&root.join("pelvis_000/dicom"), &request(&names)).unwrap();
    let described = import_described(&root.join("pelvis_000/pelvis_000.json"), &names).unwrap().case;
    assert_eq!(case.grid(), described.grid());
    assert_eq!(case.hu(), described.hu());
    println!("{notes:?}");
    for structure in described.structures() {
        let drawn = case.structure(&structure.name).unwrap();
        assert_eq!(drawn.role, structure.role);
        let both = structure.mask.indices().filter(|&i| drawn.mask.contains(i)).count();
        let dice = 2.0 * both as f64 / (structure.mask.count() + drawn.mask.count()) as f64;
        let volumes = [described.volume_cm3(structure), case.volume_cm3(drawn)];
        println!("{}: Dice {dice:.5}, {:.3} and {:.3} cm3", structure.name, volumes[0], volumes[1]);
        assert!(dice > 0.999, "{}: Dice {dice}", structure.name);
    }
}

/// One has no file meta information, in one every element is of unknown representation, one is cut off.
#[test]
fn the_samples_of_vendors_are_read_for_what_they_are() {
    let Some(root) = reference::folder("planning") else { return };
    let names = NameTable::shipped().unwrap();
    for (file, expected) in [
        ("rtstruct.dcm", "no CT image is here, but RTSTRUCT;"),
        ("rtplan.dcm", "no CT image is here, but RTPLAN;"),
        ("rtdose.dcm", "no CT image is here, but RTDOSE;"),
        ("rtdose_rle.dcm", "no CT image is here, but RTDOSE;"),
        ("rtplan_truncated.dcm", "rtplan_truncated.dcm: the file is cut off: (300A,00B0) at byte 1410"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::copy(root.join("dicom_rt_samples").join(file), folder.path().join(file)).unwrap();
        let message = import_folder(folder.path(), &request(&names)).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let bytes = std::fs::read(root.join("dicom_rt_samples/rtstruct.dcm")).unwrap();
    let object = DataSet::read(&bytes).unwrap().object;
    let frame = Uid::parse("1.2.826.0.1.3680043.8.498.2010020400001.2").unwrap();
    let rois = Rois::read(&object, &frame, 0.0).unwrap().rois;
    let texts: Vec<_> = rois.iter().map(|r| (r.name.as_str(), r.role.unwrap(), r.contours.len())).collect();
    let iso = |name| (name, Role::Other, 0);
    assert_eq!(texts, [("patient", Role::External, 3), iso("Isocenter 1"), iso("Isocenter 2")]);
}
