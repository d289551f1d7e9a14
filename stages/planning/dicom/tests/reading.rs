//! What other programs write: several series, other positions, compressed pixels, names of regions.

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_dicom::{DataSet, Request, Slice, import_folder};
use stillpoint_patient::case::{Case, Imported, NameTable, PatientPosition, Role, Uid};

use crate::compressed;
use crate::fixture::{
    COUNTS, Encoding, SERIES, bare, ct, file, file_as, folder, name, on_every_slice, put, structure_set,
};
use crate::import::request;

fn import(folder: &std::path::Path, series: Option<&str>) -> Result<Imported, String> {
    let names = NameTable::shipped().unwrap();
    let series = series.map(|uid| Uid::parse(uid).unwrap());
    import_folder(folder, &Request { series, ..request(&names) }).map_err(|error| error.to_string())
}

/// Writes a second series, each image changed.
fn add_series(folder: &std::path::Path, change: impl Fn(&mut InMemDicomObject) -> Option<Vec<u8>>) {
    for slice in 0..COUNTS[2] {
        let mut object = ct(slice);
        put(&mut object, tags::SERIES_INSTANCE_UID, VR::UI, "1.2.99");
        let bytes = change(&mut object).unwrap_or_else(|| file(&object));
        std::fs::write(folder.join(format!("other{slice}.dcm")), bytes).unwrap();
    }
}

