//! What is suggested for a word that is no name. Names that are misspelled: `misspelled.rs` of `stillpoint-testing`.

use stillpoint_operator::config::near::nearest;
use stillpoint_operator::config::units::DIMENSIONS;

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
