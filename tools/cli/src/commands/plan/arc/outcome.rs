//! What arcs give: their dose on a fine grid, with its figures.

use stillpoint_patient::Grid;
use stillpoint_plan::arc::{ArcBeam, REPORTED_BIXELS, REPORTED_DEG};
use stillpoint_plan::check::Checked;
use stillpoint_plan::dose::{
    ArcLimits, BeamAngles, BixelSpec, Collimator, DoseParams, EngineName, LowDensity,
};
use stillpoint_plan::evaluation::{Evaluation, OnGrid, StructureDose, brought_to};
use stillpoint_plan::objectives::ObjectiveResult;
use stillpoint_plan::plan_file::{
    PLAN_FILE_VERSION, PlanFile, PlanFileArc, PlanFileArcs, PlanFileCheck, PlanFileMachine, PlanFileServed,
    WARNING,
};
use stillpoint_plan::protocol::Judged;
use stillpoint_plan::recipe::{Delivery, MethodName, PlannedArcs};
use stillpoint_plan::recompute::{BeamFluence, Recompute};

use super::super::outcome::{case_of, dose_of, figures_of, objectives};
use super::super::prepared::volumes_at_gy;
use super::super::request::Request;
use crate::exit::Failure;

/// Angles of the check, whose doses are compared with each other alone, degrees: one for each interval.
const CHECKED_DEG: f64 = 4.0;

/// A plan in arcs and what it gives.
pub struct ArcOutcome<'a> {
    /// The arcs.
    pub planned: PlannedArcs,
    /// The leaves.
    pub collimator: &'a Collimator,
    /// How fast all is.
    pub limits: ArcLimits,
    /// Dose, gray.
    pub gray: Vec<f32>,
    /// What it gives the structures.
    pub given: Evaluation<'a>,
    /// Figures of it.
    pub figures: Vec<StructureDose>,
    /// The objectives with what the arcs give.
    pub objectives: Vec<ObjectiveResult>,
    /// The limits of the protocol.
    pub judged: Vec<Judged>,
    /// Figures of the dose that came with the case.
    pub reference: Option<Vec<StructureDose>>,
    /// Lung and air on the rays of all bixels.
    pub low_density: LowDensity,
    /// What the check of the plan found.
    pub checked: Checked,
    grid: Grid,
}

impl<'a> ArcOutcome<'a> {
    /// Of planned arcs; `angles` are some of theirs.
    pub fn new(request: &'a Request, planned: PlannedArcs, angles: &[BeamAngles]) -> Result<Self, Failure> {
        let (setup, case) = (&request.setup, &request.setup.case);
        let machine = &setup.spec.machine;
        let Some(collimator) = machine.file().collimator.as_ref() else {
            return Err(Failure::wrong(stillpoint_plan::recipe::ArcPlanError::NoLeaves));
        };
        let params = setup.engine().params();
        let width_mm = REPORTED_BIXELS * params.bixels.width_mm;
        let bixels = BixelSpec { width_mm, ..params.bixels };
        let fine = DoseParams { bixels, ..*params };
        let recompute = match request.dose_grid_mm {
            Some(spacing_mm) => Recompute::with_spacing(case, machine.clone(), &fine, spacing_mm),
            None => Recompute::new(case, machine.clone(), &fine, setup.points_mm()),
        };
        let recompute = recompute.map_err(Failure::failed)?;
        let fluence = |width_mm: f64, most_deg: f64| -> Vec<BeamFluence> {
            let weight = planned.weight_per_unit;
            let of = |beam: &ArcBeam| beam.fluence(collimator, weight, width_mm, most_deg);
            planned.beams.iter().flat_map(of).collect()
        };
        let fluences = fluence(width_mm, REPORTED_DEG);
        let gray = recompute.dose(&BeamFluence::weighted(&fluences), [0.0; 3], request.threads);
        let gray = gray.map_err(Failure::failed)?;
        drop(fluences);
        let on_grid = OnGrid::new(case, recompute.grid());
        let given = on_grid.evaluate(&gray);
        let volumes = volumes_at_gy(setup.prescribed_gy());
        let objectives = setup.objective_set.results(&setup.goals, &planned.dose, &given);
        let reference = case
            .reference_dose_gy()
            .map(|gray| on_grid.evaluate(&brought_to(recompute.grid(), case.grid(), gray)).figures(&volumes));
        let delivered = fluence(params.bixels.width_mm, CHECKED_DEG);
        // An aperture has no peaks: of single bixels there is nothing to check.
        let without_bixels = |beam: &BeamFluence| BeamFluence {
            angles: beam.angles,
            bixels_mm: Vec::new(),
            weights: Vec::new(),
        };
        let bare: Vec<BeamFluence> = delivered.iter().map(without_bixels).collect();
        let delivery = Delivery {
            planned: &bare,
            delivered: &delivered,
            monitor_units: Some(planned.beams.iter().map(|beam| beam.units()).sum()),
            moved_mm: [0.0; 3],
        };
        Ok(Self {
            checked: setup.check(&delivery, request.threads).map_err(Failure::failed)?,
            low_density: setup.low_density_at(angles).map_err(Failure::failed)?,
            figures: given.figures(&volumes),
            objectives: objectives.map_err(Failure::failed)?,
            judged: request.protocol().iter().flat_map(|p| p.judge(case, &given)).collect(),
            limits: machine.arc_limits(),
            grid: *on_grid.grid(),
            collimator,
            planned,
            gray,
            given,
            reference,
        })
    }

