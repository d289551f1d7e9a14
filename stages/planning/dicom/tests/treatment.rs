//! RTPLAN and RTDOSE of other programs, read.

use dicom_core::{PrimitiveValue, Tag, VR};
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_dicom::{
    CaseIdentity, DataSet, Export, GivenDose, PlannedDose, TreatmentPlan, dose_file, plan_file,
};
use stillpoint_patient::Grid;
use stillpoint_testing::reference;

use crate::export::{prescription, shaped_beams, shaped_plan, uids};
use crate::fixture::{put, sequence};

/// The plan of the tests of the export.
fn written() -> InMemDicomObject {
    let (uids, identity) = (uids(), CaseIdentity::none());
    let export = Export { uids: &uids, identity: &identity };
    let (beams, prescription) = (shaped_beams(), prescription());
    let file = plan_file(&export, &shaped_plan(&beams, &prescription)).unwrap();
    DataSet::read(&file.bytes).unwrap().object
}

/// A file with the first item of a sequence, and of one within it, changed.
fn changed(path: &[Tag], change: impl FnOnce(&mut InMemDicomObject)) -> InMemDicomObject {
    fn go(object: &mut InMemDicomObject, path: &[Tag], change: impl FnOnce(&mut InMemDicomObject)) {
        let [tag, rest @ ..] = path else { return change(object) };
        let mut items = object.get(*tag).unwrap().value().items().unwrap().to_vec();
        go(&mut items[0], rest, change);
        sequence(object, *tag, items);
    }
    let mut object = written();
    go(&mut object, path, change);
    object
}

const BEAM: &[Tag] = &[tags::BEAM_SEQUENCE];
const POINT: &[Tag] = &[tags::BEAM_SEQUENCE, tags::CONTROL_POINT_SEQUENCE];

#[test]
fn a_plan_that_was_exported_is_read_back_segment_by_segment() {
    let plan = TreatmentPlan::read(&written()).unwrap();
    assert_eq!((plan.fractions, plan.beams.len(), plan.left_out.len()), (39, 5, 0));
    assert_eq!(plan.frame_of_reference, Some(uids().frame_of_reference));
    assert_eq!(plan.position.as_deref(), Some("HFS"));
    for (beam, wanted) in plan.beams.iter().zip(shaped_beams()) {
        assert_eq!(
            (&beam.name, beam.energy_mv, beam.source_axis_mm),
            (&wanted.name, Some(6.0), Some(1000.0))
        );
        let units: f64 = wanted.segments.iter().map(|s| s.monitor_units).sum();
        assert!((beam.monitor_units - units).abs() < 1e-9 * units);
        let leaves = beam.leaves.as_ref().unwrap();
        assert_eq!((leaves.along_y, leaves.edges_mm.len()), (false, 3));
        assert_eq!(beam.points.len(), 2 * wanted.segments.len());
        for (pair, segment) in beam.points.chunks(2).zip(&wanted.segments) {
            let share = pair[1].given - pair[0].given;
            assert!((share - segment.monitor_units / units).abs() < 1e-9);
            for point in pair {
                assert_eq!(point.tips_mm, segment.tips_mm);
                assert_eq!(
                    (point.jaws_mm, point.gantry_deg),
                    (segment.field_mm.map(Some), wanted.gantry_deg)
                );
                assert_eq!((point.collimator_deg, point.couch_deg), (0.0, wanted.couch_deg));
            }
        }
    }
}

#[test]
fn what_would_give_another_dose_is_refused_with_the_beam_and_the_tag() {
    let number = |tag, value: &'static str| {
        move |object: &mut InMemDicomObject| put(object, tag, VR::DS, PrimitiveValue::from(value))
    };
    let refused = |object: InMemDicomObject| TreatmentPlan::read(&object).unwrap_err().to_string();
    for (object, words) in [
        (changed(BEAM, number(tags::NUMBER_OF_WEDGES, "1")), "wedge"),
        (changed(POINT, number(tags::TABLE_TOP_PITCH_ANGLE, "2")), "level table top"),
        (changed(POINT, number(tags::TABLE_TOP_ROLL_ANGLE, "359")), "level table top"),
        (changed(POINT, number(tags::TABLE_TOP_ECCENTRIC_ANGLE, "90")), "level table top"),
        (changed(BEAM, number(tags::NUMBER_OF_BLOCKS, "1")), "block"),
        (changed(BEAM, |o| put(o, tags::RADIATION_TYPE, VR::CS, "ELECTRON")), "photons are read"),
        (changed(BEAM, number(tags::FINAL_CUMULATIVE_METERSET_WEIGHT, "2")), "final weight"),
        (changed(POINT, number(tags::CUMULATIVE_METERSET_WEIGHT, "0.5")), "begin with 0"),
        (
            changed(POINT, |o| {
                o.remove_element(tags::GANTRY_ANGLE);
            }),
            "GantryAngle is missing",
        ),
        (changed(POINT, number(tags::GANTRY_ANGLE, "nan")), "finite numbers"),
    ] {
        let message = refused(object);
        assert!(message.starts_with("beam \"0 degrees\": ") && message.contains(words), "{message}");
    }
    let none = changed(&[tags::FRACTION_GROUP_SEQUENCE], |o| {
        o.remove_element(tags::REFERENCED_BEAM_SEQUENCE);
    });
    assert!(refused(none).contains("no beam 1"));
    let brachy = changed(&[], |o| {
        o.remove_element(tags::BEAM_SEQUENCE);
    });
    assert!(refused(brachy).contains("external machine"));
}

