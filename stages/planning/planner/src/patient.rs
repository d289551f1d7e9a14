//! A case, ready for plans in any set-up.

use nalgebra::Vector3;
use stillpoint_operator::{Setup, SetupError};
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, PatientPosition, content_hash, from_bytes, phantom};
use stillpoint_patient::couch::patient_from_couch;
use stillpoint_plan::RowsRef;
use stillpoint_plan::beams::{Evaluated, Ring};
use stillpoint_plan::dose::{BixelSpec, DoseEngine, DoseParams, Machine};
use stillpoint_plan::evaluation::OnGrid;
use stillpoint_plan::fluence::Goals;
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::protocol::Protocol;

/// Lengths of the plans of a patient, mm.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// Distance between the points whose dose is optimised.
    pub grid_mm: f64,
    /// Width of a bixel.
    pub bixel_mm: f64,
    /// Farthest set-up. Bixels are placed that much farther beyond the target than usual.
    pub reach_mm: f64,
}

/// All that the plans of a case share in any set-up.
pub struct Patient {
    /// Content hash of the case.
    pub hash: [u64; 4],
    pub goals: Goals,
    /// Doses in the planned set-up.
    pub engine: DoseEngine,
    pub ring: Ring,
    /// Prescription of the target, Gy.
    pub prescribed_gy: f64,
    position: PatientPosition,
    case: Case,
    grid: Grid,
    /// Limits that a standing plan keeps.
    limits: Protocol,
    /// Rows of the target in a dose matrix.
    target: Vec<usize>,
}

/// Doses of the target at the points that are optimised, Gy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetDose {
    pub d98: f64,
    pub d2: f64,
}

impl Patient {
    /// Makes a case ready, with gantry angles on `ring`.
    pub fn new(case: Case, sizes: Sizes, ring: Ring, limits: Protocol) -> Result<Self, SetupError> {
        let fault = |why: &dyn std::fmt::Display| SetupError(format!("case {}: {why}", case.name()));
        let hash = hash_of(&case)?;
        let usual = BixelSpec::of_width(sizes.bixel_mm);
        let bixels = BixelSpec { margin_mm: usual.margin_mm + sizes.reach_mm, ..usual };
        let params = DoseParams { bixels, ..DoseParams::over(case.grid(), sizes.grid_mm) };
        let table = ObjectiveTable::shipped().map_err(|e| fault(&e))?;
        let grid = params.grid;
        let aims = table.for_case(&case, &grid).map_err(|e| fault(&e))?;
        let goals = aims.goals(1).map_err(|e| fault(&e))?;
        let doses = case.prescription().iter().filter(|p| case.targets().any(|t| t.name == p.structure));
        let Some(highest) = doses.max_by(|a, b| a.dose_gy.total_cmp(&b.dose_gy)) else {
            return Err(fault(&"no target has a prescription"));
        };
        let points = goals.structures().iter().find(|w| w.name == highest.structure).map(|w| &w.voxels);
        let Some(points) = points.filter(|points| !points.is_empty()) else {
            return Err(fault(&format!(
                "{} has no point on the dose grid; a finer `grid` has some",
                highest.structure
            )));
        };
        let target = points.iter().map(|row| *row as usize).collect();
        let prescribed_gy = highest.dose_gy;
        let machine = Machine::shipped().map_err(|e| fault(&e))?;
        let engine = DoseEngine::of_case(&case, machine, params).map_err(|e| fault(&e))?;
        // Limits need the dose of all structures, the search only that of the points of its objectives.
        let engine = if limits.limits.is_empty() { engine.within(goals.voxels()) } else { engine };
        let position = case.position();
        let patient = Self { hash, goals, engine, ring, prescribed_gy, position, case, grid, limits, target };
        patient.check_limits()?;
        Ok(patient)
    }

