//! Broken files: read whole or refused, never a panic, and never more memory than a file can justify.
//!
//! A program of its own, so that the limit on its memory is its own: a request beyond it ends the program.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::Write;
use std::sync::LazyLock;

use cap::Cap;
use flate2::{Compression, write::ZlibEncoder};
use proptest::prelude::*;
use proptest::sample::Index;
use sha2::{Digest, Sha256};
use stillpoint_patient::case::{Case, NameTable, Values, from_bytes, import_described, read_nrrd, to_bytes};
use stillpoint_plan::objectives::ObjectiveTable;

#[path = "../../../shared/patient/tests/case/small.rs"]
#[allow(dead_code)]
mod small;

/// The inputs are at most 2 kB; deflate makes at most 1032 times that of them, and the tests run side by side.
#[global_allocator]
static LIMIT: Cap<std::alloc::System> = Cap::new(std::alloc::System, 64 << 20);

#[derive(Clone, Debug)]
enum Harm {
    Cut(Index),
    Set(Index, u8),
    Flip(Index, u8),
    Remove(Index, usize),
    Insert(Index, &'static str),
    /// Exchanges a number in the text for another.
    Number(Index, &'static str),
}

fn harm() -> impl Strategy<Value = Harm> {
    let at = any::<Index>;
    let words = prop::sample::select(vec![
        "0",
        "-1",
        "4294967295",
        "18446744073709551615",
        "99999",
        "1e308",
        "1e-308",
        "nan",
        "null",
        "[]",
        "\n",
        "\n\n",
        " ",
        "(",
        ")",
        "\"",
        "}",
        "\u{e9}",
    ]);
    prop_oneof![
        1 => at().prop_map(Harm::Cut),
        2 => (at(), any::<u8>()).prop_map(|(i, b)| Harm::Set(i, b)),
        2 => (at(), 0..8_u8).prop_map(|(i, b)| Harm::Flip(i, b)),
        1 => (at(), 1..20_usize).prop_map(|(i, n)| Harm::Remove(i, n)),
        2 => (at(), words.clone()).prop_map(|(i, w)| Harm::Insert(i, w)),
        4 => (at(), words).prop_map(|(i, w)| Harm::Number(i, w)),
    ]
}

fn harmed(mut bytes: Vec<u8>, harms: &[Harm]) -> Vec<u8> {
    for harm in harms {
        let n = bytes.len();
        if n == 0 {
            break;
        }
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
                bytes.splice(start..start, word.bytes());
            }
            Harm::Number(at, word) => {
                let digit = |i: &usize| bytes[*i].is_ascii_digit();
                let starts: Vec<usize> =
                    (0..n).filter(|i| digit(i) && (*i == 0 || !digit(&(i - 1)))).collect();
                if !starts.is_empty() {
                    let start = starts[at.index(starts.len())];
                    let end = (start..n).find(|i| !digit(i)).unwrap_or(n);
                    bytes.splice(start..end, word.bytes());
                }
            }
        }
    }
    bytes
}

/// Where the header of a case file ends.
fn header_end(bytes: &[u8]) -> usize {
    44 + u32::from_le_bytes(bytes[40..44].try_into().unwrap()) as usize
}

static FILE: LazyLock<Vec<u8>> = LazyLock::new(|| to_bytes(&small::case()).unwrap().0);

static NRRD: LazyLock<Vec<u8>> = LazyLock::new(|| small::nrrd("int16", &(0..24).collect::<Vec<_>>(), None));

/// The blocks of the small case, as they are and packed, made from the description of the format alone.
static BLOCKS: LazyLock<(Vec<u8>, Vec<u8>)> = LazyLock::new(|| {
    let case = small::case();
    let mut blocks = vec![case.hu().iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()];
    for structure in case.structures() {
        let byte =
            |b: usize| (0..8).fold(0_u8, |byte, i| byte | u8::from(structure.mask.contains(8 * b + i)) << i);
        blocks.push((0..3).map(byte).collect());
    }
    blocks.push(case.reference_dose_gy().unwrap().iter().flat_map(|v| v.to_le_bytes()).collect());
    let mut packed = Vec::new();
    for block in &blocks {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(block).unwrap();
        let bytes = encoder.finish().unwrap();
        packed.extend((bytes.len() as u64).to_le_bytes());
        packed.extend(bytes);
    }
    (blocks.concat(), packed)
});

