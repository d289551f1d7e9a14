//! RTPLAN and RTDOSE: what is written is read back, here and by pydicom. `STILLPOINT_PYTHON` names a Python that has it.

use std::process::Command;

use proptest::prelude::*;
use stillpoint_dicom::{
    Beam, CaseIdentity, DataSet, Export, ExportError, LeafSegment, Machine, Plan, PlannedDose, dose_file,
    plan_file, structure_file, uids_of,
};
use stillpoint_patient::Grid;
use stillpoint_patient::case::{ContentHash, NameTable, PatientPosition, Prescription, Uid, Uids};

use crate::fixture::folder;
use crate::import::request;

const GRID: Grid =
    Grid { counts: [5, 4, 3], spacing_mm: [2.5, 3.906, 1.0 / 3.0], origin_mm: [-1e3 / 3.0, 0.1, -94.5] };

pub fn uids() -> Uids {
    let uid = |n| Uid::parse(&format!("1.2.3.{n}")).unwrap();
    Uids { study: uid(1), series: uid(2), frame_of_reference: uid(3), structure_set: uid(4) }
}

fn gray() -> Vec<f32> {
    (0..60).map(|i| i as f32 * i as f32 / 47.0).collect()
}

fn beams() -> Vec<Beam> {
    let beam = |i: usize| Beam {
        name: format!("{} degrees", 72 * i),
        gantry_deg: 72.0 * i as f64,
        couch_deg: [0.0, 0.0, 12.5, 330.0, 0.0][i],
        isocentre_mm: [-2.0059738816337926, 3.9915254237288025, 5.651986662961917],
        weight: (i + 2) as f64 / 20.0,
        field_mm: [[-35.0, 40.0], [-30.5, 30.0]],
        segments: Vec::new(),
        arc: None,
    };
    (0..5).map(beam).collect()
}

/// The same beams with three segments each.
pub fn shaped_beams() -> Vec<Beam> {
    let segment = |i: usize| LeafSegment {
        tips_mm: vec![[-35.0, -35.0 + 10.0 * i as f64], [-5.5, 40.0]],
        field_mm: [[-35.0, 40.0], [-10.0 * i.min(1) as f64, 10.0]],
        monitor_units: 12.5 + i as f64 / 3.0,
    };
    beams().into_iter().map(|beam| Beam { segments: (0..3).map(segment).collect(), ..beam }).collect()
}

pub fn prescription() -> Vec<Prescription> {
    vec![Prescription { structure: "PTV".to_owned(), dose_gy: 78.0 }]
}

fn plan<'a>(beams: &'a [Beam], prescription: &'a [Prescription]) -> Plan<'a> {
    let machine = Machine { name: "generic", energy_mv: 6.0, source_axis_mm: 1000.0 };
    Plan {
        label: "greedy 5",
        machine,
        prescription,
        fractions: 39,
        position: PatientPosition::HeadFirstSupine,
        leaf_edges_mm: &[],
        beams,
    }
}

/// A plan of the beams with segments.
pub fn shaped_plan<'a>(beams: &'a [Beam], prescription: &'a [Prescription]) -> Plan<'a> {
    Plan { leaf_edges_mm: &[-10.0, 0.0, 10.0], ..plan(beams, prescription) }
}

#[test]
fn the_same_plan_makes_the_same_bytes_and_another_plan_other_uids() {
    let (uids, identity) = (uids(), CaseIdentity::none());
    let export = Export { uids: &uids, identity: &identity };
    let (beams, prescription) = (beams(), prescription());
    let first = plan_file(&export, &plan(&beams, &prescription)).unwrap();
    assert_eq!(first, plan_file(&export, &plan(&beams, &prescription)).unwrap());
    let other = plan_file(&export, &plan(&beams[1..], &prescription)).unwrap();
    assert_ne!(first.uid, other.uid);
    assert!(first.uid.as_str().starts_with("2.25."));
    let read = DataSet::read(&first.bytes).unwrap().object;
    let uid = read.get(dicom_dictionary_std::tags::SOP_INSTANCE_UID).unwrap().to_str().unwrap().into_owned();
    assert_eq!(Uid::parse(&uid).unwrap(), first.uid);
}

