//! What a plan gives: doses, figures, and all of it as JSON.

use stillpoint_patient::Grid;
use stillpoint_patient::case::Structure;
use stillpoint_plan::beams::{Progress, SHARE_OF_A_SOLVE};
use stillpoint_plan::check::Checked;
use stillpoint_plan::dose::{BeamAngles, EngineName, LowDensity};
use stillpoint_plan::evaluation::{Evaluation, FallOff, OnGrid, StructureDose, brought_to};
use stillpoint_plan::fluence::StructureObjectives;
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::objectives::{ObjectiveResult, follows};
use stillpoint_plan::plan_file::{
    Histogram, PlanFile, PlanFileBeam, PlanFileCase, PlanFileCheck, PlanFileDose, PlanFileFigures,
    PlanFileGame, PlanFileGrid, PlanFileLowDensity, PlanFileMachine, PlanFileObjectives, PlanFilePoints,
    PlanFileProtocol, PlanFileSearch, PlanFileServed, PlanFileSetup, PlanFileSolve, WARNING,
};
use stillpoint_plan::protocol::Judged;
use stillpoint_plan::recompute::{BeamFluence, Recompute, WeightedBeam};

use super::charts::{percent_curve, up_to_gy};
use super::leaves::Leaves;
use super::prepared::{Prepared, bar};
use super::request::Request;
use crate::exit::Failure;
use stillpoint_plan::recipe::{Delivery, PlanRun};

/// The best plan and what it gives: of a dose that is computed again on a finer grid than that of the points.
pub struct Outcome<'a> {
    /// How it was found.
    pub run: &'a PlanRun,
    /// Where the beams come from, by rising gantry angle.
    pub angles: Vec<BeamAngles>,
    grid: Grid,
    /// Dose in each set-up, gray, the planned one first.
    pub gray: Vec<Vec<f32>>,
    /// What each of these doses gives the structures.
    pub given: Vec<Evaluation<'a>>,
    /// Figures of the planned set-up.
    pub figures: Vec<StructureDose>,
    /// How the dose falls off in the planned set-up.
    pub fall_off: Option<FallOff>,
    /// What uneven fluence adds to the objective.
    pub modulation: f64,
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
    /// Lung and air on the rays of the bixels with weight.
    pub low_density: LowDensity,
    /// What the check of the plan found.
    pub checked: Checked,
}

impl<'a> Outcome<'a> {
    /// Of this run.
    pub fn new(request: &'a Request, prepared: &Prepared, run: &'a PlanRun) -> Result<Self, Failure> {
        let best = &run.choice.best;
        let case = &request.setup.case;
        let points_mm = request.setup.points_mm();
        let machine = request.setup.spec.machine.clone();
        let params = request.setup.engine().params();
        let recompute = match request.dose_grid_mm {
            Some(spacing_mm) => Recompute::with_spacing(case, machine, params, spacing_mm),
            None => Recompute::new(case, machine, params, points_mm),
        };
        let recompute = recompute.map_err(Failure::failed)?;
        let weighted = |beam: &u16| WeightedBeam {
            angles: request.setup.directions.angles(*beam),
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
        let figures = |given: &Evaluation<'_>| given.figures(&prepared.volumes_at_gy);
        let of_moving = |given: &Evaluation<'_>| {
            let mut figures = figures(given);
            figures.retain(|f| follows(f.role));
            figures
        };
        let objectives =
            request.setup.objective_set.results(&request.setup.goals, &best.plan.dose, &given[0]);
        let reference = case.reference_dose_gy();
        let reference_given =
            reference.map(|gray| on_grid.evaluate(&brought_to(recompute.grid(), case.grid(), gray)));
        let leaves = Leaves::new(request, prepared, run, &recompute, &on_grid)?;
        let low_density = request.setup.low_density(best, &prepared.doses.solved);
        Ok(Self {
            low_density: low_density.map_err(Failure::failed)?,
            checked: checked(request, prepared, run, leaves.as_ref())?,
            leaves,
            run,
            angles: request.setup.angles(best.beams.beams()),
            figures: figures(&given[0]),
            fall_off: given[0].fall_off,
            modulation: match request.setup.goals.modulation() {
                Some(_) => {
                    best.solved_cost() - request.setup.goals.cost_of(&best.plan).map_err(Failure::failed)?
                }
                None => 0.0,
            },
            objectives: objectives.map_err(Failure::failed)?,
            limits: request.protocol().iter().flat_map(|p| p.judge(case, &given[0])).collect(),
            moved: given[1..].iter().map(of_moving).collect(),
            reference: reference_given.as_ref().map(figures),
            reference_given,
            gray,
            given,
            grid: *on_grid.grid(),
        })
    }

