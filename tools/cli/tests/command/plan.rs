//! Plans: beams chosen, files written, the same for any number of threads.

use std::path::Path;
use std::process::Command;

use dicom_core::{DataElement, PrimitiveValue, VR};
use dicom_dictionary_std::tags;
use serde_json::Value;
use stillpoint_network::{Model, Sizes};

use super::{stillpoint, text};

/// Coarse, so that all beams of the ring and the dose of the plan are made ready in a moment.
const COARSE: [&str; 6] = ["--grid", "12mm", "--bixel", "20mm", "--dose-grid", "5mm"];
/// Coarse, with the dose on the usual grid.
const FINE_DOSE: [&str; 4] = ["--grid", "12mm", "--bixel", "20mm"];

fn plan(folder: &Path, arguments: &[&str]) -> Value {
    plan_of(folder, &[arguments, &COARSE].concat())
}

fn plan_of(folder: &Path, arguments: &[&str]) -> Value {
    let accepted = ["--accept-check", "too coarse to judge"];
    let arguments = [&["plan"], arguments, &["--doses", "doses", "--json"], &accepted[..]].concat();
    let out = stillpoint(folder, &arguments);
    assert!(out.status.success(), "{}", text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn angles(reported: &Value) -> Vec<f64> {
    reported["beams"].as_array().unwrap().iter().map(|b| b["gantry_deg"].as_f64().unwrap()).collect()
}

#[test]
fn a_plan_is_a_folder_and_its_bytes_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let asked = ["--beams", "3", "--budget", "8", "--method", "exchange"];
    let reported = plan(folder.path(), &[&asked[..], &["--out", "one", "--threads", "1"]].concat());
    plan(folder.path(), &[&asked[..], &["--out", "three", "--threads", "3"]].concat());
    assert_eq!(angles(&reported).len(), 3);
    assert_eq!(reported["searches"][0]["solves"], 8);
    let names = [
        "plan.json",
        "plan.html",
        "dvh.svg",
        "objective.svg",
        "tree.svg",
        "axial.png",
        "coronal.png",
        "sagittal.png",
        "rtplan.dcm",
        "rtdose.dcm",
        "rtstruct.dcm",
    ];
    assert_eq!(reported["files"].as_array().unwrap().len(), names.len());
    for name in names {
        let read = |folder_name: &str| std::fs::read(folder.path().join(folder_name).join(name)).unwrap();
        assert!(read("one") == read("three"), "{name}");
    }
    let requested = &reported["wanted"][0];
    assert_eq!(
        (&requested["structure"], requested["objectives"].as_array().unwrap().len()),
        (&Value::from("PTV"), 3)
    );
    let under = serde_json::json!({ "underdose": { "dose_gy": 78.0, "weight": 1600.0 } });
    assert_eq!(requested["objectives"][0], under, "a share of the prescription is told in gray");
    let limits = reported["protocol"]["limits"].as_array().unwrap();
    assert_eq!(reported["protocol"]["name"], "prostate");
    let of_rectum: Vec<&Value> = limits.iter().filter(|l| l["structure"] == "Rectum").collect();
    assert_eq!(of_rectum.len(), 5);
    assert!(of_rectum.iter().all(|l| l["value"].is_number() && l["passed"].is_boolean()), "{of_rectum:?}");
    assert!(limits.iter().any(|l| l["structure"] == "PenileBulb" && l["passed"].is_null()), "{limits:?}");
    let ptv = reported["structures"].as_array().unwrap().iter().find(|s| s["name"] == "PTV").unwrap().clone();
    assert!(ptv["mean_gy"].as_f64().unwrap() > 70.0 && ptv["conformity"].as_f64().unwrap() > 0.4, "{ptv}");
    two_plans_stand_beside_each_other_and_others_are_refused(folder.path(), &reported);
}

/// A machine that needs a hundred times the monitor units.
fn weak_machine() -> String {
    let shipped = std::fs::read_to_string(super::root().join("stages/planning/plan/data/generic_6mv.json"));
    let weak = shipped.unwrap().replace(r#""mu_per_weight":100.0"#, r#""mu_per_weight":10000.0"#);
    assert!(weak.contains("10000.0"));
    weak
}

#[test]
fn beams_and_arcs_that_the_leaves_cannot_shape_are_refused_before_doses_and_solve() {
    let folder = tempfile::tempdir().unwrap();
    let shipped =
        std::fs::read_to_string(super::root().join("stages/planning/plan/data/generic_6mv.json")).unwrap();
    let mut machine: Value = serde_json::from_str(&shipped).unwrap();
    machine["collimator"]["over_travel_mm"] = 20.0.into();
    machine["collimator"]["reach_mm"] = 20.0.into();
    std::fs::write(folder.path().join("short.json"), machine.to_string()).unwrap();
    let plan = |more: &[&str]| {
        let fixed = ["plan", "--machine", "short.json", "--out", "one"];
        stillpoint(folder.path(), &[&fixed[..], &COARSE, more].concat())
    };
    let has_doses =
        || std::fs::read_dir(folder.path().join("doses")).is_ok_and(|mut files| files.next().is_some());
    let with_doses = ["--doses", "doses"];
    for (chosen, message) in [
        (&["--angles", "0,72@30"][..], "leaves: the beam at 0 degrees: the bixel at x = -"),
        (
            &["--beams", "3"],
            "but the leaves shape fields of +-20 mm along x and -200 to 200 mm along z; plan with another",
        ),
        (
            &["--angles", "90", "--engine", "superposition"],
            "with --fluence-only the fluence is not sequenced",
        ),
    ] {
        let out = plan(&[chosen, &with_doses].concat());
        assert_eq!(out.status.code(), Some(1), "{chosen:?}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(message), "{chosen:?}: {}", text(&out.stderr));
        assert!(!has_doses(), "{chosen:?}: doses were computed");
    }
    let arc = plan(&["--arc", "60..84cw"]);
    assert!(
        !arc.status.success() && text(&arc.stderr).contains("leaves are withdrawn to 20 mm"),
        "{}",
        text(&arc.stderr)
    );
    let fluence = plan(
        &[&["--angles", "0,72", "--fluence-only", "--accept-check", "coarse"][..], &with_doses].concat(),
    );
    assert!(fluence.status.success() && has_doses(), "{}", text(&fluence.stderr));
}

#[test]
fn a_plan_that_the_check_refuses_is_not_exported_unless_a_person_says_why() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("weak.json"), weak_machine()).unwrap();
    let plan = |more: &[&str]| {
        let fixed = ["plan", "--angles", "0,72,144,216,288", "--machine", "weak.json", "--out", "one"];
        stillpoint(folder.path(), &[&fixed[..], &COARSE, more].concat())
    };
    let exported = |name: &str| folder.path().join("one").join(name).is_file();
    let read = || {
        let json = std::fs::read(folder.path().join("one/plan.json")).unwrap();
        stillpoint_plan::plan_file::PlanFile::from_json(&json).unwrap().check.unwrap()
    };
    assert_eq!(plan(&["--accept-check", " "]).status.code(), Some(2));

    let taken = plan(&["--accept-check", "a machine of a test"]);
    assert!(taken.status.success(), "{}", text(&taken.stderr));
    let check = read();
    assert_eq!(check.accepted.as_deref(), Some("a machine of a test"));
    assert!(check.faults.iter().any(|fault| fault.contains("monitor units for a fraction")), "{check:?}");
    assert!(check.values.mu_per_cgy.unwrap() > check.bounds.mu_per_cgy, "{check:?}");
    assert!(["rtplan.dcm", "rtdose.dcm", "rtstruct.dcm"].map(exported) == [true; 3]);

    // A refused plan leaves no files of the plan before.
    let refused = plan(&[]);
    let output_text = text(&refused.stdout);
    assert_eq!(refused.status.code(), Some(6), "{output_text}");
    assert!(
        output_text.contains("plan check: refused") && output_text.contains("--accept-check REASON"),
        "{output_text}"
    );
    assert!(["rtplan.dcm", "rtdose.dcm", "rtstruct.dcm"].map(exported) == [false; 3]);
    assert!(exported("plan.html") && read().accepted.is_none());
}

/// One fraction of 20 Gy to the pelvis of seed 0.
fn single_fraction() -> Vec<u8> {
    use stillpoint_patient::case::{CaseParts, Prescription, phantom, to_bytes};

    let pelvis = phantom(0).unwrap();
    let case = stillpoint_patient::case::Case::new(CaseParts {
        name: "single".into(),
        grid: *pelvis.grid(),
        hu: pelvis.hu().to_vec(),
        structures: pelvis.structures().to_vec(),
        isocentre_mm: None,
        prescription: vec![Prescription { structure: "PTV".into(), dose_gy: 20.0 }],
        fractions: Some(1),
        reference_dose_gy: None,
        uids: None,
        provenance: "a test".into(),
    });
    to_bytes(&case.unwrap()).unwrap().0
}

#[test]
fn limits_for_fractions_of_2_gy_do_not_pass_for_one_of_20_gy() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("single.case"), single_fraction()).unwrap();
    let own =
        "name: own\nfraction: 1.7 to 2.3 Gy\nlimits:\n  - { structure: Rectum, limit: \"V50Gy[%] <= 50\" }\n";
    std::fs::write(folder.path().join("own.yaml"), own).unwrap();
    let asked = ["single.case", "--angles", "0,72,144,216,288", "--fluence-only", "--out", "one"];
    let reported = plan(folder.path(), &asked);
    assert!(reported["protocol"].is_null(), "{}", reported["protocol"]);
    let page = std::fs::read_to_string(folder.path().join("one/plan.html")).unwrap();
    assert!(page.contains("the protocol prostate is not applied") && page.contains("1 of 20.00 Gy"));
    for stated in
        ["20.00 Gy, 20.00 Gy a fraction", "isocentre, mm of the patient", "Objectives, in the order"]
    {
        assert!(page.contains(stated), "{stated}");
    }
    let refused = stillpoint(folder.path(), &[&["plan"][..], &asked, &["--protocol", "own.yaml"]].concat());
    let output_text = text(&refused.stderr);
    assert!(
        refused.status.code() == Some(2) && output_text.contains("own.yaml: the limits of the protocol own"),
        "{output_text}"
    );
}