#[test]
fn a_case_without_uids_gets_some_from_its_content() {
    let folder = folder();
    let names = NameTable::shipped().unwrap();
    let case = stillpoint_dicom::import_folder(folder.path(), &request(&names)).unwrap().case;
    assert_eq!(Some(&uids_of(&case, &ContentHash([1; 32]))), case.uids());
}

#[test]
fn exported_structures_are_read_back_as_the_same_voxels() {
    let folder = folder();
    let names = NameTable::shipped().unwrap();
    let read = || stillpoint_dicom::import_folder(folder.path(), &request(&names)).unwrap().case;
    let case = read();
    let uids = uids_of(&case, &ContentHash([1; 32]));
    let identity = CaseIdentity::none();
    let file = structure_file(&Export { uids: &uids, identity: &identity }, &case).unwrap();
    assert_eq!(file.uid, uids.structure_set);
    std::fs::write(folder.path().join("rs.dcm"), file.bytes).unwrap();
    let duplicates = read();
    assert!(case.structures().iter().any(|s| !s.mask.is_empty()));
    assert_eq!(duplicates.structures(), case.structures());
}

#[test]
fn what_cannot_be_written_is_refused() {
    let (uids, identity) = (uids(), CaseIdentity::none());
    let export = Export { uids: &uids, identity: &identity };
    let (beams, prescription) = (beams(), prescription());
    let message = |change: &dyn Fn(&mut Plan<'_>, &mut Vec<Beam>)| {
        let mut changed = beams.clone();
        let mut plan = plan(&[], &prescription);
        change(&mut plan, &mut changed);
        plan_file(&export, &Plan { beams: &changed, ..plan }).unwrap_err().to_string()
    };
    assert!(message(&|_, b| b.clear()).contains("1 to 999 beams"));
    assert!(message(&|p, _| p.label = "a label of more than sixteen").contains("label of a plan"));
    assert!(message(&|p, _| p.fractions = 0).contains("number of fractions"));
    assert!(message(&|p, _| p.machine.source_axis_mm = f64::NAN).contains("distance of the source"));
    assert!(message(&|_, b| b[1].gantry_deg = 360.0).contains("below 360"));
    assert!(message(&|_, b| b[1].couch_deg = -30.0).contains("couch angle"));
    assert!(message(&|_, b| b[1].weight = -0.1).contains("weight of a beam"));
    assert!(message(&|_, b| b[1].isocentre_mm[2] = f64::INFINITY).contains("isocentre"));
    assert!(message(&|_, b| b[1].field_mm[0] = [3.0, 3.0]).contains("width of a field"));
    assert!(message(&|_, b| b[1].name = "a\\b".to_owned()).contains("name of a beam"));
    let edges = [-10.0, 0.0, 10.0];
    let leaves = |change: &dyn Fn(&mut LeafSegment)| {
        let mut shaped = shaped_beams();
        change(&mut shaped[2].segments[1]);
        let plan = Plan { leaf_edges_mm: &edges, ..plan(&shaped, &prescription) };
        plan_file(&export, &plan).map(|_| ()).map_err(|e| e.to_string())
    };
    assert_eq!(leaves(&|_| ()), Ok(()));
    assert!(leaves(&|s| s.tips_mm[0] = [5.0, 4.0]).unwrap_err().contains("place of a leaf"));
    assert!(leaves(&|s| s.tips_mm[1] = [f64::NAN; 2]).unwrap_err().contains("place of a leaf"));
    assert!(leaves(&|s| s.tips_mm.truncate(1)).unwrap_err().contains("number of leaf pairs"));
    assert!(leaves(&|s| s.field_mm[1] = [4.0, -4.0]).unwrap_err().contains("width of a field"));
    assert!(leaves(&|s| s.monitor_units = -1.0).unwrap_err().contains("monitor units"));
    let dose = |grid: &Grid, gray: &[f32]| {
        dose_file(&export, &PlannedDose { grid, gray, plan: &uids.study }).map(|_| ())
    };
    assert_eq!(dose(&GRID, &[0.0; 59]), Err(ExportError::Length { expected: 60, found: 59 }));
    assert!(matches!(dose(&GRID, &[f32::NAN; 60]), Err(ExportError::Number { .. })));
    assert!(matches!(dose(&GRID, &[-1.0; 60]), Err(ExportError::Number { .. })));
    assert!(matches!(dose(&Grid { counts: [usize::MAX, 9, 9], ..GRID }, &[]), Err(ExportError::Size(_))));
    assert_eq!(dose(&GRID, &[0.0; 60]), Ok(()));
}

