//! A case, ready for plans in any set-up.

use nalgebra::Vector3;
use stillpoint_operator::{Setup, SetupError};
use stillpoint_patient::case::{Case, ContentHash, content_hash, from_bytes, phantom};
use stillpoint_patient::couch::patient_from_couch;
use stillpoint_plan::RowsRef;
use stillpoint_plan::beams::{Evaluated, Ring};
use stillpoint_plan::check::Checked;
use stillpoint_plan::dose::{DoseEngine, DoseError, EngineName};
use stillpoint_plan::evaluation::{Evaluation, OnGrid};
use stillpoint_plan::fluence::Goals;
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::protocol::{Judged, Protocol};
use stillpoint_plan::recipe::{Delivery, PlanSetup, SetupSpec};
use stillpoint_plan::recompute::{BeamFluence, Recompute, WeightedBeam};

/// Limits of the standing plan.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Each must be kept, and each must have a value for the case.
    pub own: Protocol,
    /// Those that the case has a value for must be kept.
    pub protocol: Option<Protocol>,
}

/// All that the plans of a case share in any set-up.
pub struct Patient {
    /// The case made ready.
    pub setup: PlanSetup,
    /// Content hash of the case.
    pub hash: [u64; 4],
    /// Prescription of the target, Gy.
    pub prescribed_gy: f64,
    limits: Limits,
    /// The dose of all structures, of which limits are judged; `None` without limits.
    recompute: Option<Recompute>,
    /// Rows of the target in a dose matrix.
    target: Vec<usize>,
    /// The volume that each of these rows stands for.
    volumes: Vec<f64>,
}

/// Doses of the target at the points that are optimised, Gy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetDose {
    pub d98: f64,
    pub d2: f64,
}

impl Patient {
    /// Makes a case ready.
    pub fn new(case: Case, spec: SetupSpec, limits: Limits) -> Result<Self, SetupError> {
        let name = case.name().to_owned();
        let fault = |why: &dyn std::fmt::Display| SetupError(format!("case {name}: {why}"));
        let setup = PlanSetup::new(case, spec).map_err(|e| fault(&e))?;
        let case = &setup.case;
        let doses = case.prescription().iter().filter(|p| case.targets().any(|t| t.name == p.structure));
        let Some(highest) = doses.max_by(|a, b| a.dose_gy.total_cmp(&b.dose_gy)) else {
            return Err(fault(&"no target has a prescription"));
        };
        let points = setup.objective_set.structures.iter().find(|w| w.name == highest.structure);
        let Some(points) = points.filter(|points| !points.voxels.is_empty()) else {
            return Err(fault(&format!(
                "{} has no point on the dose grid; a finer `grid` has some",
                highest.structure
            )));
        };
        let target: Vec<usize> = points.voxels.iter().map(|row| *row as usize).collect();
        let volumes = match points.volumes.is_empty() {
            true => vec![1.0; target.len()],
            false => points.volumes.clone(),
        };
        let has_limits = !limits.own.limits.is_empty() || limits.protocol.is_some();
        let recompute = has_limits.then(|| {
            let params = setup.engine().params();
            let grid_mm = setup.spec.grid_mm;
            Recompute::with_spacing(case, setup.spec.machine.clone(), params, grid_mm)
        });
        let recompute = recompute.transpose().map_err(|e| fault(&e))?;
        let (hash, prescribed_gy) = (words(&setup.hash), highest.dose_gy);
        let patient = Self { setup, hash, prescribed_gy, limits, recompute, target, volumes };
        patient.check_limits()?;
        Ok(patient)
    }

    /// The goals of plans.
    pub fn goals(&self) -> &Goals {
        &self.setup.goals
    }

    /// The angles that beams may have.
    pub fn ring(&self) -> Ring {
        self.setup.spec.ring
    }

    /// Doses in the planned set-up.
    pub fn engine(&self) -> &DoseEngine {
        self.setup.engine()
    }

