//! The checked request for a plan.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use stillpoint_dicom::CaseIdentity;
use stillpoint_network::{LearnedError, caution, with_network};
use stillpoint_patient::case::{Case, phantom, read};
use stillpoint_plan::dose::{BeamAngles, Collimator, EngineName, Machine};
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::plan_file::{PlanFile, PlanFileCouch};
use stillpoint_plan::protocol::{Fractionation, Protocol};
use stillpoint_plan::recipe::{
    CouchError, MethodName, PlanRequest, PlanRun, PlanSearch, PlanSetup, PriorName, RobustBy, SetupSpec,
    set_up_errors,
};
use stillpoint_planner::protocol;

use super::args::PlanArgs;
use crate::exit::Failure;
use crate::quantity::quantity;

/// Who is planned, where the plan goes, and how. No plan depends on more of it than the case.
pub struct Patient<'a> {
    /// The case file; none for the synthetic pelvis of seed 0.
    pub case: Option<&'a Path>,
    /// The folder of the plan, unless it is that of the name of the case.
    pub out: Option<PathBuf>,
    /// Threads.
    pub threads: NonZeroUsize,
    /// Nothing is printed but what happens to workers.
    pub is_quiet: bool,
    /// Weights of the bixels that another program found, in place of a solve.
    pub weights: Option<Vec<f64>>,
}

/// A consistent request.
pub struct Request {
    /// The case made ready.
    pub setup: PlanSetup,
    /// The searches, one for each method.
    pub searches: Vec<PlanSearch>,
    /// Whether the weights were given: then nothing is optimised.
    pub has_weights: bool,
    /// The plan with whose fluence the solve begins.
    pub start: Option<PlanFile>,
    /// The method by which dose was computed for the search, where it is not that of the plan.
    pub searched_by: Option<EngineName>,
    /// Beams of the plan.
    pub beams: usize,
    /// Most solves of a method.
    pub budget: usize,
    /// What people should know of the network that they use.
    pub caution: Option<String>,
    /// Shifts of the patient (mm), the planned set-up first.
    pub setups_mm: Vec<[f64; 3]>,
    /// What people should know of the protocol.
    pub protocol_note: Option<String>,
    /// Largest couch angle of the search to both sides, degrees; 0 where it has none.
    pub couch_deg: f64,
    /// What couch angles changed, once they were searched.
    pub couch: Option<PlanFileCouch>,
    /// Spacing of the grid of the reported dose, mm, where it is given.
    pub dose_grid_mm: Option<f64>,
    /// Why a person takes a plan that the check refuses.
    pub accept_check: Option<String>,
    /// Whether fluences are sequenced where the machine has leaves.
    leaves: bool,
    /// Where the plan goes.
    pub out: PathBuf,
    /// Where doses are kept.
    pub doses: PathBuf,
    /// Whose plan it is, in the exported DICOM.
    pub identity: CaseIdentity,
    /// Seed of the random methods.
    pub seed: u64,
    /// Threads.
    pub threads: NonZeroUsize,
    /// Whether progress is shown.
    pub quiet: bool,
}