#[test]
fn couch_angles_are_searched_from_the_best_beams_without_them() {
    let folder = tempfile::tempdir().unwrap();
    let out = stillpoint(folder.path(), &["case", "phantom", "--site", "head", "--seed", "0", "--out", "."]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let asked = ["head-0.case", "--beams", "3", "--budget", "8", "--engine", "pencil", "--fluence-only"];
    let reported = plan(folder.path(), &[&asked[..], &["--couch", "30", "--out", "turned"]].concat());
    let couch = &reported["couch"];
    let number = |name: &str| couch[name].as_f64().unwrap();
    assert!(number("objective") <= number("coplanar_objective"), "{couch}");
    assert!(number("doses") < number("candidates") && number("most_deg") == 30.0, "{couch}");
    let searches = reported["searches"].as_array().unwrap();
    assert_eq!((searches.len(), &searches[1]["objective"]), (2, &couch["objective"]));
    assert!(searches[1]["solves"].as_u64().unwrap() <= 8);
    let tried = searches[1]["history"].as_array().unwrap().iter();
    assert!(tried.filter(|solve| solve.get("couches_deg").is_some()).count() > 0, "{}", searches[1]);
    let beams = reported["beams"].as_array().unwrap();
    let couches = beams.iter().map(|beam| beam.get("couch_deg").map_or(0.0, |deg| deg.as_f64().unwrap()));
    assert!(couches.clone().count() == 3 && couches.clone().all(|deg| deg.abs() <= 30.0), "{beams:?}");
    // A build that knows no couch angles refuses the file.
    let is_turned = couches.clone().any(|deg| deg != 0.0);
    assert!(is_turned && reported["version"] == 2, "{beams:?}");
    // The plan is that of its beams.
    let difference = reported["objective"].as_f64().unwrap() / number("objective") - 1.0;
    assert!(difference.abs() < 1e-5, "{difference}");
    // A pelvis ends where its images end: what such a beam crosses before is not known.
    let out = stillpoint(
        folder.path(),
        &[&["plan", "--angles", "0,90@-30,240", "--out", "cut"], &COARSE[..]].concat(),
    );
    assert!(
        !out.status.success() && text(&out.stderr).contains("by the end of the images"),
        "{}",
        text(&out.stderr)
    );
    for (option, wrong) in [
        ("--couch", "200"),
        ("--couch", "10"),
        ("--couch", "wide"),
        ("--angles", "0,72@"),
        ("--angles", "0@5,0@5"),
    ] {
        let out = stillpoint(folder.path(), &["plan", option, wrong]);
        assert_eq!(out.status.code(), Some(2), "{option} {wrong}");
        assert!(text(&out.stderr).contains(wrong), "{}", text(&out.stderr));
    }
}

#[test]
fn leaves_in_progress_are_part_of_a_plan_and_refused_where_a_method_has_none() {
    let folder = tempfile::tempdir().unwrap();
    let asked = ["--beams", "3", "--budget", "8", "--method", "search", "--out", "wide", "--leaves", "4"];
    let reported = plan(folder.path(), &asked);
    assert_eq!(
        (&reported["searches"][0]["leaves"], &reported["searches"][0]["solves"]),
        (&4.into(), &8.into())
    );
    let page = std::fs::read_to_string(folder.path().join("wide/plan.html")).unwrap();
    assert!(page.contains("The search by search with 4 leaves under way"));
    for (method, leaves, reason) in
        [("greedy", "2", "takes no number of leaves"), ("search", "65", "1 to 64")]
    {
        let out = stillpoint(folder.path(), &["plan", "--method", method, "--leaves", leaves]);
        assert!(out.status.code() == Some(2) && text(&out.stderr).contains(reason), "{}", text(&out.stderr));
    }
}

/// The operator `plan.optimizer` gives these bytes, too: `stages/planning/planner/tests/recipe.rs`.
#[test]
fn the_command_gives_the_plan_of_the_recipe_of_the_library() {
    use stillpoint_patient::case::phantom;
    use stillpoint_plan::recipe::{PlanRequest, SetupSpec, plan as of_library};

    let folder = tempfile::tempdir().unwrap();
    let asked = ["--beams", "3", "--budget", "5", "--seed", "7", "--out", "one"];
    plan(folder.path(), &asked);
    let written = std::fs::read(folder.path().join("one/plan.json")).unwrap();
    let written = stillpoint_plan::plan_file::PlanFile::from_json(&written).unwrap();
    let spec = SetupSpec { grid_mm: 12.0, bixel_mm: 20.0, ..SetupSpec::shipped().unwrap() };
    let request = PlanRequest { beams: 3, budget: 5, seed: 7, ..PlanRequest::default() };
    let planned = of_library(phantom(0).unwrap(), spec, &request).unwrap();
    assert_eq!(written.angles_deg(), planned.angles_deg());
    assert_eq!(written.objective.to_bits(), planned.best().cost.to_bits());
    for (beam, number) in written.beams.iter().zip(planned.best().beams.beams()) {
        let weights: Vec<f64> = beam.bixels_x_z_mm_weight.iter().map(|[_, _, weight]| *weight).collect();
        assert_eq!(weights, planned.best().weights_of(*number).unwrap());
    }
}

/// A DVH point and an equivalent uniform dose are optimised by their costs; the plan says what they truly came to.
#[test]
fn a_chest_is_searched_by_pencil_beams_and_planned_by_superposition_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let case = stillpoint(folder.path(), &["case", "phantom", "--site", "lung", "--out", "."]);
    assert!(case.status.success(), "{}", text(&case.stderr));
    let asked = ["lung-0.case", "--beams", "2", "--method", "equidistant", "--budget", "3", "--fluence-only"];
    let coarse = ["--grid", "15mm", "--bixel", "20mm", "--dose-grid", "5mm"];
    let of = |more: &[&str]| plan_of(folder.path(), &[&asked[..], &coarse, more].concat());
    let auto = of(&["--out", "auto", "--threads", "1"]);
    assert_eq!(
        (&auto["dose"]["engine"], &auto["dose"]["searched_by"]),
        (&"superposition".into(), &"pencil".into())
    );
    assert_eq!(auto["dose"]["low_density"]["caution"], Value::Null);
    assert_eq!(
        auto["searches"][0]["history"].as_array().unwrap().len(),
        3,
        "the history is that of the search"
    );
    let found = auto["searches"][0]["objective"].as_f64().unwrap();
    assert!(auto["objective"].as_f64().unwrap() > found, "pencil beams promise too much in lung");
    of(&["--out", "three", "--threads", "3"]);
    let read = |out: &str| std::fs::read(folder.path().join(out).join("plan.json")).unwrap();
    assert_eq!(read("auto"), read("three"));
    let pencil = of(&["--out", "pencil", "--engine", "pencil"]);
    assert_eq!(pencil["objective"].as_f64().unwrap().to_bits(), found.to_bits());
    assert!(
        pencil["dose"]["low_density"]["caution"].is_string() && pencil["dose"].get("searched_by").is_none()
    );
}

