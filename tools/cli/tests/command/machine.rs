//! `stillpoint machine fit`: a machine file from scans of a water tank.

use serde_json::Value;

use crate::{stillpoint, text};

const DEPTH_DOSE: &str = include_str!("../../../../stages/planning/plan/data/measured/depth_dose.mcc");
const PROFILES: &str = include_str!("../../../../stages/planning/plan/data/measured/profiles.mcc");

#[test]
fn a_machine_is_fitted_to_scans_and_planned_with_and_a_wrong_curve_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("pdd.mcc", DEPTH_DOSE);
    write("profiles.mcc", PROFILES);
    let readings = "kind,field_x_mm,field_y_mm,ssd_mm,depth_mm,off_mm,value\n\
                    output,100,100,900,100,0,1\noutput,40,40,900,100,0,0.87\ncalibration,100,100,900,100,0,0.0080\n";
    write("output.csv", readings);
    let fit = |arguments: &[&str]| {
        stillpoint(folder.path(), &[&["machine", "fit", "--out", "own.json"], arguments].concat())
    };
    let good = fit(&["pdd.mcc", "profiles.mcc", "output.csv"]);
    let printed = text(&good.stdout);
    assert_eq!(good.status.code(), Some(0), "{printed}{}", text(&good.stderr));
    for piece in [
        "depth dose, 100 x 100 mm",
        "profile along x",
        "monitor units for a weight of 1",
        "output factor 40 x 40 mm",
    ] {
        assert!(printed.contains(piece), "no {piece} in {printed}");
    }
    let page = std::fs::read_to_string(folder.path().join("machine-fit.html")).unwrap();
    assert!(page.contains("computed less measured") && page.contains("Photons at the surface"));
    // The file is a machine: the dose check reads it, and its monitor units are those of the reading.
    let file: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("own.json")).unwrap()).unwrap();
    assert_eq!(file["pencils_of"], "start");
    let units = file["collimator"]["mu_per_weight"].as_f64().unwrap();
    assert!((units - 125.0).abs() < 1.0, "{units}");
    let check = stillpoint(folder.path(), &["dose", "check", "own.json", "--phantom", "water", "--json"]);
    assert!(matches!(check.status.code(), Some(0 | 1)), "{}", text(&check.stderr));

    // Pencil beams of it are another machine's, and the plan says so.
    let phantom = stillpoint(folder.path(), &["case", "phantom", "--out", "."]);
    assert_eq!(phantom.status.code(), Some(0), "{}", text(&phantom.stderr));
    let case = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
    let case = case.into_iter().find(|path| path.extension().is_some_and(|end| end == "case")).unwrap();
    let arguments =
        ["plan", case.to_str().unwrap(), "--machine", "own.json", "--engine", "pencil", "--out", "plan"];
    let coarse =
        ["--angles", "0,120", "--fluence-only", "--grid", "15mm", "--bixel", "20mm", "--dose-grid", "5mm"];
    let plan = stillpoint(folder.path(), &[&arguments[..], &coarse].concat());
    let printed = text(&plan.stdout);
    assert_eq!(plan.status.code(), Some(0), "{printed}{}", text(&plan.stderr));
    assert!(printed.contains("caution: dose by pencil beams of another machine"), "{printed}");
    for file in ["plan/plan.json", "plan/plan.html"] {
        let written = std::fs::read_to_string(folder.path().join(file)).unwrap();
        assert!(written.contains("pencil beams of another machine"), "{file}");
    }

    std::fs::remove_file(folder.path().join("own.json")).unwrap();
    // An output factor that is 8 % higher, and one in the build-up.
    for (wrong, expected) in [
        (readings.replace("0.87", "0.95"), "output factor of 40 x 40 mm (output.csv, line 3)"),
        (
            readings.replace("calibration,100,100,900,100", "calibration,100,100,900,15"),
            "output.csv, line 4: the calibration",
        ),
    ] {
        write("output.csv", &wrong);
        let refused = fit(&["pdd.mcc", "output.csv"]);
        let message = text(&refused.stderr);
        assert!(matches!(refused.status.code(), Some(1 | 2)) && message.contains(expected), "{message}");
        assert!(!folder.path().join("own.json").exists());
    }
    // No energy in the file.
    write("silent.mcc", &DEPTH_DOSE.replace("ENERGY=6.00", ""));
    let silent = fit(&["silent.mcc"]);
    assert_eq!(silent.status.code(), Some(2));
    assert!(text(&silent.stderr).contains("--energy 6MV"), "{}", text(&silent.stderr));
    let contradicted = fit(&["pdd.mcc", "--energy", "10MV"]);
    assert!(text(&contradicted.stderr).contains("10 MV in --energy"), "{}", text(&contradicted.stderr));
    // One value is too high by 10 %.
    write("bad.mcc", &DEPTH_DOSE.replace("1.2856E+00", "1.4142E+00"));
    let bad = fit(&["bad.mcc", "--json"]);
    assert_eq!(bad.status.code(), Some(1), "{}", text(&bad.stderr));
    let answer: Value = serde_json::from_slice(&bad.stdout).unwrap();
    assert_eq!(answer["missed"], 1);
    let message = text(&bad.stderr);
    assert!(message.contains("bad.mcc") && message.contains("100.0 mm"), "{message}");
    assert!(!folder.path().join("own.json").exists());

    write("comma.mcc", &DEPTH_DOSE.replace("1.2856E+00", "1,2856E+00"));
    let refused = fit(&["comma.mcc"]);
    assert_eq!(refused.status.code(), Some(2));
    let message = text(&refused.stderr);
    assert!(message.contains("comma.mcc, line 74") && message.contains("decimal point"), "{message}");
    assert_eq!(fit(&["pdd.mcc", "--depth-dose-bound", "50"]).status.code(), Some(2));
}
