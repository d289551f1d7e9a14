//! The checked request for a plan.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde::Serialize;
use stillpoint_dicom::Identity;
use stillpoint_network::Judgement;
use stillpoint_network::game::APART;
use stillpoint_patient::case::{Case, ContentHash, content_hash, phantom, read};
use stillpoint_plan::beams::{
    BeamGame, BeamSet, Method, Mixture, Prior, Ring, SearchOptions, class_solution, pelvis_solutions,
    set_of_prior,
};
use stillpoint_plan::dose::{Collimator, Machine};
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::protocol::Protocol;

use super::guide::{self, Guide};
use super::way::Way;
use super::{Plan, learned, protocol};
use crate::exit::Failure;
use crate::quantity::quantity;

/// Angles of the ring, 4 degrees apart, and steps that beams keep from each other: 20 degrees.
const RING: (u16, u16) = (90, 5);

/// Most solves of a method, if nothing else is asked for.
const BUDGET: usize = 40;
/// The same of the sets that a network proposes.
const PROPOSALS: usize = 5;

/// Exchanges of the game of two players.
const EXCHANGES: usize = 2;

/// What is optimised where there are several set-ups.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RobustBy {
    /// The mean over the set-ups, by beams and by fluence.
    Mean,
    /// The worst set-up, by beams: the robust game. The fluence is that for the planned set-up; a second player answers each
    /// set of beams with the set-up under which it costs most, and the search minimises that cost. Its answers are counted in
    /// the budget, each set-up as 0.02 solves.
    Worst,
}

/// A consistent request.
pub struct Request {
    /// The patient.
    pub case: Case,
    /// Hash of the case.
    pub hash: ContentHash,
    /// Angles that beams may have.
    pub ring: Ring,
    /// Beams of the plan.
    pub beams: usize,
    /// Most solves of a method.
    pub budget: usize,
    /// The methods of choosing beams, with their names.
    pub methods: Vec<(Way, Method)>,
    /// What people should know of the network that they use.
    pub caution: Option<String>,
    /// What is known of beams without a solve, beside prices.
    mixture: Option<Mixture<'static>>,
    /// Shifts of the patient (mm), the planned set-up first.
    pub setups_mm: Vec<[f64; 3]>,
    /// What is optimised where there are several.
    pub robust_by: RobustBy,
    /// The objectives.
    pub objectives: ObjectiveTable,
    /// The limits that the plan is compared with.
    pub protocol: Option<Protocol>,
    /// The machine.
    pub machine: Machine,
    /// Whether fluences are sequenced where the machine has leaves.
    leaves: bool,
    /// Spacing of the dose grid, mm.
    pub grid_mm: f64,
    /// Width of a bixel, mm.
    pub bixel_mm: f64,
    /// Where the plan goes.
    pub out: PathBuf,
    /// Where doses are kept.
    pub doses: PathBuf,
    /// Whose plan it is, in the exported DICOM.
    pub identity: Identity,
    /// Seed of the random methods.
    pub seed: u64,
    /// Threads.
    pub threads: NonZeroUsize,
    /// Whether progress is shown.
    pub quiet: bool,
}

