//! A table of objectives on a case: goals on its dose grid.

use thiserror::Error;

use super::table::ObjectiveTable;
use crate::fluence::{
    Dose, Goals, GoalsError, Modulation, Objective, ObjectiveSpec, StructureObjectives, StructurePart,
};
use crate::sampling::{Points, Sampling};
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, Role, Structure};

/// The objectives of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectiveSet {
    /// Structures with their objectives, those that come first first. A voxel counts for the first that has it.
    pub structures: Vec<StructureObjectives>,
    /// What was left out, a sentence each.
    pub notes: Vec<String>,
    /// Whether each of `structures` counts in every set-up; the patient's outline counts in the planned one.
    pub(super) moves: Vec<bool>,
    /// Rows that get dose in every set-up, rising.
    followed: Vec<u32>,
    /// Rows of a dose matrix.
    pub(super) rows: usize,
    /// What uneven fluence costs.
    pub modulation: Option<Modulation>,
}

/// Why a table gives a case no objectives.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ObjectiveSetError {
    /// A target has no dose.
    #[error(
        "{0} is a target without a prescription: import the case with `--prescribe {0}=DOSE`, or give {0} another role"
    )]
    NoDose(String),
    /// Shares of a prescription that is not there.
    #[error(
        "{0} is to have a share of the prescription, but the case has none: import it with `--prescribe`, or give doses in Gy"
    )]
    NoPrescription(String),
    /// No target has objectives.
    #[error("no target with voxels has objectives, so there is nothing to plan")]
    NoTarget,
    /// Objectives that cannot be.
    #[error(transparent)]
    Goals(#[from] GoalsError),
}

impl ObjectiveTable {
    /// The objectives of a case by this table on every voxel of this dose grid.
    pub fn for_case(&self, case: &Case, grid: &Grid) -> Result<ObjectiveSet, ObjectiveSetError> {
        self.for_points(case, &Sampling::every_voxel(case, grid))
    }

    /// The objectives of a case by this table at these points.
    ///
    /// A share of the prescription is of a target's own, and of the highest for any other structure. Targets come
    /// first, the one of the highest dose before the others, then organs, then the rest, the outline last; each keeps
    /// the voxels that none before it has.
    pub fn for_points(&self, case: &Case, sampling: &Sampling) -> Result<ObjectiveSet, ObjectiveSetError> {
        let own =
            |s: &Structure| case.prescription().iter().find(|p| p.structure == s.name).map(|p| p.dose_gy);
        let highest = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let mut order: Vec<(usize, &Structure)> = case.structures().iter().enumerate().collect();
        let rank = |s: &Structure| match s.role {
            Role::Target => (0, -own(s).unwrap_or(0.0)),
            Role::Organ => (1, 0.0),
            Role::ClinicalTarget => (2, 0.0),
            Role::Other => (3, 0.0),
            Role::External => (4, 0.0),
        };
        order.sort_by(|a, b| rank(a.1).partial_cmp(&rank(b.1)).unwrap_or(std::cmp::Ordering::Equal));
        let mut followed = Vec::new();
        for (place, structure) in order.iter().filter(|(_, s)| follows(s.role)) {
            followed.extend(sampling.points(*place, structure, &sampling.members[*place]).rows);
        }
        followed.sort_unstable();
        followed.dedup();
        let mut set = ObjectiveSet {
            structures: Vec::new(),
            notes: self.unused(case),
            moves: Vec::new(),
            followed,
            rows: sampling.rows(),
            modulation: self.modulation,
        };
        let mut taken = vec![false; sampling.grid().len()];
        for (place, structure) in order {
            let specs = self.find(case.structures(), &structure.name, structure.role);
            if specs.is_empty() {
                continue;
            }
            let own_part = |spec: &&ObjectiveSpec| spec.part() == StructurePart::Own;
            let (specs, regional): (Vec<&ObjectiveSpec>, Vec<&ObjectiveSpec>) =
                specs.iter().partition(own_part);
            let doses = || specs.iter().chain(&regional).flat_map(|spec| spec.doses());
            let prescribed = match structure.role {
                Role::Target if doses().any(|dose| matches!(dose, Dose::OfPrescription(_))) => {
                    own(structure).ok_or_else(|| ObjectiveSetError::NoDose(structure.name.clone()))?
                }
                _ if highest == 0.0 && doses().any(|dose| !matches!(dose, Dose::Gray(_))) => {
                    return Err(ObjectiveSetError::NoPrescription(structure.name.clone()));
                }
                _ => highest,
            };
            for spec in &regional {
                set.add_region(case, sampling, (place, structure), spec, [prescribed, highest]);
            }
            if specs.is_empty() {
                continue;
            }
            let mut voxels = sampling.members[place].clone();
            voxels.retain(|v| !std::mem::replace(&mut taken[*v as usize], true));
            let Points { rows: voxels, volumes, .. } = sampling.points(place, structure, &voxels);
            if voxels.is_empty() {
                set.notes.push(format!(
                    "{} has no voxel on the dose grid outside structures of higher priority; its objectives are ignored",
                    structure.name
                ));
                continue;
            }
            set.moves.push(follows(structure.role));
            let objectives = specs.iter().map(|spec| spec.resolve(prescribed, highest)).collect();
            let name = structure.name.clone();
            set.structures.push(StructureObjectives {
                name,
                voxels,
                volumes,
                to_target_mm: Vec::new(),
                objectives,
            });
        }
        if !set.structures.iter().any(|w| case.targets().any(|t| t.name == w.name)) {
            return Err(ObjectiveSetError::NoTarget);
        }
        Ok(set)
    }
}

