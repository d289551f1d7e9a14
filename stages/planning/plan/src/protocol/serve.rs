//! Which objective serves a limit, and the objectives that limits without one are given.
//!
//! An objective serves a limit where a dose that fulfils it keeps the limit. A limit that no objective serves is not aimed at:
//! a plan keeps it by chance. [`Protocol::serve`] gives each of them an objective.

use super::limits::{Limit, Of, Protocol, Side};
use super::metric::{Dose, DoseUnit, Metric, Volume, VolumeUnit};
use crate::fluence::{
    Aim, Bound, DvhAtMost, MeanAtLeast, MeanDose, Objective, Overdose, StructureObjectives, Underdose,
};
use stillpoint_patient::case::{Case, Role, Structure};

/// Where an objective that is derived begins, as a part of the bound: solutions end a little above their goals.
const BEFORE: f64 = 0.9;
/// Weights of objectives that are derived.
const MEAN_WEIGHT: f64 = 20.0;
const LARGEST_WEIGHT: f64 = 1000.0;
const VOLUME_WEIGHT: f64 = 20.0;
const TARGET_WEIGHT: f64 = 1600.0;
/// Part of a structure up to which a dose at a volume counts as its largest dose.
const SMALL: f64 = 0.02;

/// A limit on a structure of a case, and the objective that serves it.
#[derive(Clone, Debug, PartialEq)]
pub struct Served {
    /// The structure, or `plan`.
    pub structure: String,
    /// The limit.
    pub limit: String,
    /// The objective, with the name of its structure or part of it; nothing where none serves the limit.
    pub by: Option<(String, Objective)>,
    /// Whether the objective was derived from the limit.
    pub is_derived: bool,
}

impl Protocol {
    /// Adds to the objectives of the structures of a case one for each limit that none serves, and says for every limit on
    /// the case which objective serves it, in the order of the protocol. A structure without objectives gets none.
    pub fn serve(&self, case: &Case, structures: &mut [StructureObjectives]) -> Vec<Served> {
        let highest_gy = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let mut all = Vec::new();
        for limit in &self.limits {
            let mut say = |structure: &str, by: Option<(String, Objective)>, is_derived: bool| {
                let (structure, limit) = (structure.to_owned(), limit.to_string());
                all.push(Served { structure, limit, by, is_derived });
            };
            if limit.of == Of::Plan {
                say(
                    "plan",
                    find(structures, |_| true, |aim| serves_plan(limit.metric, aim, highest_gy)),
                    false,
                );
            }
            for structure in case.structures().iter().filter(|s| limit.of.takes(case, s, highest_gy)) {
                let goal = Goal {
                    limit,
                    prescribed_gy: prescribed(case, structure).unwrap_or(highest_gy),
                    volume_cm3: case.volume_cm3(structure),
                };
                if limit.metric == Metric::Paddick {
                    let is_around = |aim| matches!(aim, Aim::FallOff { .. });
                    say(&structure.name, find(structures, |_| true, is_around), false);
                    continue;
                }
                let is_own = |name: &str| name == structure.name;
                if let Some(by) = find(structures, is_own, |aim| goal.is_served_by(aim)) {
                    say(&structure.name, Some(by), false);
                    continue;
                }
                let own = structures.iter_mut().find(|of| is_own(&of.name));
                let derived = own.zip(goal.derived(structure.role)).map(|(own, objective)| {
                    own.objectives.push(objective);
                    (own.name.clone(), objective)
                });
                let is_derived = derived.is_some();
                say(&structure.name, derived, is_derived);
            }
        }
        all
    }
}

/// A limit on a structure.
struct Goal<'a> {
    limit: &'a Limit,
    /// What percents of doses are of.
    prescribed_gy: f64,
    /// What percents of volumes are of.
    volume_cm3: f64,
}