proptest! {
    #[test]
    fn a_dose_comes_back_to_a_part_in_four_billion_of_the_largest(
        values in prop::collection::vec(prop_oneof![0.0..1e-6_f32, 0.0..100.0_f32, 0.0..1e20_f32], 60),
    ) {
        use dicom_dictionary_std::tags;
        let (uids, identity) = (uids(), CaseIdentity::none());
        let dose = PlannedDose { grid: &GRID, gray: &values, plan: &uids.study };
        let file = dose_file(&Export { uids: &uids, identity: &identity }, &dose).unwrap();
        let object = DataSet::read(&file.bytes).unwrap().object;
        let scaling = object.get(tags::DOSE_GRID_SCALING).unwrap().to_float64().unwrap();
        let text = object.get(tags::DOSE_GRID_SCALING).unwrap().to_str().unwrap().into_owned();
        prop_assert!(text.trim().len() <= 16);
        let bytes = object.get(tags::PIXEL_DATA).unwrap().to_bytes().unwrap().into_owned();
        let largest = values.iter().copied().fold(0.0, f32::max);
        for (value, stored) in values.iter().zip(bytes.chunks_exact(4)) {
            let read = scaling * f64::from(u32::from_le_bytes(stored.try_into().unwrap()));
            prop_assert!((read - f64::from(*value)).abs() <= 0.5001 * f64::from(largest) / 4_294_967_000.0);
        }
    }
}

/// Reads both files and prints what they say; `dciodvfy`-like rules are pydicom's own, as errors.
const PRINT: &str = r#"
import sys, warnings
import pydicom
from pydicom import config
config.settings.reading_validation_mode = config.RAISE
warnings.simplefilter('error')
plan, dose = (pydicom.dcmread(path) for path in sys.argv[1:3])
for d in (plan, dose):
    print(d.file_meta.MediaStorageSOPInstanceUID == d.SOPInstanceUID, d.SOPClassUID.name, d.Modality, d.StudyInstanceUID, d.FrameOfReferenceUID)
    print(repr(str(d.PatientName)), repr(d.PatientID), repr(d.PatientBirthDate), repr(d.PatientSex), d.get('PatientIdentityRemoved'))
    str(d)
print(plan.RTPlanLabel, '|', plan.RTPlanDescription, '|', plan.ApprovalStatus, plan.RTPlanGeometry)
print(plan.ReferencedStructureSetSequence[0].ReferencedSOPInstanceUID, plan.PatientSetupSequence[0].PatientPosition)
print(plan.DoseReferenceSequence[0].DoseReferenceDescription, plan.DoseReferenceSequence[0].TargetPrescriptionDose)
g = plan.FractionGroupSequence[0]
print(g.NumberOfFractionsPlanned, g.NumberOfBeams, [int(b.ReferencedBeamNumber) for b in g.ReferencedBeamSequence])
for b in plan.BeamSequence:
    c = b.ControlPointSequence
    print(b.BeamNumber, b.BeamName, b.RadiationType, float(b.SourceAxisDistance), float(c[0].GantryAngle), float(c[0].PatientSupportAngle), [float(v) for v in c[0].IsocenterPosition],
          float(b.FinalCumulativeMetersetWeight), float(c[1].CumulativeMetersetWeight), float(c[0].NominalBeamEnergy),
          [[float(v) for v in d.LeafJawPositions] for d in c[0].BeamLimitingDevicePositionSequence])