    /// Refuses limits of which the case has no quantity.
    fn check_limits(&self) -> Result<(), SetupError> {
        let even = vec![self.prescribed_gy as f32; self.grid.len()];
        let on_grid = OnGrid::new(&self.case, &self.grid);
        let judged = self.limits.judge(&self.case, &on_grid.evaluate(&even));
        match judged.iter().find(|judged| judged.value.is_none()) {
            Some(judged) => Err(SetupError(format!(
                "case {}: the limit `{}` of `limits` has no value for {}: a limit is on a structure of the case, on \
                 `target` or on `plan`",
                self.case.name(),
                judged.limit,
                judged.structure
            ))),
            None => Ok(()),
        }
    }

    /// A shift along the axes of the couch, m, as one along the axes of the patient, mm.
    pub fn shift_mm(&self, couch_m: [f64; 3]) -> [f64; 3] {
        (patient_from_couch(self.position) * Vector3::from(couch_m) * 1e3).into()
    }

    /// The dose of a plan to the target with these matrices; `None` where a matrix is missing.
    pub fn target_dose<'a>(
        &self,
        plan: &Evaluated,
        matrix: impl Fn(u16) -> Option<RowsRef<'a>>,
    ) -> Option<TargetDose> {
        let mut dose = vec![0.0; self.target.len()];
        for beam in plan.beams.beams() {
            let (rows, weights) = (matrix(*beam)?, plan.weights_of(*beam)?);
            for (sum, row) in dose.iter_mut().zip(&self.target) {
                let (columns, values) = rows.row(*row);
                *sum += columns
                    .iter()
                    .zip(values)
                    .map(|(c, v)| f64::from(*v) * weights[usize::from(*c)])
                    .sum::<f64>();
            }
        }
        let dvh = Dvh::new(&dose).ok()?;
        Some(TargetDose { d98: dvh.dose_at(98.0), d2: dvh.dose_at(2.0) })
    }

    /// Whether a plan keeps every limit with these matrices; `None` where a matrix is missing.
    pub fn keeps_limits<'a>(
        &self,
        plan: &Evaluated,
        matrix: impl Fn(u16) -> Option<RowsRef<'a>>,
    ) -> Option<bool> {
        if self.limits.limits.is_empty() {
            return Some(true);
        }
        let part = |beam: &u16| Some((matrix(*beam)?, plan.weights_of(*beam)?));
        let parts: Vec<_> = plan.beams.beams().iter().map(part).collect::<Option<_>>()?;
        let mut gray = vec![0.0; self.grid.len()];
        for (rows, weights) in parts {
            for (row, sum) in gray.iter_mut().enumerate() {
                let (columns, values) = rows.row(row);
                let doses = columns.iter().zip(values).map(|(c, v)| f64::from(*v) * weights[usize::from(*c)]);
                *sum += doses.sum::<f64>();
            }
        }
        let gray: Vec<f32> = gray.into_iter().map(|gray| gray as f32).collect();
        let evaluation = OnGrid::new(&self.case, &self.grid).evaluate(&gray);
        let judged = self.limits.judge(&self.case, &evaluation);
        Some(judged.iter().all(|judged| judged.passed == Some(true)))
    }
}

/// The case in this file; without a file, the synthetic pelvis of seed 0.
pub fn case_of(file: Option<&str>, setup: &Setup<'_>) -> Result<Case, SetupError> {
    match file {
        Some(name) => from_bytes(&setup.file(name)?).map_err(|e| SetupError(format!("{name}: {e}"))),
        None => phantom(0).map_err(|e| SetupError(e.to_string())),
    }
}

/// The content hash of a case as samples have it: little-endian words.
pub fn hash_of(case: &Case) -> Result<[u64; 4], SetupError> {
    let bytes = content_hash(case).map_err(|e| SetupError(e.to_string()))?.0;
    let word = |i: usize| (0..8).rev().fold(0, |word, byte| word << 8 | u64::from(bytes[8 * i + byte]));
    Ok([0, 1, 2, 3].map(word))
}
