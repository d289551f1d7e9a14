//! NRRD volumes with JSON: what is read, and what is refused with the file and what to do.

use stillpoint_patient::case::{Imported, NameTable, Role, Values, import_described, read_nrrd};

use super::small::{GRID, JSON, describe, nrrd};

fn import(json: &str, harm: impl FnOnce(&std::path::Path)) -> Result<Imported, String> {
    let folder = tempfile::tempdir().unwrap();
    describe(folder.path(), json);
    harm(folder.path());
    import_described(&folder.path().join("small.json"), &NameTable::shipped().unwrap())
        .map_err(|e| e.to_string())
}

fn refusal(from: &str, to: &str) -> String {
    assert!(JSON.contains(from), "{from}");
    import(&JSON.replace(from, to), |_| {}).unwrap_err()
}

#[test]
fn a_described_case_is_read() {
    let Imported { case, notes, .. } = import(JSON, |_| {}).unwrap();
    assert_eq!(case.hu()[..3], [-1000, -900, -800]);
    let ptv = case.structure("PTV").unwrap();
    assert_eq!((ptv.role, ptv.mask.indices().collect::<Vec<_>>()), (Role::Target, vec![5, 6]));
    assert_eq!(case.external().unwrap().name, "Body");
    assert_eq!(notes, [r#""BODY" is called "Body""#]);
    assert_eq!((case.prescription()[0].dose_gy, case.fractions()), (50.0, Some(25)));
    assert_eq!(case.reference_dose_gy().unwrap()[3], 0.21);
    assert!((case.isocentre_mm()[0] - (-6.0 + 3.0 * 1.5)).abs() < 1e-12);
}

#[test]
fn a_description_at_odds_is_refused_with_the_file() {
    for (from, to, expected) in [
        ("\"mm\"", "\"cm\"", "`mm` and `LPS` are required"),
        ("LPS", "RAS", "`mm` and `LPS` are required"),
        ("[4, 3, 2]", "[4, 3, 1]", "2 or more along each axis"),
        ("[3, 2.5, 1.1]", "[3, 2.5, 1.2]", "small.ct.nrrd: it has"),
        ("[-6, 0.1,", "[-6, 0.2,", "small.ct.nrrd: it has"),
        ("small.ct.nrrd", "small.labels.nrrd", "is unsigned, but a CT is int16"),
        ("small.labels.nrrd", "small.ct.nrrd", "is signed, but labels are uint8"),
        ("small.ct.nrrd", "../small.ct.nrrd", "not a plain file name"),
        ("small.ct.nrrd", "small.other.nrrd", "small.other.nrrd: "),
        ("\"bit\": 3", "\"bit\": 16", "labels have 16"),
        ("\"bit\": 3", "\"bit\": 0", "two structures are bit 0"),
        ("\"bit\": 3", "\"bit\": 2", "0 voxels in the labels, but the JSON says 2"),
        ("TARGET\", \"voxels\": 2", "TARGETS\"", "type \"TARGETS\""),
        ("{\"PTV\": 50}", "{\"PTW\": 50}", "no structure has that name"),
        ("{\"PTV\": 50}", "{\"PTV\": 5000}", "at most 200 Gy"),
        ("\"fractions\": 25", "\"fractions\": \"x\"", "does not describe a case"),
    ] {
        let stated = refusal(from, to);
        assert!(stated.contains(expected), "{stated}");
        assert!(stated.contains("small."), "names the file: {stated}");
    }
    let unnamed = r#",
                   {"name": "PTV", "bit": 3, "type": "TARGET", "voxels": 2, "volume_cm3": 0.1}"#;
    assert!(refusal(unnamed, "").contains("bit 3, which no structure names"));
}

#[test]
fn a_truncated_volume_is_refused_with_the_file_and_what_to_do() {
    for name in ["small.ct.nrrd", "small.labels.nrrd", "small.dose.nrrd"] {
        for part in [0.2, 0.97] {
            let stated = import(JSON, |folder| {
                let bytes = std::fs::read(folder.join(name)).unwrap();
                std::fs::write(folder.join(name), &bytes[..(bytes.len() as f64 * part) as usize]).unwrap();
            });
            let stated = stated.unwrap_err();
            assert!(stated.contains(name) && stated.contains("again"), "{stated}");
        }
    }
}

#[test]
fn an_nrrd_that_a_plan_cannot_stand_on_is_refused_by_its_field() {
    let read = |field, text| read_nrrd(&nrrd("int16", &[7; 24], Some((field, text))));
    for (field, text, expected) in [
        ("type", "int64", "int16"),
        ("dimension", "4", "3 axes"),
        ("space", "scanner-xyz", "are required in this order"),
        ("space", "", "no `space`"),
        ("sizes", "4 3", "three whole numbers"),
        ("sizes", "4 3 2 1", "three whole numbers"),
        ("sizes", "4 3 -2", "three whole numbers"),
        ("sizes", "40000000 30000000 2", "4294967295 voxels"),
        ("sizes", "4000 3000 20", "end early"),
        ("sizes", "4 3 1", "go on beyond"),
        ("space directions", "(3,0.1,0) (0,2.5,0) (0,0,1.1)", "not oblique"),
        ("space directions", "(0,3,0) (2.5,0,0) (0,0,1.1)", "in this order"),
        ("space directions", "(3,0,0) (0,2.5,0) (0,0,0)", "spacing 0 mm"),
        ("space directions", "(3,0,0) (0,nan,0) (0,0,1.1)", "three vectors"),
        ("space origin", "(0,0)", "one vector"),
        ("endian", "middle", "`little` or `big`"),
        ("encoding", "bzip2", "`gzip` or `raw`"),
        ("data file", "other.raw", "in one file"),
    ] {
        let stated = read(field, text).unwrap_err().to_string();
        assert!(stated.contains(expected), "{field}: {text}: {stated}");
    }
    assert!(read_nrrd(b"PNG").unwrap_err().to_string().contains("not an NRRD file"));
    assert!(read_nrrd(b"NRRD0005\ntype: int16\n").unwrap_err().to_string().contains("empty line"));
}

#[test]
fn either_byte_order_and_raw_data_are_read() {
    let volume = read_nrrd(&nrrd("int16", &[0x0102; 24], Some(("endian", "big")))).unwrap();
    assert_eq!((volume.grid, volume.values), (GRID, Values::I16(vec![0x0201; 24])));
    let packed = nrrd("uint16", &[], Some(("encoding", "raw")));
    let header = packed.windows(2).position(|w| w == b"\n\n").unwrap() + 2;
    let mut raw = packed[..header].to_vec();
    raw.extend([1, 0].repeat(24));
    assert_eq!(read_nrrd(&raw).unwrap().values, Values::U16(vec![1; 24]));
}

/// What a voxel of the patient holds is the same however the file runs along the patient.
#[test]
fn a_volume_in_any_space_and_direction_holds_the_same_at_each_place() {
    let plain = read_nrrd(&nrrd("int16", &small_values(), None)).unwrap();
    let Values::I16(values) = &plain.values else { panic!() };
    for signs in (0..8).map(|bits| [0, 1, 2].map(|axis| bits >> axis & 1 == 1)) {
        for flips in (0..8).map(|bits| [0, 1, 2].map(|axis| bits >> axis & 1 == 1)) {
            let space: String = signs
                .iter()
                .zip([['L', 'R'], ['P', 'A'], ['S', 'I']])
                .map(|(&s, l)| l[usize::from(s)])
                .collect();
            let sign = |axis: usize| if signs[axis] { -1.0 } else { 1.0 };
            let direction = |axis: usize| {
                let along = if signs[axis] != flips[axis] { -1.0 } else { 1.0 } * GRID.spacing_mm[axis];
                let mut vector = [0.0; 3];
                vector[axis] = along;
                format!("({},{},{})", vector[0], vector[1], vector[2])
            };
            let first = |axis: usize| {
                let last = (GRID.counts[axis] - 1) as f64 * GRID.spacing_mm[axis];
                sign(axis) * (GRID.origin_mm[axis] + if flips[axis] { last } else { 0.0 })
            };
            let written: Vec<u16> = (0..GRID.len())
                .map(|index| {
                    let voxel = GRID.voxel(index);
                    let at = |a: usize| if flips[a] { GRID.counts[a] - 1 - voxel[a] } else { voxel[a] };
                    values[GRID.index(std::array::from_fn(at))] as u16
                })
                .collect();
            let bytes = nrrd("int16", &written, None);
            let end = bytes.windows(2).position(|w| w == b"\n\n").unwrap();
            let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
            let turned: Vec<String> = header
                .lines()
                .map(|line| match line.split(": ").next().unwrap() {
                    "space" => format!("space: {space}"),
                    "space directions" => {
                        format!("space directions: {} {} {}", direction(0), direction(1), direction(2))
                    }
                    "space origin" => format!("space origin: ({},{},{})", first(0), first(1), first(2)),
                    _ => line.to_owned(),
                })
                .collect();
            let mut file = turned.join("\n").into_bytes();
            file.extend(&bytes[end..]);
            let volume = read_nrrd(&file).unwrap();
            assert_eq!(volume.values, plain.values, "{space} {flips:?}");
            let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
            assert!(near(volume.grid.origin_mm, GRID.origin_mm), "{space} {flips:?}: {:?}", volume.grid);
        }
    }
}

fn small_values() -> Vec<u16> {
    (0..GRID.len()).map(|i| (7 * i) as u16).collect()
}

#[test]
fn keys_that_nothing_reads_are_left_out_and_told() {
    let misspelt = JSON.replace("\"fractions\"", "\"fraction\"");
    let left_out = import(&misspelt, |_| {}).unwrap().left_out;
    assert_eq!(left_out, [r#"the key "fraction" of the JSON is not read"#]);
}
