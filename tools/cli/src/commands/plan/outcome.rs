//! What a plan gives: doses, figures, and all of it as JSON.

use serde_json::{Value, json};
use stillpoint_patient::Grid;
use stillpoint_patient::case::Structure;
use stillpoint_plan::beams::{Progress, SHARE_OF_A_SOLVE};
use stillpoint_plan::evaluation::{Evaluation, FallOff, OnGrid, StructureDose, brought_to};
use stillpoint_plan::fluence::StructureObjectives;
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::objectives::{ObjectiveResult, follows};
use stillpoint_plan::protocol::Judged;
use stillpoint_plan::recompute::{Recompute, WeightedBeam};

use super::charts::up_to_gy;
use super::compare::Histogram;
use super::ground::{Ground, bar};
use super::leaves::Leaves;
use super::request::Request;
use super::search::Run;
use crate::exit::Failure;

/// The best plan and what it gives: of a dose that is computed again on a finer grid than that of the points.
pub struct Outcome<'a> {
    /// How it was found.
    pub run: &'a Run,
    /// Gantry angles, rising, degrees.
    pub angles_deg: Vec<f64>,
    grid: Grid,
    /// Dose in each set-up, gray, the planned one first.
    pub gray: Vec<Vec<f32>>,
    /// What each of these doses gives the structures.
    pub given: Vec<Evaluation<'a>>,
    /// Figures of the planned set-up.
    pub figures: Vec<StructureDose>,
    /// How the dose falls off in the planned set-up.
    pub fall_off: Option<FallOff>,
    /// The objectives with what the planned fluence gives.
    pub objectives: Vec<ObjectiveResult>,
    /// The limits of the protocol, in the planned set-up.
    pub limits: Vec<Judged>,
    /// The segments, with their dose; nothing where the fluence is not sequenced.
    pub leaves: Option<Leaves<'a>>,
    /// Figures of the other set-ups; of structures that are followed through them.
    pub moved: Vec<Vec<StructureDose>>,
    /// What the dose that came with the case gives, on the same grid.
    pub reference_given: Option<Evaluation<'a>>,
    /// Figures of that dose.
    pub reference: Option<Vec<StructureDose>>,
}

