//! What programs of operators say of themselves.

use proptest::prelude::*;
use stillpoint_operator::Stage;
use stillpoint_operator::program::description::{from_json, to_json};

use crate::kinds::registry;

fn description() -> String {
    let stages: Vec<Stage> = registry().iter().copied().collect();
    to_json(&stages).to_string()
}

#[test]
fn a_description_is_the_kinds_that_were_described() {
    let kinds = from_json(&serde_json::from_str(&description()).unwrap()).unwrap();
    let stages: Vec<Stage> = registry().iter().copied().collect();
    assert_eq!(kinds.len(), stages.len());
    for (read, stage) in kinds.iter().zip(&stages) {
        assert_eq!(format!("{:?}", read.kind), format!("{:?}", stage.kind));
        assert_eq!(format!("{:?}", read.fields), format!("{:?}", stage.fields));
    }
}

#[test]
fn a_program_of_another_version_or_with_another_sample_is_refused() {
    let text = description();
    let refused = |text: String| from_json(&serde_json::from_str(&text).unwrap()).err().unwrap().to_string();
    let other = refused(text.replace("\"protocol\":1", "\"protocol\":0"));
    assert!(other.contains("another version of stillpoint-operator"), "{other}");
    let other = refused(text.replace("\"PointCloud@", "\"PointClot@"));
    assert!(other.contains("there is no sample PointClot"), "{other}");
    let (before, behind) = text.split_once("\"PointCloud@").unwrap();
    let other = refused(format!("{before}\"PointCloud@0{}", &behind[1..]));
    assert!(other.contains("has another layout") || other.contains("PointCloud@0"), "{other}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn broken_descriptions_are_refused_or_read(
        edits in prop::collection::vec((any::<prop::sample::Index>(), "[\\[\\]{}\",:a-z0-9]{1,6}"), 1..4),
    ) {
        let mut text = description();
        for (at, piece) in edits {
            let at = at.index(text.len());
            let to = (at + piece.len()).min(text.len());
            if text.is_char_boundary(at) && text.is_char_boundary(to) {
                text.replace_range(at..to, &piece);
            }
        }
        if let Ok(value) = serde_json::from_str(&text)
            && let Err(refused) = from_json(&value)
        {
            prop_assert!(!refused.to_string().is_empty());
        }
    }
}
