//! `plan.optimizer`: answers requests for plans.
//!
//! The standing plan is the plan of the patient: the first for the planned set-up, or the one that a person accepted.

use std::collections::BTreeSet;
use std::sync::Arc;

use stillpoint_network::with_network;
use stillpoint_operator::{Activation, Operator, Outputs, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_plan::beams::Evaluated;
use stillpoint_plan::check::Fault;
use stillpoint_plan::dose::Machine;
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::protocol::Fractionation;
use stillpoint_plan::recipe::{
    MethodName, PlanEngine, PlanRequest as Search, PriorName, RequestError, SetupSpec,
};
use stillpoint_pool::{Build, Hash, MOST_BYTES};
use stillpoint_pose::checked_isometry;
use stillpoint_samples::{
    BixelWeight, Cause, Command, ConsoleCommand, Diagnostics, LONGEST_POOL_MESSAGE, PlanRefusal, PlanRequest,
    PlanRequestElement, PlanStanding, PlanUpdate, PlanUpdateBody, PoolMessage, Sample, Verb,
};

use crate::job::{Asked, Job, WorkShare};
use crate::params::{Degraded, OptimizerParams, Standing, limits};
use crate::patient::{Limits, Patient, TargetDose, case_of};
use crate::pooled::{METRICS, PoolState, Pooled};
use crate::protocol;
use crate::remote::Served;

const REQUEST: usize = 0;
const ACCEPT: usize = 1;
const ANSWERS: usize = 2;
const PLAN: usize = 0;
const CALLS: usize = 1;
const DIAGNOSTICS: usize = 2;
/// Beams of a plan at most: the angles of an update.
const MOST_BEAMS: usize = 12;
/// Solves of a request at most: each keeps a fluence in memory until the next request.
const MOST_SOLVES: usize = 1000;
/// A set-up nearer than this to the planned one is the planned one, mm.
const PLANNED_WITHIN_MM: f64 = 1e-3;

/// Searches beams and fluence for the newest request, a fixed number of solves at each tick, and sends the best plan so far
/// after each tick.
///
/// The plan is that of `stillpoint plan` with the same case, parameters and seed: the seed is that of the pipeline.
///
/// At first it computes the doses of all angles in the set-up of the request, a fixed number of beams at each tick. A newer
/// request ends the work on the request before; a refused request is answered at once and changes nothing else. The best
/// plan of the first request for the planned set-up (no shift) is the standing plan, unless `standing` says otherwise. Every
/// update says whether the standing plan holds in the set-up of its request: D98 and D2 of the target against the parameters
/// `least` and `most`, and the `limits`. D98 and D2 are of the points that are optimised, and the limits are judged on a grid of the spacing `grid`: neither is recomputed on a finer grid. An
/// update is an offer: a person takes it with `console.accept` and the number of its request, when the work on that has
/// ended. Then it is the standing plan, and an update tells whether it holds. When the work ends, the plan check is that of
/// `stillpoint plan` in the set-up of the request. A plan that it refuses is not offered: the request is refused with the
/// fault that was found first.
///
/// Where `answers` is connected, workers of a pool compute doses, solves and prices: the updates are the same to the byte, and
/// each is sent as soon as its answers are there. When no worker has been there for the `patience` of `pool`, the `degraded`
/// mode of `pool` begins for the request in work.
pub struct PlanOptimizer {
    params: OptimizerParams,
    patient: Patient,
    /// How beams are chosen; a request gives their number and the budget.
    search: Search,
    job: Option<Job>,
    /// The build, until the pool is there.
    build: Option<Build>,
    pool: Option<Pooled>,
    /// The job is done by this operator.
    is_here: bool,
    standing: Option<StandingPlan>,
    /// Whether the standing plan keeps the limits in the set-up of the job; `None` as long as that was not judged.
    keeps_limits: Option<bool>,
}

/// The plan whose dose is judged in each set-up.
struct StandingPlan {
    plan: Arc<Evaluated>,
    /// Number of its request.
    request: u64,
    /// Calls to a pool whose answers it stands on.
    answers: BTreeSet<Hash>,
}

impl Operator for PlanOptimizer {
    type Params = OptimizerParams;
    const KIND: Kind = Kind {
        name: "plan.optimizer",
        about: "Searches beams and fluence for the newest request, a fixed number of solves at each tick.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "request",
                sample: PlanRequest::KIND,
                // Each request has an activation, so that each refusal is answered.
                policy: Policy::Queue(8),
                required: true,
                about: "The set-up, the number of beams and the budget of solves.",
            },
            Input {
                name: "accept",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(8),
                required: false,
                about: "`accept` with the number of a request: the plan that is offered for it becomes the standing plan. A person has looked at it.",
            },
            Input {
                name: "answers",
                sample: PoolMessage::KIND,
                policy: Policy::Queue(256),
                required: false,
                about: "Messages of the workers of a planning pool, from `pool.client`. Where they are connected, workers compute.",
            },
        ],
        outputs: &[
            Output {
                name: "plan",
                sample: PlanUpdate::KIND,
                frame: FrameRule::None,
                about: "The best plan so far, and whether the standing plan holds in this set-up.",
            },
            Output {
                name: "calls",
                sample: PoolMessage::KIND,
                frame: FrameRule::None,
                about: "Messages to the workers of a planning pool, for `pool.client`.",
            },
            Output {
                name: "diagnostics",
                sample: Diagnostics::KIND,
                frame: FrameRule::None,
                about: "With a pool: workers, calls, and whether the degraded mode has begun, when one of them is new.",
            },
        ],
        timer: Timer::Required,
    };

    fn new(params: OptimizerParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let case = case_of(params.case.as_deref(), setup)?;
        let mut spec = spec(&params, setup)?;
        let mut search = search(&params)?;
        let own = params.network.as_deref().map(|name| setup.file(name)).transpose()?;
        let named = params.network.as_deref().map_or(String::new(), |name| format!("{name}: "));
        with_network(std::slice::from_mut(&mut search), &case, &spec, own.as_deref())
            .map_err(|e| SetupError(format!("{named}{e}")))?;
        let protocol = match &params.protocol {
            Some(name) => {
                let read = protocol::read(name, setup.file(name)?);
                Some(read.map_err(|faults| SetupError(faults.to_string()))?)
            }
            None => None,
        };
        if let (Some(protocol), Some(name)) = (&protocol, &params.protocol)
            && let Fractionation::Other(why) = protocol.fractionation(&case)
        {
            return Err(SetupError(format!("{name}: {why}")));
        }
        spec.protocol = protocol.clone();
        let limits = Limits { own: limits(&params.limits)?, protocol };
        let patient = Patient::new(case, spec, limits)?;
        if let Some(caution) = patient.caution()? {
            tracing::warn!("{caution}");
        }
        let build = setup
            .is_connected(ANSWERS)
            .then(Build::here)
            .transpose()
            .map_err(|e| SetupError(e.to_string()))?;
        Ok(Self {
            params,
            patient,
            search,
            job: None,
            build,
            pool: None,
            is_here: true,
            standing: None,
            keeps_limits: None,
        })
    }

    fn capacities(params: &OptimizerParams) -> Vec<usize> {
        // The longest call names beams and has a weight for each bixel.
        let bixels = params.max_bixels as usize;
        vec![bixels, LONGEST_POOL_MESSAGE + (8 * bixels).min(MOST_BYTES), METRICS]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let (now, seed) = (activation.time, activation.key.seed);
        if let Some(build) = self.build.take() {
            self.pool = Some(Pooled::new(now, build, &self.params.pool));
        }
        if let Some(request) = activation.fresh::<PlanRequest>(REQUEST)
            && let (Some(element), Some(header)) = (request.elements.first(), activation.header(REQUEST))
        {
            match self.asked(element, header.sequence, seed) {
                Ok(asked) => self.take(asked)?,
                Err(refusal) => self.refuse(header.sequence, refusal, outputs)?,
            }
        }
        if let Some(command) = activation.fresh::<ConsoleCommand>(ACCEPT)
            && let Some(command) = command.first().filter(|command| command.verb == Verb::Accept as u32)
        {
            self.accept(command, outputs)?;
        }
        let is_tick = activation.cause == Cause::Timer;
        let Some(mut pool) = self.pool.take() else {
            return if is_tick { self.work_here(outputs) } else { Ok(()) };
        };
        if let Some(message) = activation.fresh::<PoolMessage>(ANSWERS) {
            pool.handle(now, &message, &Served { patient: &self.patient, job: self.job.as_ref() });
        }
        let worked = self.work_with(&mut pool, (now, is_tick), outputs);
        let sent = pool.send(CALLS, outputs);
        let reported = if is_tick { pool.report(now, DIAGNOSTICS, outputs) } else { Ok(()) };
        self.pool = Some(pool);
        worked.and(sent).and(reported)
    }
}

