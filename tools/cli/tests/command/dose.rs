//! `stillpoint dose check`: a machine next to Monte Carlo.

use serde_json::Value;
use stillpoint_plan::dose::Machine;

use crate::{stillpoint, text};

/// The machine that comes with the project, changed.
fn machine(folder: &std::path::Path, change: impl FnOnce(&mut Value)) {
    let mut file = serde_json::to_value(Machine::shipped().unwrap().file()).unwrap();
    change(&mut file);
    std::fs::write(folder.join("own.json"), file.to_string()).unwrap();
}

#[test]
fn a_dose_check_prints_and_draws_every_place_and_tells_a_wrong_machine_by_its_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let check = |arguments: &[&str]| {
        stillpoint(folder.path(), &[&["dose", "check", "--phantom", "water"], arguments].concat())
    };
    let good = check(&[]);
    let printed = text(&good.stdout);
    assert_eq!(good.status.code(), Some(0), "{printed}{}", text(&good.stderr));
    assert!(printed.contains("4 of 4 bounds") && printed.contains("varian-6mv"), "{printed}");
    let page = std::fs::read_to_string(folder.path().join("dose-check.html")).unwrap();
    for field_cm in [1, 2, 5] {
        let drawn = format!("water, {field_cm} cm, 61 mm deep");
        assert!(page.contains(&drawn) && page.contains("depth, mm"), "no {drawn}");
    }

    machine(folder.path(), |file| {
        let photons = file["superposition"]["photons"].as_array_mut().unwrap();
        photons.fill(Value::from(0.0));
        *photons.last_mut().unwrap() = Value::from(1.0);
    });
    let wrong = check(&["own.json", "--json"]);
    let answer: Value = serde_json::from_slice(&wrong.stdout).unwrap();
    assert_eq!(wrong.status.code(), Some(1), "{answer}");
    assert!(answer["missed"].as_u64().unwrap() > 0, "{answer}");

    machine(folder.path(), |file| {
        file.as_object_mut().unwrap().remove("superposition");
    });
    let refused = check(&["own.json"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("no section `superposition`"), "{}", text(&refused.stderr));
}
