//! Names of regions as names of structures: any text that a region may be named is taken.

use std::collections::BTreeSet;

/// Longest name of a structure, in characters.
const LONGEST: usize = 64;

/// Names for structures, all different. `notes` gets a sentence for each that is not the name of its region.
pub(crate) fn unique<'a>(
    written: impl Iterator<Item = &'a str> + Clone,
    notes: &mut Vec<String>,
) -> Vec<String> {
    // A region whose name needs no change keeps it, wherever it stands.
    let mut taken: BTreeSet<String> =
        written.clone().filter(|name| plain(name) == **name).map(str::to_owned).collect();
    let mut seen = BTreeSet::new();
    let mut names = Vec::new();
    for original in written {
        let own = plain(original);
        let is_first = seen.insert(own.clone());
        let name = match (is_first && (own == *original || !taken.contains(&own)), own) {
            (true, own) => own,
            (false, own) => numbered(&own, &taken),
        };
        if name != *original {
            let why =
                if is_first { "its name cannot be a structure's" } else { "another region has its name" };
            notes.push(format!("region {original:?} is called {name:?}: {why}"));
        }
        taken.insert(name.clone());
        names.push(name);
    }
    names
}

/// The name without characters that cannot be printed, and not longer than a structure's may be.
fn plain(name: &str) -> String {
    let printed: String = name.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect();
    let short: String = printed.trim().chars().take(LONGEST).collect();
    match short.trim_end() {
        "" => "region".to_owned(),
        name => name.to_owned(),
    }
}

/// The name with the first number that makes it another.
fn numbered(name: &str, taken: &BTreeSet<String>) -> String {
    let with = |number: usize| {
        let end = format!(" ({number})");
        let start: String = name.chars().take(LONGEST - end.len()).collect();
        format!("{}{end}", start.trim_end())
    };
    // One of more numbers than there are names is free.
    (2..=taken.len() + 2)
        .map(with)
        .find(|name| !taken.contains(name))
        .unwrap_or_else(|| with(taken.len() + 3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_that_can_be_kept_are_kept_and_the_others_told() {
        let mut notes = Vec::new();
        let long = "x".repeat(70);
        let written = ["PTV", "L/R", "PTV", "a\u{1b}b", " ", &long, "PTV (2)"];
        let names = unique(written.into_iter(), &mut notes);
        let short = "x".repeat(64);
        assert_eq!(names, ["PTV", "L/R", "PTV (3)", "a\u{fffd}b", "region", &short, "PTV (2)"]);
        assert_eq!(notes.len(), 4, "{notes:?}");
        assert!(notes[0].contains(r#"region "PTV" is called "PTV (3)": another region has its name"#));
    }

    proptest! {
        #[test]
        fn names_are_different_and_fit(written in prop::collection::vec("[ab\u{0}/ ]{0,3}|\\PC{60,70}", 0..12)) {
            let names = unique(written.iter().map(String::as_str), &mut Vec::new());
            let different: BTreeSet<_> = names.iter().collect();
            prop_assert_eq!(different.len(), written.len());
            for name in &names {
                prop_assert!((1..=LONGEST).contains(&name.chars().count()) && name.trim() == name);
                prop_assert!(!name.chars().any(char::is_control));
            }
        }
    }
}