impl PlanOptimizer {
    /// A request that can be answered, or why it cannot.
    fn asked(&self, request: &PlanRequestElement, sequence: u64, seed: u64) -> Result<Asked, PlanRefusal> {
        let (beams, budget) = (request.beams as usize, request.budget as usize);
        if request.case_hash != self.patient.hash {
            return Err(PlanRefusal::Case);
        }
        if beams > MOST_BEAMS {
            return Err(PlanRefusal::Beams);
        }
        if budget > MOST_SOLVES {
            return Err(PlanRefusal::Budget);
        }
        let search = Search { beams, budget, seed, ..self.search.clone() };
        let search = search.check(&self.patient.setup.case, self.patient.ring()).map_err(|e| match e {
            RequestError::NoSolve => PlanRefusal::Budget,
            // What does not depend on the request was checked when the operator was made.
            _ => PlanRefusal::Beams,
        })?;
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
        Ok(Asked { request: sequence, shift_mm, search })
    }

    fn take(&mut self, asked: Asked) -> Result<(), StepError> {
        self.keep_standing();
        self.job = Some(Job::new(&self.patient, asked)?);
        self.keeps_limits = None;
        if let Some(pool) = &mut self.pool {
            pool.leave();
            self.is_here = false;
        }
        Ok(())
    }

