//! The table that structure names are matched by.
//!
//! Clinics write names in many ways. A name is compared by its letters and digits alone, without case; `*` in the table
//! stands for any of them. The first line that matches gives the name, the role, or both. A user's table has priority
//! over the shipped table ([`NameTable::before`]).

use std::collections::BTreeSet;

use serde::Deserialize;
use thiserror::Error;

use super::structure::Role;

const SHIPPED: &str = include_str!("../../data/structure-names.json");

/// Lines that names are matched by, in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NameTable {
    lines: Vec<NameRule>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct NameRule {
    /// The name to give; without it the structure keeps its own.
    name: Option<String>,
    role: Option<Role>,
    #[serde(rename = "match")]
    patterns: Vec<String>,
    /// Whether a user wrote it: its role holds against the type that a file states.
    #[serde(skip)]
    is_own: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    structures: Vec<NameRule>,
}

/// What the table says of a structure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StandardName<'a> {
    /// Its name in a case, if the table gives one.
    pub name: Option<&'a str>,
    /// Its role, if the table gives one.
    pub role: Option<Role>,
    /// Whether a user's table says it.
    pub is_own: bool,
}

/// Why a text is no table of names.
#[derive(Debug, Error)]
pub enum NamesError {
    /// It is no JSON of a table.
    #[error(
        "the names table cannot be read: {0}; it must be like {{\"structures\": [{{\"name\": \"Bladder\", \"role\": \"organ\", \"match\": [\"bladder*\"]}}]}}"
    )]
    Json(#[from] serde_json::Error),
    /// A line that says nothing, or matches nothing.
    #[error("line {0} of the names table needs a `match` with letters or digits, and a `name` or a `role`")]
    Line(usize),
}

impl NameTable {
    /// The table that stillpoint ships.
    pub fn shipped() -> Result<Self, NamesError> {
        Self::parse(SHIPPED)
    }

    /// The table in this JSON text.
    pub fn parse(text: &str) -> Result<Self, NamesError> {
        let Table { structures: lines } = serde_json::from_str(text)?;
        let empty = |line: &NameRule| {
            (line.name.is_none() && line.role.is_none())
                || line.patterns.is_empty()
                || line.patterns.iter().any(|p| plain(p).is_empty())
        };
        match lines.iter().position(empty) {
            Some(index) => Err(NamesError::Line(index + 1)),
            None => Ok(Self { lines }),
        }
    }

    /// This table of a user, with `later` for the names that it does not match.
    pub fn before(mut self, later: Self) -> Self {
        self.lines.iter_mut().for_each(|line| line.is_own = true);
        self.lines.extend(later.lines);
        self
    }

    /// What the first line that matches says.
    pub fn find(&self, name: &str) -> Option<StandardName<'_>> {
        let name = plain(name).replace('*', "");
        let line = self.lines.iter().find(|l| l.patterns.iter().any(|p| fits(&plain(p), &name)))?;
        Some(StandardName { name: line.name.as_deref(), role: line.role, is_own: line.is_own })
    }
}

impl NameTable {
    /// The names and roles of the structures of a case, from the names as they were written and the roles by the types that
    /// the file states. If several match one name, the structure that already has the name gets it, else the first; the
    /// others keep their own.
    ///
    /// A user's role holds, then the role by type, then the role by the shipped table. `notes` gets a sentence for each changed
    /// name and for each type that contradicts the shipped table.
    pub fn apply(&self, written: &[(&str, Option<Role>)], notes: &mut Vec<String>) -> Vec<(String, Role)> {
        let mut taken: BTreeSet<&str> = written.iter().map(|(name, _)| *name).collect();
        let mut result = Vec::with_capacity(written.len());
        for &(own, by_type) in written {
            let found = self.find(own);
            let by_table = found.as_ref().and_then(|f| f.role);
            let is_users = found.as_ref().is_some_and(|f| f.is_own);
            let (role, contradicted) = match (by_type, by_table) {
                (Some(by_type), Some(by_table)) if by_type != by_table && !is_users => {
                    notes.push(format!(
                        "{own:?} has the role {} by its type, and its name suggests {}: the type holds",
                        by_type.word(),
                        by_table.word()
                    ));
                    // What is no outline and no target must not be named as one.
                    (by_type, matches!(by_table, Role::External | Role::Target))
                }
                (Some(by_type), _) if !is_users => (by_type, false),
                (by_type, by_table) => (by_table.or(by_type).unwrap_or(Role::Other), false),
            };
            let standard = found.as_ref().and_then(|f| f.name).filter(|name| *name != own && !contradicted);
            let name = match standard {
                Some(name) if taken.insert(name) => {
                    notes.push(format!("{own:?} is called {name:?}"));
                    name
                }
                Some(name) => {
                    notes.push(format!("{own:?} keeps its name: another structure is {name:?}"));
                    own
                }
                None => own,
            };
            result.push((name.to_owned(), role));
        }
        result
    }
}

/// Whether a name is the pattern, by letters and digits alone, where `*` is any text.
pub fn name_fits(pattern: &str, name: &str) -> bool {
    fits(&plain(pattern), &plain(name).replace('*', ""))
}

/// Letters, digits and `*`, in lower case.
fn plain(text: &str) -> String {
    text.chars().filter(|c| c.is_alphanumeric() || *c == '*').flat_map(char::to_lowercase).collect()
}

