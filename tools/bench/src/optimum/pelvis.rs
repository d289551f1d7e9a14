//! Pelves whose beams are chosen again and again: the rows and goals of a small fluence problem, doses in memory.

use std::num::NonZeroUsize;

use stillpoint_plan::Rows;
use stillpoint_plan::beams::Ring;
use stillpoint_plan::case::{Case, phantom};
use stillpoint_plan::dose::{DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::{Goals, Objective, Wanted, voxels_on};

/// Spacing of the dose grid, mm.
const GRID_MM: f64 = 5.0;
/// Of the voxels of the body outside other structures one in so many counts.
const BODY_EVERY: usize = 25;

/// A pelvis with the doses of a ring.
pub struct Pelvis {
    /// Its seed.
    pub seed: u64,
    /// The case.
    pub case: Case,
    /// The angles.
    pub ring: Ring,
    /// A matrix for each angle.
    pub doses: Vec<Rows>,
    /// The goals.
    pub goals: Goals,
}

impl Pelvis {
    /// The synthetic pelvis of a seed.
    pub fn new(seed: u64, ring: Ring, threads: NonZeroUsize) -> Result<Self, Box<dyn std::error::Error>> {
        let case = phantom(seed)?;
        let params = DoseParams::over(case.grid(), GRID_MM);
        let over = |dose, weight| Objective::Overdose { dose, weight };
        let under = |dose, weight| Objective::Underdose { dose, weight };
        let wanted = [
            ("PTV", vec![over(78.0, 100.0), under(78.0, 200.0)]),
            ("Rectum", vec![over(35.0, 20.0)]),
            ("Bladder", vec![over(35.0, 15.0)]),
            ("FemoralHeadL", vec![over(25.0, 8.0)]),
            ("FemoralHeadR", vec![over(25.0, 8.0)]),
            ("Body", vec![over(20.0, 8.0)]),
        ];
        // A voxel counts for the first structure that has it.
        let mut taken = vec![false; params.grid.len()];
        let mut of_structure = Vec::new();
        for (name, objectives) in wanted {
            let structure = case.structure(name).ok_or_else(|| format!("pelvis {seed} has no {name}"))?;
            let mut voxels = voxels_on(&params.grid, case.grid(), &structure.mask);
            voxels.retain(|v| !std::mem::replace(&mut taken[*v as usize], true));
            if name == "Body" {
                voxels = voxels.into_iter().step_by(BODY_EVERY).collect();
            }
            of_structure.push((name, objectives, voxels));
        }
        let mut samples: Vec<u32> = of_structure.iter().flat_map(|(.., voxels)| voxels.clone()).collect();
        samples.sort_unstable();
        let row = |voxel: &u32| samples.binary_search(voxel).unwrap_or_default() as u32;
        let wanted = of_structure.into_iter().map(|(name, objectives, voxels)| Wanted {
            name: name.into(),
            voxels: voxels.iter().map(row).collect(),
            volumes: Vec::new(),
            to_target_mm: Vec::new(),
            objectives,
        });
        let goals = Goals::new(wanted.collect(), samples.len())?;
        let engine = DoseEngine::of_case(&case, Machine::shipped()?, params)?.sampled(samples);
        let angles: Vec<f64> = (0..ring.count()).map(|beam| ring.angle_deg(beam)).collect();
        let columns = engine.beams(&angles, threads)?;
        let doses =
            columns.iter().map(|beam| Rows::from_columns(beam.dose.view())).collect::<Result<_, _>>()?;
        Ok(Self { seed, case, ring, doses, goals })
    }
}
