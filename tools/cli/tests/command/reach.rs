//! `stillpoint reach`: the map of what a rig can hold.

use serde_json::Value;

use crate::{stillpoint, text};

fn map(arguments: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let out = stillpoint(folder.path(), &[&["reach"], arguments, &["--json"]].concat());
    assert!(out.status.success(), "{}", text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn the_sources_step_is_on_the_map_and_what_lies_beyond_names_its_bladder() {
    // From left to right -11.5, 0, 11.5 and so on to 115 mm; upwards from -90 to 90 degrees in steps of 10.
    let over = ["--over", "z=-11.5 mm..115 mm", "--over", "roll=-90 deg..90 deg", "--at", "pitch=1.35 deg"];
    let map = map(&[&over[..], &["--columns", "12", "--rows", "19"]].concat());
    let at = |z: usize, roll: usize| &map["map"][roll][z];
    assert!((map["across"]["values"][2].as_f64().unwrap() - 11.5).abs() < 1e-9, "{}", map["across"]);
    assert!((map["up"]["values"][10].as_f64().unwrap() - 10.0).abs() < 1e-9, "{}", map["up"]);
    assert!(at(1, 9).is_null() && at(2, 10).is_null(), "the start and the step are held");
    for (z, roll) in [(11, 9), (2, 0), (2, 18)] {
        let wall = at(z, roll);
        assert!((0.0..1.0).contains(&wall["part"].as_f64().unwrap()), "{wall}");
        assert!(wall["bladder"].as_u64().unwrap() < 3 && wall["why"].as_str().unwrap().contains("bladder"));
    }
    // Left and right are the same but for the bladder's name.
    let held = |roll: usize| (0..12).map(|z| at(z, roll).is_null()).collect::<Vec<_>>();
    assert_eq!(held(6), held(12));
    let count =
        map["map"].as_array().unwrap().iter().flat_map(|row| row.as_array().unwrap()).filter(|w| w.is_null());
    assert_eq!(map["held"], count.count());
}

#[test]
fn a_rig_of_one_bladder_has_a_line_and_people_see_what_it_holds() {
    let folder = tempfile::tempdir().unwrap();
    let out = stillpoint(folder.path(), &["reach", "one_bladder", "--columns", "16"]);
    let output_text = text(&out.stdout);
    assert!(out.status.success(), "{}", text(&out.stderr));
    // From -50 to 100 mm in steps of 10: from 20 mm below to 89 mm above the start it can be held.
    assert!(output_text.contains(" 000") && output_text.contains("..........00\n"), "{output_text}");
}

#[test]
fn what_cannot_be_mapped_is_said_with_what_to_write() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, words) in [
        (&["--over", "x", "--over", "z"][..], "the rig moves z, pitch, roll"),
        (&["--over", "z"], "give two coordinates"),
        (&["--over", "z", "--over", "z"], "named twice"),
        (&["--over", "z=1 mm", "--over", "roll"], "z=-20 mm..40 mm"),
        (&["--at", "pitch=1"], "pitch=1"),
        (&["--at", "pitch"], "write it as"),
        (&["--head-mass", "nan kg"], "--head-mass"),
        (&["--head-mass=-3 kg"], "from 1 kg to 10 kg"),
        (&["--head-mass", "90 kg"], "from 1 kg to 10 kg"),
        (&["--columns", "1"], "--columns"),
    ] {
        let out = stillpoint(folder.path(), &[&["reach"], arguments].concat());
        let output_text = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{arguments:?}: {output_text}");
        assert!(output_text.contains(words), "{arguments:?}: {output_text}");
    }
}