    /// What a person should know of the method by which dose is computed, for plans of any beams of the ring.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn caution(&self) -> Result<Option<String>, SetupError> {
        if self.setup.engine_name() != EngineName::Pencil {
            return Ok(None);
        }
        let crossed = self.setup.low_density_of(&self.all_beams()).map_err(|e| SetupError(e.to_string()))?;
        Ok(self.setup.caution(&crossed))
    }

    fn all_beams(&self) -> Vec<u16> {
        (0..self.ring().count()).collect()
    }

    /// Refuses limits of which the case has no quantity, and a protocol of which no limit is on the case.
    fn check_limits(&self) -> Result<(), SetupError> {
        let Some(recompute) = &self.recompute else { return Ok(()) };
        let case = &self.setup.case;
        let even = vec![self.prescribed_gy as f32; recompute.grid().len()];
        let on_grid = OnGrid::new(case, recompute.grid());
        let evaluation = on_grid.evaluate(&even);
        let (own, protocol) = self.judged(&evaluation);
        if let Some(judged) = own.iter().find(|judged| judged.value.is_none()) {
            return Err(SetupError(format!(
                "case {}: the limit `{}` of `limits` has no value for {}: a limit is on a structure of the case, on \
                 `target` or on `plan`",
                case.name(),
                judged.limit,
                judged.structure
            )));
        }
        match &self.limits.protocol {
            Some(given) if !protocol.iter().any(|judged| judged.value.is_some()) => Err(SetupError(format!(
                "case {}: no limit of the protocol {} is on a structure of the case",
                case.name(),
                given.name
            ))),
            _ => Ok(()),
        }
    }

    /// The limits of `limits`, and those of the protocol.
    fn judged(&self, evaluation: &Evaluation<'_>) -> (Vec<Judged>, Vec<Judged>) {
        let case = &self.setup.case;
        let protocol = self.limits.protocol.as_ref().map(|protocol| protocol.judge(case, evaluation));
        (self.limits.own.judge(case, evaluation), protocol.unwrap_or_default())
    }

    /// A shift along the axes of the couch, m, as one along the axes of the patient, mm.
    pub fn shift_mm(&self, couch_m: [f64; 3]) -> [f64; 3] {
        (patient_from_couch(self.setup.case.position()) * Vector3::from(couch_m) * 1e3).into()
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
        let dvh = Dvh::weighted(&dose, &self.volumes).ok()?;
        Some(TargetDose { d98: dvh.dose_at(98.0), d2: dvh.dose_at(2.0) })
    }

    /// What the plan check finds in a plan for the patient displaced by so much, mm; the fluence is not sequenced.
    ///
    /// # Errors
    /// A dose cannot be computed there.
    pub fn check(
        &self,
        plan: &Evaluated,
        bixels_mm: impl Fn(u16) -> Vec<[f64; 2]>,
        moved_mm: [f64; 3],
    ) -> Result<Checked, DoseError> {
        let fluence = |beam: &u16| BeamFluence {
            angles: self.ring().angle_deg(*beam).into(),
            bixels_mm: bixels_mm(*beam),
            weights: plan.weights_of(*beam).unwrap_or_default().to_vec(),
        };
        let fluences: Vec<BeamFluence> = plan.beams.beams().iter().map(fluence).collect();
        let delivery = Delivery { planned: &fluences, delivered: &fluences, monitor_units: None, moved_mm };
        self.setup.check(&delivery, std::num::NonZeroUsize::MIN)
    }

    /// Whether a plan keeps every limit where the patient is displaced by so much, mm.
    ///
    /// # Errors
    /// The dose cannot be computed there.
    pub fn keeps_limits(&self, plan: &Evaluated, shift_mm: [f64; 3]) -> Result<bool, DoseError> {
        let Some(recompute) = &self.recompute else { return Ok(true) };
        let weighted = |beam: &u16| WeightedBeam {
            angles: self.ring().angle_deg(*beam).into(),
            weights: plan.weights_of(*beam).unwrap_or_default(),
            bixels_mm: None,
        };
        let beams: Vec<WeightedBeam<'_>> = plan.beams.beams().iter().map(weighted).collect();
        let gray = recompute.dose(&beams, shift_mm, std::num::NonZeroUsize::MIN)?;
        let on_grid = OnGrid::new(&self.setup.case, recompute.grid());
        let (own, protocol) = self.judged(&on_grid.evaluate(&gray));
        Ok(own.iter().all(|judged| judged.passed == Some(true))
            && protocol.iter().all(|judged| judged.passed != Some(false)))
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
    content_hash(case).map(|hash| words(&hash)).map_err(|e| SetupError(e.to_string()))
}

fn words(hash: &ContentHash) -> [u64; 4] {
    let bytes = hash.0;
    let word = |i: usize| (0..8).rev().fold(0, |word, byte| word << 8 | u64::from(bytes[8 * i + byte]));
    [0, 1, 2, 3].map(word)
}
