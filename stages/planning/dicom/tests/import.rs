//! Folders of CT and RTSTRUCT: what becomes a case, and what is refused with the file and the tag.

use std::path::Path;

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::tags;
use stillpoint_dicom::{CaseIdentity, Request, import_folder};
use stillpoint_patient::case::intake::Scale;
use stillpoint_patient::case::{Imported, NameTable, Prescription, Role, Uid, Uids, to_bytes};

use crate::fixture::{
    COUNTS, Encoding, FRAME, SERIES, STRUCTURES, STUDY, bare, contour, ct, file, folder, name, put,
    rectangle, replace, small_structures, structure_set,
};

pub fn request(names: &NameTable) -> Request<'_> {
    Request {
        names,
        name: None,
        series: None,
        prescription: Vec::new(),
        fractions: None,
        isocentre_mm: None,
        allowed_cut_cm3: 0.0,
        position: None,
        scale: Scale::OfPatients,
        resample: false,
    }
}

fn import(folder: &Path) -> Result<Imported, String> {
    let names = NameTable::shipped().unwrap();
    import_folder(folder, &request(&names)).map_err(|error| error.to_string())
}

/// What is said when one slice is changed.
fn refusal(slice: usize, change: impl FnOnce(&mut dicom_object::InMemDicomObject)) -> String {
    let folder = folder();
    replace(folder.path(), slice, change);
    import(folder.path()).unwrap_err()
}