    /// The grid of the dose.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Monitor units of one fraction.
    pub fn units(&self) -> f64 {
        self.planned.beams.iter().map(|beam| beam.units()).sum()
    }

    /// Seconds with the beam on in one fraction.
    pub fn seconds(&self) -> f64 {
        self.planned.beams.iter().map(|beam| beam.seconds(&self.limits)).sum()
    }

    /// The arcs as they were given.
    pub fn arcs(&self) -> String {
        let arcs: Vec<String> = self.planned.beams.iter().map(|beam| beam.spec.to_string()).collect();
        arcs.join(", ")
    }

    /// What a person should know of the method by which dose was computed.
    pub fn caution(&self, request: &Request) -> Option<String> {
        match request.setup.engine_name() {
            EngineName::Pencil => self.low_density.caution(),
            EngineName::Superposition => None,
        }
    }

    /// Everything, as it is written to `plan.json`; nothing in it depends on a clock.
    pub fn file(&self, request: &Request) -> Result<PlanFile, serde_json::Error> {
        let setup = &request.setup;
        let params = setup.engine().params();
        let machine = setup.spec.machine.file();
        let fall_off = self.given.fall_off;
        let searched_by = (params.engine != EngineName::Pencil).then_some(EngineName::Pencil);
        let arc = |beam| PlanFileArc::new(beam, self.collimator, &self.limits);
        Ok(PlanFile {
            version: PLAN_FILE_VERSION,
            stillpoint: env!("CARGO_PKG_VERSION").to_owned(),
            warning: WARNING.to_owned(),
            case: case_of(request),
            prescription: setup.case.prescription().to_vec(),
            fractions: setup.case.fractions(),
            isocentre_mm: setup.case.isocentre_mm(),
            machine: PlanFileMachine { energy_mv: machine.energy_mv, provenance: machine.provenance.clone() },
            dose: dose_of(request, self.grid(), searched_by, &self.low_density, self.caution(request)),
            requested: setup.objective_set.structures.iter().map(objectives).collect::<Result<_, _>>()?,
            objectives: self.objectives.iter().map(serde_json::to_value).collect::<Result<_, _>>()?,
            couch: None,
            method: MethodName::Given,
            given_weights: false,
            start: None,
            seed: request.seed,
            objective: self.planned.objective,
            modulation: 0.0,
            robust_game: None,
            excess_at_most: None,
            kkt: None,
            newton_steps: 0,
            beams: Vec::new(),
            figures: figures_of(request, &self.figures, &self.given, fall_off, &self.judged),
            leaves: None,
            arcs: Some(PlanFileArcs {
                collimator: self.collimator.clone(),
                limits: self.limits,
                monitor_units: self.units(),
                seconds: self.seconds(),
                angles_deg: REPORTED_DEG,
                bixel_mm: REPORTED_BIXELS * params.bixels.width_mm,
                spacing_rms_gy: self.planned.spacing.rms_gy,
                spacing_largest_gy: self.planned.spacing.largest_gy,
                objectives: self.planned.objectives.clone(),
                points: self.planned.points,
                arcs: self.planned.beams.iter().map(arc).collect(),
            }),
            served: setup.served.iter().map(PlanFileServed::from).collect(),
            check: Some(PlanFileCheck::new(&self.checked, request.accept_check.as_deref())),
            setups: Vec::new(),
            reference: self.reference.clone(),
            searches: Vec::new(),
        })
    }
}
