//! Limits, and a plan beside them.

use std::fmt::{Display, Formatter};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::metric::{Metric, MetricError, Subject};
use crate::evaluation::Evaluation;
use crate::metrics::Dvh;
use stillpoint_patient::case::{Case, Role, Structure, name_fits};

/// The limits of a kind of treatment.
#[derive(Clone, Debug, PartialEq)]
pub struct Protocol {
    /// Its name.
    pub name: String,
    /// Doses of a fraction of the highest prescription for which its limits hold, gray; nothing where it does not say.
    pub fraction_gy: Option<[f64; 2]>,
    /// Its limits.
    pub limits: Vec<Limit>,
}

/// A limit of one quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Limit {
    pub(super) of: Of,
    pub(super) metric: Metric,
    pub(super) side: Side,
    pub(super) bound: f64,
    text: String,
    source: String,
}

/// What a limit is on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Of {
    /// The structures of the case with this name, or a name that fits one of the patterns.
    Structure {
        /// Name of TG-263.
        name: String,
        /// Further names, with `*` for any text.
        patterns: Vec<String>,
    },
    /// Each target, by its own prescription.
    EachTarget,
    /// The targets of the highest prescription.
    HighestTarget,
    /// The whole plan.
    Plan,
}

/// On which side of the bound a plan keeps the limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    AtMost,
    AtLeast,
}

/// Why a text is no limit.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum LimitError {
    /// It has no bound.
    #[error("`{0}` is not a limit; write a quantity, `<=` or `>=`, and a number, such as `V75Gy[%] <= 15`")]
    Bound(String),
    /// Its quantity is none.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// A quantity of plans for a structure, or of structures for a plan.
    #[error("`{0}` is a quantity of {1}, so it cannot be limited for {2}")]
    Subject(String, &'static str, &'static str),
}

/// A limit beside a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// The structure of the case, or `plan`; the protocol's name where the case has no such structure.
    pub structure: String,
    /// The limit.
    pub limit: String,
    /// The plan's value in the limit's unit; nothing where the case has no such structure or prescription.
    pub value: Option<f64>,
    /// Whether the plan keeps it.
    pub passed: Option<bool>,
    /// Who published it.
    pub source: String,
}

impl Limit {
    /// Reads a limit such as `V75Gy[%] <= 15`.
    pub fn new(of: Of, text: &str, source: &str) -> Result<Self, LimitError> {
        let fault = || LimitError::Bound(text.to_owned());
        let (metric, side, bound) = match (text.split_once("<="), text.split_once(">=")) {
            (Some((metric, bound)), None) => (metric, Side::AtMost, bound),
            (None, Some((metric, bound))) => (metric, Side::AtLeast, bound),
            _ => return Err(fault()),
        };
        let bound = bound.trim().parse().ok().filter(|b: &f64| b.is_finite()).ok_or_else(fault)?;
        let name = metric.trim().to_owned();
        let metric: Metric = metric.parse()?;
        let on_target = matches!(of, Of::EachTarget | Of::HighestTarget);
        match of {
            Of::Plan if !metric.is_of_plan() => {
                return Err(LimitError::Subject(name, "structures", "a plan"));
            }
            Of::Plan => {}
            _ if metric.is_of_plan() => return Err(LimitError::Subject(name, "plans", "a structure")),
            _ if metric == Metric::Paddick && !on_target => {
                return Err(LimitError::Subject(name, "targets", "another structure"));
            }
            _ => {}
        }
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        Ok(Self { of, metric, side, bound, text, source: source.to_owned() })
    }

    fn judged(&self, structure: &str, value: Option<f64>) -> Judged {
        let passed = value.map(|value| match self.side {
            Side::AtMost => value <= self.bound,
            Side::AtLeast => value >= self.bound,
        });
        let (structure, limit, source) = (structure.to_owned(), self.text.clone(), self.source.clone());
        Judged { structure, limit, value, passed, source }
    }
}

impl Display for Limit {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

impl Of {
    pub(super) fn takes(&self, case: &Case, structure: &Structure, highest_gy: f64) -> bool {
        let prescribed = || prescribed_gy(case, structure);
        match self {
            Self::Structure { name, patterns } => {
                structure.role != Role::Target
                    && (name_fits(name, &structure.name)
                        || patterns.iter().any(|p| name_fits(p, &structure.name)))
            }
            Self::EachTarget => structure.role == Role::Target && prescribed().is_some(),
            Self::HighestTarget => structure.role == Role::Target && prescribed() == Some(highest_gy),
            Self::Plan => false,
        }
    }

    fn name(&self) -> &str {
        match self {
            Self::Structure { name, .. } => name,
            Self::EachTarget | Self::HighestTarget => "target",
            Self::Plan => "plan",
        }
    }
}

/// Whether the limits of a protocol hold for the fractions of a case.
#[derive(Clone, Debug, PartialEq)]
pub enum Fractionation {
    /// They do.
    Holds,
    /// It is not known, for the reason in words: limits are compared, and people are told.
    Unknown(String),
    /// They do not, for the reason in words: they are not compared.
    Other(String),
}

impl Protocol {
    /// Whether its limits hold for the fractions of a case.
    pub fn fractionation(&self, case: &Case) -> Fractionation {
        let name = &self.name;
        let Some([least, most]) = self.fraction_gy else {
            return Fractionation::Unknown(format!(
                "the protocol {name} does not state the doses of a fraction for which its limits hold (`fraction: 1.7 to 2.3 Gy`)"
            ));
        };
        let highest_gy = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let Some(fractions) = case.fractions().filter(|_| highest_gy > 0.0) else {
            return Fractionation::Unknown(format!(
                "the limits of the protocol {name} hold for fractions of {least} to {most} Gy; the case does not state its \
                 fractions"
            ));
        };
        let each_gy = highest_gy / f64::from(fractions);
        match (least..=most).contains(&each_gy) {
            true => Fractionation::Holds,
            false => Fractionation::Other(format!(
                "the limits of the protocol {name} hold for fractions of {least} to {most} Gy, and the case has {fractions} of \
                 {each_gy:.2} Gy; give limits for this fractionation"
            )),
        }
    }

