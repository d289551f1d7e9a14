//! The dose of an RTPLAN, beside that of the program that wrote it.

use std::path::Path;

use dicom_core::{DataElement, PrimitiveValue, VR};
use dicom_dictionary_std::tags;
use serde_json::Value;
use stillpoint_dicom::DataSet;

use super::{stillpoint, text};

fn run(folder: &Path, arguments: &[&str]) -> Vec<u8> {
    let out = stillpoint(folder, arguments);
    assert!(out.status.success(), "{arguments:?}: {}", text(&out.stderr));
    out.stdout
}

#[test]
fn a_plan_of_this_program_has_its_own_dose_and_that_of_another_patient_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for seed in ["0", "1"] {
        run(folder, &["case", "phantom", "--seed", seed, "--out", "."]);
    }
    let coarse = ["--angles", "20,140@-30,260", "--grid", "16mm", "--bixel", "5mm", "--dose-grid", "5mm"];
    let more =
        ["--out", "plan", "--doses", "doses", "--engine", "pencil", "--accept-check", "coarse", "--json"];
    let planned: Value =
        serde_json::from_slice(&run(folder, &[&["plan", "pelvis-0.case"], &coarse[..], &more].concat()))
            .unwrap();
    assert_eq!(planned["beams"][1]["couch_deg"], -30.0);
    // The foot end of the couch is there: exported only because a person accepts it.
    let faults = planned["check"]["faults"].to_string();
    assert!(faults.contains("gantry and couch may collide at 140@-30"), "{faults}");
    assert!(
        planned["beams"][0].get("couch_deg").is_none() && planned["leaves"]["beams"][1]["couch_deg"] == -30.0
    );
    assert_eq!(planned["searches"][0]["couches_deg"], serde_json::json!([0.0, -30.0, 0.0]));
    let asked = |case, dose| {
        let files = ["plan", "recalculate", "plan/rtplan.dcm", "--case", case, "--dose", dose];
        [&files[..], &["--engine", "pencil", "--grid", "8mm", "--json"]].concat()
    };
    let found: Value =
        serde_json::from_slice(&run(folder, &asked("pelvis-0.case", "plan/rtdose.dcm"))).unwrap();
    // The same field on finer bixels and another grid: what differs is the penumbra.
    let gamma = &found["other"]["gamma"];
    assert!(gamma["passed"].as_f64().unwrap() > 0.98, "{gamma}");
    assert_eq!(found["beams"][1]["couch_deg"], serde_json::json!([330.0, 330.0]));
    assert!((found["other"]["factor"].as_f64().unwrap() - 1.0).abs() < 0.02, "{}", found["other"]["factor"]);
    let units: f64 =
        found["beams"].as_array().unwrap().iter().map(|b| b["monitor_units"].as_f64().unwrap()).sum();
    assert!((units - planned["leaves"]["monitor_units"].as_f64().unwrap()).abs() < 0.01);
    assert!(folder.join("recalculated/rtplan/recalculated.svg").is_file());

    let refused = |arguments: &[&str]| {
        let out = stillpoint(folder, arguments);
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        text(&out.stderr)
    };
    let message = refused(&asked("pelvis-1.case", "plan/rtdose.dcm"));
    assert!(message.contains("give the case of this patient"), "{message}");
    let message = refused(&asked("pelvis-0.case", "plan/rtplan.dcm"));
    assert!(message.contains("an RTDOSE is expected"), "{message}");

    // A couch that is turned the other way gives another dose, and a table top that is tilted is refused.
    let mut plan = DataSet::read(&std::fs::read(folder.join("plan/rtplan.dcm")).unwrap()).unwrap().object;
    let mut beams = plan.get(tags::BEAM_SEQUENCE).unwrap().value().items().unwrap().to_vec();
    let original = beams[1].get(tags::CONTROL_POINT_SEQUENCE).unwrap().value().items().unwrap().to_vec();
    let sequence = |items: Vec<_>| dicom_core::value::DataSetSequence::from(items);
    let mut change = |tag, value: &'static str| {
        let mut points = original.clone();
        points[0].put(DataElement::new(tag, VR::DS, PrimitiveValue::from(value)));
        beams[1].put(DataElement::new(tags::CONTROL_POINT_SEQUENCE, VR::SQ, sequence(points)));
        plan.put(DataElement::new(tags::BEAM_SEQUENCE, VR::SQ, sequence(beams.clone())));
        let mut bytes = Vec::new();
        let syntax = dicom_transfer_syntax_registry::entries::EXPLICIT_VR_LITTLE_ENDIAN.erased();
        plan.write_dataset_with_ts(&mut bytes, &syntax).unwrap();
        std::fs::write(folder.join("plan/rtplan.dcm"), bytes).unwrap();
    };
    change(tags::PATIENT_SUPPORT_ANGLE, "30");
    let other: Value =
        serde_json::from_slice(&run(folder, &asked("pelvis-0.case", "plan/rtdose.dcm"))).unwrap();
    let passed = &other["other"]["gamma"]["passed"];
    assert!(passed.as_f64().unwrap() < 0.9, "{passed}");
    change(tags::TABLE_TOP_PITCH_ANGLE, "3");
    let message = refused(&asked("pelvis-0.case", "plan/rtdose.dcm"));
    assert!(message.contains("a level table top is read"), "{message}");
}