print(dose.ReferencedRTPlanSequence[0].ReferencedSOPInstanceUID == plan.SOPInstanceUID, dose.DoseUnits, dose.DoseSummationType)
print([float(v) for v in dose.ImagePositionPatient], [float(v) for v in dose.PixelSpacing], [float(v) for v in dose.GridFrameOffsetVector], dose.FrameIncrementPointer)
a = dose.pixel_array * float(dose.DoseGridScaling)
print(a.shape, ' '.join(v.hex() for v in a.ravel().tolist()))
"#;

#[test]
fn pydicom_reads_the_plan_and_the_dose_back() {
    let python = std::env::var("STILLPOINT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let probe = Command::new(&python).args(["-c", "import pydicom, numpy"]).output();
    if !probe.is_ok_and(|p| p.status.success()) {
        println!("skipped: {python} cannot import pydicom and numpy (set STILLPOINT_PYTHON to one that can)");
        return;
    }
    let source = folder();
    let retained = CaseIdentity::read_stored(source.path(), &uids()).unwrap();
    for (identity, person) in [
        (CaseIdentity::none(), "'' '' '' '' YES"),
        (retained, "'M\u{fc}ller^Secret' 'SECRET-4711' '19500203' 'M' None"),
    ] {
        let lines = read_back(&python, &identity);
        assert_eq!(lines[0], "True RT Plan Storage RTPLAN 1.2.3.1 1.2.3.3");
        assert_eq!(lines[2], "True RT Dose Storage RTDOSE 1.2.3.1 1.2.3.3");
        assert_eq!([lines[1].as_str(), &lines[3]], [person; 2]);
        assert!(
            lines[4].starts_with("greedy 5 | ") && lines[4].ends_with("| UNAPPROVED PATIENT"),
            "{}",
            lines[4]
        );
        assert!(lines[4].contains("The fluence is not sequenced for a collimator"));
        assert_eq!(lines[5..8], ["1.2.3.4 HFS", "PTV 78", "39 5 [1, 2, 3, 4, 5]"].map(str::to_owned));
        for (i, beam) in beams().iter().enumerate() {
            let [x, y, z] = [-2.0059738816338, 3.9915254237288, 5.65198666296192];
            let expected = format!(
                "{} {} PHOTON 1000.0 {:?} {:?} [{x}, {y}, {z}] {w:?} {w:?} 6.0 [[-35.0, 40.0], [-30.5, 30.0]]",
                i + 1,
                beam.name,
                beam.gantry_deg,
                beam.couch_deg,
                w = beam.weight
            );
            assert_eq!(lines[8 + i], expected);
        }
        assert_eq!(lines[13], "True GY PLAN");
        let place = "[-333.33333333333, 0.1, -94.5] [3.906, 2.5] [0.0, 0.33333333333333, 0.66666666666667] (3004,000C)";
        assert_eq!(lines[14], place);
        let (shape, values) = lines[15].split_once(") ").unwrap();
        assert_eq!(shape, "(3, 4, 5");
        let values: Vec<f64> = values.split(' ').map(unhex).collect();
        let largest = f64::from(gray()[59]);
        assert_eq!(values.len(), 60);
        for (read, written) in values.iter().zip(gray()) {
            assert!(
                (read - f64::from(written)).abs() <= 0.51 * largest / 4_294_967_000.0,
                "{read} {written}"
            );
        }
    }
}

fn read_back(python: &str, identity: &CaseIdentity) -> Vec<String> {
    let uids = uids();
    let export = Export { uids: &uids, identity };
    let plan = plan_file(&export, &plan(&beams(), &prescription())).unwrap();
    let dose = dose_file(&export, &PlannedDose { grid: &GRID, gray: &gray(), plan: &plan.uid }).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let paths = [("rp.dcm", plan.bytes), ("rd.dcm", dose.bytes)].map(|(name, bytes)| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    });
    let out = Command::new(python).args(["-c", PRINT]).args(&paths).env("PYTHONUTF8", "1").output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).unwrap().lines().map(str::to_owned).collect()
}