#[test]
fn an_unwanted_series_does_not_stop_the_wanted_one() {
    let expected = import(folder().path(), None).unwrap().case;
    type Change = fn(&mut InMemDicomObject) -> Option<Vec<u8>>;
    let unwanted: [Change; 5] = [
        |o| {
            put(o, tags::PATIENT_POSITION, VR::CS, "FFDL");
            None
        },
        |o| {
            put(o, tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\0\\0\\-1");
            None
        },
        |o| {
            compressed::put_piece(o, &[0xFF, 0x4F, 0xFF, 0x51]);
            Some(crate::fixture::file_as(o, "1.2.840.10008.1.2.4.90"))
        },
        |o| {
            put(o, tags::SOP_CLASS_UID, VR::UI, "1.2.840.10008.5.1.4.1.1.2.1");
            None
        },
        |o| {
            o.take(tags::PIXEL_DATA);
            None
        },
    ];
    for change in unwanted {
        let folder = folder();
        add_series(folder.path(), change);
        assert_eq!(import(folder.path(), Some(SERIES)).unwrap().case, expected);
        assert_eq!(import(folder.path(), None).unwrap().case, expected, "the structure set names it");
    }
}

#[test]
fn compressed_images_are_those_that_were_compressed() {
    for (syntax, piece) in compressed::pieces() {
        let data = DataSet::read(&compressed::image(1, syntax, &piece)).unwrap();
        let slice = Slice::read(&data).unwrap();
        let expected: Vec<i16> = compressed::words().map(|word| word as i16 - 1024).collect();
        assert_eq!(slice.hu.len(), expected.len());
        for (found, due) in slice.hu.iter().zip(&expected) {
            assert_eq!(found, due, "{syntax}");
        }
        let message = DataSet::read(&compressed::image(1, syntax, &piece[..piece.len() / 2]));
        let message = Slice::read(&message.unwrap()).unwrap_err().to_string();
        assert!(message.contains("(7FE0,0010)") && message.contains("export"), "{syntax}: {message}");
    }
    let jpeg_ls = compressed::image(1, "1.2.840.10008.1.2.4.80", &[0; 8]);
    let message = Slice::read(&DataSet::read(&jpeg_ls).unwrap()).unwrap_err().to_string();
    assert!(message.contains("RLE, JPEG lossless and JPEG 2000 lossless are read"), "{message}");
}

#[test]
fn signed_words_in_jpeg_2000_keep_their_sign() {
    let mut object = ct(1);
    put(&mut object, tags::RESCALE_SLOPE, VR::DS, "1");
    put(&mut object, tags::RESCALE_INTERCEPT, VR::DS, "0");
    put(&mut object, tags::PIXEL_REPRESENTATION, VR::US, 1_u16);
    compressed::put_piece(&mut object, &compressed::signed_piece());
    let bytes = file_as(&object, "1.2.840.10008.1.2.4.90");
    let slice = Slice::read(&DataSet::read(&bytes).unwrap()).unwrap();
    let due: Vec<i16> = compressed::words().map(|word| word as i16 - 2048).collect();
    assert_eq!(slice.hu, due);
}

/// The folder of a patient in another position: the scanner turns the image with the patient.
fn lying(position: &str, [along_x, along_y]: [f64; 2]) -> Case {
    let folder = folder();
    for slice in 0..COUNTS[2] {
        let mut object = ct(slice);
        put(&mut object, tags::PATIENT_POSITION, VR::CS, position);
        put(
            &mut object,
            tags::IMAGE_ORIENTATION_PATIENT,
            VR::DS,
            format!("{along_x}\\0\\0\\0\\{along_y}\\0"),
        );
        let x = if along_x > 0.0 { -10.0 } else { -10.0 + 2.0 * (COUNTS[0] - 1) as f64 };
        let y = if along_y > 0.0 { -12.0 } else { -12.0 + 3.0 * (COUNTS[1] - 1) as f64 };
        let place = format!("{x}\\{y}\\{}", 100.0 + 2.5 * slice as f64);
        put(&mut object, tags::IMAGE_POSITION_PATIENT, VR::DS, place);
        let pixel = |i: usize| {
            let [mut column, mut row] = [i % COUNTS[0], i / COUNTS[0]];
            column = if along_x > 0.0 { column } else { COUNTS[0] - 1 - column };
            row = if along_y > 0.0 { row } else { COUNTS[1] - 1 - row };
            (column + COUNTS[0] * row) as u16
        };
        let pixels: Vec<u16> = (0..COUNTS[0] * COUNTS[1]).map(pixel).collect();
        put(&mut object, tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(pixels.into()));
        std::fs::write(folder.path().join(name(slice)), file(&object)).unwrap();
    }
    import(folder.path(), None).unwrap().case
}

#[test]
fn a_patient_in_another_position_is_the_same_patient() {
    let expected = import(folder().path(), None).unwrap().case;
    for position in PatientPosition::ALL {
        for along in [[1.0, 1.0], [-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0]] {
            let case = lying(position.term(), along);
            assert_eq!(case.position(), position);
            assert_eq!(case, expected.clone().lying(position), "{position}, {along:?}");
            let bytes = stillpoint_patient::case::to_bytes(&case).unwrap().0;
            assert_eq!(stillpoint_patient::case::from_bytes(&bytes).unwrap().position(), position);
        }
    }
}

/// The names that regions of these names get, and what is said.
fn names(written: &[&str]) -> (Vec<String>, Vec<String>) {
    let region = |name: &&'static str| (*name, "ORGAN", on_every_slice([-1.0, 5.0, -1.5, 4.5]));
    let leaked: Vec<&'static str> =
        written.iter().map(|name| &*Box::leak((*name).to_owned().into_boxed_str())).collect();
    let mut regions: Vec<_> = leaked.iter().map(region).collect();
    regions.push(("PTV", "PTV", on_every_slice([-1.0, 5.0, -1.5, 4.5])));
    of_set(&file(&structure_set(regions)))
}

fn of_set(bytes: &[u8]) -> (Vec<String>, Vec<String>) {
    let folder = folder();
    std::fs::write(folder.path().join("rs.dcm"), bytes).unwrap();
    let Imported { case, notes, .. } = import(folder.path(), None).unwrap();
    // The outline is made where none is drawn.
    let drawn = case.structures().iter().filter(|s| s.role != Role::External);
    (drawn.map(|s| s.name.clone()).collect(), notes)
}

#[test]
fn any_name_of_a_region_is_taken() {
    let chinese = "\u{8111}\u{5e72}".repeat(12);
    let (found, notes) = names(&["Z/L+R", &chinese, "Znode", "Znode", "\u{1b}Zx"]);
    assert_eq!(found, ["Z/L+R", &chinese, "Znode", "Znode (2)", "\u{fffd}Zx", "PTV"]);
    let notes = notes.join("\n");
    assert!(notes.contains(r#"region "Znode" is called "Znode (2)""#), "{notes}");
    assert!(notes.contains(r#"region "\u{1b}Zx" is called"#), "{notes}");
}

/// A structure set whose name of a region is these bytes.
fn named(set: &str, name: &[u8]) -> Vec<u8> {
    let mark = "Q".repeat(name.len());
    let regions = vec![
        (mark.as_str(), "ORGAN", on_every_slice([-1.0, 5.0, -1.5, 4.5])),
        ("PTV", "PTV", on_every_slice([-1.0, 5.0, -1.5, 4.5])),
    ];
    let mut object = structure_set(regions);
    put(&mut object, tags::PATIENT_NAME, VR::PN, "X");
    let mut values: dicom_core::value::C<String> = set.split('\\').map(str::to_owned).collect();
    // The writer would refuse a character set that it does not know, so a text of that length is written over.
    let length = values.join("\\").len();
    values = [String::from("A").repeat(length)].into_iter().collect();
    put(&mut object, tags::SPECIFIC_CHARACTER_SET, VR::CS, PrimitiveValue::Strs(values));
    let mut bytes = bare(&object, Encoding::Explicit);
    for (from, to) in [("A".repeat(length).into_bytes(), set.as_bytes()), (mark.clone().into_bytes(), name)] {
        let at = bytes.windows(from.len()).position(|window| window == from).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to);
    }
    bytes
}

#[test]
fn names_in_every_character_set_are_read() {
    for (set, bytes, expected) in [
        ("ISO_IR 100", &b"Z\xfc"[..], "Z\u{fc}"),
        ("ISO_IR 101", b"Z\xb1", "Z\u{105}"),
        ("ISO_IR 144", b"Z\xbf", "Z\u{41f}"),
        ("ISO_IR 126", b"Z\xe1", "Z\u{3b1}"),
        ("ISO_IR 166", b"Z\xa1", "Z\u{e01}"),
        ("ISO_IR 13", b"Z\xb1", "Z\u{ff71}"),
        ("ISO_IR 192", b"Z\xe8\x84\x91", "Z\u{8111}"),
        ("GB18030", b"Z\xc4\xd4", "Z\u{8111}"),
        // Of some characters the second byte is that of a backslash.
        ("GBK", b"Z\x81\x5c", "Z\u{4e57}"),
        ("\\ISO 2022 IR 87", b"Z\x1b$B;3ED\x1b(B", "Z\u{5c71}\u{7530}"),
        ("ISO 2022 IR 13\\ISO 2022 IR 87", b"\xd4\xcf\x1b$B;3\x1b(J", "\u{ff94}\u{ff8f}\u{5c71}"),
        ("\\ISO 2022 IR 87", b"Z\x1b$B\x30\x5c\x1b(B", "Z\u{79fb}"),
        ("\\ISO 2022 IR 149", b"Z\x1b$)C\xb1\xe8", "Z\u{ae40}"),
        ("\\ISO 2022 IR 58", b"Z\x1b$)A\xcd\xf5", "Z\u{738b}"),
        ("ISO 2022 IR 6\\ISO 2022 IR 100", b"Z\x1b-A\xfc", "Z\u{fc}"),
    ] {
        // Values have an even length.
        let even = |mut text: Vec<u8>| {
            if text.len() % 2 == 1 {
                text.push(b' ');
            }
            text
        };
        let set_text = String::from_utf8(even(set.into())).unwrap();
        let (found, _) = of_set(&named(&set_text, &even(bytes.to_vec())));
        assert_eq!(found, [expected, "PTV"], "{set}");
    }
}