#[test]
fn another_optimiser_gets_the_matrix_and_its_weights_become_the_plan() {
    let folder = tempfile::tempdir().unwrap();
    let angles = ["--angles", "0,120,240", "--fluence-only"];
    let solved = plan(folder.path(), &[&angles[..], &["--out", "solved"]].concat());
    let export =
        [&["plan", "export"], &angles[..], &COARSE, &["--out", "matrix", "--doses", "doses"]].concat();
    let out = stillpoint(folder.path(), &export);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let matrix = folder.path().join("matrix");
    fn array<T: npyz::Deserialize>(path: &Path) -> Vec<T> {
        npyz::NpyFile::new(&std::fs::read(path).unwrap()[..]).unwrap().into_vec().unwrap()
    }
    let data: Vec<f32> = array(&matrix.join("dose-data.npy"));
    let indices: Vec<i32> = array(&matrix.join("dose-indices.npy"));
    let starts: Vec<i64> = array(&matrix.join("dose-starts.npy"));
    let problem: Value =
        serde_json::from_slice(&std::fs::read(matrix.join("problem.json")).unwrap()).unwrap();
    let bixels = std::fs::read_to_string(matrix.join("bixels.csv")).unwrap();
    let [rows, columns] = [0, 1].map(|axis| problem["shape"][axis].as_u64().unwrap() as usize);
    assert_eq!((starts.len(), bixels.lines().count()), (rows + 1, columns + 1));
    assert!(data.len() == indices.len() && indices.iter().all(|column| (*column as usize) < columns));

    // The weights of the plan, in the order of the bixels, make the same plan, as numbers of NumPy and as text.
    let of_beams = solved["beams"].as_array().unwrap().iter();
    let of_bixels = of_beams.flat_map(|beam| beam["bixels_x_z_mm_weight"].as_array().unwrap());
    let weights: Vec<f64> = of_bixels.map(|bixel| bixel[2].as_f64().unwrap()).collect();
    let lines: Vec<String> = weights.iter().map(f64::to_string).collect();
    std::fs::write(folder.path().join("weights.txt"), lines.join("\n")).unwrap();
    let evaluate = |weights: &str, out: &str| {
        let accepted = ["--accept-check", "too coarse to judge", "--json"];
        let given = ["plan", "evaluate", "--weights", weights, "--out", out, "--doses", "doses"];
        stillpoint(folder.path(), &[&given, &angles[..], &COARSE, &accepted].concat())
    };
    let out = evaluate("weights.txt", "given");
    assert!(out.status.success(), "{}", text(&out.stderr));
    let given: Value = serde_json::from_slice(&out.stdout).unwrap();
    let near = |a: &Value, b: &Value, part: f64| {
        let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
        assert!((a - b).abs() <= part * b.abs(), "{a} and {b}");
    };
    near(&given["objective"], &solved["objective"], 1e-9);
    assert_eq!(given["structures"], solved["structures"]);
    assert_eq!((&given["given_weights"], &given["searches"][0]["solves"]), (&true.into(), &0.into()));
    assert_eq!((solved.get("given_weights"), &solved["searches"][0]["solves"]), (None, &1.into()));
    // The doses of the matrix are those that the objectives judge: a target has its prescription about.
    let target = &problem["prescription"][0];
    let of_target = |structure: &&Value| structure["name"] == target["structure"];
    let structure = problem["structures"].as_array().unwrap().iter().find(of_target).unwrap();
    let dose_of = |row: &Value| -> f64 {
        let row = row.as_u64().unwrap() as usize;
        let entries = starts[row] as usize..starts[row + 1] as usize;
        entries.map(|entry| f64::from(data[entry]) * weights[indices[entry] as usize]).sum()
    };
    let doses: Vec<f64> = structure["voxels"].as_array().unwrap().iter().map(dose_of).collect();
    let mean = doses.iter().sum::<f64>() / doses.len() as f64;
    let prescribed = target["dose_gy"].as_f64().unwrap();
    assert!((0.9..1.1).contains(&(mean / prescribed)), "{mean} Gy of {prescribed} Gy");

    // Worse weights cost more, and the certificate says so.
    let worse: Vec<String> = weights.iter().map(|weight| (0.9 * weight).to_string()).collect();
    std::fs::write(folder.path().join("worse.txt"), worse.join("\n")).unwrap();
    let out = evaluate("worse.txt", "worse");
    let worse: Value = serde_json::from_slice(&out.stdout).unwrap();
    let [worse_cost, cost] = [&worse, &solved].map(|plan| plan["objective"].as_f64().unwrap());
    assert!(worse_cost > 1.1 * cost && worse["excess_at_most"].as_f64().unwrap() >= worse_cost - cost);
    // What is no list of weights of these bixels is refused.
    for (content, reason) in [("1\n2\n", "2 numbers"), ("1\nx\n", "line 2"), ("", "0 numbers")] {
        std::fs::write(folder.path().join("wrong.txt"), content).unwrap();
        let out = evaluate("wrong.txt", "wrong");
        assert!(!out.status.success() && text(&out.stderr).contains(reason), "{}", text(&out.stderr));
    }
    std::fs::write(folder.path().join("wrong.txt"), lines.join("\n").replacen(&lines[0], "-1", 1)).unwrap();
    assert!(text(&evaluate("wrong.txt", "wrong").stderr).contains("finite and not negative"));
}