    /// Every limit beside what the dose of a plan gives, in the order of the protocol.
    pub fn judge(&self, case: &Case, dose: &Evaluation<'_>) -> Vec<Judged> {
        let figures = dose.figures(&[]);
        let highest_gy = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let mut judged = Vec::new();
        for limit in &self.limits {
            let before = judged.len();
            if limit.of == Of::Plan {
                let subject = Subject {
                    dvh: None,
                    prescribed_gy: highest_gy,
                    conformity: None,
                    fall_off: dose.fall_off.as_ref(),
                };
                judged.push(limit.judged("plan", limit.metric.value(subject)));
            }
            let of = |(structure, dvh): &(&Structure, Dvh)| {
                let own = figures.iter().find(|f| f.name == structure.name);
                let prescribed_gy = match structure.role {
                    Role::Target => prescribed_gy(case, structure).unwrap_or(0.0),
                    _ => highest_gy,
                };
                let conformity = own.and_then(|f| f.conformity);
                let subject = Subject { dvh: Some(dvh), prescribed_gy, conformity, fall_off: None };
                limit.judged(&structure.name, limit.metric.value(subject))
            };
            judged
                .extend(dose.histograms.iter().filter(|(s, _)| limit.of.takes(case, s, highest_gy)).map(of));
            if judged.len() == before {
                judged.push(limit.judged(limit.of.name(), None));
            }
        }
        judged
    }
}

fn prescribed_gy(case: &Case, structure: &Structure) -> Option<f64> {
    case.prescription().iter().find(|p| p.structure == structure.name).map(|p| p.dose_gy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::OnGrid;
    use stillpoint_patient::case::phantom;

    fn limit(of: Of, text: &str) -> Limit {
        Limit::new(of, text, "a test").unwrap()
    }

    #[test]
    fn a_plan_keeps_some_limits_breaks_others_and_has_no_value_where_a_structure_is_missing() {
        let case = phantom(0).unwrap();
        let grid = *case.grid();
        let on_grid = OnGrid::new(&case, &grid);
        let ptv = case.structure("PTV").unwrap();
        let gray: Vec<f32> =
            (0..grid.len()).map(|i| if ptv.mask.contains(i) { 78.0 } else { 39.0 }).collect();
        let named =
            |name: &str, pattern: &str| Of::Structure { name: name.into(), patterns: vec![pattern.into()] };
        let protocol = Protocol {
            name: "test".into(),
            fraction_gy: None,
            limits: vec![
                limit(Of::EachTarget, "D50%[%]  >= 95"),
                limit(Of::HighestTarget, "Paddick >= 0.8"),
                limit(named("Femur_Head_L", "FemoralHeadL"), "V39Gy[%] <= 5"),
                limit(named("PTV", "PTV"), "Mean[Gy] <= 5"),
                limit(named("Brainstem", "stem*"), "D0.03cc[Gy] <= 54"),
                limit(Of::Plan, "D2cm[%] <= 50"),
            ],
        };
        let judged = protocol.judge(&case, &on_grid.evaluate(&gray));
        let reported: Vec<(&str, Option<bool>)> =
            judged.iter().map(|j| (j.structure.as_str(), j.passed)).collect();
        assert_eq!(
            reported,
            [
                ("PTV", Some(true)),
                ("PTV", Some(true)),
                ("FemoralHeadL", Some(false)),
                ("PTV", None),
                ("Brainstem", None),
                ("plan", Some(true)),
            ]
        );
        assert_eq!((judged[0].limit.as_str(), judged[0].value), ("D50%[%] >= 95", Some(100.0)));
        assert_eq!((judged[2].value, judged[5].value), (Some(100.0), Some(50.0)));
    }

    #[test]
    fn limits_for_fractions_of_2_gy_do_not_hold_for_one_of_20_gy() {
        let case = phantom(0).unwrap();
        let of =
            |fraction_gy| Protocol { name: "test".into(), fraction_gy, limits: vec![] }.fractionation(&case);
        assert_eq!(of(Some([1.7, 2.3])), Fractionation::Holds, "78 Gy in 39 fractions");
        let Fractionation::Other(why) = of(Some([15.0, 25.0])) else { panic!("2 Gy are not 15 to 25 Gy") };
        assert!(why.contains("fractions of 15 to 25 Gy, and the case has 39 of 2.00 Gy"), "{why}");
        assert!(matches!(of(None), Fractionation::Unknown(why) if why.contains("does not state")));
    }

    #[test]
    fn what_is_no_limit_is_refused() {
        let organ = || Of::Structure { name: "Rectum".into(), patterns: vec![] };
        let fault = |of: Of, text: &str| Limit::new(of, text, "").unwrap_err().to_string();
        for text in ["V75Gy[%]", "V75Gy[%] < 15", "V75Gy[%] <= x", "V75Gy[%] <= nan", "1 <= V75Gy[%] <= 2"] {
            assert!(fault(organ(), text).contains("is not a limit"), "{text}");
        }
        assert!(fault(organ(), "V75[%] <= 15").contains("is not a quantity"));
        assert!(fault(organ(), "R50 <= 5").contains("a quantity of plans"));
        assert!(fault(Of::Plan, "Mean[Gy] <= 5").contains("a quantity of structures"));
        assert!(fault(organ(), "Paddick >= 0.8").contains("a quantity of targets"));
    }
}