#[test]
fn a_gantry_that_passes_the_zero_runs_on_and_set_up_beams_are_left_out() {
    let mut object = written();
    let mut beams = object.get(tags::BEAM_SEQUENCE).unwrap().value().items().unwrap().to_vec();
    put(&mut beams[1], tags::TREATMENT_DELIVERY_TYPE, VR::CS, "SETUP");
    let mut points = beams[0].get(tags::CONTROL_POINT_SEQUENCE).unwrap().value().items().unwrap().to_vec();
    for (point, angle) in points.iter_mut().zip(["350", "355", "0", "5.5", "2", "358"]) {
        put(point, tags::GANTRY_ANGLE, VR::DS, angle);
    }
    sequence(&mut beams[0], tags::CONTROL_POINT_SEQUENCE, points);
    sequence(&mut object, tags::BEAM_SEQUENCE, beams);
    let plan = TreatmentPlan::read(&object).unwrap();
    assert_eq!((plan.beams.len(), plan.left_out.len()), (4, 1));
    let angles: Vec<f64> = plan.beams[0].points.iter().map(|p| p.gantry_deg).collect();
    assert_eq!(angles, [350.0, 355.0, 360.0, 365.5, 362.0, 358.0]);
}

#[test]
fn a_dose_that_was_exported_is_read_back_and_frames_may_run_downwards() {
    let grid = Grid { counts: [5, 4, 3], spacing_mm: [2.5, 3.5, 3.0], origin_mm: [-33.25, 0.5, -94.5] };
    let gray: Vec<f32> = (0..60).map(|i| i as f32 * i as f32 / 47.0).collect();
    let (uids, identity) = (uids(), CaseIdentity::none());
    let export = Export { uids: &uids, identity: &identity };
    let planned = PlannedDose { grid: &grid, gray: &gray, plan: &uids.study };
    let data = DataSet::read(&dose_file(&export, &planned).unwrap().bytes).unwrap();
    let dose = GivenDose::read(&data).unwrap();
    assert_eq!((dose.grid, &dose.sum[..]), (grid, "PLAN"));
    assert!(dose.gray.iter().zip(&gray).all(|(a, b)| (a - b).abs() <= 1e-6 * 80.0), "{:?}", dose.gray);
    let mut down = data.clone();
    put(&mut down.object, tags::GRID_FRAME_OFFSET_VECTOR, VR::DS, "0\\-3\\-6");
    let turned = GivenDose::read(&down).unwrap();
    assert_eq!(turned.grid.origin_mm[2], -100.5);
    assert_eq!(turned.gray[..20], dose.gray[40..]);
    for (tag, vr, value, words) in [
        (tags::DOSE_UNITS, VR::CS, "RELATIVE", "absolute dose"),
        (tags::GRID_FRAME_OFFSET_VECTOR, VR::DS, "0\\3\\7", "evenly spaced"),
        (tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "-1\\0\\0\\0\\-1\\0", "rows along x"),
        (tags::DOSE_GRID_SCALING, VR::DS, "-1", "above 0"),
        (tags::ROWS, VR::US, "4097", "1 to 4096"),
    ] {
        let mut wrong = data.clone();
        match vr {
            VR::US => put(&mut wrong.object, tag, vr, value.parse::<u16>().unwrap()),
            _ => put(&mut wrong.object, tag, vr, value),
        }
        let message = GivenDose::read(&wrong).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
}

/// Files of vendors: a plan whose elements are of unknown representation, and a compressed dose.
#[test]
fn the_plans_and_doses_of_vendors_are_read_or_refused_by_name() {
    let Some(root) = reference::folder("planning") else { return };
    let data = |name: &str| DataSet::read(&std::fs::read(root.join("dicom_rt_samples").join(name)).unwrap());
    let plan = TreatmentPlan::read(&data("rtplan.dcm").unwrap().object).unwrap();
    assert_eq!((&plan.label[..], plan.fractions, plan.beams.len()), ("Plan1", 30, 1));
    let beam = &plan.beams[0];
    assert_eq!((beam.monitor_units, beam.points[1].jaws_mm), (116.0036697, [Some([-100.0, 100.0]); 2]));
    let message = GivenDose::read(&data("rtdose.dcm").unwrap()).unwrap_err().to_string();
    assert!(message.contains("absolute dose"), "{message}");
    let message = GivenDose::read(&data("rtdose_rle.dcm").unwrap()).unwrap_err().to_string();
    assert!(message.contains("uncompressed"), "{message}");
}
