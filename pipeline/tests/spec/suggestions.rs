//! The first suggestion for a misspelled name is the right one.

use stillpoint_pipeline::spec::near::nearest;
use stillpoint_pipeline::spec::units::DIMENSIONS;

/// What typing goes wrong by: a letter left out, doubled, swapped with the next, or another one.
fn misspellings(name: &str) -> Vec<String> {
    let chars: Vec<char> = name.chars().collect();
    let mut out = Vec::new();
    for i in 0..chars.len() {
        let mut left_out = chars.clone();
        left_out.remove(i);
        let mut doubled = chars.clone();
        doubled.insert(i, chars[i]);
        let mut other = chars.clone();
        other[i] = if chars[i] == 'r' { 't' } else { 'r' };
        let mut swapped = chars.clone();
        if i + 1 < chars.len() {
            swapped.swap(i, i + 1);
        }
        out.extend([left_out, doubled, other, swapped].map(String::from_iter));
    }
    out.retain(|m| m != name && !m.is_empty());
    out
}

fn share_right(names: &[&str]) -> f64 {
    let (mut right, mut all) = (0, 0);
    for name in names {
        for wrong in misspellings(name).iter().filter(|w| !names.contains(&w.as_str())) {
            all += 1;
            if nearest(wrong, names.iter().copied()) == Some(*name) {
                right += 1;
            }
        }
    }
    f64::from(right) / f64::from(all)
}

#[test]
fn nine_of_ten_misspelled_names_get_the_right_first_suggestion() {
    let keys = ["use", "params", "inputs", "every", "frame", "latency", "deadline"];
    let top = ["stillpoint", "name", "seed", "frames", "operators", "processes", "record"];
    let params = [
        "leaf",
        "plane_tolerance",
        "iterations",
        "model",
        "crop",
        "gain",
        "watchdog",
        "near",
        "far",
        "stride",
    ];
    let operators = ["rig", "console", "cloud", "face", "head", "filter", "target", "mrac", "valves"];
    let kinds = [
        "rig.three_bladders",
        "ingest.depth",
        "segment.face",
        "track.head",
        "estimate.kalman",
        "control.mrac",
    ];
    for names in [&keys[..], &top, &params, &operators, &kinds] {
        let share = share_right(names);
        println!("{:.1} % right of {}", share * 100.0, names.join(", "));
        assert!(share >= 0.9, "{share} of {names:?}");
    }
}

#[test]
fn case_dashes_endings_and_last_parts_are_understood() {
    let names = ["plane_tolerance", "leaf", "segment.face", "track.head"];
    assert_eq!(nearest("plane-tolerance", names), Some("plane_tolerance"));
    assert_eq!(nearest("Leaf", names), Some("leaf"));
    assert_eq!(nearest("plane_tol", names), Some("plane_tolerance"));
    assert_eq!(nearest("face", names), Some("segment.face"));
    assert_eq!(nearest("segmnet.face", names), Some("segment.face"));
}

#[test]
fn nothing_is_suggested_for_what_is_like_nothing() {
    assert_eq!(nearest("zebra", ["leaf", "iterations"]), None);
    assert_eq!(nearest("", ["leaf"]), None);
}

#[test]
fn units_in_the_wrong_case_get_the_right_one() {
    let lengths: Vec<&str> = DIMENSIONS[0].units.iter().map(|u| u.symbol).collect();
    assert_eq!(nearest("MM", lengths.iter().copied()), Some("mm"));
    assert_eq!(nearest("mmm", lengths.iter().copied()), Some("mm"));
}