/// Whether a name is the pattern, where `*` is any text.
fn fits(pattern: &str, name: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = name.strip_prefix(first) else { return false };
    let mut middle: Vec<&str> = parts.collect();
    let Some(last) = middle.pop() else { return rest.is_empty() };
    for part in middle {
        match rest.find(part) {
            Some(place) => rest = &rest[place + part.len()..],
            None => return false,
        }
    }
    rest.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_matched_by_letters_and_digits_with_stars_for_any() {
        for (pattern, name) in
            [("ptv", "PTV"), ("femoral head l*", "Femoral_Head_Lt"), ("*", "x"), ("a*b*c", "a1b2c")]
        {
            assert!(fits(&plain(pattern), &plain(name)), "{pattern} {name}");
        }
        for (pattern, name) in [("ptv", "PTV70"), ("a*b*c", "acb"), ("ab*b", "ab"), ("rectum", "rectu")] {
            assert!(!fits(&plain(pattern), &plain(name)), "{pattern} {name}");
        }
    }

    #[test]
    fn the_shipped_table_knows_the_ways_clinics_write_and_a_user_goes_before_it() {
        let shipped = NameTable::shipped().unwrap();
        let named = |name| shipped.find(name).and_then(|s| s.name.zip(s.role));
        for (written, name, role) in [
            ("BODY", "Body", Role::External),
            ("External", "Body", Role::External),
            ("ptv", "PTV", Role::Target),
            ("Femur_Head_L", "FemoralHeadL", Role::Organ),
            ("Rt Femoral Head", "FemoralHeadR", Role::Organ),
            ("Parotid_L", "LeftParotid", Role::Organ),
            ("spinal cord", "SpinalCord", Role::Organ),
            ("CTV", "CTV", Role::ClinicalTarget),
        ] {
            assert_eq!(named(written), Some((name, role)), "{written}");
        }
        assert_eq!(
            shipped.find("PTV_7000"),
            Some(StandardName { name: None, role: Some(Role::Target), is_own: false })
        );
        assert_eq!(shipped.find("whatever"), None);
        let own = r#"{"structures": [{"name": "Rectum", "role": "organ", "match": ["enddarm"]}, {"role": "other", "match": ["ptv old"]}]}"#;
        let both = NameTable::parse(own).unwrap().before(shipped.clone());
        assert_eq!(both.find("Enddarm").and_then(|s| s.name), Some("Rectum"));
        assert_eq!(both.find("PTV_old").and_then(|s| s.role), Some(Role::Other));
        assert_eq!(both.find("bladder"), shipped.find("bladder"));
    }

    #[test]
    fn of_two_that_match_one_name_that_which_has_it_keeps_it() {
        let mut notes = Vec::new();
        let written = [
            ("Rectum_whole", None),
            ("Rectum", Some(Role::Organ)),
            ("bladder", Some(Role::Organ)),
            ("X", Some(Role::Other)),
        ];
        let names = NameTable::shipped().unwrap().apply(&written, &mut notes);
        let expected = [
            ("Rectum_whole", Role::Organ),
            ("Rectum", Role::Organ),
            ("Bladder", Role::Organ),
            ("X", Role::Other),
        ];
        assert_eq!(names, expected.map(|(name, role)| (name.to_owned(), role)));
        assert_eq!(notes.len(), 2);
    }

    #[test]
    fn the_type_holds_against_the_shipped_table_and_a_users_line_against_both() {
        let shipped = NameTable::shipped().unwrap();
        let mut notes = Vec::new();
        let written = [
            ("Liver-PTV", Some(Role::Organ)),
            ("PTV_Ring", Some(Role::Other)),
            ("Prostate", Some(Role::Target)),
            ("Skin", Some(Role::Organ)),
            ("PTV", None),
            ("Parotid_Low", Some(Role::Organ)),
        ];
        let roles: Vec<_> = shipped.apply(&written, &mut notes);
        let required = [
            ("Liver-PTV", Role::Organ),
            ("PTV_Ring", Role::Other),
            ("Prostate", Role::Target),
            ("Skin", Role::Organ),
            ("PTV", Role::Target),
            ("Parotid_Low", Role::Organ),
        ];
        assert_eq!(roles, required.map(|(name, role)| (name.to_owned(), role)));
        assert!(
            notes.iter().any(|n| n.contains(r#""Prostate" has the role target by its type"#)),
            "{notes:?}"
        );
        let own = r#"{"structures": [{"role": "target", "match": ["Liver-PTV"]}]}"#;
        let both = NameTable::parse(own).unwrap().before(shipped);
        assert_eq!(both.apply(&written[..1], &mut Vec::new())[0].1, Role::Target);
    }

    #[test]
    fn a_table_that_says_nothing_is_refused_with_its_line() {
        let refused = |text| NameTable::parse(text).unwrap_err().to_string();
        assert!(refused("{").contains("cannot be read"));
        assert!(refused(r#"{"structures": [{"match": ["a"]}]}"#).contains("line 1"));
        assert!(
            refused(r#"{"structures": [{"name": "A", "match": ["a"]}, {"name": "B", "match": ["--"]}]}"#)
                .contains("line 2")
        );
    }
}