    fn part(&self) -> WorkShare {
        WorkShare { doses: self.params.doses as usize, solves: self.params.solves as usize }
    }

    /// Does the next part on this thread.
    fn work_here(&mut self, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let part = self.part();
        let Some(job) = self.job.as_mut().filter(|job| !job.ended) else { return Ok(()) };
        job.work(&self.patient, part)?;
        self.send_part(outputs)
    }

    /// Tells what a part has brought.
    fn send_part(&mut self, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(job) = &self.job else { return Ok(()) };
        if job.has_doses(&self.patient) && job.most_bixels() > self.params.max_bixels as usize {
            let request = job.asked.request;
            self.job = None;
            return self.refuse(request, PlanRefusal::Bixels, outputs);
        }
        if job.ended && job.best.is_none() {
            // The method needs more solves until it has a set of so many beams.
            let request = job.asked.request;
            self.job = None;
            return self.refuse(request, PlanRefusal::Budget, outputs);
        }
        if job.ended {
            if let Some(best) = &job.best {
                let bixels_mm = |beam| job.bixels_mm(beam).to_vec();
                let checked = self.patient.check(best, bixels_mm, job.asked.shift_mm);
                let checked = checked.map_err(|e| StepError(e.to_string()))?;
                if let Some(fault) = checked.faults.first() {
                    let request = job.asked.request;
                    let refusal = refusal_of(fault);
                    // The plan that stands is judged in this set-up all the same.
                    self.judge_limits()?;
                    let (judged, _) = self.update();
                    self.job = None;
                    let body = PlanUpdateBody {
                        request,
                        refusal: refusal as u32,
                        ended: 1,
                        standing: judged.standing,
                        standing_d98: judged.standing_d98,
                        standing_d2: judged.standing_d2,
                        ..self.nothing()
                    };
                    return outputs.send_slice::<PlanUpdate>(PLAN, &body, &[]);
                }
            }
            self.keep_standing();
        }
        self.send_update(outputs)
    }