impl ObjectiveSet {
    /// The goals in so many set-ups: the objective is the mean over them, as the planned one is what the outline counts
    /// in. One set-up is the plan as it stands.
    pub fn goals(&self, setups: usize) -> Result<Goals, ObjectiveSetError> {
        let setups = setups.max(1);
        let mut structures = Vec::new();
        for (structure, moves) in self.structures.iter().zip(&self.moves) {
            let times = if *moves { setups } else { 1 };
            for setup in 0..times {
                let before = (setup * self.rows) as u32;
                let voxels = structure.voxels.iter().map(|v| before + v).collect();
                let share = |objective: &Objective| objective.scaled(1.0 / times as f64);
                let objectives = structure.objectives.iter().map(share).collect();
                structures.push(StructureObjectives { voxels, objectives, ..structure.clone() });
            }
        }
        Ok(Goals::new(structures, setups * self.rows)?.modulated(self.modulation)?)
    }

    /// The goals of one set-up in two parts, whose objectives add up to that of `goals(1)`: of structures that are followed
    /// through every set-up, and of the outline.
    pub fn parts(&self) -> Result<[Goals; 2], ObjectiveSetError> {
        let part = |moves: bool| -> Result<Goals, ObjectiveSetError> {
            let of = self.structures.iter().zip(&self.moves).filter(|(_, of)| **of == moves);
            Ok(Goals::new(of.map(|(structure, _)| structure.clone()).collect(), self.rows)?)
        };
        Ok([part(true)?, part(false)?])
    }

    /// Adds an objective for a part of a structure, of which all points outside targets count, also those of organs.
    fn add_region(
        &mut self,
        case: &Case,
        sampling: &Sampling,
        (place, structure): (usize, &Structure),
        spec: &ObjectiveSpec,
        [prescribed, highest]: [f64; 2],
    ) {
        let outside = sampling.members[place].iter().filter(|v| sampling.to_target_mm[**v as usize] > 0.0);
        let (part, voxels): (String, Vec<u32>) = match spec.part() {
            StructurePart::Skin(depth) => {
                let depths = case.external().map(|body| sampling.depths_mm(case, body)).unwrap_or_default();
                let shallow = |v: &&u32| depths.get(**v as usize).is_some_and(|d| f64::from(*d) <= depth);
                (format!("{} (first {depth} mm)", structure.name), outside.filter(shallow).copied().collect())
            }
            StructurePart::OutsideTargets | StructurePart::Own => {
                (format!("{} (fall-off)", structure.name), outside.copied().collect())
            }
        };
        let Points { rows: voxels, volumes, to_target_mm } = sampling.points(place, structure, &voxels);
        if voxels.is_empty() {
            self.notes.push(format!("{part} has no voxel on the dose grid; its objective is ignored"));
            return;
        }
        // From the border of the target: half a voxel nearer than the centre of its last voxel.
        let half = 0.5 * sampling.grid().spacing_mm[0];
        let to_target_mm = to_target_mm.iter().map(|r| (r - half).max(0.0)).collect();
        let objectives = vec![spec.resolve(prescribed, highest)];
        self.moves.push(follows(structure.role));
        self.structures.push(StructureObjectives { name: part, voxels, volumes, to_target_mm, objectives });
    }