impl Request {
    /// Checks it.
    pub fn new(given: &Plan) -> Result<Self, Failure> {
        if given.prior != [Guide::Price] && !given.compare && !given.method.takes_prior() {
            return Err(Failure::wrong(format!(
                "--method {} takes no --prior; the methods search, prior, construction and two-player do",
                given.method.word()
            )));
        }
        let case = match &given.case {
            Some(path) => read(path).map_err(Failure::wrong)?,
            None => phantom(0).map_err(Failure::failed)?,
        };
        let (count, gap) = RING;
        let angles = given.angles.as_deref().map(angles_deg).transpose()?;
        let ring = Ring::new(count, gap).map_err(Failure::failed)?;
        let ring = match (&angles, &given.angles) {
            (Some(angles), Some(text)) => {
                ring.for_angles(angles).map_err(|e| Failure::wrong(format!("--angles {text}: {e}")))?
            }
            _ => ring,
        };
        let (objectives, machine) =
            (objectives(given.objectives.as_deref())?, machine(given.machine.as_deref())?);
        let length = |name: &str, text: &str| quantity(text, "mm", &format!("--{name} {text}"));
        let (grid_mm, bixel_mm) = (length("grid", &given.grid)?, length("bixel", &given.bixel)?);
        let network = given.network.as_deref();
        let learned = || learned::judgement(&case, &objectives, &machine, bixel_mm, network);
        let budget = given.budget.unwrap_or(if given.method == Way::Network { PROPOSALS } else { BUDGET });
        let (beams, methods) = methods(given, angles, ring, &case, budget, learned)?;
        ring.check_room(beams).map_err(|e| Failure::wrong(format!("{e}")))?;
        let mixture = guide::mixture(&given.prior, &case, ring, beams, learned)?;
        let uses_network =
            given.prior.contains(&Guide::Network) || given.method == Way::Network || given.compare;
        let uses_shipped = uses_network && network.is_none();
        let caution = uses_shipped.then(|| learned::caution(case.is_pelvis(), beams)).flatten();
        if network.is_some() && !uses_network {
            return Err(Failure::wrong(
                "--network is the model of --method network, --prior network and --compare; give one of them, too",
            ));
        }
        if given.method == Way::Prior && mixture.is_none() {
            return Err(Failure::wrong(
                "--method prior: prices need solves; choose --prior geometry, class, uniform or network",
            ));
        }
        if budget == 0 {
            return Err(Failure::wrong(
                "--budget 0 solves nothing; allow at least 1, and for some methods one for each beam",
            ));
        }
        Ok(Self {
            hash: content_hash(&case).map_err(Failure::failed)?,
            ring,
            beams,
            budget,
            methods,
            caution,
            mixture,
            setups_mm: setups(given.robust.as_deref())?,
            robust_by: given.robust_by,
            objectives,
            protocol: protocol::of(&case, given.protocol.as_deref())?,
            machine,
            leaves: !given.fluence_only,
            grid_mm,
            bixel_mm,
            out: given.out.clone().unwrap_or_else(|| Path::new("plans").join(case.name())),
            doses: given.doses.clone(),
            identity: identity(given.keep_identity.as_deref(), &case)?,
            seed: given.seed,
            threads: match given.threads {
                Some(threads) => threads,
                None => std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN),
            },
            quiet: given.json,
            case,
        })
    }

    /// The leaves that fluences are sequenced for.
    pub fn collimator(&self) -> Option<&Collimator> {
        self.machine.file().collimator.as_ref().filter(|_| self.leaves)
    }

    /// What is known of beams without a solve.
    pub fn prior(&self) -> Option<&dyn Prior> {
        self.mixture.as_ref().map(|mixture| mixture as &dyn Prior)
    }

    /// Beams that need a dose: all of the ring, unless the methods are sure to use fewer.
    pub fn needed_beams(&self) -> Vec<u16> {
        match &self.methods[..] {
            [(_, Method::Prior)] => {
                let set = self.prior().and_then(|prior| set_of_prior(prior, self.ring, self.beams).ok());
                set.map_or_else(|| (0..self.ring.count()).collect(), |set| set.beams().to_vec())
            }
            [(_, Method::Sets(sets))] => {
                let beams: BTreeSet<u16> =
                    sets.iter().flatten().map(|angle| self.ring.nearest(*angle)).collect();
                beams.into_iter().collect()
            }
            [(_, Method::Class(angles))] => {
                let mut beams: Vec<u16> = angles.iter().map(|angle| self.ring.nearest(*angle)).collect();
                beams.sort_unstable();
                beams
            }
            _ => (0..self.ring.count()).collect(),
        }
    }
}