    /// Whether the check refuses the plan, and no person takes it all the same.
    pub fn is_refused(&self, request: &Request) -> bool {
        !self.checked.faults.is_empty() && request.accept_check.is_none()
    }

    /// What a person should know of the method by which dose was computed.
    pub fn caution(&self, request: &Request) -> Option<String> {
        request.setup.caution(&self.low_density)
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
    pub fn file(
        &self,
        request: &Request,
        prepared: &Prepared,
        runs: &[PlanRun],
    ) -> Result<PlanFile, serde_json::Error> {
        let best = &self.run.choice.best;
        let setup = &request.setup;
        let machine = setup.spec.machine.file();
        let beam = |beam: &u16| {
            let weights = best.weights_of(*beam).unwrap_or_default();
            let bixels = prepared.doses.solved.bixels_mm(*beam).iter().zip(weights);
            let BeamAngles { gantry_deg, couch_deg } = setup.directions.angles(*beam);
            PlanFileBeam {
                gantry_deg,
                couch_deg,
                weight: weights.iter().sum(),
                bixels_x_z_mm_weight: bixels.map(|([x, z], w)| [*x, *z, *w]).collect(),
            }
        };
        let certificate = &best.plan.certificate;
        let moved = |(shift, figures): (&[f64; 3], &Vec<StructureDose>)| PlanFileSetup {
            patient_moved_mm: *shift,
            structures: figures.clone(),
        };
        let beams: Vec<PlanFileBeam> = best.beams.beams().iter().map(beam).collect();
        Ok(PlanFile {
            version: PlanFile::version_of(&beams),
            stillpoint: env!("CARGO_PKG_VERSION").to_owned(),
            warning: WARNING.to_owned(),
            case: case_of(request),
            prescription: setup.case.prescription().to_vec(),
            fractions: setup.case.fractions(),
            isocentre_mm: setup.case.isocentre_mm(),
            machine: PlanFileMachine { energy_mv: machine.energy_mv, provenance: machine.provenance.clone() },
            dose: dose_of(
                request,
                self.grid(),
                request.searched_by,
                &self.low_density,
                self.caution(request),
            ),
            requested: setup.objective_set.structures.iter().map(objectives).collect::<Result<_, _>>()?,
            objectives: self.objectives.iter().map(serde_json::to_value).collect::<Result<_, _>>()?,
            couch: request.couch.clone(),
            method: self.run.name,
            given_weights: request.has_weights,
            start: request.start.as_ref().map(|start| start.case.clone()),
            seed: request.seed,
            objective: best.solved_cost(),
            modulation: self.modulation,
            robust_game: best.answer.as_ref().map(|answer| PlanFileGame {
                worst_objective: best.cost,
                worst_setup: answer.error,
                objectives_of_setups: answer.costs.clone(),
            }),
            excess_at_most: finite(certificate.excess),
            kkt: finite(certificate.kkt),
            newton_steps: best.plan.steps,
            beams,
            figures: figures_of(request, &self.figures, &self.given[0], self.fall_off, &self.limits),
            leaves: self.leaves.as_ref().map(|leaves| leaves.file(request, self.run)),
            arcs: None,
            served: setup.served.iter().map(PlanFileServed::from).collect(),
            check: Some(PlanFileCheck::new(&self.checked, request.accept_check.as_deref())),
            setups: request.setups_mm[1..].iter().zip(&self.moved).map(moved).collect(),
            reference: self.reference.clone(),
            searches: runs.iter().map(|run| search(request, run)).collect(),
        })
    }
}

/// The case of a request.
pub fn case_of(request: &Request) -> PlanFileCase {
    let setup = &request.setup;
    PlanFileCase {
        name: setup.case.name().to_owned(),
        hash: setup.hash.to_string(),
        provenance: setup.case.provenance().to_owned(),
    }
}

/// Grids, bixels and engines of a dose on this grid.
pub fn dose_of(
    request: &Request,
    grid: &Grid,
    searched_by: Option<EngineName>,
    low_density: &LowDensity,
    caution: Option<String>,
) -> PlanFileDose {
    let setup = &request.setup;
    let params = setup.engine().params();
    PlanFileDose {
        grid: PlanFileGrid::from(grid),
        optimised: Some(PlanFilePoints {
            lattice: PlanFileGrid::from(&params.grid),
            points: setup.goals.voxels().len(),
        }),
        bixel_mm: params.bixels.width_mm,
        cutoff_mm: params.cutoff_mm,
        engine: params.engine,
        searched_by,
        low_density: Some(PlanFileLowDensity {
            bixels: low_density.bixels,
            crossing: low_density.crossing,
            longest_mm: low_density.longest_mm,
            caution,
        }),
    }
}

/// The figures of a dose.
pub fn figures_of(
    request: &Request,
    structures: &[StructureDose],
    given: &Evaluation<'_>,
    fall_off: Option<FallOff>,
    limits: &[Judged],
) -> PlanFileFigures {
    let protocol = request.protocol();
    PlanFileFigures {
        structures: structures.to_vec(),
        histograms: histograms(given),
        fall_off,
        protocol: protocol.map(|p| PlanFileProtocol { name: p.name.clone(), limits: limits.to_vec() }),
    }
}

/// The histogram of each structure in percent of its volume.
fn histograms(given: &Evaluation<'_>) -> Vec<Histogram> {
    let up_to = up_to_gy(given.histograms.iter().map(|(_, dvh)| dvh));
    let of =
        |(structure, dvh): &(&Structure, Dvh)| Histogram::new(&structure.name, &percent_curve(dvh, up_to));
    given.histograms.iter().map(of).collect()
}

/// Objectives as they were solved: doses in gray, over the points that count for the structure.
pub fn objectives(requested: &StructureObjectives) -> Result<PlanFileObjectives, serde_json::Error> {
    let objectives: Result<Vec<_>, _> = requested.objectives.iter().map(serde_json::to_value).collect();
    Ok(PlanFileObjectives {
        structure: requested.name.clone(),
        voxels: requested.voxels.len(),
        objectives: objectives?,
    })
}

fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn search(request: &Request, run: &PlanRun) -> PlanFileSearch {
    let gantry = |beams: &[u16]| run.directions.all(beams).iter().map(|angles| angles.gantry_deg).collect();
    let solve = |progress: &Progress| PlanFileSolve {
        cost: finite(progress.cost),
        best: finite(progress.best),
        prices: progress.prices,
        angles_deg: gantry(progress.beams.beams()),
        couches_deg: run.directions.couches_deg(progress.beams.beams()),
    };
    let ended = match (request.has_weights, run.choice.spent) {
        (true, _) => "the weights were given",
        (false, true) => "the budget was spent",
        (false, false) => "nothing more to try",
    };
    PlanFileSearch {
        method: run.name,
        budget: run.budget,
        leaves: run.leaves.get(),
        ended: ended.to_owned(),
        objective: run.choice.best.cost,
        angles_deg: gantry(run.choice.best.beams.beams()),
        couches_deg: run.directions.couches_deg(run.choice.best.beams.beams()),
        solves: run.solves(),
        prices: run.prices,
        history: run.history.iter().map(solve).collect(),
    }
}

/// What the check of a plan finds: of what is exported, the segments where there are some.
fn checked(
    request: &Request,
    prepared: &Prepared,
    run: &PlanRun,
    leaves: Option<&Leaves<'_>>,
) -> Result<Checked, Failure> {
    let (best, setup) = (&run.choice.best, &request.setup);
    let fluence = |beam: &u16| BeamFluence {
        angles: setup.directions.angles(*beam),
        bixels_mm: prepared.doses.solved.bixels_mm(*beam).to_vec(),
        weights: best.weights_of(*beam).unwrap_or_default().to_vec(),
    };
    let planned: Vec<BeamFluence> = best.beams.beams().iter().map(fluence).collect();
    let delivery = Delivery {
        planned: &planned,
        delivered: leaves.map_or(&planned, |leaves| &leaves.fluences),
        monitor_units: leaves.map(|leaves| leaves.totals().1),
        moved_mm: [0.0; 3],
    };
    setup.check(&delivery, request.threads).map_err(Failure::failed)
}
