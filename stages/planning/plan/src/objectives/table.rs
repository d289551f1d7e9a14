//! The table of objectives.

use serde::Deserialize;
use thiserror::Error;

use crate::fluence::{Modulation, ObjectiveSpec};
use stillpoint_patient::case::{Role, name_fits};

const SHIPPED: &str = include_str!("../../data/objectives.json");

/// Lines that structures are matched by, in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectiveTable {
    pub(super) lines: Vec<TableLine>,
    /// What uneven fluence costs; nothing where the table does not say.
    pub(super) modulation: Option<Modulation>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TableLine {
    /// Names, by letters and digits, with `*` for any; without it every name.
    #[serde(rename = "match")]
    patterns: Option<Vec<String>>,
    /// Role; without it every role.
    role: Option<Role>,
    #[serde(rename = "wanted")]
    pub specs: Vec<ObjectiveSpec>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    objectives: Vec<TableLine>,
    #[serde(default)]
    modulation: Option<Modulation>,
}

/// Why a text is no table of objectives.
#[derive(Debug, Error)]
pub enum TableError {
    /// It is no JSON of a table.
    #[error(
        "the objectives cannot be read: {0}; write them like {{\"objectives\": [{{\"match\": [\"Rectum\"], \"wanted\": [{{\"overdose\": {{\"dose\": \"35 Gy\", \"weight\": 20}}}}]}}]}}"
    )]
    Json(#[from] serde_json::Error),
    /// A line that matches nothing, or everything.
    #[error("line {0} of the objectives needs a `match` with names, a `role`, or both")]
    Line(usize),
}

impl ObjectiveTable {
    /// The table that stillpoint ships.
    pub fn shipped() -> Result<Self, TableError> {
        Self::parse(SHIPPED)
    }

    /// The table in this JSON text.
    pub fn parse(text: &str) -> Result<Self, TableError> {
        let Table { objectives: lines, modulation } = serde_json::from_str(text)?;
        let empty = |line: &TableLine| match &line.patterns {
            Some(patterns) => {
                patterns.is_empty() || patterns.iter().any(|p| !p.contains(char::is_alphanumeric))
            }
            None => line.role.is_none(),
        };
        match lines.iter().position(empty) {
            Some(index) => Err(TableError::Line(index + 1)),
            None => Ok(Self { lines, modulation }),
        }
    }

    /// This table, with `later` for the structures that it does not match, and for the modulation where it has none.
    pub fn before(mut self, later: Self) -> Self {
        self.lines.extend(later.lines);
        self.modulation = self.modulation.or(later.modulation);
        self
    }

    /// The objectives of the first line that matches; none if no line does.
    pub(super) fn find(&self, name: &str, role: Role) -> &[ObjectiveSpec] {
        let fits = |line: &&TableLine| {
            line.role.is_none_or(|r| r == role)
                && line.patterns.as_ref().is_none_or(|patterns| patterns.iter().any(|p| name_fits(p, name)))
        };
        self.lines.iter().find(fits).map_or(&[], |line| &line.specs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_that_matches_name_and_role_counts_and_a_user_goes_first() {
        let own = r#"{"objectives": [
            {"match": ["rect*"], "role": "organ", "wanted": [{"mean_dose": {"dose": "50 %", "weight": 1}}]},
            {"match": ["skip"], "wanted": []}
        ]}"#;
        let table = ObjectiveTable::parse(own).unwrap().before(ObjectiveTable::shipped().unwrap());
        let spec = |text: &str| -> ObjectiveSpec { serde_json::from_str(text).unwrap() };
        let mean = spec(r#"{"mean_dose": {"dose": "50 %", "weight": 1}}"#);
        assert_eq!(table.find("Rectum", Role::Organ), [mean]);
        assert_eq!(table.find("Skip", Role::Organ), []);
        assert_eq!(table.find("Rectum", Role::Target).len(), 3, "a target by its role");
        let head = spec(r#"{"overdose": {"dose": "25 Gy", "weight": 8}}"#);
        assert_eq!(table.find("FemoralHeadL", Role::Organ), [head]);
        assert_eq!(table.find("GTV", Role::ClinicalTarget), []);
    }

    #[test]
    fn what_is_no_table_is_refused_with_its_place_and_what_is_due() {
        let refused = |text: &str| ObjectiveTable::parse(text).unwrap_err().to_string();
        let wish =
            |wish: &str| refused(&format!(r#"{{"objectives": [{{"match": ["a"], "wanted": [{wish}]}}]}}"#));
        assert!(refused("[]").contains("write them like"));
        assert!(
            refused(r#"{"objectives": [{"role": "organ", "wanted": []}, {"wanted": []}]}"#)
                .contains("line 2")
        );
        assert!(refused(r#"{"objectives": [{"match": ["*"], "wanted": []}]}"#).contains("line 1"));
        assert!(wish(r#"{"overdose": {"dose": "35", "weight": 1}}"#).contains("`35 Gy`, `95 %`"));
        assert!(
            wish(r#"{"dvh_at_most": {"dose": "3 Gy", "volume": "130 %", "weight": 1}}"#)
                .contains("is not a volume")
        );
        assert!(wish(r#"{"overdoes": {}}"#).contains("unknown variant"));
        assert!(wish(r#"{"dvh_point": {"limit": "D95 > 50 Gy", "weight": 1}}"#).contains("`D95% >= 50 Gy`"));
        assert!(wish(r#"{"geud": {"a": 8, "limit": "30 Gy", "weight": 1}}"#).contains("`<= 30 Gy`"));
    }
}