impl Request {
    /// Checks it, for a patient.
    pub fn new(given: &PlanArgs, patient: &Patient<'_>) -> Result<Self, Failure> {
        let couch_deg = couch_deg(given)?;
        if couch_deg > 0.0 && RobustBy::from(given.robust_by) == RobustBy::Worst {
            return Err(Failure::wrong(CouchError::Game));
        }
        let case = match patient.case {
            Some(path) => read(path).map_err(Failure::wrong)?,
            None => phantom(0).map_err(Failure::failed)?,
        };
        let mut spec = spec(given)?;
        let (protocol, protocol_note) = protocol(&case, given.protocol.as_deref())?;
        spec.protocol = protocol;
        let start = given.start.as_deref().map(|path| plan_at(path).map(|(_, plan)| plan)).transpose()?;
        if let (Some(path), true) = (&given.start, start.as_ref().is_some_and(|plan| plan.arcs.is_some())) {
            return Err(Failure::wrong(format!(
                "--start {}: this plan is of arcs, which have no fluence of static beams to start from: plan arcs with --arc",
                path.display()
            )));
        }
        let angles = match &start {
            Some(plan) => Some(plan.angles()),
            None => given.angles.as_deref().map(angles_of).transpose()?,
        };
        if let Some(angles) = &angles {
            spec = spec.for_angles(angles).map_err(|e| match (&given.start, &given.angles) {
                (Some(path), _) => Failure::wrong(format!("{}: {e}", path.display())),
                (None, text) => {
                    Failure::wrong(format!("--angles {}: {e}", text.as_deref().unwrap_or_default()))
                }
            })?;
        }
        let threads = patient.threads;
        let mut requests = requests(given, angles, threads)?;
        network(&mut requests, &case, &spec, given.network.as_deref())?;
        let searches: Result<Vec<PlanSearch>, _> =
            requests.iter().map(|request| request.check(&case, spec.directions())).collect();
        let searches = searches.map_err(Failure::wrong)?;
        let (beams, budget) = (requests[0].beams, requests[0].budget);
        let is_shipped = given.network.is_none() && requests.iter().any(PlanRequest::uses_network);
        let out = patient.out.clone().unwrap_or_else(|| Path::new("plans").join(case.name()));
        let identity = identity(given.keep_identity.as_deref(), &case)?;
        let mut setup = PlanSetup::new(case, spec).map_err(Failure::failed)?;
        if let [search] = &searches[..]
            && let Some(beams) = search.only_beams()
        {
            let engine = setup.engine_of_plan(&beams).map_err(Failure::failed)?;
            setup = setup.by(engine).map_err(Failure::failed)?;
        }
        Ok(Self {
            caution: is_shipped.then(|| caution(setup.case.is_pelvis(), beams)).flatten(),
            setups_mm: setup.setups_mm(),
            setup,
            searches,
            has_weights: patient.weights.is_some(),
            start,
            searched_by: None,
            beams,
            budget,
            protocol_note,
            couch_deg,
            couch: None,
            dose_grid_mm: given.dose_grid.as_deref().map(dose_grid_mm).transpose()?,
            accept_check: accept_check(given)?,
            leaves: !given.fluence_only,
            out,
            doses: given.doses.clone(),
            identity,
            seed: given.seed,
            threads,
            quiet: patient.is_quiet,
        })
    }

    /// The leaves that fluences are sequenced for.
    pub fn collimator(&self) -> Option<&Collimator> {
        self.setup.spec.machine.file().collimator.as_ref().filter(|_| self.leaves)
    }

    /// Refuses beams that the leaves cannot shape, before doses are computed for them.
    ///
    /// # Errors
    /// A beam has bixels where the leaves cannot shape them.
    pub fn check_leaves(&self) -> Result<(), Failure> {
        // Where weights are given, only the bixels that have one count, and nothing is solved.
        let Some(collimator) = self.collimator().filter(|_| !self.has_weights) else { return Ok(()) };
        for search in &self.searches {
            self.setup.check_leaves(search, collimator).map_err(unshaped)?;
        }
        Ok(())
    }

    /// The limits that the plan aims at and is compared with.
    pub fn protocol(&self) -> Option<&Protocol> {
        self.setup.spec.protocol.as_ref()
    }

    /// The same request for the beams of a search that has ended, with doses by another method.
    ///
    /// # Errors
    /// No dose can be computed.
    pub fn by(self, engine: EngineName, found: &PlanRun) -> Result<Self, Failure> {
        let last = self.searches.iter().find(|search| search.name == found.name);
        let last = last.map(|search| search.of_beams(&found.choice.best.beams));
        let searches = last.into_iter().collect();
        let searched_by = Some(self.setup.engine_name());
        let setup = self.setup.by(engine).map_err(Failure::failed)?;
        Ok(Self { setup, searches, searched_by, ..self })
    }

    /// The same request for beams of these angles that a search with couch angles found, with doses by another method.
    ///
    /// # Errors
    /// No dose can be computed.
    pub fn with_couch(
        self,
        engine: EngineName,
        angles: &[BeamAngles],
        couch: PlanFileCouch,
    ) -> Result<Self, Failure> {
        let is_same = engine == self.setup.engine_name();
        let searched_by = (!is_same).then(|| self.setup.engine_name());
        let mut setup = self.setup.for_angles(angles).map_err(Failure::failed)?;
        if !is_same {
            setup = setup.by(engine).map_err(Failure::failed)?;
        }
        let last = self.searches.first().map(|search| search.of_directions(&setup.directions, angles));
        let searches = last.transpose().map_err(Failure::failed)?.into_iter().collect();
        Ok(Self { setup, searches, searched_by, couch: Some(couch), ..self })
    }

