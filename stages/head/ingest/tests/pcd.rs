//! PCD files: what is read, what is refused, and that nothing broken does harm.

#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use stillpoint_ingest::INVALID_POINT;
use stillpoint_ingest::pcd::{PcdError, read, write_ascii, write_binary};

const POINTS: [[f32; 3]; 4] = [[0.1, -0.25, 0.9], INVALID_POINT, [1e-7, 3.0, -2.5], [0.0, 0.0, 1.5]];

fn bits(points: &[[f32; 3]]) -> Vec<[u32; 3]> {
    points.iter().map(|p| p.map(f32::to_bits)).collect()
}

fn file(header: &str, data: &[u8]) -> Vec<u8> {
    [header.as_bytes(), data].concat()
}

/// `label` (u16), then z (f64), y (i16), x (f32), all in another order than usual, with a padding field of three bytes.
const MIXED: &str = "# comment\nVERSION .7\nFIELDS label z y x _\nSIZE 2 8 2 4 1\nTYPE U F I F U\nCOUNT 1 1 1 1 3\n\
     WIDTH 2\nHEIGHT 1\nVIEWPOINT 0.5 0 0 1 0 0 0\nPOINTS 2\n";

fn mixed_columns() -> [Vec<u8>; 5] {
    [
        [7_u16, 8].iter().flat_map(|v| v.to_le_bytes()).collect(),
        [0.75_f64, f64::INFINITY].iter().flat_map(|v| v.to_le_bytes()).collect(),
        [-3_i16, 4].iter().flat_map(|v| v.to_le_bytes()).collect(),
        [1.5_f32, 2.5].iter().flat_map(|v| v.to_le_bytes()).collect(),
        vec![9; 6],
    ]
}

fn mixed_binary() -> Vec<u8> {
    let columns = mixed_columns();
    let records: Vec<u8> = (0..2)
        .flat_map(|i| columns.iter().flat_map(move |c| c[i * c.len() / 2..(i + 1) * c.len() / 2].to_vec()))
        .collect();
    file(&format!("{MIXED}DATA binary\n"), &records)
}

/// Compressed with literal runs only, which is valid LZF.
fn mixed_compressed() -> Vec<u8> {
    let unpacked = mixed_columns().concat();
    let packed: Vec<u8> =
        unpacked.chunks(32).flat_map(|run| [&[run.len() as u8 - 1], run].concat()).collect();
    let sizes = [packed.len() as u32, unpacked.len() as u32].map(u32::to_le_bytes).concat();
    file(&format!("{MIXED}DATA binary_compressed\n"), &[sizes, packed].concat())
}

#[test]
fn ascii_and_binary_give_back_what_was_written() {
    for bytes in [write_ascii(&POINTS, 2).into_bytes(), write_binary(&POINTS, 2)] {
        let cloud = read(&bytes).unwrap();
        assert_eq!((cloud.width, cloud.height), (2, 2));
        assert_eq!(bits(&cloud.points), bits(&POINTS));
    }
}

#[test]
fn fields_of_any_order_size_type_and_count_are_found() {
    for bytes in [mixed_binary(), mixed_compressed()] {
        let cloud = read(&bytes).unwrap();
        assert_eq!(bits(&cloud.points), bits(&[[1.5, -3.0, 0.75], INVALID_POINT]));
        assert_eq!(cloud.viewpoint[0], 0.5);
    }
}

#[test]
fn any_invalid_coordinate_makes_the_one_canonical_nan() {
    let negative_nan = f32::from_bits(0xffc0_1234);
    let cloud = read(&write_binary(&[[1.0, negative_nan, 2.0], [f32::NEG_INFINITY, 0.0, 0.0]], 2)).unwrap();
    assert_eq!(bits(&cloud.points), bits(&[INVALID_POINT; 2]));
}

#[test]
fn short_binary_data_is_refused_with_expected_and_found() {
    let bytes = write_binary(&POINTS, 2);
    let offset = bytes.len() - 48;
    assert_eq!(
        read(&bytes[..bytes.len() - 5]),
        Err(PcdError::DataTooShort { offset, expected: 48, found: 43 })
    );
}

#[test]
fn huge_point_count_is_refused_before_memory_is_taken() {
    for encoding in ["ascii", "binary", "binary_compressed"] {
        let header = format!(
            "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 4000000000\nHEIGHT 1000000\nDATA {encoding}\n1 2 3 4 5 6\n"
        );
        let error = read(header.as_bytes()).unwrap_err();
        assert!(matches!(error, PcdError::DataTooShort { .. } | PcdError::UnpackedSize { .. }), "{error}");
    }
    let overflow =
        format!("FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH {}\nHEIGHT 2\nDATA ascii\n", usize::MAX / 2);
    assert!(matches!(read(overflow.as_bytes()), Err(PcdError::TooLarge { .. })));
}

