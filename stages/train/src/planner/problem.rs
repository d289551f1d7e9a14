//! A varied pelvis with goals and coarse doses.

use std::num::NonZeroUsize;

use stillpoint_plan::Rows;
use stillpoint_plan::beams::Ring;
use stillpoint_plan::case::{Case, varied_phantom};
use stillpoint_plan::dose::{BixelSpec, DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::{Goals, Objective, Wanted, voxels_on};

use crate::TrainError;

/// Overdose objectives of organs: name, dose in Gy, weight. They are those of the shipped table.
const ORGANS: [(&str, f64, f64); 7] = [
    ("Rectum", 35.0, 20.0),
    ("Bladder", 35.0, 15.0),
    ("FemoralHeadL", 25.0, 8.0),
    ("FemoralHeadR", 25.0, 8.0),
    ("HipImplantL", 10.0, 15.0),
    ("HipImplantR", 10.0, 15.0),
    ("Bowel", 30.0, 15.0),
];

/// How coarse doses are.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Coarseness {
    /// Spacing of the dose grid, mm.
    pub grid_mm: f64,
    /// Width of a bixel, mm.
    pub bixel_mm: f64,
}

/// What is solved.
pub struct Problem {
    /// The patient.
    pub case: Case,
    /// The objectives, structure by structure.
    pub wanted: Vec<Wanted>,
    /// The same, checked.
    pub goals: Goals,
    engine: DoseEngine,
}

/// The ring of the dissertation: 90 angles, beams 20 degrees apart.
pub fn ring() -> Result<Ring, TrainError> {
    Ring::new(90, 5).map_err(plan)
}

/// An error of planning.
pub fn plan(error: impl std::fmt::Display) -> TrainError {
    TrainError::Plan(error.to_string())
}

impl Problem {
    /// The varied pelvis of this seed. Of organs every second voxel counts, of the outline every eighteenth.
    pub fn of_seed(seed: u64, coarse: Coarseness) -> Result<Self, TrainError> {
        let case = varied_phantom(seed).map_err(plan)?;
        let params = DoseParams {
            bixels: BixelSpec::of_width(coarse.bixel_mm),
            ..DoseParams::over(case.grid(), coarse.grid_mm)
        };
        let grid = params.grid;
        let prescribed = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let over = |dose, weight| Objective::Overdose { dose, weight };
        let target = vec![over(prescribed, 100.0), Objective::Underdose { dose: prescribed, weight: 200.0 }];
        let mut structures = vec![("PTV", target)];
        structures.extend(ORGANS.map(|(name, dose, weight)| (name, vec![over(dose, weight)])));
        structures.push(("Body", vec![over(20.0, 8.0)]));
        let mut taken = vec![false; grid.len()];
        let mut wanted = Vec::new();
        for (name, objectives) in structures {
            let Some(structure) = case.structure(name) else { continue };
            let mut voxels = voxels_on(&grid, case.grid(), &structure.mask);
            voxels.retain(|v| !std::mem::replace(&mut taken[*v as usize], true));
            let counts = |v: &u32| {
                let [x, y, z] = grid.voxel(*v as usize);
                match name {
                    "PTV" => true,
                    "Body" => x % 3 == 0 && y % 3 == 0 && z % 2 == 0,
                    _ => (x + y + z) % 2 == 0,
                }
            };
            voxels.retain(counts);
            if !voxels.is_empty() {
                wanted.push(Wanted {
                    name: name.to_owned(),
                    voxels,
                    volumes: Vec::new(),
                    to_target_mm: Vec::new(),
                    objectives,
                });
            }
        }
        let mut samples: Vec<u32> = wanted.iter().flat_map(|w| w.voxels.iter().copied()).collect();
        samples.sort_unstable();
        for voxel in wanted.iter_mut().flat_map(|w| &mut w.voxels) {
            *voxel = samples.binary_search(voxel).unwrap_or_default() as u32;
        }
        let machine = Machine::shipped().map_err(plan)?;
        let goals = Goals::new(wanted.clone(), samples.len()).map_err(plan)?;
        let engine = DoseEngine::of_case(&case, machine, params).map_err(plan)?.sampled(samples);
        Ok(Self { case, wanted, goals, engine })
    }

    /// The dose matrices of all beams of a ring.
    pub fn doses(&self, ring: Ring, threads: NonZeroUsize) -> Result<Vec<Rows>, TrainError> {
        let angles: Vec<f64> = (0..ring.count()).map(|beam| ring.angle_deg(beam)).collect();
        let beams = self.engine.beams(&angles, threads).map_err(plan)?;
        beams.iter().map(|beam| Rows::from_columns(beam.dose.view()).map_err(plan)).collect()
    }
}
