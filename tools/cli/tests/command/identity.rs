//! Whose plan it is: in the exported DICOM where it is asked for, and nowhere else.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use super::{stillpoint, text};

#[allow(dead_code)]
#[path = "../../../../stages/planning/dicom/tests/fixture.rs"]
mod fixture;

/// What the patient's DICOM says of him.
const REPORTED: [&str; 3] = ["Secret", "SECRET-4711", "19500203"];

fn holds(path: &Path, word: &str) -> bool {
    std::fs::read(path).unwrap().windows(word.len()).any(|w| w == word.as_bytes())
}

#[test]
fn identity_is_kept_in_the_exported_dicom_alone_and_only_where_it_is_asked_for() {
    let (folder, source) = (tempfile::tempdir().unwrap(), fixture::folder());
    let from = source.path().to_str().unwrap();
    let import =
        ["case", "import", from, "--out", "new/small.case", "--prescribe", "PTV=20Gy", "--fractions", "5"];
    let out = stillpoint(folder.path(), &import);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let plan = |to: &str, more: &[&str]| {
        let asked = ["plan", "new/small.case", "--angles", "0,120,240", "--grid", "3mm", "--bixel", "5mm"];
        // The head of the fixture is a few voxels: shifts of 5 mm move it out of any plan.
        let asked = [&asked[..], &["--accept-check", "a phantom of a test"]].concat();
        stillpoint(folder.path(), &[&asked[..], &["--out", to], more].concat())
    };
    for (to, more) in [("nobody", &[][..]), ("kept", &["--keep-identity", from])] {
        let out = plan(to, more);
        assert!(out.status.success(), "{}", text(&out.stderr));
        let output_text = text(&out.stdout) + &text(&out.stderr);
        assert!(REPORTED.iter().all(|word| !output_text.contains(word)), "{output_text}");
    }
    assert!(REPORTED.iter().all(|word| !holds(&folder.path().join("new/small.case"), word)));
    for entry in std::fs::read_dir(folder.path().join("kept")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        let nobody = folder.path().join("nobody").join(name);
        let dicom = name.ends_with(".dcm");
        for word in REPORTED {
            assert_eq!(holds(&path, word), dicom, "{name}: {word}");
            assert!(!holds(&nobody, word), "{name}: {word}");
        }
        assert!(dicom || std::fs::read(&path).unwrap() == std::fs::read(&nobody).unwrap(), "{name}");
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o600, "{name}");
    }
}

#[test]
fn the_identity_of_another_study_is_refused() {
    let (folder, source, other) =
        (tempfile::tempdir().unwrap(), fixture::folder(), tempfile::tempdir().unwrap());
    let mut image = fixture::ct(0);
    fixture::put(&mut image, dicom_dictionary_std::tags::STUDY_INSTANCE_UID, dicom_core::VR::UI, "1.2.3.99");
    std::fs::write(other.path().join("ct.dcm"), fixture::file(&image)).unwrap();
    let [from, other] = [source.path(), other.path()].map(|path| path.to_str().unwrap());
    let import = ["case", "import", from, "--out", "small.case", "--prescribe", "PTV=20Gy"];
    assert!(stillpoint(folder.path(), &import).status.success());
    let out = stillpoint(folder.path(), &["plan", "small.case", "--angles", "0", "--keep-identity", other]);
    let output_text = text(&out.stderr);
    assert!(
        out.status.code() == Some(1)
            && output_text.contains(fixture::STUDY)
            && !output_text.contains("Secret"),
        "{output_text}"
    );
    assert!(!folder.path().join("plans").exists());
}
