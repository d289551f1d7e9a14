//! Arcs of an RTPLAN: read back here and by pydicom, and refused where they are none.

use std::process::Command;

use stillpoint_dicom::{
    Arc, ArcPoint, Beam, CaseIdentity, DataSet, Export, ExportError, TreatmentPlan, plan_file,
};

use crate::export::{prescription, shaped_beams, shaped_plan, uids};

/// An arc from 350 to 10 degrees and back.
fn arcs() -> Vec<Beam> {
    let [first, ..] = &shaped_beams()[..] else { panic!("a beam") };
    let points = |clockwise: bool| -> Vec<ArcPoint> {
        let point = |i: usize| ArcPoint {
            gantry_deg: (350.0 + 4.0 * if clockwise { i } else { 5 - i } as f64) % 360.0,
            // Nothing in the second interval.
            given: [0.0, 7.5, 7.5, 20.0, 21.0, 21.25][i],
            tips_mm: vec![[-30.0 + i as f64, 12.25 - i as f64], [-5.5, -5.5 + 3.0 * i as f64]],
        };
        (0..6).map(point).collect()
    };
    let arc = |clockwise: bool| {
        let points = points(clockwise);
        Beam {
            gantry_deg: points[0].gantry_deg,
            couch_deg: 0.0,
            segments: Vec::new(),
            arc: Some(Arc { clockwise, mu_per_min: 600.0, points }),
            ..first.clone()
        }
    };
    vec![arc(true), arc(false)]
}

fn bytes(beams: &[Beam]) -> Result<Vec<u8>, ExportError> {
    let (uids, identity, prescription) = (uids(), CaseIdentity::none(), prescription());
    let export = Export { uids: &uids, identity: &identity };
    Ok(plan_file(&export, &shaped_plan(beams, &prescription))?.bytes)
}

#[test]
fn an_arc_that_was_exported_is_read_back_point_by_point() {
    let plan = TreatmentPlan::read(&DataSet::read(&bytes(&arcs()).unwrap()).unwrap().object).unwrap();
    assert_eq!((plan.beams.len(), plan.left_out.len()), (2, 0));
    for (beam, expected) in plan.beams.iter().zip(arcs()) {
        let arc = expected.arc.unwrap();
        assert!((beam.monitor_units - 21.25).abs() < 1e-9);
        assert_eq!(beam.points.len(), arc.points.len());
        for (found, point) in beam.points.iter().zip(&arc.points) {
            assert!((found.given - point.given / 21.25).abs() < 1e-9);
            assert_eq!(
                (found.gantry_deg.rem_euclid(360.0), &found.tips_mm),
                (point.gantry_deg, &point.tips_mm)
            );
        }
        // It goes on beyond 360 degrees, or below 0.
        let turned = beam.points[5].gantry_deg - beam.points[0].gantry_deg;
        assert!((turned - if arc.clockwise { 20.0 } else { -20.0 }).abs() < 1e-9, "{turned}");
    }
}

#[test]
fn what_is_no_arc_is_refused() {
    let refused = |change: &dyn Fn(&mut Arc)| {
        let mut beams = arcs();
        change(beams[0].arc.as_mut().unwrap());
        matches!(bytes(&beams), Err(ExportError::Number { .. }))
    };
    assert!(!refused(&|_| ()));
    assert!(refused(&|arc| arc.points[0].given = 1.0));
    assert!(refused(&|arc| arc.points[3].given = 5.0));
    assert!(refused(&|arc| arc.points[3].given = f64::NAN));
    assert!(refused(&|arc| arc.points.iter_mut().for_each(|point| point.given = 0.0)));
    assert!(refused(&|arc| arc.points.clear()));
    assert!(refused(&|arc| arc.points[2].gantry_deg = 360.0));
    assert!(refused(&|arc| arc.points[2].tips_mm[0] = [3.0, 2.0]));
    assert!(refused(&|arc| {
        arc.points[2].tips_mm.pop();
    }));
    assert!(refused(&|arc| arc.mu_per_min = 0.0));
}

/// What pydicom reads of arcs: the first line of each beam, then each control point.
const PRINT: &str = r#"
import sys, warnings, pydicom
from pydicom import config
config.settings.reading_validation_mode = config.RAISE
warnings.simplefilter('error')
plan = pydicom.dcmread(sys.argv[1])
str(plan)
print([float(b.BeamMeterset) for b in plan.FractionGroupSequence[0].ReferencedBeamSequence])
for b in plan.BeamSequence:
    print(b.BeamType, b.NumberOfControlPoints, float(b.FinalCumulativeMetersetWeight), float(b.ControlPointSequence[0].DoseRateSet))
    for i, c in enumerate(b.ControlPointSequence):
        assert c.ControlPointIndex == i
        print(float(c.CumulativeMetersetWeight), float(c.GantryAngle), c.GantryRotationDirection,
              [float(v) for v in c.BeamLimitingDevicePositionSequence[-1].LeafJawPositions])
"#;

#[test]
fn pydicom_reads_one_control_point_for_each_angle() {
    let python = std::env::var("STILLPOINT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let probe = Command::new(&python).args(["-c", "import pydicom"]).output();
    if !probe.is_ok_and(|p| p.status.success()) {
        println!("skipped: {python} cannot import pydicom (set STILLPOINT_PYTHON to one that can)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rp.dcm");
    std::fs::write(&path, bytes(&arcs()).unwrap()).unwrap();
    let out = Command::new(python).args(["-c", PRINT]).arg(&path).env("PYTHONUTF8", "1").output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let text = String::from_utf8(out.stdout).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[..2], ["[21.25, 21.25]", "DYNAMIC 6 1.0 600.0"]);
    assert_eq!(lines[2], "0.0 350.0 CW [-30.0, -5.5, 12.25, -5.5]");
    assert!(lines[5].contains(" 2.0 CW [-27.0, -5.5, 9.25, 3.5]"), "{}", lines[5]);
    assert_eq!(lines[7], "1.0 10.0 NONE [-25.0, -5.5, 7.25, 9.5]");
    assert_eq!(lines[9], "0.0 10.0 CC [-30.0, -5.5, 12.25, -5.5]");
    assert!(lines[14].starts_with("1.0 350.0 NONE"), "{}", lines[14]);
}