#[test]
fn a_plan_that_starts_from_another_one_is_the_same_as_without_and_takes_fewer_steps() {
    let folder = tempfile::tempdir().unwrap();
    let other = r#"{"objectives": [{"match": ["Rectum"], "wanted": [{"mean_dose": {"dose": "15 Gy", "weight": 30}}]}]}"#;
    std::fs::write(folder.path().join("other.json"), other).unwrap();
    plan(folder.path(), &["--angles", "0,120,240", "--fluence-only", "--out", "first"]);
    let of = |name: &str, asked: &[&str]| {
        let more = ["--objectives", "other.json", "--fluence-only", "--out", name];
        plan(folder.path(), &[asked, &more[..]].concat())
    };
    let (alone, started) = (of("alone", &["--angles", "0,120,240"]), of("started", &["--start", "first"]));
    let number = |plan: &Value, key: &str| plan[key].as_f64().unwrap();
    let [a, b] = [&alone, &started].map(|plan| number(plan, "objective"));
    let excess = number(&alone, "excess_at_most").max(number(&started, "excess_at_most"));
    assert!((a - b).abs() <= excess, "{a} and {b}, at most {excess} above the optimum");
    let [a, b] = [&alone, &started].map(|plan| number(plan, "newton_steps"));
    assert!(b < a, "{b} steps with a start, {a} without");
    assert_eq!(started["start"]["name"], started["case"]["name"]);
    assert!(alone.get("start").is_none());
    // Bixels of another width begin with the weight at their centre.
    let mut wide: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("first/plan.json")).unwrap()).unwrap();
    wide["dose"]["bixel_mm"] = 60.0.into();
    std::fs::write(folder.path().join("wide.json"), wide.to_string()).unwrap();
    let from_wide = of("from-wide", &["--start", "wide.json"]);
    let difference = (number(&from_wide, "objective") - number(&started, "objective")).abs();
    assert!(difference <= excess.max(number(&from_wide, "excess_at_most")), "{difference}");
    // What cannot be a start is refused with the reason.
    let file = std::fs::read_to_string(folder.path().join("first/plan.json")).unwrap();
    let negative = {
        let mut plan: Value = serde_json::from_str(&file).unwrap();
        for bixel in plan["beams"][0]["bixels_x_z_mm_weight"].as_array_mut().unwrap() {
            bixel[2] = (-1.0).into();
        }
        plan.to_string()
    };
    let none = {
        let mut plan: Value = serde_json::from_str(&file).unwrap();
        for beam in plan["beams"].as_array_mut().unwrap() {
            beam["bixels_x_z_mm_weight"] = serde_json::json!([]);
        }
        plan.to_string()
    };
    for (content, reason) in [
        ("{}", "not a plan.json"),
        (&file[..file.len() / 2], "not a plan.json"),
        (&negative, "finite and not negative"),
        (&none, "plan without a start"),
    ] {
        std::fs::write(folder.path().join("wrong.json"), content).unwrap();
        let given = ["plan", "--start", "wrong.json", "--out", "wrong", "--doses", "doses", "--fluence-only"];
        let out = stillpoint(folder.path(), &[&given[..], &COARSE].concat());
        assert!(out.status.code() == Some(2) && text(&out.stderr).contains(reason), "{}", text(&out.stderr));
    }
    let out = stillpoint(folder.path(), &["plan", "--start", "first", "--angles", "0"]);
    assert!(out.status.code() == Some(2) && text(&out.stderr).contains("--angles"), "{}", text(&out.stderr));
}