#[test]
fn header_faults_name_their_line() {
    let of = |text: &str| read(text.as_bytes()).unwrap_err();
    assert_eq!(of("VERSION 0.7\nFEILDS x y z\n"), PcdError::UnknownKey { line: 2, key: "FEILDS".into() });
    assert_eq!(
        of("FIELDS x y z\nSIZE 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n"),
        PcdError::ValueCount { line: 2, key: "SIZE", expected: 3, found: 2 }
    );
    assert_eq!(
        of("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH -1\nHEIGHT 1\nDATA ascii\n"),
        PcdError::BadValue { line: 4, key: "WIDTH", expected: "a whole number", found: "-1".into() }
    );
    assert_eq!(
        of("FIELDS x y x\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n"),
        PcdError::Coordinate { axis: 'x', found: 2 }
    );
    assert_eq!(of("WIDTH 3\n"), PcdError::NoDataLine { lines: 1 });
}

#[test]
fn ascii_fault_names_line_and_column() {
    let header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA ascii\n";
    let of = |rows: &str| read(format!("{header}{rows}").as_bytes()).unwrap_err();
    assert_eq!(
        of("1 2 3\n4 five 6\n"),
        PcdError::NotANumber { line: 8, column: 2, axis: 'y', found: "five".into() }
    );
    assert_eq!(of("1 2 3\n4 5 66\n7 8 9"), PcdError::RecordCount { line: 9, expected: 2, found: 3 });
    assert_eq!(of("1 2 3 4\n4 5 6\n"), PcdError::RecordLength { line: 7, expected: 3, found: 4 });
}

#[test]
fn wrong_unpacked_size_and_damaged_compression_name_their_offset() {
    let good = mixed_compressed();
    let start = good.len() - 8 - 38 - 2;
    let mut wrong_size = good.clone();
    wrong_size[start + 4] += 1;
    assert_eq!(read(&wrong_size), Err(PcdError::UnpackedSize { offset: start + 4, expected: 38, found: 39 }));
    let mut damaged = good;
    damaged[start + 8] = 0xff;
    assert!(
        matches!(read(&damaged), Err(PcdError::Compression { offset, .. }) if offset == start + 8),
        "{:?}",
        read(&damaged)
    );
}

#[derive(Debug, Clone)]
enum Harm {
    Cut(prop::sample::Index),
    Set(prop::sample::Index, u8),
    Flip(prop::sample::Index, u8),
    Remove(prop::sample::Index, usize),
    Insert(prop::sample::Index, Vec<u8>),
}

fn harm() -> impl Strategy<Value = Harm> {
    let at = any::<prop::sample::Index>;
    let words = prop::sample::select(vec![
        "4294967295",
        "18446744073709551615",
        "-1",
        "nan",
        "1e40",
        "\n",
        " ",
        "x",
        "DATA ascii\n",
        "#",
        "COUNT 0 0 0\n",
    ]);
    prop_oneof![
        at().prop_map(Harm::Cut),
        (at(), any::<u8>()).prop_map(|(i, b)| Harm::Set(i, b)),
        (at(), 0..8_u8).prop_map(|(i, b)| Harm::Flip(i, b)),
        (at(), 1..20_usize).prop_map(|(i, n)| Harm::Remove(i, n)),
        (at(), words).prop_map(|(i, w)| Harm::Insert(i, w.as_bytes().to_vec())),
    ]
}

fn harmed(mut bytes: Vec<u8>, harms: &[Harm]) -> Vec<u8> {
    for harm in harms {
        if bytes.is_empty() {
            break;
        }
        let n = bytes.len();
        match harm {
            Harm::Cut(at) => bytes.truncate(at.index(n)),
            Harm::Set(at, b) => bytes[at.index(n)] = *b,
            Harm::Flip(at, bit) => bytes[at.index(n)] ^= 1 << bit,
            Harm::Remove(at, count) => {
                let start = at.index(n);
                bytes.drain(start..n.min(start + count));
            }
            Harm::Insert(at, word) => {
                let start = at.index(n);
                bytes.splice(start..start, word.iter().copied());
            }
        }
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn broken_files_are_refused_or_read_whole(which in 0..4_usize, harms in prop::collection::vec(harm(), 1..5)) {
        let valid = match which {
            0 => write_ascii(&POINTS, 2).into_bytes(),
            1 => write_binary(&POINTS, 4),
            2 => mixed_binary(),
            _ => mixed_compressed(),
        };
        if let Ok(cloud) = read(&harmed(valid, &harms)) {
            prop_assert_eq!(cloud.points.len(), cloud.width * cloud.height);
            for point in cloud.points {
                prop_assert!(point.iter().all(|c| c.is_finite()) || bits(&[point]) == bits(&[INVALID_POINT]));
            }
        }
    }
}