    /// Rows of structures that are followed through every set-up, rising.
    pub fn followed(&self) -> &[u32] {
        &self.followed
    }
}

/// Whether a structure of this role is followed through every set-up: all but the outline, whose doses would be most of
/// the work.
pub fn follows(role: Role) -> bool {
    role != Role::External
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dose::DoseParams;
    use crate::fluence::{FallOff, Overdose, Underdose};
    use stillpoint_patient::case::{CaseParts, Mask, Prescription, phantom};

    fn set_of_phantom() -> (Case, ObjectiveSet) {
        let case = phantom(0).unwrap();
        let grid = DoseParams::over(case.grid(), 5.0).grid;
        let set = ObjectiveTable::shipped().unwrap().for_case(&case, &grid).unwrap();
        (case, set)
    }

    #[test]
    fn targets_come_first_and_a_voxel_counts_once() {
        let (_, set) = set_of_phantom();
        let names: Vec<&str> = set.structures.iter().map(|w| w.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "PTV",
                "Rectum",
                "Bladder",
                "FemoralHeadL",
                "FemoralHeadR",
                "Body (fall-off)",
                "Body (fall-off)",
                "Body (first 10 mm)",
                "Body"
            ]
        );
        let whole = set.structures.iter().filter(|w| !w.name.contains('('));
        let mut all: Vec<u32> = whole.flat_map(|w| w.voxels.clone()).collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
        assert_eq!(
            set.structures[0].objectives[0],
            Objective::Underdose(Underdose { dose: 78.0, weight: 1600.0 })
        );
    }

    #[test]
    fn set_ups_share_the_weight_and_the_outline_counts_once() {
        let (_, set) = set_of_phantom();
        let goals = set.goals(7).unwrap();
        assert_eq!(goals.rows(), 7 * set.rows);
        assert_eq!(goals.structures().len(), 7 * 5 + 4);
        let whole = set.structures.iter().filter(|w| !w.name.contains('('));
        let all = whole.map(|w| w.voxels.len()).sum::<usize>();
        let moving: usize = set.structures[..5].iter().map(|w| w.voxels.len()).sum();
        assert_eq!(goals.voxels().len(), all + 6 * moving);
        assert!(set.structures[..5].iter().all(|w| w.voxels.iter().all(|v| set.followed.contains(v))));
        assert_eq!(
            goals.structures()[6].objectives[0],
            Objective::Underdose(Underdose { dose: 78.0, weight: 1600.0 * (1.0 / 7.0) })
        );
        assert!(matches!(
            goals.structures()[38].objectives[0],
            Objective::Overdose(Overdose { weight: 8.0, .. })
        ));
    }

    /// Goals by distance hold for all points outside the targets, also those of organs.
    #[test]
    fn the_fall_off_and_the_entry_count_for_every_point_of_their_region_outside_the_targets() {
        let (case, set) = set_of_phantom();
        let find = |name: &str| set.structures.iter().find(|w| w.name == name).unwrap();
        let (fall_off, entry) = (find("Body (fall-off)"), find("Body (first 10 mm)"));
        let rectum = find("Rectum");
        assert!(rectum.voxels.iter().all(|v| fall_off.voxels.contains(v)));
        assert!(find("PTV").voxels.iter().all(|v| !fall_off.voxels.contains(v)));
        let nearest = fall_off.to_target_mm.iter().fold(f64::INFINITY, |a, b| a.min(*b));
        assert_eq!((fall_off.to_target_mm.len(), nearest), (fall_off.voxels.len(), 2.5), "voxels of 5 mm");
        assert!(matches!(
            fall_off.objectives[..],
            [Objective::FallOff(FallOff { near: 78.0, over_mm: 13.0, .. })]
        ));
        let grid = DoseParams::over(case.grid(), 5.0).grid;
        let body = case.external().unwrap();
        let deep = |voxel: u32| {
            let centre = grid.centre_mm(grid.voxel(voxel as usize));
            // A cross of 15 mm arms around the voxel is in the patient.
            (0..3).all(|axis| {
                [-15.0, 15.0].iter().all(|by| {
                    let mut at = centre;
                    at[axis] += by;
                    let place = std::array::from_fn(|i| {
                        ((at[i] - case.grid().origin_mm[i]) / case.grid().spacing_mm[i]).round().max(0.0)
                            as usize
                    });
                    (0..3).all(|i| place[i] < case.grid().counts[i])
                        && body.mask.contains(case.grid().index(place))
                })
            })
        };
        let too_deep = entry.voxels.iter().filter(|v| deep(**v)).count();
        assert!(
            !entry.voxels.is_empty() && too_deep * 20 < entry.voxels.len(),
            "{too_deep} of {}",
            entry.voxels.len()
        );
        assert!(matches!(entry.objectives[..], [Objective::Overdose(Overdose { dose: 39.0, .. })]));
    }

    #[test]
    fn a_line_that_counts_for_nothing_is_said_with_its_cause() {
        let (case, shipped) = set_of_phantom();
        assert_eq!(shipped.notes, Vec::<String>::new(), "the shipped table has lines for other sites");
        let grid = DoseParams::over(case.grid(), 5.0).grid;
        let own = r#"{"objectives": [
            {"match": ["Rectum"], "wanted": []}, {"match": ["Rectun"], "wanted": []},
            {"match": ["rect*"], "role": "organ", "wanted": []}]}"#;
        let own = ObjectiveTable::parse(own).unwrap().before(ObjectiveTable::shipped().unwrap());
        let notes = own.for_case(&case, &grid).unwrap().notes;
        assert_eq!(notes.len(), 2, "{notes:?}");
        assert!(
            notes[0].starts_with("line 2 of the objectives (match: Rectun) counts for nothing: no structure")
        );
        assert!(
            notes[1].contains("(match: rect*, role: organ)")
                && notes[1].ends_with("a line before it takes Rectum")
        );
    }

    #[test]
    fn a_target_without_a_dose_is_refused() {
        let (case, _) = set_of_phantom();
        let grid = DoseParams::over(case.grid(), 5.0).grid;
        let own = r#"{"objectives": [{"role": "external", "wanted": [{"overdose": {"dose": "1 Gy", "weight": 1}}]}]}"#;
        let only = ObjectiveTable::parse(own).unwrap();
        assert_eq!(only.for_case(&case, &grid), Err(ObjectiveSetError::NoTarget));
        let unprescribed = two_targets(Vec::new());
        let grid = *unprescribed.grid();
        let shipped = ObjectiveTable::shipped().unwrap();
        assert_eq!(shipped.for_case(&unprescribed, &grid), Err(ObjectiveSetError::NoDose("low".into())));
        let own = r#"{"objectives": [
            {"match": ["PTV"], "wanted": [{"overdose": {"dose": "60 Gy", "weight": 1}}]},
            {"match": ["low"], "wanted": [{"overdose": {"dose": "104 % of the highest", "weight": 1}}]}]}"#;
        let own = ObjectiveTable::parse(own).unwrap();
        assert_eq!(own.for_case(&unprescribed, &grid), Err(ObjectiveSetError::NoPrescription("low".into())));
    }

    /// A box in a box, each a target.
    fn two_targets(prescription: Vec<Prescription>) -> Case {
        let grid = Grid { counts: [6, 6, 6], spacing_mm: [5.0; 3], origin_mm: [0.0; 3] };
        let within = |most: usize| Mask::from_fn(grid.len(), |i| grid.voxel(i).iter().all(|c| *c < most));
        let target =
            |name: &str, most| Structure { name: name.into(), role: Role::Target, mask: within(most) };
        Case::new(CaseParts {
            name: "two".into(),
            grid,
            hu: vec![0; grid.len()],
            structures: vec![target("low", 5), target("PTV", 3)],
            isocentre_mm: None,
            prescription,
            fractions: None,
            reference_dose_gy: None,
            uids: None,
            provenance: String::new(),
        })
        .unwrap()
    }

    #[test]
    fn a_share_of_the_highest_is_one_dose_for_all_targets() {
        let prescribed = |structure: &str, dose_gy| Prescription { structure: structure.into(), dose_gy };
        let case = two_targets(vec![prescribed("low", 50.0), prescribed("PTV", 70.0)]);
        let set = ObjectiveTable::shipped().unwrap().for_case(&case, case.grid()).unwrap();
        let names: Vec<&str> = set.structures.iter().map(|w| w.name.as_str()).collect();
        assert_eq!(names, ["PTV", "low"]);
        for (structure, own) in set.structures.iter().zip([70.0, 50.0]) {
            let expected = [
                Objective::Underdose(Underdose { dose: own, weight: 1600.0 }),
                Objective::Overdose(Overdose { dose: 1.02 * own, weight: 150.0 }),
                Objective::Overdose(Overdose { dose: 1.04 * 70.0, weight: 1500.0 }),
            ];
            assert_eq!(structure.objectives, expected);
        }
    }

    #[test]
    fn the_costs_of_the_results_add_up_to_that_of_the_plan_and_true_values_stand_beside_them() {
        let case = phantom(0).unwrap();
        let grid = DoseParams::over(case.grid(), 5.0).grid;
        let own = r#"{"objectives": [
            {"match": ["Rectum"], "wanted": [
                {"geud": {"a": 8, "limit": "<= 40 %", "weight": 3}},
                {"dvh_point": {"limit": "V20Gy <= 30 %", "weight": 7}},
                {"mean_dose": {"dose": "20 Gy", "weight": 1}}]},
            {"match": ["Bladder"], "wanted": [{"dvh_point": {"limit": "D10% <= 30 Gy", "weight": 5}}]}]}"#;
        let table = ObjectiveTable::parse(own).unwrap().before(ObjectiveTable::shipped().unwrap());
        let set = table.for_case(&case, &grid).unwrap();
        // A dose that falls from front to back.
        let of_voxel = |grid: &Grid, voxel: usize| 60.0 + 0.2 * grid.centre_mm(grid.voxel(voxel))[1];
        let gray: Vec<f32> = (0..grid.len()).map(|v| of_voxel(&grid, v) as f32).collect();
        let evaluation = crate::evaluation::OnGrid::new(&case, &grid).evaluate(&gray);
        for setups in [1, 3] {
            let goals = set.goals(setups).unwrap();
            let dose: Vec<f64> =
                goals.voxels().iter().map(|row| of_voxel(&grid, *row as usize % set.rows)).collect();
            let results = set.results(&goals, &dose, &evaluation).unwrap();
            let mut all = vec![0.0; goals.rows()];
            goals.voxels().iter().zip(&dose).for_each(|(row, gray)| all[*row as usize] = *gray);
            let (sum, whole) = (results.iter().map(|r| r.cost).sum::<f64>(), goals.cost(&all).unwrap());
            assert!((sum - whole).abs() < 1e-9 * whole && whole > 0.0, "{sum} {whole}");
            let (_, rectum) = evaluation.histograms.iter().find(|(s, _)| s.name == "Rectum").unwrap();
            let found: Vec<_> = results.iter().filter(|r| r.structure == "Rectum").collect();
            let values: Vec<f64> = found.iter().map(|r| r.measured.as_ref().unwrap().value).collect();
            assert_eq!(values, [rectum.geud(8.0), 100.0 * rectum.volume_at(20.0), rectum.mean()]);
            assert_eq!(found[1].measured.as_ref().unwrap().requested(), "V20Gy <= 30 %");
            assert_eq!(found[0].met, Some(rectum.geud(8.0) <= 0.4 * 78.0));
            let bladder = results.iter().find(|r| r.structure == "Bladder").unwrap();
            assert_eq!(bladder.measured.as_ref().unwrap().requested(), "D10% <= 30 Gy");
            let text = serde_json::to_string(&results).unwrap();
            assert_eq!(serde_json::from_str::<Vec<super::super::ObjectiveResult>>(&text).unwrap(), results);
            assert!(set.results(&goals, &dose[1..], &evaluation).is_err());
        }
        let other = ObjectiveTable::shipped().unwrap().for_case(&case, &grid).unwrap();
        let goals = other.goals(1).unwrap();
        let dose = vec![0.0; goals.voxels().len()];
        assert!(set.results(&goals, &dose, &evaluation).is_err(), "goals of another set");
    }
}