impl Goal<'_> {
    fn bound(&self) -> Bound {
        match self.limit.side {
            Side::AtMost => Bound::AtMost,
            Side::AtLeast => Bound::AtLeast,
        }
    }

    /// The bound as a dose.
    fn gray(&self, unit: DoseUnit) -> f64 {
        match unit {
            DoseUnit::Gray => self.limit.bound,
            DoseUnit::Percent => self.limit.bound / 100.0 * self.prescribed_gy,
        }
    }

    /// The bound as a fraction of the volume.
    fn fraction(&self, unit: VolumeUnit) -> f64 {
        match unit {
            VolumeUnit::Percent => self.limit.bound / 100.0,
            VolumeUnit::Cc => self.limit.bound / self.volume_cm3,
        }
    }

    fn at(&self, dose: Dose) -> f64 {
        match dose {
            Dose::Gray(gray) => gray,
            Dose::Percent(percent) => percent / 100.0 * self.prescribed_gy,
        }
    }

    fn part(&self, volume: Volume) -> f64 {
        match volume {
            Volume::Percent(percent) => percent / 100.0,
            Volume::Cc(cm3) => cm3 / self.volume_cm3,
        }
    }

    fn is_served_by(&self, aim: Aim) -> bool {
        let side = self.bound();
        // Whether a number on its side of the first is on that side of the second, too.
        let within = |own: f64, asked: f64| match side {
            Bound::AtMost => own <= asked,
            Bound::AtLeast => own >= asked,
        };
        match (self.limit.metric, aim) {
            (Metric::Homogeneity, aim) => side == Bound::AtMost && aim == Aim::Even,
            (Metric::Mean(unit), Aim::Dose(bound, dose) | Aim::Mean(bound, dose)) => {
                bound == side && within(dose, self.gray(unit))
            }
            // From a mean of powers of at least 1 the mean is not above, from one of at most 1 not below.
            (Metric::Mean(unit), Aim::Geud { a, bound, dose }) => {
                let bounds_mean = if side == Bound::AtMost { a >= 1.0 } else { a <= 1.0 };
                bound == side && bounds_mean && within(dose, self.gray(unit))
            }
            (Metric::DoseAt(_, unit), Aim::Dose(bound, dose)) => {
                bound == side && within(dose, self.gray(unit))
            }
            (Metric::DoseAt(at, unit), Aim::Volume { bound, dose, volume }) => {
                bound == side && within(dose, self.gray(unit)) && within(volume, self.part(at))
            }
            (Metric::VolumeAt(at, _), Aim::Dose(bound, dose)) => bound == side && within(dose, self.at(at)),
            (Metric::VolumeAt(at, unit), Aim::Volume { bound, dose, volume }) => {
                bound == side && within(dose, self.at(at)) && within(volume, self.fraction(unit))
            }
            _ => false,
        }
    }

    /// An objective that aims at the limit; nothing where no shape does.
    fn derived(&self, role: Role) -> Option<Objective> {
        match (self.bound(), self.limit.metric) {
            (Bound::AtMost, Metric::Mean(unit)) => {
                Some(MeanDose { dose: BEFORE * self.gray(unit), weight: MEAN_WEIGHT }.into())
            }
            (Bound::AtMost, Metric::DoseAt(at, unit)) => {
                Some(self.most(BEFORE * self.gray(unit), self.part(at)))
            }
            (Bound::AtMost, Metric::VolumeAt(at, unit)) => {
                Some(self.most(self.at(at), BEFORE * self.fraction(unit)))
            }
            (Bound::AtLeast, Metric::Mean(unit)) => {
                Some(MeanAtLeast { dose: self.gray(unit), weight: TARGET_WEIGHT }.into())
            }
            (Bound::AtLeast, Metric::DoseAt(_, unit)) if role == Role::Target => {
                Some(Underdose { dose: self.gray(unit), weight: TARGET_WEIGHT }.into())
            }
            (Bound::AtLeast, Metric::VolumeAt(at, _)) if role == Role::Target => {
                Some(Underdose { dose: self.at(at), weight: TARGET_WEIGHT }.into())
            }
            _ => None,
        }
    }

    /// At most this part of the structure gets more than a dose.
    fn most(&self, dose: f64, part: f64) -> Objective {
        match part <= SMALL {
            true => Overdose { dose, weight: LARGEST_WEIGHT }.into(),
            false => DvhAtMost { dose, volume: part.min(1.0), weight: VOLUME_WEIGHT }.into(),
        }
    }
}

/// Whether an objective aims at a limit of a whole plan.
fn serves_plan(metric: Metric, aim: Aim, highest_gy: f64) -> bool {
    match (metric, aim) {
        (Metric::R50 | Metric::Beyond2cm(_), Aim::FallOff { .. }) => true,
        (Metric::Entry(_), Aim::Dose(Bound::AtMost, dose)) => dose <= 0.5 * highest_gy,
        _ => false,
    }
}

fn find(
    structures: &[StructureObjectives],
    of: impl Fn(&str) -> bool,
    serves: impl Fn(Aim) -> bool,
) -> Option<(String, Objective)> {
    let own = structures.iter().filter(|structure| of(&structure.name));
    own.flat_map(|structure| structure.objectives.iter().map(move |objective| (structure, objective)))
        .find(|(_, objective)| serves(objective.aim()))
        .map(|(structure, objective)| (structure.name.clone(), *objective))
}