#[test]
fn the_true_value_of_each_limit_of_an_objective_stands_beside_its_cost() {
    let folder = tempfile::tempdir().unwrap();
    let own = r#"{"objectives": [{"match": ["Rectum"], "wanted": [
        {"dvh_point": {"limit": "V40Gy <= 20 %", "weight": 50}},
        {"geud": {"a": 8, "limit": "<= 50 %", "weight": 20}},
        {"overdose": {"dose": "70 Gy", "weight": 5}}]}]}"#;
    std::fs::write(folder.path().join("own.json"), own).unwrap();
    let asked =
        ["--angles", "0,72,144,216,288", "--objectives", "own.json", "--fluence-only", "--out", "own"];
    let reported = plan(folder.path(), &asked);
    let of_rectum: Vec<&Value> =
        reported["objectives"].as_array().unwrap().iter().filter(|o| o["structure"] == "Rectum").collect();
    assert_eq!(of_rectum.len(), 3);
    let (point, geud) = (&of_rectum[0], &of_rectum[1]);
    assert_eq!(
        (&point["measured"]["quantity"], &point["measured"]["limit"]),
        (&"V40Gy".into(), &20.0.into())
    );
    assert_eq!(
        (&geud["measured"]["quantity"], &geud["measured"]["limit"]),
        (&"gEUD(8)".into(), &39.0.into())
    );
    assert!(of_rectum[2]["measured"].is_null() && of_rectum[2]["cost"].as_f64().unwrap() >= 0.0);
    // The same volume as in the histogram of the plan.
    let histograms = reported["histograms"].as_array().unwrap();
    let rectum = histograms.iter().find(|h| h["structure"] == "Rectum").unwrap();
    let step = (40.0 / rectum["step_gy"].as_f64().unwrap()).floor() as usize;
    let volume = |at: usize| rectum["volumes_percent"][at].as_f64().unwrap();
    let value = point["measured"]["value"].as_f64().unwrap();
    assert!(volume(step + 1) - 1e-3 <= value && value <= volume(step) + 1e-3, "{value} {}", volume(step));
    assert_eq!(point["met"], value <= 20.0);
    let sum: f64 =
        reported["objectives"].as_array().unwrap().iter().map(|o| o["cost"].as_f64().unwrap()).sum();
    let uneven = reported["modulation"].as_f64().unwrap();
    assert!(uneven > 0.0, "{uneven}");
    let (whole, sum) = (reported["objective"].as_f64().unwrap(), sum + uneven);
    assert!((sum - whole).abs() <= 1e-6 * whole, "{sum} {whole}");
    let page = std::fs::read_to_string(folder.path().join("own/plan.html")).unwrap();
    assert!(
        page.contains("gEUD(8) &lt;= 39 Gy") && page.contains("V40Gy &lt;= 20 %"),
        "no true values on the page"
    );
    let printed =
        stillpoint(folder.path(), &[&["plan"], &asked[..], &COARSE, &["--doses", "doses"]].concat());
    let printed = text(&printed.stdout);
    assert!(printed.contains("gEUD(8) <= 39 Gy") && printed.contains("V40Gy <= 20 %"), "{printed}");
}

#[test]
fn tissue_denser_than_the_table_of_the_machine_is_reported_with_its_volume() {
    let folder = tempfile::tempdir().unwrap();
    let shipped = include_str!("../../../../stages/planning/plan/data/generic_6mv.json");
    let short = shipped.replace(",[3000.0,2.492]", "");
    assert_ne!(short, shipped);
    std::fs::write(folder.path().join("short.json"), short).unwrap();
    let asked = ["plan", "--angles", "0", "--doses", "doses"];
    let out = |machine: &[&str]| {
        let out = stillpoint(folder.path(), &[&asked, &COARSE[..], machine].concat());
        assert!(out.status.success(), "{}", text(&out.stderr));
        format!("{}{}", text(&out.stdout), text(&out.stderr))
    };
    let reported = out(&["--machine", "short.json"]);
    assert!(reported.contains("cm3 of the patient have above 100 HU"), "{reported}");
    assert!(!out(&[]).contains("of the patient have above"), "the shipped table ends at 3000 HU");
}

#[test]
fn every_method_is_compared_with_one_budget_and_set_ups_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let asked = ["--beams", "3", "--budget", "6", "--compare", "--robust", "5mm", "--out", "both"];
    let reported = plan(folder.path(), &asked);
    let searches = reported["searches"].as_array().unwrap();
    assert_eq!(searches.len(), 9);
    let cost = |s: &Value| s["objective"].as_f64().unwrap();
    let least = searches.iter().map(cost).fold(f64::INFINITY, f64::min);
    assert_eq!(cost(&reported), least);
    assert!(searches.iter().all(|s| s["solves"].as_u64().unwrap() <= 6));
    let setups = reported["setups"].as_array().unwrap();
    assert_eq!(setups.len(), 6);
    assert_eq!(setups[1]["patient_moved_mm"], serde_json::json!([5.0, 0.0, 0.0]));
    assert!(setups[0]["structures"].as_array().unwrap().iter().all(|s| s["name"] != "Body"));
    let svg = std::fs::read_to_string(folder.path().join("both/compare.svg")).unwrap();
    assert!(
        ["greedy", "annealing", "columns", "search", "network", "best objective"]
            .iter()
            .all(|word| svg.contains(word))
    );
}

#[test]
fn the_robust_game_is_played_by_any_method_and_tells_its_worst_case() {
    let folder = tempfile::tempdir().unwrap();
    let asked = ["--beams", "3", "--budget", "9", "--method", "search", "--robust", "5mm"];
    let game = [&asked[..], &["--robust-by", "worst"]].concat();
    let reported = plan(folder.path(), &[&game[..], &["--out", "one", "--threads", "1"]].concat());
    plan(folder.path(), &[&game[..], &["--out", "three", "--threads", "3"]].concat());
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(read("one/plan.json") == read("three/plan.json"));
    // Nine solves less the six answers to each, of a fiftieth of a solve.
    assert_eq!(reported["searches"][0]["solves"], 8);
    let answer = &reported["robust_game"];
    let costs: Vec<f64> =
        answer["objectives_of_setups"].as_array().unwrap().iter().map(|c| c.as_f64().unwrap()).collect();
    assert_eq!((costs.len(), reported["setups"].as_array().unwrap().len()), (6, 6));
    let worst = answer["worst_objective"].as_f64().unwrap();
    let planned = reported["objective"].as_f64().unwrap();
    assert_eq!(costs.iter().copied().fold(planned, f64::max), worst);
    assert!(worst > planned, "5 mm off the target's edge costs: {worst} {planned}");
    assert_eq!(reported["searches"][0]["objective"].as_f64().unwrap(), worst);
    let page = String::from_utf8(read("one/plan.html")).unwrap();
    assert!(page.contains("Robust game: the objective is"));
    // Without the game the same options plan for the mean, and without a shift there is none to play.
    assert!(plan(folder.path(), &[&asked[..], &["--out", "mean"]].concat())["robust_game"].is_null());
    let turned = stillpoint(folder.path(), &["plan", "--robust", "--robust-by", "worst", "--couch", "30"]);
    assert!(turned.status.code() == Some(2) && text(&turned.stderr).contains("leave out --couch"));
    let alone = stillpoint(folder.path(), &["plan", "--robust-by", "worst"]);
    assert!(!alone.status.success() && text(&alone.stderr).contains("--robust"), "{}", text(&alone.stderr));
}