/// A case file with this header over the blocks of the small case, with the hash that fits it.
fn sealed(header: &[u8]) -> Vec<u8> {
    let (raw, packed) = &*BLOCKS;
    let length = (header.len() as u32).to_le_bytes();
    let hash = Sha256::new_with_prefix(length).chain_update(header).chain_update(raw).finalize();
    [b"SPCASE01", &hash[..], &length, header, packed].concat()
}

#[test]
fn a_case_file_made_by_the_description_alone_is_the_one_that_is_written() {
    assert_eq!(sealed(&FILE[44..header_end(&FILE)]), *FILE);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn broken_case_files_are_refused(harms in prop::collection::vec(harm(), 1..4)) {
        if let Ok(case) = from_bytes(&harmed(FILE.clone(), &harms)) {
            prop_assert_eq!(case, small::case_as_read());
        }
    }

    #[test]
    fn headers_that_lie_under_a_right_hash_are_refused_or_make_a_whole_case(
        harms in prop::collection::vec(harm(), 1..4),
    ) {
        let header = harmed(FILE[44..header_end(&FILE)].to_vec(), &harms);
        if let Ok(case) = from_bytes(&sealed(&header)) {
            prop_assert_eq!(case.hu().len(), case.grid().len());
            prop_assert!(case.structures().iter().all(|s| s.mask.len() == case.grid().len()));
            prop_assert!(case.isocentre_mm().iter().all(|c| c.is_finite()));
        }
    }

    #[test]
    fn broken_nrrd_files_are_refused_or_read_whole(harms in prop::collection::vec(harm(), 1..4)) {
        if let Ok(volume) = read_nrrd(&harmed(NRRD.clone(), &harms)) {
            let len = match &volume.values {
                Values::U8(v) => v.len(),
                Values::I16(v) => v.len(),
                Values::U16(v) => v.len(),
                Values::U32(v) => v.len(),
                Values::F64(v) => v.len(),
            };
            prop_assert_eq!(len, volume.grid.len());
            prop_assert!(volume.grid.spacing_mm.iter().all(|s| *s > 0.0));
        }
    }

    #[test]
    fn broken_names_tables_are_refused_or_matched(harms in prop::collection::vec(harm(), 1..4)) {
        let own = r#"{"structures": [{"name": "Bladder", "role": "organ", "match": ["bladder*", "*a*b*"]}]}"#;
        let text = harmed(own.as_bytes().to_vec(), &harms);
        if let Ok(table) = NameTable::parse(&String::from_utf8_lossy(&text)) {
            table.find("Bladder_wall");
        }
    }

    #[test]
    fn broken_objectives_are_refused_or_make_goals(harms in prop::collection::vec(harm(), 1..4)) {
        let own = r#"{"objectives": [
            {"match": ["PTV"], "wanted": [{"underdose": {"dose": "100 %", "weight": 9}}, {"homogeneity": {"weight": 1}}]},
            {"match": ["*"], "wanted": [{"dvh_at_most": {"dose": "20 Gy", "volume": "30 %", "weight": 2}}]}
        ]}"#;
        let text = harmed(own.as_bytes().to_vec(), &harms);
        if let Ok(table) = ObjectiveTable::parse(&String::from_utf8_lossy(&text))
            && let Ok(objective_set) = table.for_case(&CASE, CASE.grid())
            && let Ok(goals) = objective_set.goals(2)
        {
            prop_assert_eq!(goals.rows(), 2 * CASE.grid().len());
            prop_assert!(goals.problem(&[]).is_ok() || objective_set.structures.iter().any(|w| !w.objectives.is_empty()));
        }
    }
}

static CASE: LazyLock<Case> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    small::describe(folder.path(), small::JSON);
    import_described(&folder.path().join("small.json"), &NameTable::shipped().unwrap()).unwrap().case
});

#[test]
fn broken_descriptions_are_refused_or_make_a_whole_case() {
    let folder = tempfile::tempdir().unwrap();
    small::describe(folder.path(), small::JSON);
    let (json, names) = (folder.path().join("small.json"), NameTable::shipped().unwrap());
    let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::default() };
    proptest!(config, |(harms in prop::collection::vec(harm(), 1..4))| {
        std::fs::write(&json, harmed(small::JSON.as_bytes().to_vec(), &harms)).unwrap();
        if let Ok(imported) = import_described(&json, &names) {
            prop_assert_eq!(imported.case.hu().len(), imported.case.grid().len());
        }
    });
}