impl<'a> Outcome<'a> {
    /// Of this run.
    pub fn new(request: &'a Request, ground: &Ground, run: &'a Run) -> Result<Self, Failure> {
        let best = &run.choice.best;
        let case = &request.case;
        let points_mm = ground.sampling.grid().spacing_mm[0];
        let machine = request.machine.clone();
        let recompute = Recompute::new(case, machine, ground.engine().params(), points_mm);
        let recompute = recompute.map_err(Failure::failed)?;
        let weighted = |beam: &u16| WeightedBeam {
            gantry_deg: request.ring.angle_deg(*beam),
            weights: best.weights_of(*beam).unwrap_or_default(),
            bixels_mm: None,
        };
        let beams: Vec<WeightedBeam<'_>> = best.beams.beams().iter().map(weighted).collect();
        let bar = bar(request.setups_mm.len() as u64, "dose of the plan", request.quiet);
        let of_setup = |shift: &[f64; 3]| {
            bar.inc(1);
            recompute.dose(&beams, *shift, request.threads)
        };
        let gray: Result<Vec<Vec<f32>>, _> = request.setups_mm.iter().map(of_setup).collect();
        bar.finish_and_clear();
        let gray = gray.map_err(Failure::failed)?;
        let on_grid = OnGrid::new(case, recompute.grid());
        let given: Vec<Evaluation<'a>> = gray.iter().map(|gray| on_grid.evaluate(gray)).collect();
        let figures = |given: &Evaluation<'_>| given.figures(&ground.volumes_at_gy);
        let of_moving = |given: &Evaluation<'_>| {
            let mut figures = figures(given);
            figures.retain(|f| follows(f.role));
            figures
        };
        let objectives = ground.aims.results(&ground.goals, &best.plan.dose, &given[0]);
        let reference = case.reference_dose_gy();
        let reference_given =
            reference.map(|gray| on_grid.evaluate(&brought_to(recompute.grid(), case.grid(), gray)));
        Ok(Self {
            leaves: Leaves::new(request, ground, run, &recompute, &on_grid)?,
            run,
            angles_deg: best.beams.beams().iter().map(|beam| request.ring.angle_deg(*beam)).collect(),
            figures: figures(&given[0]),
            fall_off: given[0].fall_off,
            objectives: objectives.map_err(Failure::failed)?,
            limits: request.protocol.iter().flat_map(|p| p.judge(case, &given[0])).collect(),
            moved: given[1..].iter().map(of_moving).collect(),
            reference: reference_given.as_ref().map(figures),
            reference_given,
            gray,
            given,
            grid: *on_grid.grid(),
        })
    }

    /// The grid of the dose.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// What the robust game found, in words; nothing where it was not played.
    pub fn worst_case(&self, request: &Request) -> Option<String> {
        let best = &self.run.choice.best;
        let answer = best.answer.as_ref()?;
        let where_from = match answer.error.and_then(|error| request.setups_mm.get(error + 1)) {
            Some([x, y, z]) => format!("where the patient is moved by ({x}, {y}, {z}) mm"),
            None => "as planned".to_owned(),
        };
        Some(format!(
            "Robust game: the objective is {:.4} in the worst of {} set-ups, {where_from}, and {:.4} as planned. The search \
             minimised the worst; the fluence is that for the planned set-up. Each answer was counted as {:.2} solves.",
            best.cost,
            request.setups_mm.len(),
            best.solved_cost(),
            SHARE_OF_A_SOLVE * answer.costs.len() as f64,
        ))
    }

    /// Everything, as it is written to `plan.json`; nothing in it depends on a clock.
    pub fn told(&self, request: &Request, ground: &Ground, runs: &[Run]) -> Value {
        let best = &self.run.choice.best;
        let params = ground.engine().params();
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
                "grid": grid(self.grid()),
                "optimised": { "lattice": grid(&params.grid), "points": ground.goals.voxels().len() },
                "bixel_mm": params.bixels.width_mm,
                "cutoff_mm": params.cutoff_mm,
            },
            "wanted": ground.aims.structures.iter().map(wanted).collect::<Vec<_>>(),
            "objectives": self.objectives,
            "method": self.run.way,
            "seed": request.seed,
            "objective": best.solved_cost(),
            "robust_game": best.answer.as_ref().map(|answer| json!({
                "worst_objective": best.cost,
                "worst_setup": answer.error,
                "objectives_of_setups": answer.costs,
            })),
            "excess_at_most": certificate.excess,
            "kkt": certificate.kkt,
            "newton_steps": best.plan.steps,
            "beams": best.beams.beams().iter().map(beam).collect::<Vec<_>>(),
            "structures": self.figures,
            "histograms": histograms(&self.given[0]),
            "fall_off": self.fall_off,
            "protocol": request.protocol.as_ref().map(|p| json!({ "name": p.name, "limits": self.limits })),
            "leaves": self.leaves.as_ref().map(|leaves| leaves.told(request, self.run)),
            "setups": request.setups_mm[1..].iter().zip(&self.moved).map(setup).collect::<Vec<_>>(),
            "reference": self.reference,
            "searches": runs.iter().map(|run| search(request, run)).collect::<Vec<_>>(),
        })
    }
}

/// The histogram of each structure in percent of its volume.
pub fn histograms(given: &Evaluation<'_>) -> Vec<Histogram> {
    let up_to = up_to_gy(given.histograms.iter().map(|(_, dvh)| dvh));
    let told = |(structure, dvh): &(&Structure, Dvh)| Histogram::new(&structure.name, dvh, up_to);
    given.histograms.iter().map(told).collect()
}

fn grid(grid: &Grid) -> Value {
    json!({ "counts": grid.counts, "spacing_mm": grid.spacing_mm, "origin_mm": grid.origin_mm })
}

/// Objectives as they were solved: doses in gray, over the points that count for the structure.
fn wanted(wanted: &StructureObjectives) -> Value {
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
