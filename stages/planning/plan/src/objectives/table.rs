//! The table of objectives.

use serde::Deserialize;
use thiserror::Error;

use crate::fluence::{Modulation, ObjectiveSpec};
use stillpoint_patient::case::{Case, Role, Structure, name_fits};

const SHIPPED: &str = include_str!("../../data/objectives.json");

/// Lines that structures are matched by, in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectiveTable {
    pub(super) lines: Vec<TableLine>,
    /// How many of them, from the first, are not those that come with stillpoint.
    own: usize,
    /// What uneven fluence costs; nothing where the table does not say.
    pub modulation: Option<Modulation>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TableLine {
    /// Names, by letters and digits, with `*` for any; without it every name.
    #[serde(rename = "match")]
    patterns: Option<Vec<String>>,
    /// Role; without it every role.
    role: Option<Role>,
    /// Names: the line counts only for cases with a structure of one of them; without it for every case.
    with: Option<Vec<String>>,
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
        Ok(Self { own: 0, ..Self::parse(SHIPPED)? })
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
            None => Ok(Self { own: lines.len(), lines, modulation }),
        }
    }

    /// This table, with `later` for the structures that it does not match, and for the modulation where it has none.
    pub fn before(mut self, later: Self) -> Self {
        self.lines.extend(later.lines);
        self.modulation = self.modulation.or(later.modulation);
        self
    }

    /// The objectives of the first line that matches a structure of a case; none if no line does.
    pub(super) fn find(&self, structures: &[Structure], name: &str, role: Role) -> &[ObjectiveSpec] {
        let mut lines = self.lines.iter().filter(|line| line.is_for(structures));
        lines.find(|line| line.fits(name, role)).map_or(&[], |line| &line.specs)
    }

    /// Says of each line that does not come with stillpoint and counts for no structure of a case why it does not.
    pub(super) fn unused(&self, case: &Case) -> Vec<String> {
        let mut warning = Vec::new();
        for (number, line) in self.lines.iter().take(self.own).enumerate() {
            let fitting = || case.structures().iter().filter(|s| line.fits(&s.name, s.role));
            let takes =
                |l: &&TableLine, s: &Structure| l.is_for(case.structures()) && l.fits(&s.name, s.role);
            let is_first = |s: &Structure| !self.lines[..number].iter().any(|l| takes(&l, s));
            let is_for = line.is_for(case.structures());
            if is_for && fitting().any(is_first) {
                continue;
            }
            let why = match fitting().next() {
                _ if !is_for => "no structure of the case is one of its `with`".to_owned(),
                Some(structure) => format!("a line before it takes {}", structure.name),
                None => {
                    let names: Vec<&str> = case.structures().iter().map(|s| s.name.as_str()).collect();
                    format!("no structure of the case fits (there are {})", names.join(", "))
                }
            };
            warning.push(format!("line {} of the objectives ({line}) counts for nothing: {why}", number + 1));
        }
        warning
    }
}

impl TableLine {
    fn is_for(&self, structures: &[Structure]) -> bool {
        self.with.as_ref().is_none_or(|with| {
            structures.iter().any(|s| with.iter().any(|pattern| name_fits(pattern, &s.name)))
        })
    }

    fn fits(&self, name: &str, role: Role) -> bool {
        self.role.is_none_or(|r| r == role)
            && self.patterns.as_ref().is_none_or(|patterns| patterns.iter().any(|p| name_fits(p, name)))
    }
}

impl std::fmt::Display for TableLine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let patterns = self.patterns.as_ref().map(|patterns| format!("match: {}", patterns.join(", ")));
        let word =
            |role: Role| serde_json::to_value(role).ok().and_then(|word| Some(word.as_str()?.to_owned()));
        let role = self.role.and_then(word).map(|role| format!("role: {role}"));
        f.write_str(&patterns.into_iter().chain(role).collect::<Vec<_>>().join(", "))
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
        assert_eq!(table.find(&[], "Rectum", Role::Organ), [mean]);
        assert_eq!(table.find(&[], "Skip", Role::Organ), []);
        assert_eq!(table.find(&[], "Rectum", Role::Target).len(), 3, "a target by its role");
        let head = spec(r#"{"overdose": {"dose": "25 Gy", "weight": 8}}"#);
        assert_eq!(table.find(&[], "FemoralHeadL", Role::Organ), [head]);
        assert_eq!(table.find(&[], "GTV", Role::ClinicalTarget), []);
    }

    #[test]
    fn a_line_with_a_condition_counts_for_cases_that_fulfil_it_alone() {
        let table = ObjectiveTable::shipped().unwrap();
        let (pelvis, neck) =
            (stillpoint_patient::case::phantom(0).unwrap(), stillpoint_patient::case::neck(0).unwrap());
        let of = |case: &Case, name: &str, role| table.find(case.structures(), name, role).to_vec();
        for (name, role) in [("SpinalCord", Role::Organ), ("PTV60", Role::Target), ("Body", Role::External)] {
            assert_ne!(of(&pelvis, name, role), of(&neck, name, role), "{name}");
        }
        let own = ObjectiveTable::parse(
            r#"{"objectives": [{"match": ["PTV"], "with": ["Larynx"], "wanted": []}, {"match": ["PTV*"], "wanted": []}]}"#,
        )
        .unwrap();
        let warning = own.unused(&pelvis);
        assert_eq!(warning.len(), 1);
        assert!(warning[0].contains("is one of its `with`"), "{warning:?}");
    }

    #[test]
    fn what_is_no_table_is_refused_with_its_place_and_what_is_due() {
        let refused = |text: &str| ObjectiveTable::parse(text).unwrap_err().to_string();
        let structure_objectives = |structure_objectives: &str| {
            refused(&format!(r#"{{"objectives": [{{"match": ["a"], "wanted": [{structure_objectives}]}}]}}"#))
        };
        assert!(refused("[]").contains("write them like"));
        assert!(
            refused(r#"{"objectives": [{"role": "organ", "wanted": []}, {"wanted": []}]}"#)
                .contains("line 2")
        );
        assert!(refused(r#"{"objectives": [{"match": ["*"], "wanted": []}]}"#).contains("line 1"));
        assert!(
            structure_objectives(r#"{"overdose": {"dose": "35", "weight": 1}}"#).contains("`35 Gy`, `95 %`")
        );
        assert!(
            structure_objectives(r#"{"dvh_at_most": {"dose": "3 Gy", "volume": "130 %", "weight": 1}}"#)
                .contains("is not a volume")
        );
        assert!(structure_objectives(r#"{"overdoes": {}}"#).contains("unknown variant"));
        assert!(
            structure_objectives(r#"{"dvh_point": {"limit": "D95 > 50 Gy", "weight": 1}}"#)
                .contains("`D95% >= 50 Gy`")
        );
        assert!(
            structure_objectives(r#"{"geud": {"a": 8, "limit": "30 Gy", "weight": 1}}"#)
                .contains("`<= 30 Gy`")
        );
    }
}
