//! `stillpoint bladder`: pressure against stretch, as numbers and pictures.

use serde_json::Value;

use crate::{stillpoint, text};

#[test]
fn the_figures_have_their_corrected_numbers_and_a_picture_each() {
    let folder = tempfile::tempdir().unwrap();
    let out = stillpoint(folder.path(), &["bladder", "--out", "pictures", "--json"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let rows: Value = serde_json::from_slice(&out.stdout).unwrap();
    // Pressure in Pa, outer radius in m, computed independently.
    let due = [
        ("Fig 2.4", 18_169.9, 0.165_97),
        ("Fig 2.5", 915_728.0, 0.132_12),
        ("Fig 2.6", -818_679.0, 0.138_33),
        ("Fig 2.7", -1.2501e12, 0.185_38),
    ];
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), 5);
    for (name, pressure, outer) in due {
        let row = rows.iter().find(|row| row["name"] == name).unwrap();
        let found = row["pressure_pa"].as_f64().unwrap();
        assert!((found / pressure - 1.0).abs() < 1e-4, "{name}: {found}");
        assert!((row["radii_m"][1].as_f64().unwrap() - outer).abs() < 1e-5, "{name}: {row}");
        let picture = name.to_lowercase().replace([' ', '.'], "-");
        let svg = std::fs::read_to_string(folder.path().join(format!("pictures/{picture}.svg"))).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains(name), "{name}");
    }
    let retained = std::fs::read_to_string(folder.path().join("pictures/bladders.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&retained).unwrap().as_array().unwrap(), rows);
}

#[test]
fn a_bladder_of_ones_own_shows_its_limit_point_and_what_cannot_be_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let own = |more: &[&str]| {
        let soft = ["bladder", "--inner", "50 mm", "--outer", "53 mm", "--c1", "200 kPa", "--c2", "0 kPa"];
        stillpoint(folder.path(), &[&soft[..], more].concat())
    };
    let out = own(&["--to", "65 mm"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    // Without C2 a shell of this thickness has one limit point, at a stretch of 1.409.
    assert!(text(&out.stdout).contains("at 1.409"), "{}", text(&out.stdout));
    let refused = |out: std::process::Output, with: &str| {
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stdout));
        assert!(text(&out.stderr).contains(with), "{}", text(&out.stderr));
    };
    refused(own(&["--to", "65"]), "--to");
    refused(own(&["--to", "0 mm"]), "--to");
    let thick = ["bladder", "--inner", "53 mm", "--outer", "50 mm", "--c1", "200 kPa", "--c2", "0 kPa"];
    refused(stillpoint(folder.path(), &thick), "53");
}