/// A number that Python's `float.hex` wrote.
fn unhex(text: &str) -> f64 {
    let (mantissa, exponent) = text.strip_prefix("0x").unwrap().split_once('p').unwrap();
    let (whole, fraction) = mantissa.split_once('.').unwrap();
    let digits = u64::from_str_radix(&format!("{whole}{fraction}"), 16).unwrap();
    digits as f64 * 2.0_f64.powi(exponent.parse::<i32>().unwrap() - 4 * fraction.len() as i32)
}

/// What pydicom reads of a plan in segments: monitor units, devices, and each control point.
const PRINT_LEAVES: &str = r#"
import sys, warnings, pydicom
from pydicom import config
config.settings.reading_validation_mode = config.RAISE
warnings.simplefilter('error')
plan = pydicom.dcmread(sys.argv[1])
str(plan)
print([float(b.BeamMeterset) for b in plan.FractionGroupSequence[0].ReferencedBeamSequence])
b = plan.BeamSequence[1]
print(b.BeamType, b.PrimaryDosimeterUnit, b.NumberOfControlPoints, float(b.FinalCumulativeMetersetWeight),
      [(d.RTBeamLimitingDeviceType, int(d.NumberOfLeafJawPairs)) for d in b.BeamLimitingDeviceSequence],
      [float(v) for v in b.BeamLimitingDeviceSequence[2].LeafPositionBoundaries])
for i, c in enumerate(b.ControlPointSequence):
    assert c.ControlPointIndex == i
    devices = c.BeamLimitingDevicePositionSequence
    print(float(c.CumulativeMetersetWeight), [d.RTBeamLimitingDeviceType for d in devices], [float(v) for v in devices[-1].LeafJawPositions])
"#;

#[test]
fn pydicom_reads_segments_and_monitor_units() {
    let python = std::env::var("STILLPOINT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let probe = Command::new(&python).args(["-c", "import pydicom"]).output();
    if !probe.is_ok_and(|p| p.status.success()) {
        println!("skipped: {python} cannot import pydicom (set STILLPOINT_PYTHON to one that can)");
        return;
    }
    let (uids, identity) = (uids(), CaseIdentity::none());
    let (beams, prescription) = (shaped_beams(), prescription());
    let plan = shaped_plan(&beams, &prescription);
    let file = plan_file(&Export { uids: &uids, identity: &identity }, &plan).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rp.dcm");
    std::fs::write(&path, file.bytes).unwrap();
    let out =
        Command::new(python).args(["-c", PRINT_LEAVES]).arg(&path).env("PYTHONUTF8", "1").output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let lines: Vec<String> = String::from_utf8(out.stdout).unwrap().lines().map(str::to_owned).collect();
    assert_eq!(lines[0], "[38.5, 38.5, 38.5, 38.5, 38.5]");
    let devices = "[('ASYMX', 1), ('ASYMY', 1), ('MLCX', 2)] [-10.0, 0.0, 10.0]";
    assert_eq!(lines[1], format!("STATIC MU 6 1.0 {devices}"));
    // Weights rise only between the two points of a segment, and leaves move only between segments.
    let weights: Vec<f64> =
        lines[2..].iter().map(|l| l.split(' ').next().unwrap().parse().unwrap()).collect();
    let first = 12.5 / 38.5;
    let second = first + (12.5 + 1.0 / 3.0) / 38.5;
    for (found, expected) in weights.iter().zip([0.0, first, first, second, second, 1.0]) {
        assert!((found - expected).abs() < 1e-12, "{weights:?}");
    }
    // Jaws may follow each segment, so each control point has them beside its leaves.
    for (line, leaves) in [(2, "-35.0, 40.0"), (3, "-35.0, 40.0"), (7, "-15.0, 40.0")] {
        let point = format!("['ASYMX', 'ASYMY', 'MLCX'] [-35.0, -5.5, {leaves}]");
        assert!(lines[line].contains(&point), "{}", lines[line]);
    }
}
