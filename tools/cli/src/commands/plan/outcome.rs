//! What a plan gives: doses, figures, and all of it as JSON.

use serde_json::{Value, json};
use stillpoint_plan::beams::Progress;
use stillpoint_plan::evaluation::StructureDose;
use stillpoint_plan::fluence::Wanted;
use stillpoint_plan::objectives::follows;

use super::ground::Ground;
use super::request::Request;
use super::search::Run;

/// The best plan and what it gives.
pub struct Outcome<'a> {
    /// How it was found.
    pub run: &'a Run,
    /// Gantry angles, rising, degrees.
    pub angles_deg: Vec<f64>,
    /// Dose on the dose grid in each set-up, gray, the planned one first. The others hold the voxels that are followed.
    pub gray: Vec<Vec<f32>>,
    /// Figures of the planned set-up.
    pub figures: Vec<StructureDose>,
    /// Figures of the other set-ups; of structures that are followed through them.
    pub moved: Vec<Vec<StructureDose>>,
    /// Figures of the dose that came with the case.
    pub reference: Option<Vec<StructureDose>>,
}

impl<'a> Outcome<'a> {
    /// Of this run.
    pub fn new(request: &Request, ground: &Ground<'_>, run: &'a Run) -> Self {
        let best = &run.choice.best;
        let gray: Vec<Vec<f32>> =
            (0..request.setups_mm.len()).map(|setup| ground.doses.dose(best, setup)).collect();
        let figures = |gray: &[f32]| ground.on_grid.figures(gray, &ground.volumes_at_gy);
        let of_moving = |gray: &Vec<f32>| {
            let mut figures = figures(gray);
            figures.retain(|f| follows(f.role));
            // The dose around the target is not known there.
            figures.iter_mut().for_each(|f| f.conformity = None);
            figures
        };
        Self {
            run,
            angles_deg: best.beams.beams().iter().map(|beam| request.ring.angle_deg(*beam)).collect(),
            figures: figures(&gray[0]),
            moved: gray[1..].iter().map(of_moving).collect(),
            reference: ground.reference.as_deref().map(figures),
            gray,
        }
    }

    /// Everything, as it is written to `plan.json`; nothing in it depends on a clock.
    pub fn told(&self, request: &Request, ground: &Ground<'_>, runs: &[Run]) -> Value {
        let best = &self.run.choice.best;
        let params = ground.engine.params();
        let beam = |beam: &u16| {
            let weights = best.weights_of(*beam).unwrap_or_default();
            let bixels =
                ground.doses.bixels_mm(*beam).iter().zip(weights).map(|([x, z], w)| json!([x, z, w]));
            json!({
                "gantry_deg": request.ring.angle_deg(*beam),
                "weight": weights.iter().sum::<f64>(),
                "bixels_x_z_mm_weight": bixels.collect::<Vec<_>>(),
            })
        };
        let certificate = &best.plan.certificate;
        let setup = |(shift, figures): (&[f64; 3], &Vec<StructureDose>)| json!({ "patient_moved_mm": shift, "structures": figures });
        json!({
            "stillpoint": env!("CARGO_PKG_VERSION"),
            "warning": "Research only. No plan made by stillpoint may treat a patient.",
            "case": { "name": request.case.name(), "hash": request.hash.to_string(), "provenance": request.case.provenance() },
            "prescription": request.case.prescription(),
            "fractions": request.case.fractions(),
            "isocentre_mm": request.case.isocentre_mm(),
            "machine": { "energy_mv": request.machine.file().energy_mv, "provenance": request.machine.file().provenance },
            "dose": {
                "grid": { "counts": params.grid.counts, "spacing_mm": params.grid.spacing_mm, "origin_mm": params.grid.origin_mm },
                "bixel_mm": params.bixels.width_mm,
                "cutoff_mm": params.cutoff_mm,
            },
            "wanted": ground.aims.wanted.iter().map(wanted).collect::<Vec<_>>(),
            "method": self.run.way,
            "seed": request.seed,
            "objective": best.cost,
            "excess_at_most": certificate.excess,
            "kkt": certificate.kkt,
            "newton_steps": best.plan.steps,
            "beams": best.beams.beams().iter().map(beam).collect::<Vec<_>>(),
            "structures": self.figures,
            "setups": request.setups_mm[1..].iter().zip(&self.moved).map(setup).collect::<Vec<_>>(),
            "reference": self.reference,
            "searches": runs.iter().map(|run| search(request, run)).collect::<Vec<_>>(),
        })
    }
}

/// Objectives as they were solved: doses in gray, over the voxels of the dose grid that count for the structure.
fn wanted(wanted: &Wanted) -> Value {
    json!({ "structure": wanted.name, "voxels": wanted.voxels.len(), "objectives": wanted.objectives })
}

fn search(request: &Request, run: &Run) -> Value {
    let angles = |progress: &Progress| {
        progress.beams.beams().iter().map(|beam| request.ring.angle_deg(*beam)).collect::<Vec<_>>()
    };
    let solve = |progress: &Progress| {
        let best = Some(progress.best).filter(|b| b.is_finite());
        json!({ "cost": progress.cost, "best": best, "prices": progress.prices, "angles_deg": angles(progress) })
    };
    json!({
        "method": run.way,
        "budget": request.budget,
        "ended": if run.choice.spent { "the budget was spent" } else { "nothing more to try" },
        "objective": run.choice.best.cost,
        "angles_deg": run.choice.best.beams.beams().iter().map(|b| request.ring.angle_deg(*b)).collect::<Vec<_>>(),
        "solves": run.history.len(),
        "prices": run.prices,
        "history": run.history.iter().map(solve).collect::<Vec<_>>(),
    })
}
