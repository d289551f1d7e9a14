//! A small case, and the files that describe it.

use std::io::Write;
use std::path::Path;

use flate2::{Compression, write::GzEncoder};
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, CaseParts, Mask, Prescription, Role, Structure, Uid, Uids};

pub const GRID: Grid =
    Grid { counts: [4, 3, 2], spacing_mm: [3.0, 2.5, 1.1], origin_mm: [-6.0, 0.1, -1e3 / 7.0] };

pub fn parts() -> CaseParts {
    let structure = |name: &str, role, from, to| Structure {
        name: name.to_owned(),
        role,
        mask: Mask::from_fn(GRID.len(), |i| (from..to).contains(&i)),
    };
    let uid = |n| Uid::parse(&format!("1.2.{n}")).unwrap();
    CaseParts {
        name: "small".to_owned(),
        grid: GRID,
        hu: (0..24).map(|i| 100 * i - 1000).collect(),
        structures: vec![
            structure("Body", Role::External, 0, 24),
            structure("PTV", Role::Target, 5, 8),
            structure("PTV boost", Role::Target, 6, 9),
            structure("Rectum", Role::Organ, 0, 0),
        ],
        isocentre_mm: None,
        prescription: vec![Prescription { structure: "PTV".to_owned(), dose_gy: 70.2 }],
        fractions: Some(39),
        reference_dose_gy: Some((0..24).map(|i| i as f32 / 3.0).collect()),
        uids: Some(Uids { study: uid(1), series: uid(2), frame_of_reference: uid(3), structure_set: uid(4) }),
        provenance: "made for a test".to_owned(),
    }
}

pub fn case() -> Case {
    Case::new(parts()).unwrap()
}

/// The small case as a reader gives it: with its isocentre written down.
pub fn case_as_read() -> Case {
    let isocentre_mm = Some(case().isocentre_mm());
    Case::new(CaseParts { isocentre_mm, ..parts() }).unwrap()
}

/// An NRRD file of these values with this header line changed or added; an empty text takes the line away.
pub fn nrrd(kind: &str, values: &[u16], changed: Option<(&str, &str)>) -> Vec<u8> {
    let mut lines = vec![
        ("type", kind.to_owned()),
        ("dimension", "3".to_owned()),
        ("space", "left-posterior-superior".to_owned()),
        ("sizes", "4 3 2".to_owned()),
        ("space directions", "(3,0,0) (0,2.5,0) (0,0,1.1)".to_owned()),
        ("kinds", "domain domain domain".to_owned()),
        ("endian", "little".to_owned()),
        ("encoding", "gzip".to_owned()),
        ("space origin", format!("(-6,0.1,{})", -1e3 / 7.0)),
    ];
    if let Some((name, text)) = changed {
        lines.retain(|(n, _)| *n != name);
        if !text.is_empty() {
            lines.push((name, text.to_owned()));
        }
    }
    let mut header = "NRRD0005\n# a comment: like this\n".to_owned();
    for (name, text) in lines {
        header += &format!("{name}: {text}\n");
    }
    header += "\n";
    let mut file = header.into_bytes();
    let mut encoder = GzEncoder::new(&mut file, Compression::default());
    encoder.write_all(&values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()).unwrap();
    encoder.finish().unwrap();
    file
}

pub const JSON: &str = r#"{"name": "small", "units": "mm", "axes": "LPS (+x left, +y posterior, +z superior)",
    "shape_xyz": [4, 3, 2], "spacing_mm": [3, 2.5, 1.1], "origin_mm": [-6, 0.1, -142.857142857],
    "ct": "small.ct.nrrd", "labels": "small.labels.nrrd", "dose_centigray": "small.dose.nrrd",
    "structures": [{"name": "BODY", "bit": 0, "type": "EXTERNAL", "voxels": 24},
                   {"name": "PTV", "bit": 3, "type": "TARGET", "voxels": 2, "volume_cm3": 0.1}],
    "prescription_gray": {"PTV": 50}, "fractions": 25, "provenance": "made for a test"}"#;

/// Writes the files of a described case into a folder.
pub fn describe(folder: &Path, json: &str) {
    let ct: Vec<u16> = (0..24).map(|i| (100 * i - 1000_i16) as u16).collect();
    let labels: Vec<u16> = (0..24).map(|i| if i == 5 || i == 6 { 0b1001 } else { 1 }).collect();
    let dose: Vec<u16> = (0..24).map(|i| 7 * i).collect();
    std::fs::write(folder.join("small.json"), json).unwrap();
    std::fs::write(folder.join("small.ct.nrrd"), nrrd("int16", &ct, None)).unwrap();
    std::fs::write(folder.join("small.labels.nrrd"), nrrd("uint16", &labels, None)).unwrap();
    std::fs::write(folder.join("small.dose.nrrd"), nrrd("uint16", &dose, None)).unwrap();
}