#[test]
fn slices_are_sorted_by_their_position_and_rescaled() {
    let folder = folder();
    let Imported { case, notes, .. } = import(folder.path()).unwrap();
    assert_eq!((case.grid().counts, case.grid().spacing_mm), (COUNTS, [2.0, 3.0, 2.5]));
    assert_eq!(case.grid().origin_mm, [-10.0, -12.0, 100.0]);
    let slice: Vec<i16> = (0..108).map(|i| 10 * i - 1000).collect();
    assert!(
        case.hu().chunks(108).all(|found| found == slice),
        "the slope is 10, the intercept -1000, and 12 bits are stored"
    );
    let end = r#""ptv" is drawn up to the first or last image: where it goes on, the images end within it"#;
    assert_eq!(notes, [r#""outline" is called "Body""#, r#""ptv" is called "PTV""#, end]);
    assert_eq!(case.structure("PTV").unwrap().role, Role::Target);
    // x from -1 to 5 holds 0, 2, 4; y from -1.5 to 4.5 holds 0, 3.
    assert_eq!(case.structure("PTV").unwrap().mask.count(), 3 * 2 * COUNTS[2]);
    assert_eq!(case.isocentre_mm(), [2.0, 1.5, 105.0]);
}

#[test]
fn a_case_keeps_uids_and_nothing_that_names_a_person() {
    let folder = folder();
    let names = NameTable::shipped().unwrap();
    let prescription = vec![Prescription { structure: "PTV".to_owned(), dose_gy: 60.0 }];
    let request =
        Request { name: Some("case 7".to_owned()), prescription, fractions: Some(30), ..request(&names) };
    let case = import_folder(folder.path(), &request).unwrap().case;
    let uid = |text| Uid::parse(text).unwrap();
    let uids = Uids {
        study: uid(STUDY),
        series: uid(SERIES),
        frame_of_reference: uid(FRAME),
        structure_set: uid(STRUCTURES),
    };
    assert_eq!(case.uids(), Some(&uids));
    let (bytes, _) = to_bytes(&case).unwrap();
    let header = String::from_utf8_lossy(&bytes[44..bytes.len().min(2000)]).to_lowercase();
    assert!(header.contains("case 7") && header.contains(STUDY));
    for secret in ["secret", "4711", "ller", "1950", "0203"] {
        assert!(!header.contains(secret) && !format!("{case:?}").to_lowercase().contains(secret), "{secret}");
    }
    let identity = CaseIdentity::read_stored(folder.path(), &uids).unwrap();
    assert_eq!(format!("{identity:?}"), "Identity(kept)");
    let other = Uids { study: uid("1.9"), ..uids };
    assert!(CaseIdentity::read_stored(folder.path(), &other).unwrap_err().to_string().contains("study 1.9"));
}

#[test]
fn files_without_meta_information_and_with_unknown_representations_are_read() {
    let folder = folder();
    let expected = import(folder.path()).unwrap().case;
    std::fs::write(folder.path().join("rs.dcm"), bare(&small_structures(), Encoding::Implicit)).unwrap();
    assert_eq!(import(folder.path()).unwrap().case, expected);
    let mut unknown = small_structures();
    put(&mut unknown, tags::MODALITY, VR::UN, PrimitiveValue::from(b"RTSTRUCT".to_vec()));
    std::fs::write(folder.path().join("rs.dcm"), bare(&unknown, Encoding::Explicit)).unwrap();
    assert_eq!(import(folder.path()).unwrap().case, expected);
    std::fs::write(folder.path().join(name(2)), bare(&ct(2), Encoding::Implicit)).unwrap();
    assert_eq!(import(folder.path()).unwrap().case, expected);
}

#[test]
fn files_in_folders_are_found_and_strangers_are_told() {
    let folder = folder();
    let deeper = folder.path().join("a/b");
    std::fs::create_dir_all(&deeper).unwrap();
    std::fs::rename(folder.path().join("rs.dcm"), deeper.join("rs")).unwrap();
    std::fs::write(folder.path().join("readme.txt"), "hello").unwrap();
    let mut localizer = ct(0);
    put(&mut localizer, tags::IMAGE_TYPE, VR::CS, "ORIGINAL\\PRIMARY\\LOCALIZER");
    put(&mut localizer, tags::SERIES_INSTANCE_UID, VR::UI, "1.2.99");
    std::fs::write(folder.path().join("scout.dcm"), file(&localizer)).unwrap();
    let notes = import(folder.path()).unwrap().notes.join("\n");
    assert!(notes.contains("scout.dcm is a localizer") && notes.contains("1 files are not DICOM"), "{notes}");
}

#[test]
fn corners_that_a_writer_rounded_are_those_of_one_volume() {
    let folder = folder();
    replace(folder.path(), 3, |o| put(o, tags::IMAGE_POSITION_PATIENT, VR::DS, "-9.998\\-12.002\\107.5"));
    let Imported { case, .. } = import(folder.path()).unwrap();
    assert_eq!(case.grid().counts, COUNTS);
}

#[test]
fn images_that_make_no_volume_are_refused_with_file_and_tag() {
    let z = |text: &'static str| move |o: &mut _| put(o, tags::IMAGE_POSITION_PATIENT, VR::DS, text);
    let message = refusal(2, z("-10\\-12\\106"));
    assert!(
        message.contains("an image is missing")
            && message.contains("(0020,0032)")
            && message.contains(&name(2)),
        "{message}"
    );
    let message = refusal(2, z("-10\\-12\\102.5"));
    assert!(
        message.contains("remove one of them") && message.contains(&name(1)) && message.contains(&name(2)),
        "{message}"
    );
    let message = refusal(3, z("-9\\-12\\107.5"));
    assert!(message.contains("the corner in (0020,0032)") && message.contains(&name(3)), "{message}");
    let gap = folder();
    std::fs::remove_file(gap.path().join(name(2))).unwrap();
    let message = import(gap.path()).unwrap_err();
    assert!(message.contains("5.000 mm from the next") && message.contains(&name(1)), "{message}");
    for (tag, vr, value) in [
        (tags::STUDY_INSTANCE_UID, VR::UI, "1.2.77"),
        (tags::FRAME_OF_REFERENCE_UID, VR::UI, "1.2.77"),
        (tags::PATIENT_POSITION, VR::CS, "HFP"),
        (tags::PIXEL_SPACING, VR::DS, "3\\2.1"),
    ] {
        let message = refusal(4, |o| put(o, tag, vr, value));
        assert!(
            message.contains(&tag.to_string())
                && message.contains(&name(4))
                && message.contains("one series"),
            "{message}"
        );
    }
}

#[test]
fn of_several_series_one_must_be_chosen() {
    let folder = folder();
    for slice in 0..COUNTS[2] {
        let mut object = ct(slice);
        put(&mut object, tags::SERIES_INSTANCE_UID, VR::UI, "1.2.99");
        std::fs::write(folder.path().join(format!("other{slice}.dcm")), file(&object)).unwrap();
    }
    let Imported { case, notes, .. } = import(folder.path()).unwrap();
    assert_eq!(case.uids().unwrap().series.as_str(), SERIES, "the structure set names it");
    assert!(notes[0].contains("of 2 CT series that is taken which the RTSTRUCT names"), "{notes:?}");
    let mut set = small_structures();
    set.take(tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE);
    std::fs::write(folder.path().join("rs.dcm"), file(&set)).unwrap();
    let message = import(folder.path()).unwrap_err();
    assert!(
        message.contains("--series") && message.contains(SERIES) && message.contains("1.2.99"),
        "{message}"
    );
    std::fs::write(folder.path().join("rs.dcm"), file(&small_structures())).unwrap();
    let names = NameTable::shipped().unwrap();
    let of = |uid: &str| {
        import_folder(folder.path(), &Request { series: Some(Uid::parse(uid).unwrap()), ..request(&names) })
    };
    assert_eq!(of(SERIES).unwrap().case.uids().unwrap().series.as_str(), SERIES);
    assert!(of("1.2.99").unwrap_err().to_string().contains("names other series than 1.2.99"));
    assert!(of("1.5").unwrap_err().to_string().contains("no CT series 1.5"));
}

#[test]
fn images_of_other_kinds_and_positions_are_refused_by_tag_and_name() {
    for (tag, vr, value, expected) in [
        (tags::PATIENT_POSITION, VR::CS, "FFDR", "FFDR, feet first on the right side"),
        (tags::PATIENT_POSITION, VR::CS, "HFDL", "HFDL, head first on the left side"),
        (tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0\\0.98\\0.2", "oblique"),
        (tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\0\\0\\-1", "sagittal"),
        (tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0\\0\\-1", "coronal"),
        (tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\-1\\0\\0", "turned within its plane"),
        (tags::IMAGE_POSITION_PATIENT, VR::DS, "1\\2", "another count is expected"),
        (tags::IMAGE_POSITION_PATIENT, VR::DS, "1\\2\\x", "finite numbers are expected"),
        (tags::PIXEL_SPACING, VR::DS, "3\\0", "above 0 mm"),
        (tags::RESCALE_SLOPE, VR::DS, "1e9", "beyond -32768"),
        (tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "RGB", "MONOCHROME2"),
        (tags::SOP_CLASS_UID, VR::UI, "1.2.840.10008.5.1.4.1.1.2.1", "single-frame CT"),
        (tags::NUMBER_OF_FRAMES, VR::IS, "2", "one image per file"),
    ] {
        let message = refusal(1, |o| put(o, tag, vr, value));
        assert!(
            message.contains(&tag.to_string()) && message.contains(&name(1)) && message.contains(expected),
            "{message}"
        );
    }
    for tag in [
        tags::PATIENT_POSITION,
        tags::IMAGE_POSITION_PATIENT,
        tags::IMAGE_ORIENTATION_PATIENT,
        tags::PIXEL_SPACING,
        tags::ROWS,
        tags::BITS_STORED,
        tags::RESCALE_SLOPE,
        tags::RESCALE_INTERCEPT,
        tags::PIXEL_DATA,
        tags::STUDY_INSTANCE_UID,
        tags::SERIES_INSTANCE_UID,
        tags::FRAME_OF_REFERENCE_UID,
        tags::SOP_CLASS_UID,
    ] {
        let message = refusal(1, |o| drop(o.take(tag)));
        assert!(
            message.contains(&tag.to_string())
                && message.contains("is missing")
                && message.contains(&name(1)),
            "{message}"
        );
    }
}

#[test]
fn padding_outside_the_scanner_is_air() {
    let folder = folder();
    replace(folder.path(), 0, |o| put(o, tags::PIXEL_PADDING_VALUE, VR::US, 40_u16));
    assert_eq!(import(folder.path()).unwrap().case.hu()[39..42], [-610, -1000, -590]);
}

#[test]
fn truncated_files_are_refused_with_the_file_and_the_tag() {
    let folder = folder();
    let whole = file(&ct(1));
    for left in [0.5, 0.9, 0.99] {
        let end = (whole.len() as f64 * left) as usize;
        std::fs::write(folder.path().join(name(1)), &whole[..end]).unwrap();
        let message = import(folder.path()).unwrap_err();
        assert!(
            message.contains(&name(1)) && message.contains("cut off") && message.contains('('),
            "{message}"
        );
    }
    // Without a word the last image would be lost: the others make a volume.
    let last = name(COUNTS[2] - 1);
    for left in [0, 100, 131] {
        std::fs::write(folder.path().join(name(1)), &whole).unwrap();
        std::fs::write(folder.path().join(&last), &whole[..left]).unwrap();
        for file in [last.as_str(), "without-extension"] {
            std::fs::rename(folder.path().join(&last), folder.path().join(file)).unwrap();
            let message = import(folder.path()).unwrap_err();
            assert!(message.contains(file) && message.contains("ends before its first element"), "{message}");
            std::fs::rename(folder.path().join(file), folder.path().join(&last)).unwrap();
        }
    }
}

#[test]
fn structure_sets_that_do_not_fit_are_refused() {
    let with = |object: &dicom_object::InMemDicomObject| {
        let folder = folder();
        std::fs::write(folder.path().join("rs.dcm"), file(object)).unwrap();
        import(folder.path())
    };
    let bad = |change: &dyn Fn(&mut dicom_object::InMemDicomObject)| {
        let mut contour = contour(105.0, &rectangle([-1.0, 5.0, -1.5, 4.5]));
        change(&mut contour);
        with(&structure_set(vec![("ptv", "PTV", vec![contour])])).unwrap_err()
    };
    let message = bad(&|o| put(o, tags::CONTOUR_DATA, VR::DS, "0\\0\\100\\1\\0\\100\\1\\1\\101\\0\\1\\100"));
    assert!(
        message.contains("rs.dcm") && message.contains("(3006,0050)") && message.contains("one plane"),
        "{message}"
    );
    assert!(bad(&|o| put(o, tags::CONTOUR_DATA, VR::DS, "0\\0\\100\\1\\0")).contains("three numbers"));
    assert!(bad(&|o| put(o, tags::NUMBER_OF_CONTOUR_POINTS, VR::IS, "5")).contains("the contour is cut off"));
    assert!(bad(&|o| put(o, tags::CONTOUR_GEOMETRIC_TYPE, VR::CS, "SOLID")).contains("(3006,0042)"));
    let message = bad(&|o| put(o, tags::CONTOUR_DATA, VR::DS, PrimitiveValue::Empty));
    assert!(message.contains(r#"contour 1 of "ptv": (3006,0050) ContourData is missing"#), "{message}");
    let none = with(&structure_set(vec![("heart", "ORGAN", Vec::new())])).unwrap_err();
    assert!(none.contains("no structure is a target"), "{none}");
    for tag in [tags::STRUCTURE_SET_ROI_SEQUENCE, tags::ROI_CONTOUR_SEQUENCE, tags::SOP_INSTANCE_UID] {
        let mut set = small_structures();
        set.take(tag);
        let message = with(&set).unwrap_err();
        assert!(
            message.contains("rs.dcm")
                && message.contains(&format!("{tag} "))
                && message.contains("is missing"),
            "{message}"
        );
    }
    let folder = folder();
    std::fs::write(folder.path().join("rs2.dcm"), file(&small_structures())).unwrap();
    assert!(import(folder.path()).unwrap_err().contains("leave one here"));
    std::fs::remove_file(folder.path().join("rs.dcm")).unwrap();
    std::fs::remove_file(folder.path().join("rs2.dcm")).unwrap();
    assert!(import(folder.path()).unwrap_err().contains("no RTSTRUCT is here"));
}

#[test]
fn what_holds_no_volume_is_left_out_and_told() {
    let mut line = contour(105.0, &[[0.0, 0.0]]);
    put(&mut line, tags::CONTOUR_GEOMETRIC_TYPE, VR::CS, "POINT");
    let ptv = vec![contour(105.0, &rectangle([-1.0, 5.0, -1.5, 4.5]))];
    let set = structure_set(vec![("iso", "ISOCENTER", vec![line]), ("ptv", "PTV", ptv)]);
    let folder = folder();
    std::fs::write(folder.path().join("rs.dcm"), file(&set)).unwrap();
    let Imported { case, notes, .. } = import(folder.path()).unwrap();
    let names: Vec<_> = case.structures().iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["PTV", "Body"], "the outline is made");
    let notes = notes.join("\n");
    assert!(
        notes.contains(r#""iso": 1 contours are points"#) && notes.contains(r#""iso" holds no voxel"#),
        "{notes}"
    );
}

/// The case with a structure set that is changed.
fn with_set(change: impl FnOnce(&mut dicom_object::InMemDicomObject)) -> Result<Imported, String> {
    let folder = folder();
    let mut set = small_structures();
    change(&mut set);
    std::fs::write(folder.path().join("rs.dcm"), file(&set)).unwrap();
    import(folder.path())
}

fn items(
    object: &mut dicom_object::InMemDicomObject,
    tag: dicom_core::Tag,
) -> Vec<dicom_object::InMemDicomObject> {
    object.get(tag).and_then(|e| e.value().items()).unwrap().to_vec()
}

#[test]
fn two_regions_of_one_number_are_refused_by_their_names() {
    let message = with_set(|set| {
        for (tag, number) in [
            (tags::STRUCTURE_SET_ROI_SEQUENCE, tags::ROI_NUMBER),
            (tags::ROI_CONTOUR_SEQUENCE, tags::REFERENCED_ROI_NUMBER),
            (tags::RTROI_OBSERVATIONS_SEQUENCE, tags::REFERENCED_ROI_NUMBER),
        ] {
            let mut regions = items(set, tag);
            regions.iter_mut().for_each(|region| put(region, number, VR::IS, "2"));
            crate::fixture::sequence(set, tag, regions);
        }
    })
    .unwrap_err();
    assert!(
        message.contains("(3006,0022)") && message.contains("outline") && message.contains("ptv"),
        "{message}"
    );
}

#[test]
fn one_bad_item_is_left_out_and_told_and_stops_nothing() {
    let expected = import(folder().path()).unwrap().case;
    let empty = with_set(|set| {
        let mut regions = items(set, tags::ROI_CONTOUR_SEQUENCE);
        let mut contours = items(&mut regions[1], tags::CONTOUR_SEQUENCE);
        let mut none = contour(105.0, &[]);
        put(&mut none, tags::CONTOUR_DATA, VR::DS, PrimitiveValue::Empty);
        contours.extend([none, contour(105.0, &[[0.0, 0.0]]), contour(105.0, &[[0.0, 0.0], [1.0, 0.0]])]);
        crate::fixture::sequence(&mut regions[1], tags::CONTOUR_SEQUENCE, contours);
        crate::fixture::sequence(set, tags::ROI_CONTOUR_SEQUENCE, regions);
    })
    .unwrap();
    assert_eq!(empty.case, expected);
    assert_eq!(empty.left_out, [r#""ptv": 3 contours have fewer than three points and are left out"#]);
    let orphan = with_set(|set| {
        let mut regions = items(set, tags::ROI_CONTOUR_SEQUENCE);
        let mut stray = regions[1].clone();
        put(&mut stray, tags::REFERENCED_ROI_NUMBER, VR::IS, "77");
        regions.push(stray);
        crate::fixture::sequence(set, tags::ROI_CONTOUR_SEQUENCE, regions);
    })
    .unwrap();
    assert_eq!(orphan.case, expected);
    assert!(orphan.left_out[0].contains("5 contours are of the region number 77"), "{:?}", orphan.left_out);
    let strange = with_set(|set| {
        let mut regions = items(set, tags::STRUCTURE_SET_ROI_SEQUENCE);
        put(&mut regions[0], tags::REFERENCED_FRAME_OF_REFERENCE_UID, VR::UI, "1.2.77");
        crate::fixture::sequence(set, tags::STRUCTURE_SET_ROI_SEQUENCE, regions);
    })
    .unwrap();
    assert!(strange.left_out[0].contains(r#""outline" is drawn in another frame of reference"#));
    let neighbour = folder();
    let copy = std::fs::read(neighbour.path().join(name(1))).unwrap();
    std::fs::write(neighbour.path().join("copy.dcm"), copy).unwrap();
    std::fs::write(neighbour.path().join("._ct1.dcm"), b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X").unwrap();
    let mut directory = dicom_object::InMemDicomObject::new_empty();
    crate::fixture::sequence(&mut directory, tags::DIRECTORY_RECORD_SEQUENCE, Vec::new());
    std::fs::write(neighbour.path().join("DICOMDIR"), file(&directory)).unwrap();
    let Imported { case, notes, left_out } = import(neighbour.path()).unwrap();
    assert_eq!((case, left_out), (expected, Vec::new()));
    let notes = notes.join("\n");
    for message in ["DICOMDIR", "1 files are resource forks", "1 files are copies of others"] {
        assert!(notes.contains(message), "{message}: {notes}");
    }
}

#[test]
fn a_position_that_the_images_do_not_say_can_be_stated_and_one_that_they_say_not_changed() {
    use stillpoint_patient::case::PatientPosition;
    let folder = folder();
    for slice in 0..COUNTS[2] {
        replace(folder.path(), slice, |o| drop(o.take(tags::PATIENT_POSITION)));
    }
    let names = NameTable::shipped().unwrap();
    let stated = |position| import_folder(folder.path(), &Request { position, ..request(&names) });
    assert!(stated(None).unwrap_err().to_string().contains("--position HFS"));
    let prone = Some(PatientPosition::HeadFirstProne);
    assert_eq!(stated(prone).unwrap().case.position(), PatientPosition::HeadFirstProne);
    replace(folder.path(), 2, |_| {});
    assert!(stated(prone).unwrap_err().to_string().contains("states another"));
}

#[test]
fn values_that_are_no_hounsfield_units_are_refused_by_tag() {
    let folder = folder();
    for slice in 0..COUNTS[2] {
        replace(folder.path(), slice, |o| put(o, tags::RESCALE_TYPE, VR::LO, "EDW"));
    }
    let message = import(folder.path()).unwrap_err();
    assert!(message.contains("(0028,1054)") && message.contains("--any-hounsfield"), "{message}");
    for slice in 0..COUNTS[2] {
        replace(folder.path(), slice, |o| put(o, tags::RESCALE_INTERCEPT, VR::DS, "24"));
    }
    let message = import(folder.path()).unwrap_err();
    assert!(message.contains("implausible Hounsfield units"), "{message}");
}

#[test]
fn densities_boluses_and_couches_are_used_or_told() {
    let density = |value: &str| {
        let mut property = dicom_object::InMemDicomObject::new_empty();
        put(&mut property, tags::ROI_PHYSICAL_PROPERTY, VR::CS, "REL_ELEC_DENSITY");
        put(&mut property, tags::ROI_PHYSICAL_PROPERTY_VALUE, VR::DS, value);
        property
    };
    let folder = folder();
    let regions = vec![
        ("outline", "EXTERNAL", crate::fixture::on_every_slice([-9.0, 7.0, -13.5, 13.5])),
        ("ptv", "PTV", crate::fixture::on_every_slice([-1.0, 5.0, -1.5, 4.5])),
        ("bolus", "BOLUS", crate::fixture::on_every_slice([7.0, 9.0, -13.5, 13.5])),
        ("couch", "SUPPORT", crate::fixture::on_every_slice([9.0, 11.0, -13.5, 13.5])),
    ];
    let mut set = structure_set(regions);
    let mut observed = items(&mut set, tags::RTROI_OBSERVATIONS_SEQUENCE);
    crate::fixture::sequence(&mut observed[1], tags::ROI_PHYSICAL_PROPERTIES_SEQUENCE, vec![density("1.5")]);
    crate::fixture::sequence(&mut set, tags::RTROI_OBSERVATIONS_SEQUENCE, observed);
    std::fs::write(folder.path().join("rs.dcm"), file(&set)).unwrap();
    let Imported { case, notes, .. } = import(folder.path()).unwrap();
    let hu: Vec<i16> = case.structure("PTV").unwrap().mask.indices().map(|i| case.hu()[i]).collect();
    assert!(hu.iter().all(|&hu| hu == 933), "density 1.5: {hu:?}");
    let bolus = &case.structure("bolus").unwrap().mask;
    assert!(bolus.indices().all(|i| case.external().unwrap().mask.contains(i) && case.hu()[i] > -300));
    let notes = notes.join("\n");
    for message in ["\"bolus\" is a bolus", "\"couch\" does not count for the dose", "set to 933 HU"] {
        assert!(notes.contains(message), "{message}: {notes}");
    }
}