/// Gantry angles of the command line.
fn angles_deg(text: &str) -> Result<Vec<f64>, Failure> {
    let angle = |part: &str| part.trim().trim_end_matches("deg").trim().parse::<f64>().ok();
    let angles: Option<Vec<f64>> = text.split(',').map(angle).collect();
    angles.ok_or_else(|| {
        Failure::wrong(format!("--angles {text}: give degrees separated by commas, such as 0,72,144"))
    })
}

fn methods(
    given: &Plan,
    angles: Option<Vec<f64>>,
    ring: Ring,
    case: &Case,
    budget: usize,
    learned: impl Fn() -> Result<Judgement, Failure>,
) -> Result<(usize, Vec<(Way, Method)>), Failure> {
    if let Some(angles) = angles {
        return Ok((angles.len(), vec![(Way::Given, Method::Class(angles))]));
    }
    ring.check_room(given.beams).map_err(|e| Failure::wrong(format!("{e}")))?;
    let ways = if given.compare { Way::CHOOSING.to_vec() } else { vec![given.method] };
    let mut methods = Vec::new();
    for way in ways {
        let method = match way {
            Way::Equidistant => Method::Equidistant,
            Way::Class | Way::Given => Method::Class(class_solution(given.beams)),
            Way::Random => Method::Random,
            Way::Greedy => Method::Greedy,
            Way::Exchange => {
                Method::Exchange(if case.is_pelvis() { pelvis_solutions(given.beams) } else { Vec::new() })
            }
            Way::Annealing => Method::Annealing,
            Way::Columns => Method::ColumnGeneration,
            Way::Search => Method::Search(search_options(given, case)),
            Way::Prior => Method::Prior,
            Way::Network => {
                let sets = learned()?.spread_sets(ring, given.beams, budget, APART);
                let degrees = |set: &BeamSet| set.beams().iter().map(|beam| ring.angle_deg(*beam)).collect();
                Method::Sets(sets.map_err(Failure::failed)?.iter().map(degrees).collect())
            }
            Way::Construction => Method::Game(BeamGame::Construction),
            Way::TwoPlayer => Method::Game(BeamGame::Alternating { depth: EXCHANGES }),
        };
        methods.push((way, method));
    }
    Ok((given.beams, methods))
}

/// With prices alone the search begins where exchange does; with another prior at the set that the prior builds.
fn search_options(given: &Plan, case: &Case) -> SearchOptions {
    let by_price = given.prior.contains(&Guide::Price);
    let mixed = given.prior.iter().any(|guide| *guide != Guide::Price);
    let starts = if mixed || !case.is_pelvis() { Vec::new() } else { pelvis_solutions(given.beams) };
    SearchOptions {
        starts: starts.into_iter().take(1).collect(),
        price: if by_price { 1.0 } else { 0.0 },
        prior: if mixed { 1.0 } else { 0.0 },
        ..SearchOptions::default()
    }
}

/// The planned set-up, and shifts along each axis both ways.
fn setups(shift: Option<&str>) -> Result<Vec<[f64; 3]>, Failure> {
    let mut setups = vec![[0.0; 3]];
    let Some(text) = shift else { return Ok(setups) };
    let shift = quantity(text, "mm", &format!("--robust {text}"))?;
    if !(shift > 0.0 && shift <= 50.0) {
        return Err(Failure::wrong(format!(
            "--robust {text}: the shift must be above 0 mm and at most 50 mm"
        )));
    }
    for axis in 0..3 {
        for way in [-shift, shift] {
            let mut moved = [0.0; 3];
            moved[axis] = way;
            setups.push(moved);
        }
    }
    Ok(setups)
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

fn identity(folder: Option<&Path>, case: &Case) -> Result<Identity, Failure> {
    let Some(folder) = folder else { return Ok(Identity::none()) };
    let uids = case.uids().ok_or_else(|| {
        Failure::wrong(format!(
            "--keep-identity: {} does not come from DICOM, so it has no identity",
            case.name()
        ))
    })?;
    Identity::read_again(folder, uids).map_err(Failure::failed)
}