/// What pydicom reads of a plan and its dose.
const PRINT: &str = r#"
import sys, json, warnings, pydicom
from pydicom import config
config.settings.reading_validation_mode = config.RAISE
warnings.simplefilter('error')
plan, dose = (pydicom.dcmread(path) for path in sys.argv[1:3])
gray = dose.pixel_array * float(dose.DoseGridScaling)
print(json.dumps({
    'angles': [float(b.ControlPointSequence[0].GantryAngle) for b in plan.BeamSequence],
    'weights': [float(b.FinalCumulativeMetersetWeight) for b in plan.BeamSequence],
    'points': [len(b.ControlPointSequence) for b in plan.BeamSequence],
    'units': [float(b.BeamMeterset) for b in plan.FractionGroupSequence[0].ReferencedBeamSequence if 'BeamMeterset' in b],
    'isocentre': [float(v) for v in plan.BeamSequence[0].ControlPointSequence[0].IsocenterPosition],
    'description': plan.RTPlanDescription, 'patient': str(plan.PatientName) + str(dose.PatientID),
    'shape': list(gray.shape), 'origin': [float(v) for v in dose.ImagePositionPatient], 'largest': float(gray.max()),
    'belongs': dose.ReferencedRTPlanSequence[0].ReferencedSOPInstanceUID == plan.SOPInstanceUID,
}))
"#;