fn prescribed(case: &Case, structure: &Structure) -> Option<f64> {
    case.prescription().iter().find(|p| p.structure == structure.name).map(|p| p.dose_gy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dose::DoseParams;
    use crate::objectives::ObjectiveTable;
    use stillpoint_patient::case::neck;

    fn limit(name: &str, text: &str) -> Limit {
        Limit::new(Of::Structure { name: name.into(), patterns: vec![] }, text, "").unwrap()
    }

    #[test]
    fn a_limit_that_nothing_aims_at_gets_an_objective_before_its_bound() {
        let case = neck(0).unwrap();
        let grid = DoseParams::over(case.grid(), 8.0).grid;
        let own = r#"{"objectives": [
            {"role": "target", "wanted": [{"underdose": {"dose": "100 %", "weight": 100}}]},
            {"match": ["LeftParotid"], "wanted": [{"overdose": {"dose": "30 Gy", "weight": 5}}]},
            {"match": ["RightParotid"], "wanted": [{"overdose": {"dose": "20 Gy", "weight": 5}}]},
            {"match": ["SpinalCord"], "wanted": [{"overdose": {"dose": "46 Gy", "weight": 5}}]},
            {"match": ["Mandible"], "wanted": []}]}"#;
        let mut set = ObjectiveTable::parse(own).unwrap().for_case(&case, &grid).unwrap();
        let protocol = Protocol {
            name: "test".into(),
            fraction_gy: None,
            limits: vec![
                Limit::new(Of::EachTarget, "D98%[%] >= 95", "").unwrap(),
                Limit::new(Of::HighestTarget, "D95%[%] >= 101", "").unwrap(),
                limit("LeftParotid", "Mean[Gy] <= 25"),
                limit("LeftParotid", "V20Gy[%] <= 50"),
                limit("RightParotid", "Mean[Gy] <= 25"),
                limit("SpinalCord", "D0.03cc[Gy] <= 45"),
                limit("SpinalCord", "D0.03cc[Gy] <= 50"),
                limit("Mandible", "D0.03cc[Gy] <= 70"),
            ],
        };
        let served = protocol.serve(&case, &mut set.structures);
        let targets = case.prescription().len();
        let derived: Vec<bool> = served.iter().map(|s| s.is_derived).collect();
        assert_eq!(derived[..targets], vec![false; targets]);
        assert_eq!(derived[targets..], [true, true, true, false, true, false, false]);
        let (left_out, rest) = served.split_last().unwrap();
        assert!(left_out.by.is_none(), "a structure without objectives: {left_out:?}");
        assert!(rest.iter().all(|s| s.by.is_some()), "{served:?}");
        let objectives = |name: &str| &set.structures.iter().find(|w| w.name == name).unwrap().objectives;
        let expected: [Objective; 2] = [
            MeanDose { dose: 22.5, weight: MEAN_WEIGHT }.into(),
            DvhAtMost { dose: 20.0, volume: 0.45, weight: VOLUME_WEIGHT }.into(),
        ];
        assert_eq!(objectives("LeftParotid")[1..], expected);
        let cord = Overdose { dose: 40.5, weight: LARGEST_WEIGHT };
        assert_eq!(objectives("SpinalCord")[1..], [cord.into()]);
        let highest = case.prescription().iter().max_by(|a, b| a.dose_gy.total_cmp(&b.dose_gy)).unwrap();
        let more = Underdose { dose: 1.01 * highest.dose_gy, weight: TARGET_WEIGHT };
        assert_eq!(objectives(&highest.structure)[1..], [more.into()]);
    }

    #[test]
    fn an_objective_serves_what_its_dose_keeps_and_nothing_stricter() {
        let goal =
            |limit: &Limit, aim: Aim| Goal { limit, prescribed_gy: 60.0, volume_cm3: 10.0 }.is_served_by(aim);
        let (most, least) = (Bound::AtMost, Bound::AtLeast);
        let mean = limit("a", "Mean[Gy] <= 25");
        assert!(
            goal(&mean, Aim::Mean(most, 25.0)) && goal(&mean, Aim::Geud { a: 3.0, bound: most, dose: 25.0 })
        );
        assert!(!goal(&mean, Aim::Mean(most, 26.0)) && !goal(&mean, Aim::Mean(least, 20.0)));
        let volume = limit("a", "V30Gy[cc] <= 4");
        let aim = |dose, volume| Aim::Volume { bound: most, dose, volume };
        assert!(goal(&volume, aim(30.0, 0.4)) && goal(&volume, aim(20.0, 0.3)));
        assert!(!goal(&volume, aim(31.0, 0.4)) && !goal(&volume, aim(30.0, 0.41)));
        let covered = limit("a", "D95%[%] >= 100");
        assert!(goal(&covered, Aim::Volume { bound: least, dose: 60.0, volume: 0.95 }));
        assert!(goal(&covered, Aim::Dose(least, 60.0)) && !goal(&covered, Aim::Dose(least, 59.9)));
        assert!(!goal(&covered, Aim::Volume { bound: least, dose: 60.0, volume: 0.94 }));
    }
}
