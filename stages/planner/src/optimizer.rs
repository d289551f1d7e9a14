//! `plan.optimizer`: answers requests for plans.

use std::sync::Arc;

use stillpoint_operator::{Activation, Operator, Outputs, Params, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_plan::beams::{Evaluated, Ring};
use stillpoint_pose::checked_isometry;
use stillpoint_samples::{
    BixelWeight, Cause, PlanRefusal, PlanRequest, PlanRequestElement, PlanStanding, PlanUpdate,
    PlanUpdateBody, Sample,
};

use crate::job::{Asked, Job, Part};
use crate::patient::{Patient, Sizes, TargetDose, case_of};

const REQUEST: usize = 0;
const PLAN: usize = 0;
/// Beams of a plan at most: the angles of an update.
const MOST_BEAMS: usize = 12;
/// Solves of a request at most: each keeps a fluence in memory until the next request.
const MOST_SOLVES: usize = 1000;
/// Angles between beams of a plan, at least, as a part of the circle: 20 degrees.
const PARTS_OF_CIRCLE: u16 = 18;
/// A set-up nearer than this to the planned one is the planned one, mm.
const PLANNED_WITHIN_MM: f64 = 1e-3;

/// Parameters of `plan.optimizer`.
#[derive(Clone, Debug, Params)]
pub struct OptimizerParams {
    /// The case file, a path relative to the pipeline file; the session keeps it. Without it, the case is the synthetic
    /// pelvis of seed 0.
    #[param(file)]
    pub case: Option<String>,
    /// Number of gantry angles, equally spaced from 0. Beams of a plan are at least 20 degrees apart.
    #[param(default = 36, min = 6, max = 90)]
    pub angles: u64,
    /// Distance between the points whose dose is optimised.
    #[param(unit = "m", default = "5 mm", min = "2 mm", max = "20 mm")]
    pub grid: f64,
    /// Width of a bixel.
    #[param(unit = "m", default = "10 mm", min = "4 mm", max = "40 mm")]
    pub bixel: f64,
    /// Shift along an axis of the patient above which a request is refused. Bixels are placed that much farther beyond the
    /// target, so that a new plan can follow it.
    #[param(unit = "m", default = "10 mm", min = "0 mm", max = "50 mm")]
    pub reach: f64,
    /// Rotation above which a request is refused. Doses are computed for the shift only: a smaller rotation has no effect
    /// on them.
    #[param(unit = "rad", default = "1 deg", min = "0 deg", max = "5 deg")]
    pub turn: f64,
    /// Number of beams whose doses one tick computes.
    #[param(default = 4, min = 1, max = 90)]
    pub doses: u64,
    /// Number of solves of one tick.
    #[param(default = 2, min = 1, max = 1000)]
    pub solves: u64,
    /// The standing plan holds if 98 % of the target get at least this part of the prescription ...
    #[param(default = 0.9, min = 0, max = 1)]
    pub least: f64,
    /// ... and 2 % of the target get at most this part of it.
    #[param(default = 1.15, min = 1, max = 10)]
    pub most: f64,
    /// Bixels of an update at most. A request whose plan can have more is refused.
    #[param(default = 16384, min = 1, max = 1000000)]
    pub max_bixels: u64,
}

/// Searches beams and fluence for the newest request, a fixed number of solves at each tick, and sends the best plan so far
/// after each tick.
///
/// At first it computes the doses of all angles in the set-up of the request, a fixed number of beams at each tick. A newer
/// request ends the work on the request before; a refused request is answered at once and changes nothing else. The best
/// plan of the first request for the planned set-up (no shift) is the standing plan. Every update says whether the standing
/// plan holds in the set-up of its request: D98 and D2 of the target against the parameters `least` and `most`. These doses
/// are at the points that are optimised, not recomputed on a finer grid, and other limits of a protocol do not count. An
/// update is an offer: no operator acts on it.
pub struct PlanOptimizer {
    params: OptimizerParams,
    patient: Patient,
    job: Option<Job>,
    standing: Option<Arc<Evaluated>>,
}

impl Operator for PlanOptimizer {
    type Params = OptimizerParams;
    const KIND: Kind = Kind {
        name: "plan.optimizer",
        about: "Searches beams and fluence for the newest request, a fixed number of solves at each tick.",
        role: Role::Operator,
        inputs: &[Input {
            name: "request",
            sample: PlanRequest::KIND,
            // Each request has an activation, so that each refusal is answered.
            policy: Policy::Queue(8),
            required: true,
            about: "The set-up, the number of beams and the budget of solves.",
        }],
        outputs: &[Output {
            name: "plan",
            sample: PlanUpdate::KIND,
            frame: FrameRule::None,
            about: "The best plan so far, and whether the standing plan holds in this set-up.",
        }],
        timer: Timer::Required,
    };

    fn new(params: OptimizerParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let case = case_of(params.case.as_deref(), setup)?;
        let angles = params.angles as u16;
        let ring =
            Ring::new(angles, angles.div_ceil(PARTS_OF_CIRCLE)).map_err(|e| SetupError(e.to_string()))?;
        let sizes =
            Sizes { grid_mm: params.grid * 1e3, bixel_mm: params.bixel * 1e3, reach_mm: params.reach * 1e3 };
        let patient = Patient::new(&case, sizes, ring)?;
        Ok(Self { params, patient, job: None, standing: None })
    }

    fn capacities(params: &OptimizerParams) -> Vec<usize> {
        vec![params.max_bixels as usize]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if let Some(request) = activation.fresh::<PlanRequest>(REQUEST)
            && let (Some(element), Some(header)) = (request.elements.first(), activation.header(REQUEST))
        {
            match self.asked(element, header.sequence) {
                Ok(asked) => self.take(asked)?,
                Err(refusal) => self.refuse(header.sequence, refusal, outputs)?,
            }
        }
        if activation.cause != Cause::Timer {
            return Ok(());
        }
        let Some(job) = self.job.as_mut().filter(|job| !job.ended) else { return Ok(()) };
        let part = Part { doses: self.params.doses as usize, solves: self.params.solves as usize };
        job.work(&self.patient, part, activation.key.seed)?;
        if job.has_doses(&self.patient) && job.most_bixels() > self.params.max_bixels as usize {
            let request = job.asked.request;
            self.job = None;
            return self.refuse(request, PlanRefusal::Bixels, outputs);
        }
        if job.ended {
            self.keep_standing();
        }
        let (body, fluence) = self.update();
        outputs.send_slice::<PlanUpdate>(PLAN, &body, &fluence)
    }
}

impl PlanOptimizer {
    /// A request that can be answered, or why it cannot.
    fn asked(&self, request: &PlanRequestElement, sequence: u64) -> Result<Asked, PlanRefusal> {
        let (beams, budget) = (request.beams as usize, request.budget as usize);
        if request.case_hash != self.patient.hash {
            return Err(PlanRefusal::Case);
        }
        if beams > MOST_BEAMS || self.patient.ring.check_room(beams).is_err() {
            return Err(PlanRefusal::Beams);
        }
        if !(1..=MOST_SOLVES).contains(&budget) {
            return Err(PlanRefusal::Budget);
        }
        let motion = checked_isometry(request.position, request.orientation).ok_or(PlanRefusal::Pose)?;
        if !request.position.iter().all(|metres| metres.is_finite()) {
            return Err(PlanRefusal::Pose);
        }
        if motion.rotation.angle() > self.params.turn {
            return Err(PlanRefusal::Turn);
        }
        let shift_mm = self.patient.shift_mm(request.position);
        if shift_mm.iter().any(|mm| mm.abs() > self.params.reach * 1e3) {
            return Err(PlanRefusal::Shift);
        }
        Ok(Asked { request: sequence, shift_mm, beams, budget })
    }

    fn take(&mut self, asked: Asked) -> Result<(), StepError> {
        self.keep_standing();
        self.job = Some(Job::new(&self.patient, asked)?);
        Ok(())
    }

    /// Keeps the best plan of the first request for the planned set-up when the work on it ends.
    fn keep_standing(&mut self) {
        let planned = |job: &&Job| job.asked.shift_mm.iter().all(|mm| mm.abs() <= PLANNED_WITHIN_MM);
        if self.standing.is_none() {
            self.standing = self.job.as_ref().filter(planned).and_then(|job| job.best.clone());
        }
    }

    fn refuse(&self, request: u64, refusal: PlanRefusal, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let body = PlanUpdateBody { request, refusal: refusal as u32, ended: 1, ..self.nothing() };
        outputs.send_slice::<PlanUpdate>(PLAN, &body, &[])
    }

    /// An update without a plan.
    fn nothing(&self) -> PlanUpdateBody {
        PlanUpdateBody {
            objective: f64::NAN,
            target_d98: f64::NAN,
            target_d2: f64::NAN,
            standing_d98: f64::NAN,
            standing_d2: f64::NAN,
            angles: [f64::NAN; MOST_BEAMS],
            case_hash: self.patient.hash,
            ..PlanUpdateBody::default()
        }
    }

    fn update(&self) -> (PlanUpdateBody, Vec<BixelWeight>) {
        let (mut body, mut fluence) = (self.nothing(), Vec::new());
        let Some(job) = &self.job else { return (body, fluence) };
        body.request = job.asked.request;
        body.solves = job.solves as u32;
        body.ended = u32::from(job.ended);
        let dose = |plan: &Evaluated| self.patient.target_dose(plan, |beam| job.dose(beam));
        if let Some(of_standing) = self.standing.as_deref().and_then(dose) {
            (body.standing_d98, body.standing_d2) = (of_standing.d98, of_standing.d2);
            body.standing = self.judge(of_standing) as u32;
        }
        if let Some(best) = &job.best {
            body.objective = best.cost;
            if let Some(TargetDose { d98, d2 }) = dose(best) {
                (body.target_d98, body.target_d2) = (d98, d2);
            }
            body.beams = best.beams.beams().len() as u32;
            for (number, beam) in best.beams.beams().iter().enumerate() {
                body.angles[number] = self.patient.ring.angle_deg(*beam).to_radians();
                let weights = best.weights_of(*beam).unwrap_or_default();
                let bixel = |(centre_mm, weight): (&[f64; 2], &f64)| BixelWeight {
                    centre: centre_mm.map(|mm| (mm * 1e-3) as f32),
                    weight: *weight as f32,
                    beam: number as u32,
                };
                fluence.extend(job.bixels_mm(*beam).iter().zip(weights).map(bixel));
            }
        }
        body.length = fluence.len() as u32;
        (body, fluence)
    }

    fn judge(&self, dose: TargetDose) -> PlanStanding {
        let prescribed = self.patient.prescribed_gy;
        let enough = dose.d98 >= self.params.least * prescribed;
        let not_too_much = dose.d2 <= self.params.most * prescribed;
        if enough && not_too_much { PlanStanding::Holds } else { PlanStanding::Fails }
    }
}
