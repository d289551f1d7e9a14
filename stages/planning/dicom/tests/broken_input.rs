//! Broken files: read whole or refused, never a panic, and never more memory than a file can justify.
//!
//! A program of its own, so that the limit on its memory is its own: a request beyond it ends the program.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::PathBuf;
use std::sync::LazyLock;

use cap::Cap;
use proptest::prelude::*;
use proptest::sample::Index;
use stillpoint_dicom::{
    Beam, CaseIdentity, DataSet, Export, GivenDose, LeafSegment, Machine, Plan, PlannedDose, Rois, Slice,
    TreatmentPlan, dose_file, plan_file, rasterise, volume,
};
use stillpoint_patient::Grid;
use stillpoint_patient::case::{PatientPosition, Uid, Uids};

#[allow(dead_code)]
mod compressed;
#[allow(dead_code)]
mod fixture;

use fixture::{Encoding, FRAME, bare, ct, file, small_structures};

/// The inputs are at most 10 kB, and the tests run side by side.
#[global_allocator]
static LIMIT: Cap<std::alloc::System> = Cap::new(std::alloc::System, 64 << 20);

#[derive(Clone, Debug)]
enum Harm {
    Cut(Index),
    Set(Index, u8),
    Flip(Index, u8),
    /// Four bytes, as a length would be.
    Length(Index, u32),
    Remove(Index, usize),
    /// Writes a piece of the file again elsewhere: elements in elements.
    Repeat(Index, Index, usize),
    Number(Index, &'static str),
}

fn harm() -> impl Strategy<Value = Harm> {
    let at = any::<Index>;
    let lengths = prop::sample::select(vec![0, 1, 7, 0xFFFF, 0x7FFF_FFFF, 0xFFFF_FFFE, 0xFFFF_FFFF]);
    let words = prop::sample::select(vec![
        "0",
        "-1",
        "99999",
        "4294967296",
        "1e308",
        "1e-308",
        "nan",
        "inf",
        "x",
        "\\",
        "",
    ]);
    prop_oneof![
        at().prop_map(Harm::Cut),
        (at(), any::<u8>()).prop_map(|(i, b)| Harm::Set(i, b)),
        (at(), 0..8_u8).prop_map(|(i, b)| Harm::Flip(i, b)),
        (at(), lengths).prop_map(|(i, l)| Harm::Length(i, l)),
        (at(), 1..60_usize).prop_map(|(i, n)| Harm::Remove(i, n)),
        (at(), at(), 1..400_usize).prop_map(|(i, j, n)| Harm::Repeat(i, j, n)),
        (at(), words).prop_map(|(i, w)| Harm::Number(i, w)),
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
            Harm::Length(at, length) => {
                let start = at.index(n);
                let end = n.min(start + 4);
                bytes[start..end].copy_from_slice(&length.to_le_bytes()[..end - start]);
            }
            Harm::Remove(at, count) => {
                let start = at.index(n);
                bytes.drain(start..n.min(start + count));
            }
            Harm::Repeat(from, to, count) => {
                let start = from.index(n);
                let piece = bytes[start..n.min(start + count)].to_vec();
                let to = to.index(n);
                bytes.splice(to..to, piece);
            }
            Harm::Number(at, word) => {
                let digit = |i: &usize| bytes[*i].is_ascii_digit();
                let starts: Vec<usize> =
                    (0..n).filter(|i| digit(i) && (*i == 0 || !digit(&(i - 1)))).collect();
                if !starts.is_empty() {
                    let start = starts[at.index(starts.len())];
                    let end = (start..n).find(|i| !digit(i)).unwrap_or(n);
                    // Of the same length, so that the element stays whole.
                    let text: Vec<u8> =
                        word.bytes().chain(std::iter::repeat(b' ')).take(end - start).collect();
                    bytes[start..end].copy_from_slice(&text);
                }
            }
        }
    }
    bytes
}

static IMAGES: LazyLock<[Vec<u8>; 3]> =
    LazyLock::new(|| [file(&ct(1)), bare(&ct(1), Encoding::Explicit), bare(&ct(1), Encoding::Implicit)]);
static SETS: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| {
    let set = small_structures();
    [file(&set), bare(&set, Encoding::Explicit), bare(&set, Encoding::Implicit)]
});