    /// Beams that need a dose.
    pub fn needed_beams(&self) -> Vec<u16> {
        let beams: BTreeSet<u16> = self.searches.iter().flat_map(PlanSearch::needed_beams).collect();
        beams.into_iter().collect()
    }
}

/// A fluence that the leaves cannot shape.
pub fn unshaped(why: impl std::fmt::Display) -> Failure {
    Failure::failed(format!("leaves: {why}; with --fluence-only the fluence is not sequenced"))
}

/// The parameters of the set-up.
fn spec(given: &PlanArgs) -> Result<SetupSpec, Failure> {
    let length = |name: &str, text: &str| quantity(text, "mm", &format!("--{name} {text}"));
    let errors_mm = match &given.robust {
        Some(text) => {
            let shift_mm = length("robust", text)?;
            set_up_errors(shift_mm).map_err(|e| Failure::wrong(format!("--robust {text}: {e}")))?
        }
        None => Vec::new(),
    };
    Ok(SetupSpec {
        objectives: objectives(given.objectives.as_deref())?,
        machine: machine(given.machine.as_deref())?,
        engine: given.engine,
        grid_mm: length("grid", &given.grid)?,
        bixel_mm: length("bixel", &given.bixel)?,
        errors_mm,
        inside_mm: inside_mm(given)?,
        robust_by: RobustBy::from(given.robust_by),
        ..SetupSpec::shipped().map_err(Failure::failed)?
    })
}

/// Largest couch angle to both sides, degrees.
fn couch_deg(given: &PlanArgs) -> Result<f64, Failure> {
    let text = given.couch.trim();
    let number = text.trim_start_matches('\u{b1}').trim_end_matches("deg").trim();
    match number.parse::<f64>() {
        _ if text == "free" => Ok(180.0),
        // Below the step of the candidates there is none.
        Ok(deg) if deg == 0.0 || (15.0..=180.0).contains(&deg) => Ok(deg),
        _ => Err(Failure::wrong(format!(
            "invalid couch angle: --couch {text} (allowed: 0, free, or the largest angle to both sides, 15 to 180 degrees)"
        ))),
    }
}

/// How far within the edge of the patient bixels run, mm; negative with flash.
fn inside_mm(given: &PlanArgs) -> Result<f64, Failure> {
    let (option, text, sign) = match &given.flash {
        Some(text) => ("--flash", text, -1.0),
        None => ("--body-margin", &given.body_margin, 1.0),
    };
    let mm = quantity(text, "mm", &format!("{option} {text}"))?;
    match (0.0..=50.0).contains(&mm) {
        true => Ok(sign * mm),
        false => Err(Failure::wrong(format!("invalid length: {option} {text} (allowed: 0 mm to 50 mm)"))),
    }
}

/// Spacing of the grid of the reported dose, mm.
fn dose_grid_mm(text: &str) -> Result<f64, Failure> {
    let mm = quantity(text, "mm", &format!("--dose-grid {text}"))?;
    match (1.0..=5.0).contains(&mm) {
        true => Ok(mm),
        false => Err(Failure::wrong(format!("invalid length: --dose-grid {text} (allowed: 1 mm to 5 mm)"))),
    }
}

/// Angles of the command line: gantry angles, each with a couch angle behind an `@` where that is not 0.
fn angles_of(text: &str) -> Result<Vec<BeamAngles>, Failure> {
    let angle = |part: &str| part.trim().trim_end_matches("deg").trim().parse::<BeamAngles>();
    let angles: Result<Vec<BeamAngles>, _> = text.split(',').map(angle).collect();
    angles.map_err(|_| {
        Failure::wrong(format!(
            "--angles {text}: give degrees separated by commas, such as 0,72,144, with a couch angle as in 72@30"
        ))
    })
}

/// A plan.json, or that of a folder, with its path.
pub fn plan_at(path: &Path) -> Result<(PathBuf, PlanFile), Failure> {
    let path = if path.is_dir() { path.join("plan.json") } else { path.to_owned() };
    let fault = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", path.display()));
    let bytes = std::fs::read(&path).map_err(|e| fault(&e))?;
    let plan = PlanFile::from_json(&bytes).map_err(|e| fault(&e))?;
    Ok((path, plan))
}

