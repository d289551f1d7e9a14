//! The segments of a plan, and what they give.

use stillpoint_plan::beams::Influence;
use stillpoint_plan::dose::Collimator;
use stillpoint_plan::evaluation::{Evaluation, FallOff, OnGrid, StructureDose};
use stillpoint_plan::leaves::{FluenceBeam, LeafBeam, LeafOptions, Segment, Sequenced, sequence};
use stillpoint_plan::plan_file::{PlanFileLeafBeam, PlanFileLeaves, PlanFileSegment};
use stillpoint_plan::protocol::Judged;
use stillpoint_plan::recompute::{BeamFluence, Recompute};

use super::outcome::figures_of;
use super::prepared::Prepared;
use super::request::{Request, unshaped};
use crate::exit::Failure;
use stillpoint_plan::recipe::PlanRun;

/// A plan in segments, in the planned set-up.
pub struct Leaves<'a> {
    /// The segments.
    pub sequenced: Sequenced,
    /// What the doses of the fluence cost that they stand for.
    planned: f64,
    /// What passes them.
    pub fluences: Vec<BeamFluence>,
    /// Their dose, gray.
    pub gray: Vec<f32>,
    /// What it gives the structures.
    pub given: Evaluation<'a>,
    /// Figures of it.
    pub figures: Vec<StructureDose>,
    /// How it falls off.
    pub fall_off: Option<FallOff>,
    /// The limits of the protocol.
    pub limits: Vec<Judged>,
    /// The leaves.
    collimator: Collimator,
    /// Monitor units of a fluence of weight 1 in one fraction.
    mu_per_weight: f64,
}

impl<'a> Leaves<'a> {
    /// Of this run, where the machine has leaves and the request wants them used; or why not.
    pub fn new(
        request: &Request,
        prepared: &Prepared,
        run: &PlanRun,
        recompute: &Recompute,
        on_grid: &OnGrid<'a>,
    ) -> Result<Option<Self>, Failure> {
        let Some(collimator) = request.collimator() else { return Ok(None) };
        let best = &run.choice.best;
        let beam = |beam: &u16| FluenceBeam {
            doses: prepared.doses.solved.beam(*beam),
            bixels_mm: prepared.doses.solved.bixels_mm(*beam),
            weights: best.weights_of(*beam).unwrap_or_default(),
        };
        let beams: Vec<FluenceBeam<'_>> = best.beams.beams().iter().map(beam).collect();
        let mu_per_weight = collimator.mu_per_weight / f64::from(request.setup.case.fractions().unwrap_or(1));
        let options = LeafOptions {
            width_mm: request.setup.spec.bixel_mm,
            least_weight: collimator.least_mu / mu_per_weight,
            ..LeafOptions::PLAN
        };
        // Segments have no modulation to pay for, so they are compared by doses.
        let planned = request.setup.goals.cost_of(&best.plan).map_err(Failure::failed)?;
        let sequenced = sequence(&request.setup.goals, &beams, collimator, planned, options);
        let sequenced = sequenced.map_err(unshaped)?;
        let fluences = fluences(request, run, &sequenced, collimator);
        let beams = BeamFluence::weighted(&fluences);
        let gray = recompute.dose(&beams, [0.0; 3], request.threads).map_err(Failure::failed)?;
        let given = on_grid.evaluate(&gray);
        Ok(Some(Self {
            figures: given.figures(&prepared.volumes_at_gy),
            fall_off: given.fall_off,
            limits: request.protocol().iter().flat_map(|p| p.judge(&request.setup.case, &given)).collect(),
            given,
            planned,
            fluences,
            sequenced,
            gray,
            collimator: collimator.clone(),
            mu_per_weight,
        }))
    }

    /// Monitor units of a segment's weight in one fraction.
    pub fn monitor_units(&self, weight: f64) -> f64 {
        weight * self.mu_per_weight
    }

    /// Monitor units of a beam in one fraction.
    pub fn beam_units(&self, beam: &LeafBeam) -> f64 {
        beam.segments.iter().map(|segment| self.monitor_units(segment.weight)).sum()
    }

    /// Segments of all beams, and their monitor units in one fraction.
    pub fn totals(&self) -> (usize, f64) {
        let beams = || self.sequenced.beams.iter().flatten();
        (beams().map(|beam| beam.segments.len()).sum(), beams().map(|beam| self.beam_units(beam)).sum())
    }

    /// How much the objective is above that of the fluence, as a part of it: behind leaves that let nothing through, and
    /// with their transmission.
    pub fn losses(&self) -> [f64; 2] {
        [self.sequenced.opaque, self.sequenced.plan.certificate.objective]
            .map(|cost| cost / self.planned - 1.0)
    }

    /// All of it, for `plan.json`.
    pub fn file(&self, request: &Request, run: &PlanRun) -> PlanFileLeaves {
        let [opaque, loss] = self.losses();
        let (segments, monitor_units) = self.totals();
        let segment = |segment: &Segment, field_mm: [[f64; 2]; 2]| {
            let open = segment.tips_mm.iter().enumerate().filter(|(_, [low, high])| low < high);
            PlanFileSegment {
                monitor_units: self.monitor_units(segment.weight),
                field_x_z_mm: (segment.field_mm != field_mm).then_some(segment.field_mm),
                open_pair_from_to_mm: open.map(|(pair, [low, high])| (pair, *low, *high)).collect(),
            }
        };
        let beam = |(number, beam): (&u16, &LeafBeam)| PlanFileLeafBeam {
            gantry_deg: request.setup.directions.angles(*number).gantry_deg,
            couch_deg: request.setup.directions.angles(*number).couch_deg,
            monitor_units: self.beam_units(beam),
            field_x_z_mm: beam.field_mm,
            segments: beam.segments.iter().map(|one| segment(one, beam.field_mm)).collect(),
        };
        PlanFileLeaves {
            collimator: self.collimator.clone(),
            levels: LeafOptions::PLAN.levels,
            objective: self.sequenced.plan.certificate.objective,
            loss,
            loss_without_transmission: Some(opaque),
            loss_before_segments_were_added: Some(self.sequenced.divided / self.planned - 1.0),
            added_segments: self.sequenced.added,
            segments,
            monitor_units,
            beams: self.beams(run).map(beam).collect(),
            figures: figures_of(request, &self.figures, &self.given, self.fall_off, &self.limits),
        }
    }

    /// The beams that have segments, with their numbers on the ring.
    pub fn beams<'b>(&'b self, run: &'b PlanRun) -> impl Iterator<Item = (&'b u16, &'b LeafBeam)> {
        let numbers = run.choice.best.beams.beams().iter();
        numbers.zip(&self.sequenced.beams).filter_map(|(number, beam)| Some((number, beam.as_ref()?)))
    }
}

/// What passes the leaves, also beside the bixels that were optimised.
fn fluences(
    request: &Request,
    run: &PlanRun,
    sequenced: &Sequenced,
    collimator: &Collimator,
) -> Vec<BeamFluence> {
    let numbers = run.choice.best.beams.beams().iter();
    let fluence = |(number, beam): (&u16, &Option<LeafBeam>)| {
        let (bixels_mm, weights) = beam.as_ref()?.fluence(collimator, request.setup.spec.bixel_mm);
        Some(BeamFluence { angles: request.setup.directions.angles(*number), bixels_mm, weights })
    };
    numbers.zip(&sequenced.beams).filter_map(fluence).collect()
}