/// A plan of one beam in two segments, and its dose.
static TREATMENT: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| {
    let uid = |n| Uid::parse(&format!("1.2.3.{n}")).unwrap();
    let uids = Uids { study: uid(1), series: uid(2), frame_of_reference: uid(3), structure_set: uid(4) };
    let identity = CaseIdentity::none();
    let export = Export { uids: &uids, identity: &identity };
    let segment = |tip| LeafSegment {
        tips_mm: vec![[-35.0, tip], [-5.5, 40.0]],
        field_mm: [[-35.0, 40.0], [-10.0, 10.0]],
        monitor_units: 12.5,
    };
    let beam = Beam {
        name: "one".to_owned(),
        gantry_deg: 72.0,
        couch_deg: 0.0,
        isocentre_mm: [-2.0, 4.0, 5.5],
        weight: 1.0,
        field_mm: [[-35.0, 40.0], [-10.0, 10.0]],
        segments: vec![segment(-20.0), segment(10.0)],
        arc: None,
    };
    let plan = Plan {
        label: "one",
        machine: Machine { name: "generic", energy_mv: 6.0, source_axis_mm: 1000.0 },
        prescription: &[],
        fractions: 30,
        position: PatientPosition::HeadFirstSupine,
        leaf_edges_mm: &[-10.0, 0.0, 10.0],
        beams: &[beam],
    };
    let grid = Grid { counts: [5, 4, 3], spacing_mm: [2.0; 3], origin_mm: [0.0; 3] };
    let gray: Vec<f32> = (0..60).map(|i| i as f32).collect();
    let dose = PlannedDose { grid: &grid, gray: &gray, plan: &uids.study };
    [plan_file(&export, &plan).unwrap().bytes, dose_file(&export, &dose).unwrap().bytes]
});

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn broken_images_are_refused_or_read_whole(which in 0..3_usize, harms in prop::collection::vec(harm(), 1..4)) {
        let Ok(data) = DataSet::read(&harmed(IMAGES[which].clone(), &harms)) else { return Ok(()) };
        let Ok(slice) = Slice::read(&data) else { return Ok(()) };
        prop_assert_eq!(slice.hu.len(), slice.counts[0] * slice.counts[1]);
        prop_assert!(slice.position_mm.iter().all(|c| c.is_finite()));
        let whole = Slice::read(&DataSet::read(&file(&ct(2))).unwrap()).unwrap();
        if let Ok(volume) = volume(vec![(PathBuf::from("a"), slice), (PathBuf::from("b"), whole)], true) {
            prop_assert_eq!(volume.hu.len(), volume.grid.len());
        }
    }

    #[test]
    fn broken_compressed_images_are_refused_or_read_whole(
        which in 0..4_usize, harms in prop::collection::vec(harm(), 1..4), inside in prop::collection::vec(harm(), 0..4),
    ) {
        let (syntax, piece) = &compressed::pieces()[which];
        let bytes = compressed::image(1, syntax, &harmed(piece.clone(), &inside));
        // The pixels alone are harmed in every other case: else the lengths around them hide them.
        let bytes = if inside.len() % 2 == 0 { harmed(bytes, &harms) } else { bytes };
        let Ok(data) = DataSet::read(&bytes) else { return Ok(()) };
        let Ok(slice) = Slice::read(&data) else { return Ok(()) };
        prop_assert_eq!(slice.hu.len(), slice.counts[0] * slice.counts[1]);
    }

    #[test]
    fn broken_plans_are_refused_or_all_of_their_meterset_is_given(harms in prop::collection::vec(harm(), 1..4)) {
        let Ok(data) = DataSet::read(&harmed(TREATMENT[0].clone(), &harms)) else { return Ok(()) };
        let Ok(plan) = TreatmentPlan::read(&data.object) else { return Ok(()) };
        for beam in plan.beams {
            prop_assert!(beam.monitor_units > 0.0 && beam.points.windows(2).all(|p| p[0].given <= p[1].given));
            let ends = [beam.points[0].given, beam.points[beam.points.len() - 1].given];
            prop_assert!(ends[0] < 1e-4 && (ends[1] - 1.0).abs() < 2e-3, "{ends:?}");
            let mut angles = beam.points.iter().map(|p| p.gantry_deg + p.collimator_deg + p.couch_deg);
            prop_assert!(angles.all(f64::is_finite));
            let pairs = beam.leaves.map_or(0, |leaves| leaves.edges_mm.len() - 1);
            prop_assert!(beam.points.iter().all(|p| p.tips_mm.len() == pairs));
        }
    }

    #[test]
    fn broken_doses_are_refused_or_read_whole(harms in prop::collection::vec(harm(), 1..4)) {
        let Ok(data) = DataSet::read(&harmed(TREATMENT[1].clone(), &harms)) else { return Ok(()) };
        let Ok(dose) = GivenDose::read(&data) else { return Ok(()) };
        prop_assert_eq!(dose.gray.len(), dose.grid.len());
        prop_assert!(dose.grid.origin_mm.iter().all(|c| c.is_finite()));
    }

    #[test]
    fn broken_structure_sets_are_refused_or_drawn(which in 0..3_usize, harms in prop::collection::vec(harm(), 1..4)) {
        let grid = stillpoint_patient::Grid { counts: [12, 9, 5], spacing_mm: [2.0, 3.0, 2.5], origin_mm: [-10.0, -12.0, 100.0] };
        let Ok(data) = DataSet::read(&harmed(SETS[which].clone(), &harms)) else { return Ok(()) };
        let Ok(set) = Rois::read(&data.object, &Uid::parse(FRAME).unwrap(), 0.0) else { return Ok(()) };
        for roi in set.rois {
            prop_assert!(rasterise(&grid, &roi.contours).mask.count() <= grid.len());
        }
    }
}

#[test]
fn sequences_that_nest_without_end_are_refused() {
    for encoding in [Encoding::Explicit, Encoding::Implicit] {
        let mut bytes = bare(&ct(1), encoding);
        let head: &[u8] = match encoding {
            Encoding::Explicit => b"\x06\x30\x39\x00SQ\0\0\xff\xff\xff\xff",
            Encoding::Implicit => b"\x06\x30\x39\x00\xff\xff\xff\xff",
        };
        for _ in 0..100_000 {
            bytes.extend(head);
            bytes.extend(b"\xfe\xff\x00\xe0\xff\xff\xff\xff");
        }
        let message = DataSet::read(&bytes).unwrap_err().to_string();
        assert!(message.contains("nest more than 16 deep at (3006,0039)"), "{message}");
    }
}