/// One request for each method that is to be run.
fn requests(
    given: &PlanArgs,
    angles: Option<Vec<BeamAngles>>,
    threads: NonZeroUsize,
) -> Result<Vec<PlanRequest>, Failure> {
    if let Some(angles) = angles {
        return Ok(vec![PlanRequest { seed: given.seed, threads, ..PlanRequest::of_angles(angles) }]);
    }
    let budget = given.budget.unwrap_or_else(|| PlanRequest::usual_budget(given.method));
    let of = |method: MethodName| {
        // In a comparison the prior is that of the methods that take one.
        let has_prior = !given.compare || method.takes_prior();
        PlanRequest {
            priors: if has_prior { given.prior.clone() } else { vec![PriorName::Price] },
            beams: given.beams,
            budget,
            leaves: if given.compare && !method.looks_ahead() { 1 } else { given.leaves },
            seed: given.seed,
            threads,
            ..PlanRequest::of_method(method)
        }
    };
    let methods = if given.compare { MethodName::COMPARED.to_vec() } else { vec![given.method] };
    Ok(methods.into_iter().map(of).collect())
}

fn network(
    requests: &mut [PlanRequest],
    case: &Case,
    spec: &SetupSpec,
    file: Option<&Path>,
) -> Result<(), Failure> {
    let named = |path: &Path, e: &dyn std::fmt::Display| Failure::wrong(format!("{}: {e}", path.display()));
    let own = match file {
        Some(path) => Some(std::fs::read(path).map_err(|e| named(path, &e))?),
        None => None,
    };
    with_network(requests, case, spec, own.as_deref()).map_err(|e| match (e, file) {
        (LearnedError::File(e), Some(path)) => named(path, &e),
        (LearnedError::Request(e), _) => Failure::wrong(e),
        (e, _) => Failure::failed(e),
    })
}

fn objectives(own: Option<&Path>) -> Result<ObjectiveTable, Failure> {
    let shipped = ObjectiveTable::shipped().map_err(Failure::failed)?;
    let Some(path) = own else { return Ok(shipped) };
    let fault = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| fault(&e))?;
    Ok(ObjectiveTable::parse(&text).map_err(|e| fault(&e))?.before(shipped))
}

/// The machine of this file, or the one that comes with the project.
pub fn machine(own: Option<&Path>) -> Result<Machine, Failure> {
    let Some(path) = own else { return Machine::shipped().map_err(Failure::failed) };
    let fault = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| fault(&e))?;
    Machine::from_json(&text).map_err(|e| fault(&e))
}

/// The protocol of this file; without one the shipped protocol of the site of the case, if there is one and its limits hold
/// for the fractions of the case. With what people should know of it.
fn protocol(case: &Case, file: Option<&Path>) -> Result<(Option<Protocol>, Option<String>), Failure> {
    let found = match file {
        Some(path) => {
            let name = path.display().to_string();
            let bytes = std::fs::read(path).map_err(|e| Failure::wrong(format!("{name}: {e}")))?;
            Some(protocol::read(&name, bytes).map_err(Failure::wrong)?)
        }
        None => protocol::of_site(case).map_err(Failure::failed)?,
    };
    let Some(protocol) = found else { return Ok((None, None)) };
    match (protocol.fractionation(case), file) {
        (Fractionation::Holds, _) => Ok((Some(protocol), None)),
        (Fractionation::Unknown(note), _) => Ok((Some(protocol), Some(note))),
        (Fractionation::Other(why), Some(path)) => {
            Err(Failure::wrong(format!("--protocol {}: {why}", path.display())))
        }
        (Fractionation::Other(why), None) => {
            Ok((None, Some(format!("the protocol {} is not applied: {why} with --protocol", protocol.name))))
        }
    }
}

/// The reason to take a plan that the check refuses.
fn accept_check(given: &PlanArgs) -> Result<Option<String>, Failure> {
    match given.accept_check.as_deref().map(str::trim) {
        Some("") => Err(Failure::wrong("--accept-check: give the reason in words")),
        reason => Ok(reason.map(str::to_owned)),
    }
}

fn identity(folder: Option<&Path>, case: &Case) -> Result<CaseIdentity, Failure> {
    let Some(folder) = folder else { return Ok(CaseIdentity::none()) };
    let uids = case.uids().ok_or_else(|| {
        Failure::wrong(format!(
            "--keep-identity: {} does not come from DICOM, so it has no identity",
            case.name()
        ))
    })?;
    CaseIdentity::read_stored(folder, uids).map_err(Failure::failed)
}