    /// Goes on with a pool, as far as its answers go.
    fn work_with(
        &mut self,
        pool: &mut Pooled,
        (now, is_tick): (u64, bool),
        outputs: &mut Outputs<'_>,
    ) -> Result<(), StepError> {
        let job = self.job.as_mut().filter(|_| !self.is_here);
        let turn = pool.go_on(now, is_tick, &self.patient, job)?;
        if !turn.tainted.is_empty() {
            return self.doubt(pool, &turn.tainted, outputs);
        }
        if self.is_here {
            return if is_tick { self.work_here(outputs) } else { Ok(()) };
        }
        let part = self.part();
        while let Some(job) = &mut self.job
            && job.work_from_answers(&self.patient, part)?
        {
            self.send_part(outputs)?;
        }
        let Some(job) = self.job.as_mut().filter(|job| !job.ended && turn.state != PoolState::Pool) else {
            return Ok(());
        };
        pool.leave();
        job.leave_pool();
        self.is_here = true;
        match (turn.state, self.params.pool.degraded) {
            (PoolState::Degraded, Degraded::Keep) => {
                tracing::warn!("no worker of the pool was there for the time of patience: the plan stays");
                let request = job.asked.request;
                self.keep_standing();
                self.job = None;
                self.refuse(request, PlanRefusal::Pool, outputs)
            }
            (PoolState::Degraded, Degraded::Local) => {
                tracing::warn!(
                    "no worker of the pool was there for the time of patience: this process solves less"
                );
                job.cut_short(self.params.pool.solves as usize);
                if job.ended { self.send_part(outputs) } else { Ok(()) }
            }
            _ => Ok(()),
        }
    }

    /// Makes anew what was made of these answers of workers that were shut out.
    fn doubt(
        &mut self,
        pool: &mut Pooled,
        answers: &BTreeSet<Hash>,
        outputs: &mut Outputs<'_>,
    ) -> Result<(), StepError> {
        if self.job.as_mut().is_some_and(|job| job.forget(answers)) {
            pool.leave();
        }
        let is_doubtful = |standing: &mut StandingPlan| !standing.answers.is_disjoint(answers);
        match self.standing.take_if(is_doubtful) {
            Some(standing) => {
                self.keeps_limits = None;
                self.refuse(standing.request, PlanRefusal::Doubt, outputs)
            }
            None => Ok(()),
        }
    }

    /// Takes the plan that is offered for the request of a command as the standing plan.
    fn accept(&mut self, command: &Command, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let given = (command.given >= 1).then_some(command.values[0]);
        let offered = self.job.as_ref().filter(|job| job.ended && given == Some(job.asked.request as f64));
        let Some(plan) = offered.and_then(standing_of) else {
            let number = given.filter(|n| *n >= 0.0).map_or(u64::MAX, |n| n as u64);
            return self.refuse(number, PlanRefusal::Accept, outputs);
        };
        self.stand(plan);
        self.send_update(outputs)
    }

    fn stand(&mut self, standing: StandingPlan) {
        self.standing = Some(standing);
        self.keeps_limits = None;
    }

    fn send_update(&mut self, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        self.judge_limits()?;
        let (body, fluence) = self.update();
        outputs.send_slice::<PlanUpdate>(PLAN, &body, &fluence)
    }

