//! Patients: made, imported, shown.

use super::{stillpoint, text};

#[test]
fn a_made_case_is_shown_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let made = stillpoint(folder.path(), &["case", "phantom", "--out", "cases", "--seed", "2"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let shown =
        stillpoint(folder.path(), &["case", "show", "cases/pelvis-2.case", "--out", "pictures", "--json"]);
    assert!(shown.status.success(), "{}", text(&shown.stderr));
    let reported: serde_json::Value = serde_json::from_slice(&shown.stdout).unwrap();
    assert!(text(&made.stdout).contains(reported["hash"].as_str().unwrap()), "both say one hash");
    let names: Vec<_> =
        reported["structures"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["Body", "PTV", "Rectum", "Bladder", "FemoralHeadL", "FemoralHeadR", "CTV"]);
    for plane in ["axial", "coronal", "sagittal"] {
        let file = std::fs::File::open(folder.path().join(format!("pictures/{plane}.png"))).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let size = reader.next_frame(&mut pixels).unwrap();
        assert_eq!(size.width.max(size.height), 720);
        // The outline of the PTV, structure 1, goes round the cross at the isocentre.
        let red = pixels.chunks(3).filter(|p| *p == [255, 70, 60]).count();
        assert!(red > 100, "{plane}: {red} red pixels");
    }
}

#[test]
fn the_head_of_the_rigs_is_a_case_and_its_outline_a_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let done = stillpoint(folder.path(), arguments);
        assert!(done.status.success(), "{}", text(&done.stderr));
        text(&done.stdout)
    };
    run(&["case", "phantom", "--site", "head", "--out", "cases"]);
    let reported: serde_json::Value =
        serde_json::from_str(&run(&["case", "show", "cases/head-0.case", "--json"])).unwrap();
    let volume = |name: &str| {
        let mut structures = reported["structures"].as_array().unwrap().iter();
        structures.find(|s| s["name"] == name).unwrap()["volume_cm3"].as_f64().unwrap()
    };
    for (name, low, high) in
        [("Brain", 1100.0, 1600.0), ("Brainstem", 10.0, 40.0), ("SpinalCord", 8.0, 25.0), ("EyeL", 5.0, 8.0)]
    {
        assert!((low..high).contains(&volume(name)), "{name}: {} cm3", volume(name));
    }
    for name in ["head.ply", "head.stl"] {
        let output_text = run(&["case", "surface", "cases/head-0.case", "--out", name]);
        let bytes = std::fs::read(folder.path().join(name)).unwrap();
        let surface = stillpoint_patient::outline::read_surface(&bytes, None, None).unwrap();
        let inside = surface.mesh.volume_cm3();
        assert!(
            (inside / volume("Body") - 1.0).abs() < 0.01,
            "{output_text}: {inside} cm3 of {}",
            volume("Body")
        );
        let isocentre = reported["isocentre_mm"].as_array().unwrap();
        for (written, given) in surface.placing.isocentre_mm.iter().zip(isocentre) {
            assert!((written - given.as_f64().unwrap()).abs() < 1e-3, "{name}");
        }
    }
    let refused = stillpoint(folder.path(), &["case", "surface", "cases/head-0.case", "--out", "head.obj"]);
    assert_eq!((refused.status.code(), text(&refused.stderr).contains(".ply or .stl")), (Some(2), true));
}

#[test]
fn the_case_of_the_examples_is_made_by_one_command() {
    let folder = tempfile::tempdir().unwrap();
    let command = ["case", "phantom", "--site", "head", "--out", "."];
    let made = stillpoint(folder.path(), &[&command[..], &["--spacing", "4 mm"]].concat());
    assert!(made.status.success(), "{}", text(&made.stderr));
    let retained = std::fs::read(super::root().join("examples/data/head.case")).unwrap();
    assert!(std::fs::read(folder.path().join("head-0.case")).unwrap() == retained);
    for (site, spacing, output_text) in [
        ("head", "0.1 mm", "from 1 mm to 5 mm"),
        ("head", "4", "unit, mm"),
        ("pelvis", "4 mm", "for --site head"),
    ] {
        let refused = stillpoint(
            folder.path(),
            &["case", "phantom", "--site", site, "--out", ".", "--spacing", spacing],
        );
        assert_eq!(refused.status.code(), Some(2));
        assert!(text(&refused.stderr).contains(output_text), "{}", text(&refused.stderr));
    }
}

#[test]
fn a_case_is_imported_from_nrrd_and_faults_say_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let grid = "\"shape_xyz\": [3, 2, 2], \"spacing_mm\": [2, 2, 2], \"origin_mm\": [0, 0, 0]";
    let json = format!(
        "{{\"name\": \"tiny\", \"units\": \"mm\", \"axes\": \"LPS\", {grid}, \"ct\": \"ct.nrrd\", \"labels\": \"labels.nrrd\", \
         \"structures\": [{{\"name\": \"Target\", \"bit\": 0, \"type\": \"TARGET\"}}, \
         {{\"name\": \"Body\", \"bit\": 1, \"type\": \"EXTERNAL\"}}]}}"
    );
    let volume = |kind: &str, value: u8| {
        let header = format!(
            "NRRD0004\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: 3 2 2\n\
             space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (0,0,0)\nendian: little\nencoding: raw\n\n"
        );
        [header.into_bytes(), [value, 0].repeat(12)].concat()
    };
    std::fs::write(folder.path().join("tiny.json"), json).unwrap();
    std::fs::write(folder.path().join("ct.nrrd"), volume("int16", 40)).unwrap();
    std::fs::write(folder.path().join("labels.nrrd"), volume("uint16", 3)).unwrap();
    std::fs::write(
        folder.path().join("names.json"),
        r#"{"structures": [{"name": "PTV", "match": ["target"]}]}"#,
    )
    .unwrap();
    let run = |arguments: &[&str]| {
        let out = stillpoint(
            folder.path(),
            &[&["case", "import", "tiny.json", "--out", "tiny.case"], arguments].concat(),
        );
        (out.status.code(), text(&out.stdout) + &text(&out.stderr))
    };
    let (code, output_text) = run(&["--names", "names.json"]);
    assert_eq!(code, Some(0), "{output_text}");
    assert!(
        output_text.contains("note: \"Target\" is called \"PTV\"") && output_text.contains("targets PTV"),
        "{output_text}"
    );
    let (code, output_text) = run(&["--fractions", "30"]);
    assert!(
        code == Some(2) && output_text.contains("--fractions is for DICOM: change it in tiny.json"),
        "{output_text}"
    );
    let whole = volume("uint16", 3);
    std::fs::write(folder.path().join("labels.nrrd"), &whole[..whole.len() - 20]).unwrap();
    let (code, output_text) = run(&[]);
    assert!(
        code == Some(1) && output_text.contains("labels.nrrd") && output_text.contains("copy the file again"),
        "{output_text}"
    );
    let out = stillpoint(folder.path(), &["case", "show", "tiny.json"]);
    assert!(
        out.status.code() == Some(2) && text(&out.stderr).contains("stillpoint case import"),
        "{}",
        text(&out.stderr)
    );
}