#[test]
fn pydicom_reads_the_exported_plan_and_dose() {
    let python = std::env::var("STILLPOINT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let probe = Command::new(&python).args(["-c", "import pydicom, numpy"]).output();
    if !probe.is_ok_and(|p| p.status.success()) {
        println!("skipped: {python} cannot import pydicom and numpy (set STILLPOINT_PYTHON to one that can)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let read = |asked: &[&str], name: &str| -> (Value, Value) {
        // Voxels of less than 0.03 cm3, so that D0.03cc is near the largest dose.
        let angles = ["--angles", "0,72,144,216,288", "--out", name, "--dose-grid", "3mm"];
        let reported = plan_of(folder.path(), &[&angles[..], &FINE_DOSE, asked].concat());
        let files = ["rtplan.dcm", "rtdose.dcm"].map(|file| folder.path().join(name).join(file));
        let out =
            Command::new(&python).args(["-c", PRINT]).args(&files).env("PYTHONUTF8", "1").output().unwrap();
        assert!(out.status.success(), "{}", text(&out.stderr));
        (reported, serde_json::from_slice(&out.stdout).unwrap())
    };
    let (reported, shaped) = read(&[], "shaped");
    dciodvfy_finds_no_error(&folder.path().join("shaped"));
    let leaves = &reported["leaves"];
    assert!(shaped["description"].as_str().unwrap().contains("step and shoot"));
    assert_eq!(shaped["weights"], serde_json::json!([1.0, 1.0, 1.0, 1.0, 1.0]));
    for (at, beam) in leaves["beams"].as_array().unwrap().iter().enumerate() {
        let units = [&beam["monitor_units"], &shaped["units"][at]].map(|v| v.as_f64().unwrap());
        assert!((units[0] - units[1]).abs() < 1e-6 * units[0], "{units:?}");
        assert_eq!(shaped["points"][at], 2 * beam["segments"].as_array().unwrap().len());
    }
    let body = leaves["structures"].as_array().unwrap().iter().find(|s| s["name"] == "Body").unwrap();
    let largest = shaped["largest"].as_f64().unwrap() / body["d0_03cc_gy"].as_f64().unwrap();
    assert!((1.0..1.05).contains(&largest), "the dose of the file is that of the segments: {largest}");
    let (reported, read) = read(&["--fluence-only"], "given");
    dciodvfy_finds_no_error(&folder.path().join("given"));
    assert_eq!((&reported["leaves"], &read["units"]), (&Value::Null, &serde_json::json!([])));
    assert_eq!(read["angles"], serde_json::json!([0.0, 72.0, 144.0, 216.0, 288.0]));
    let weights: f64 = read["weights"].as_array().unwrap().iter().map(|w| w.as_f64().unwrap()).sum();
    assert!((weights - 1.0).abs() < 1e-9, "{weights}");
    assert!(read["description"].as_str().unwrap().contains("not sequenced"));
    assert_eq!((&read["patient"], &read["belongs"]), (&Value::from(""), &Value::from(true)));
    let grid = &reported["dose"]["grid"];
    let counts: Vec<u64> =
        grid["counts"].as_array().unwrap().iter().rev().map(|n| n.as_u64().unwrap()).collect();
    assert_eq!(read["shape"], serde_json::json!(counts));
    let near = |a: &Value, b: &Value| (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-6;
    for axis in 0..3 {
        assert!(near(&read["origin"][axis], &grid["origin_mm"][axis]));
        assert!(near(&read["isocentre"][axis], &reported["isocentre_mm"][axis]));
    }
    let body = reported["structures"].as_array().unwrap().iter().find(|s| s["name"] == "Body").unwrap();
    let (largest, reported) = (read["largest"].as_f64().unwrap(), body["d0_03cc_gy"].as_f64().unwrap());
    assert!(largest >= reported && largest < 1.05 * reported, "{largest} {reported}");
}

/// dciodvfy of dicom3tools checks modules and attributes. Its version of 2022 ends on an assertion of its own for pixels of
/// 32 bits, which an RTDOSE may have, so it gets a copy of the dose with 16 bits.
/// Without the program there is nothing to check.
pub fn dciodvfy_finds_no_error(folder: &Path) {
    let program = std::env::var("STILLPOINT_DCIODVFY").unwrap_or_else(|_| "dciodvfy".to_owned());
    let short = folder.join("rtdose-16-bits.dcm");
    with_16_bits(&folder.join("rtdose.dcm"), &short);
    for file in [folder.join("rtplan.dcm"), folder.join("rtstruct.dcm"), short] {
        let Ok(out) = Command::new(&program).arg(&file).output() else { return };
        let output_text = text(&out.stdout) + &text(&out.stderr);
        assert!(
            !output_text.contains("Error") && output_text.contains("RT"),
            "{}: {output_text}",
            file.display()
        );
    }
}

/// Writes a dose of 32 bits with the upper half of each pixel alone.
fn with_16_bits(from: &Path, to: &Path) {
    let mut file = dicom_object::open_file(from).unwrap();
    assert_eq!(file.element(tags::BITS_ALLOCATED).unwrap().to_int::<u16>().unwrap(), 32);
    let pixels = file.element(tags::PIXEL_DATA).unwrap().to_bytes().unwrap();
    let upper: Vec<u16> = pixels.chunks_exact(4).map(|p| u16::from_le_bytes([p[2], p[3]])).collect();
    let scale = 65_536.0 * file.element(tags::DOSE_GRID_SCALING).unwrap().to_float64().unwrap();
    for (tag, bits) in [(tags::BITS_ALLOCATED, 16), (tags::BITS_STORED, 16), (tags::HIGH_BIT, 15_u16)] {
        file.put(DataElement::new(tag, VR::US, PrimitiveValue::from(bits)));
    }
    file.put(DataElement::new(tags::DOSE_GRID_SCALING, VR::DS, PrimitiveValue::from(format!("{scale:.9e}"))));
    file.put(DataElement::new(tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(upper.into())));
    file.write_to_file(to).unwrap();
}

/// Figures of dicompyler-core, from the structures and the dose of a plan alone. It counts the points of the dose whose
/// centres are inside a contour, those on its line too, and its own finer grid is half a point off; so it is given the
/// dose between the points of the file, every millimetre, none of them on a line.
const DICOMPYLER: &str = r#"
import sys, json, warnings
warnings.simplefilter('ignore')
import numpy, pydicom.dicomio
# dicompyler-core 0.5.6 takes the reader by the name that it had before pydicom 3.
pydicom.dicomio.read_file = pydicom.dcmread
from dicompylercore import dicomparser, dvhcalc
structures, dose = sys.argv[1:3]
file = pydicom.dcmread(dose)
levels, spacing, shift = file.pixel_array.astype(float), 1.0, 0.37
for axis in (1, 2):
    step, count = float(file.PixelSpacing[axis - 1]), levels.shape[axis]
    at = numpy.arange(shift, (count - 1) * step, spacing) / step
    low = numpy.minimum(at.astype(int), count - 2)
    part = (at - low).reshape([-1 if a == axis else 1 for a in range(3)])
    levels = numpy.take(levels, low, axis) * (1 - part) + numpy.take(levels, low + 1, axis) * part
x, y, z = [float(v) for v in file.ImagePositionPatient]
file.ImagePositionPatient, file.PixelSpacing = [x + shift, y + shift, z], [spacing, spacing]
file.Rows, file.Columns = levels.shape[1:]
file.PixelData = numpy.round(levels).astype('<u4').tobytes()
file.save_as(dose + '.fine')
found = {}
for number, region in dicomparser.DicomParser(structures).GetStructures().items():
    if region['name'] in sys.argv[3:]:
        dvh = dvhcalc.get_dvh(structures, dose + '.fine', number)
        at = lambda name: float(dvh.statistic(name).value)
        found[region['name']] = {
            'volume': float(dvh.volume), 'mean': float(dvh.mean),
            'doses': [at(name) for name in ('D98', 'D95', 'D50', 'D2')],
            'percents': [100 * at(f'V{gray}Gy') / float(dvh.volume) for gray in (10, 20, 30, 40, 50, 60, 70)],
        }
print(json.dumps(found))
"#;

/// An independent program that reads the exported structures and dose finds the figures that the plan tells.
#[test]
fn dicompyler_finds_the_told_figures() {
    let python = std::env::var("STILLPOINT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let probe = Command::new(&python).args(["-c", "import dicompylercore"]).output();
    if !probe.is_ok_and(|p| p.status.success()) {
        println!("skipped: {python} cannot import dicompylercore (set STILLPOINT_PYTHON to one that can)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let asked = [&["--angles", "0,72,144,216,288", "--out", "read"][..], &FINE_DOSE].concat();
    let reported = plan_of(folder.path(), &asked);
    let files = ["rtstruct.dcm", "rtdose.dcm"].map(|name| folder.path().join("read").join(name));
    let names = ["PTV", "CTV", "Rectum", "Bladder", "FemoralHeadL", "FemoralHeadR"];
    let out = Command::new(&python).args(["-c", DICOMPYLER]).args(&files).args(names).output().unwrap();
    assert!(out.status.success(), "{}", text(&out.stderr));
    let found: Value = serde_json::from_slice(&out.stdout).unwrap();
    for name in names {
        let figures = reported["leaves"]["structures"].as_array().unwrap();
        let reported = figures.iter().find(|f| f["name"] == name).unwrap();
        let (found, number) = (&found[name], |value: &Value| value.as_f64().unwrap());
        let near = |what: &str, found: &Value, reported: f64, most: f64| {
            assert!((number(found) - reported).abs() <= most, "{name}, {what}: {found} beside {reported}");
        };
        let cm3 = number(&reported["volume_cm3"]);
        near("cm3", &found["volume"], cm3, 0.01 * cm3);
        near("mean", &found["mean"], number(&reported["mean_gy"]), 0.5);
        for (at, what) in ["d98_gy", "d95_gy", "d50_gy", "d2_gy"].into_iter().enumerate() {
            near(what, &found["doses"][at], number(&reported[what]), 0.5);
        }
        for (at, volume) in reported["volumes"].as_array().unwrap().iter().enumerate() {
            near(
                &format!("V{}", volume["dose_gy"]),
                &found["percents"][at],
                100.0 * number(&volume["fraction"]),
                1.0,
            );
        }
    }
}

/// `a` is the plan in the folder `one`; a second plan of its case is made of it, so that none must be computed.
fn two_plans_stand_beside_each_other_and_others_are_refused(folder: &Path, a: &Value) {
    let compare = |arguments: &[&str]| stillpoint(folder, &[&["plan", "compare"], arguments].concat());
    let write = |name: &str, change: &dyn Fn(&mut Value)| {
        let mut other = a.clone();
        other["leaves"] = Value::Null;
        change(&mut other);
        std::fs::write(folder.join(name), other.to_string()).unwrap();
        other
    };
    let b = write("b.json", &|plan| plan["beams"][0]["gantry_deg"] = 356.into());
    let out = compare(&["one", "b.json", "--out", "both.html", "--json"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let reported: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(
        (&reported["case"]["hash"], &reported["same_objectives"]),
        (&a["case"]["hash"], &Value::from(true))
    );
    let [of_a, of_b] = [&reported["plans"][0], &reported["plans"][1]];
    assert_eq!(
        of_a["structures"], a["leaves"]["structures"],
        "figures of the segments, where there are some"
    );
    assert_eq!(of_a["monitor_units"], a["leaves"]["monitor_units"]);
    assert_eq!((&of_b["structures"], &of_b["segments"]), (&b["structures"], &Value::Null));
    assert_eq!(of_b["angles_deg"][0], 356.0);
    let page = std::fs::read_to_string(folder.join("both.html")).unwrap();
    for word in ["Two plans of", "result of A", "Paddick", "One plan is in segments", "356\u{b0}", "<svg"] {
        assert!(page.contains(word), "{word}");
    }
    assert!(!page.contains("src=") && !page.contains("http"), "the page stands alone");
    let out = compare(&["one", "b.json"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let d98 = format!("{:.1}", b["structures"][0]["d98_gy"].as_f64().unwrap());
    for word in ["objective of the fluence", "FemoralHeadL", "pass", "compare.html", &d98] {
        assert!(text(&out.stdout).contains(word), "{word}: {}", text(&out.stdout));
    }
    let refused = |change: &dyn Fn(&mut Value)| {
        write("c.json", change);
        let out = compare(&["one", "c.json"]);
        assert!(!out.status.success());
        text(&out.stderr)
    };
    let none = || serde_json::json!([]);
    for (output_text, why) in [
        (refused(&|plan| plan["case"]["hash"] = "0".into()), "the plans are of different cases"),
        (refused(&|plan| plan["prescription"] = none()), "c.json: the plan has no prescription"),
        (refused(&|plan| plan["histograms"] = none()), "an older build"),
        (refused(&|plan| plan["structures"][1]["volumes"] = none()), "not at the doses of"),
        (refused(&|plan| plan["objective"] = Value::Null), "c.json: this is not a plan.json"),
    ] {
        assert!(output_text.contains(why), "{output_text}");
    }
    assert!(text(&compare(&["one", "none"]).stderr).contains("none"));
}

#[test]
fn what_cannot_be_planned_is_said_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("wrong.json"), r#"{"objectives": [{"wanted": []}]}"#).unwrap();
    let output_text = |arguments: &[&str]| {
        let out = stillpoint(folder.path(), &[&["plan"], arguments].concat());
        assert!(!out.status.success(), "{arguments:?}");
        text(&out.stderr)
    };
    // A file that is not there is an error of who gave it, whatever it should hold.
    for missing in [
        &["none.case"][..],
        &["--objectives", "none.json"],
        &["--method", "network", "--network", "none.safetensors"],
    ] {
        let out = stillpoint(folder.path(), &[&["plan"], missing].concat());
        let output_text = text(&out.stderr);
        assert!(out.status.code() == Some(2) && output_text.contains("none."), "{missing:?}: {output_text}");
    }
    assert!(output_text(&["--beams", "19"]).contains("19 beams, 5 steps apart, do not fit"));
    assert!(output_text(&["--angles", "0,10,370"]).contains("two beams have the gantry angle 10 degrees"));
    assert!(output_text(&["--angles", "-40,nan"]).contains("--angles -40,nan: give degrees"));
    assert!(output_text(&["--grid", "5"]).contains("must be a number with its unit, mm"));
    assert!(
        output_text(&["--grid", "0mm"]).contains("the spacing of voxels is 0; it must be from 0.1 to 100")
    );
    for length in ["0.5mm", "6mm", "0mm", "2"] {
        assert!(output_text(&["--dose-grid", length]).contains("--dose-grid"), "{length}");
    }
    std::fs::write(folder.path().join("file"), "").unwrap();
    let out = output_text(&["--out", "file/plan"]);
    assert!(out.contains("give another folder with --out"), "{out}");
    assert!(!folder.path().join("doses").exists(), "nothing is computed before it is known where to write");
    assert!(output_text(&["--robust", "0mm"]).contains("above 0 mm"));
    assert!(output_text(&["--budget", "0"]).contains("allow at least 1"));
    assert!(output_text(&["--objectives", "wrong.json"]).contains("line 1 of the objectives"));
    assert!(output_text(&["--keep-identity", "."]).contains("does not come from DICOM"));
    let out = output_text(&["--method", "search", "--prior", "network", "--network", "file"]);
    assert!(out.contains("file: it is not a safetensors file"), "{out}");
    let out = output_text(&["--compare", "--network", "file"]);
    assert!(out.contains("file: it is not a safetensors file"), "{out}");
    assert!(output_text(&["--network", "file"]).contains("give one of them, too"));
    assert!(
        output_text(&["--method", "annealing", "--prior", "geometry"]).contains("annealing takes no prior")
    );
}

#[test]
fn a_trained_network_chooses_from_the_image_and_only_its_beams_get_doses() {
    let folder = tempfile::tempdir().unwrap();
    // Numbers without meaning, but a network.
    let sizes = Sizes { structure: 2, ring: 3, angle: 3, neighbour: 2, pair: 2, set: 2, layers: 2 };
    let some = |n: usize| (0..n).map(|i| 0.3 + 0.1 * ((7 * i) % 5) as f32).collect::<Vec<f32>>();
    let numbers = sizes.tensors().into_iter().map(|(_, shape)| some(shape.iter().product())).collect();
    let model = Model::new(sizes, numbers).unwrap();
    std::fs::write(folder.path().join("model"), model.to_safetensors().unwrap()).unwrap();
    let reported = plan(
        folder.path(),
        &["--method", "prior", "--prior", "network", "--network", "model", "--out", "one"],
    );
    assert_eq!(angles(&reported).len(), 5);
    assert_eq!(reported["searches"][0]["solves"], 1);
    let doses = std::fs::read_dir(folder.path().join("doses")).unwrap().count();
    assert!((5..20).contains(&doses), "{doses} doses, and the ring has 90 beams");
    // The network that comes with the project is another one.
    let shipped = plan(folder.path(), &["--method", "network", "--budget", "2", "--out", "two"]);
    assert_eq!(shipped["searches"][0]["solves"], 2);
    assert!(shipped["objective"].as_f64().unwrap() < reported["objective"].as_f64().unwrap());
}