    /// Judges the limits once for each standing plan and set-up, when the doses of the set-up are there.
    fn judge_limits(&mut self) -> Result<(), StepError> {
        if let (None, Some(standing), Some(job)) = (self.keeps_limits, &self.standing, &self.job)
            && standing.plan.beams.beams().iter().all(|beam| job.dose(*beam).is_some())
        {
            let keeps = self.patient.keeps_limits(&standing.plan, job.asked.shift_mm);
            self.keeps_limits = Some(keeps.map_err(|e| StepError(e.to_string()))?);
        }
        Ok(())
    }

    /// Keeps the best plan of the first request for the planned set-up when the work on it ends.
    fn keep_standing(&mut self) {
        let planned = |job: &&Job| job.asked.shift_mm.iter().all(|mm| mm.abs() <= PLANNED_WITHIN_MM);
        if self.standing.is_none()
            && self.params.standing == Standing::First
            && let Some(standing) = self.job.as_ref().filter(planned).and_then(standing_of)
        {
            self.stand(standing);
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
        if let Some(of_standing) = self.standing.as_ref().and_then(|standing| dose(&standing.plan)) {
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
                body.angles[number] = self.patient.ring().angle_deg(*beam).to_radians();
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
        let keeps_limits = self.keeps_limits == Some(true);
        if enough && not_too_much && keeps_limits { PlanStanding::Holds } else { PlanStanding::Fails }
    }
}

/// The fault of a check, as the reason of a refusal.
fn refusal_of(fault: &Fault) -> PlanRefusal {
    match fault {
        Fault::Outside { .. } => PlanRefusal::CheckOutside,
        Fault::Peak { .. } => PlanRefusal::CheckPeak,
        Fault::Units { .. } => PlanRefusal::CheckUnits,
        Fault::Hotter { .. } => PlanRefusal::CheckHotter,
        Fault::Uncovered { .. } => PlanRefusal::CheckUncovered,
        Fault::Closed { .. } => PlanRefusal::CheckClosed,
    }
}

/// The parameters of the set-up of all plans.
fn spec(params: &OptimizerParams, setup: &Setup<'_>) -> Result<SetupSpec, SetupError> {
    let shipped = SetupSpec::shipped().map_err(|e| SetupError(e.to_string()))?;
    let text = |name: &str| -> Result<String, SetupError> {
        String::from_utf8(setup.file(name)?).map_err(|_| SetupError(format!("{name}: the file is not UTF-8")))
    };
    let objectives = match &params.objectives {
        Some(name) => ObjectiveTable::parse(&text(name)?)
            .map_err(|e| SetupError(format!("{name}: {e}")))?
            .before(shipped.objectives),
        None => shipped.objectives,
    };
    let machine = match &params.machine {
        Some(name) => Machine::from_json(&text(name)?).map_err(|e| SetupError(format!("{name}: {e}")))?,
        None => shipped.machine,
    };
    Ok(SetupSpec {
        objectives,
        machine,
        engine: PlanEngine::from(params.engine),
        grid_mm: params.grid * 1e3,
        bixel_mm: params.bixel * 1e3,
        reach_mm: params.reach * 1e3,
        ring: SetupSpec::ring_of(params.angles as u16).map_err(|e| SetupError(e.to_string()))?,
        ..shipped
    })
}

/// How beams are chosen, but for what a request says.
fn search(params: &OptimizerParams) -> Result<Search, SetupError> {
    let search = Search {
        priors: params.prior.iter().map(|prior| PriorName::from(*prior)).collect(),
        leaves: params.leaves as usize,
        ..Search::of_method(MethodName::from(params.method))
    };
    search.check_names().map_err(|e| SetupError(format!("`method`, `prior` and `leaves`: {e}")))?;
    Ok(search)
}

/// The best plan of a job, as one that stands.
fn standing_of(job: &Job) -> Option<StandingPlan> {
    let plan = job.best.clone()?;
    Some(StandingPlan { plan, request: job.asked.request, answers: job.asked_calls().clone() })
}
