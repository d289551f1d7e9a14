//! A game: the sets of a patient that a network proposes and a search finds from there, each solved.
//!
//! A game is a pure function of the network's numbers, the patient, the seed and the rules: anyone may play it, anywhere, as
//! often as wanted. Without a network it is an opening, for the supervised start of a training.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};
use stillpoint_plan::Rows;
use stillpoint_plan::beams::{
    BeamSet, Budget, ChoiceError, Evaluator, Method, Prior, Ring, RingError, SearchOptions, Stop,
    ToleranceError, choose, pelvis_solutions, rotations,
};
use stillpoint_plan::dose::{Machine, MachineError};
use thiserror::Error;

use crate::eye::{Eye, EyeError};
use crate::file::ModelFileError;
use crate::judgement::Judgement;
use crate::model::Model;
use crate::patient::{Patient, PatientError};
use crate::problem::{Problem, ProblemError};

/// Version of the bytes of a game, of the way in which games are played, and of the phantoms on which they are played: a
/// folder of games of another version is refused.
const VERSION: u32 = 1;
/// Angles of the ring, 4 degrees apart, and steps that beams keep from each other: 20 degrees.
pub const RING: (u16, u16) = (90, 5);
/// To which part of its optimum a set is solved.
const TOLERANCE: f64 = 1e-3;
/// Steps between beams of two proposals that are not neighbours.
pub const APART: u16 = 3;
/// Part of Dirichlet noise at the root of the search of a game (SCIENCE G5).
const NOISE: f64 = 0.25;

/// What is solved in a game.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Beams of a set.
    pub beams: usize,
    /// Whether the class set of the pelvis is solved, where there is one for so many beams.
    pub class: bool,
    /// Rotations of equal beams, evenly spread.
    pub rotations: usize,
    /// Sets of the best value that the network proposes.
    pub proposed: usize,
    /// Solves of the search: tree search from the network's first set and guided by it; exchange where there is no network.
    pub search: usize,
    /// Random sets.
    pub random: usize,
}

/// A game that is to be played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Due {
    /// Its name. The game does not depend on it.
    pub name: String,
    /// Whose beams are chosen.
    pub patient: Patient,
    /// The seed.
    pub seed: u64,
    /// The rules.
    pub rules: Rules,
}

/// What was solved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Game {
    version: u32,
    /// The rules.
    pub rules: Rules,
    /// The patient.
    pub patient: Patient,
    /// The seed.
    pub seed: u64,
    /// Hash of the network; none of an opening.
    pub network: Option<String>,
    /// Cost of the class set.
    pub class: Option<f64>,
    /// Costs of the rotations of equal beams.
    pub rotations: Vec<f64>,
    /// Costs of the network's sets, the one of the best value first.
    pub proposed: Vec<f64>,
    /// All sets of as many beams as the rules say, by their numbers on the ring, rising, with their costs.
    pub sets: Vec<(Vec<u16>, f64)>,
}

/// Why a game was not played.
#[derive(Debug, Error)]
pub enum GameError {
    /// The patient.
    #[error(transparent)]
    Patient(#[from] PatientError),
    /// Goals and doses.
    #[error(transparent)]
    Problem(#[from] ProblemError),
    /// The machine that comes with the project.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The features.
    #[error(transparent)]
    Eye(#[from] EyeError),
    /// Sets of so many beams.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// The search.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// A solve.
    #[error(transparent)]
    Stop(#[from] Stop),
    /// The tolerance.
    #[error(transparent)]
    Tolerance(#[from] ToleranceError),
    /// The network has no file.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// The bytes of a game.
    #[error("the bytes are not a game that this build reads: {0}")]
    Bytes(String),
}

impl Rules {
    /// Of an opening, for the supervised start.
    pub const OPENING: Self =
        Self { beams: 5, class: true, rotations: 4, proposed: 0, search: 24, random: 6 };

    /// Of a game with a network.
    pub const SELF_PLAY: Self =
        Self { beams: 5, class: false, rotations: 4, proposed: 8, search: 16, random: 2 };

    /// Of an opening of a patient that is examined: it looks longer for the best set.
    pub const REFERENCE: Self = Self { rotations: 18, search: 60, ..Self::OPENING };

    /// Of an examination of a network: its own sets beside all rotations and the class set.
    pub const EXAM: Self = Self { beams: 5, class: true, rotations: 18, proposed: 5, search: 0, random: 0 };
}

/// The ring of games.
pub fn ring() -> Result<Ring, RingError> {
    Ring::new(RING.0, RING.1)
}

/// Plays a game. Nothing depends on the number of threads.
///
/// # Errors
/// There is no such patient, nothing to solve, or no room for so many beams.
pub fn play(
    network: Option<&Model>,
    patient: &Patient,
    seed: u64,
    rules: Rules,
    threads: NonZeroUsize,
) -> Result<Game, GameError> {
    let problem = patient.problem()?;
    play_on(&problem, network, patient, seed, rules, threads)
}

/// Plays a game on a patient that was made ready.
///
/// # Errors
/// As [`play`].
pub fn play_on(
    problem: &Problem,
    network: Option<&Model>,
    patient: &Patient,
    seed: u64,
    rules: Rules,
    threads: NonZeroUsize,
) -> Result<Game, GameError> {
    let ring = ring()?;
    let hash = network.map(Model::hash).transpose()?;
    let judgement = match network {
        Some(network) => {
            let angles = usize::from(ring.count());
            let eye = Eye::of_case(
                problem.case(),
                problem.requested(),
                &Machine::shipped()?,
                angles,
                patient.coarse.bixel_mm,
            )?;
            Some(network.judge(&eye))
        }
        None => None,
    };
    let doses = problem.doses(ring, threads)?;
    let table = Solved { problem, doses: &doses, ring, rules, threads, sets: BTreeMap::new() };
    let game = table.play(judgement.as_ref(), patient, seed)?;
    Ok(Game { network: hash, ..game })
}

/// The sets that are solved until now.
struct Solved<'a> {
    problem: &'a Problem,
    doses: &'a [Rows],
    ring: Ring,
    rules: Rules,
    threads: NonZeroUsize,
    sets: BTreeMap<Vec<u16>, f64>,
}

impl<'a> Solved<'a> {
    fn play(
        mut self,
        judgement: Option<&Judgement>,
        patient: &Patient,
        seed: u64,
    ) -> Result<Game, GameError> {
        let Rules { beams, .. } = self.rules;
        let habits = if self.problem.case().is_pelvis() { pelvis_solutions(beams) } else { Vec::new() };
        let class = match habits.first().filter(|_| self.rules.class) {
            Some(angles) => {
                let places: Vec<u16> = angles.iter().map(|angle| self.ring.nearest(*angle)).collect();
                self.costs(&[self.ring.set(&places)?])?.first().copied()
            }
            None => None,
        };
        let all = rotations(self.ring, beams)?;
        let requested = self.rules.rotations.min(all.len());
        let spread: Vec<BeamSet> = (0..requested).map(|i| all[i * all.len() / requested].clone()).collect();
        let rotations = self.costs(&spread)?;
        let (mut proposed, mut first) = (Vec::new(), None);
        if let Some(judgement) = judgement {
            let sets = judgement.spread_sets(self.ring, beams, self.rules.proposed.max(1), APART)?;
            first = sets.first().cloned();
            proposed = self.costs(&sets[..sets.len().min(self.rules.proposed)])?;
        }
        if self.rules.search > beams {
            let prior = judgement.map(|judgement| judgement as &dyn Prior);
            let method = match first {
                Some(first) => {
                    let angles = first.beams().iter().map(|beam| self.ring.angle_deg(*beam)).collect();
                    Method::Search(SearchOptions {
                        starts: vec![angles],
                        prior: 1.0,
                        noise: NOISE,
                        ..SearchOptions::default()
                    })
                }
                None => Method::Exchange(habits),
            };
            self.search(&method, self.rules.search, prior, seed)?;
        }
        if self.rules.random > 0 {
            self.search(&Method::Random, self.rules.random, None, seed)?;
        }
        Ok(Game {
            version: VERSION,
            rules: self.rules,
            patient: patient.clone(),
            seed,
            network: None,
            class,
            rotations,
            proposed,
            sets: self.sets.into_iter().collect(),
        })
    }

    fn evaluator(&self, solves: usize) -> Result<Evaluator<'a, [Rows]>, GameError> {
        let budget = Budget { solves };
        let evaluator = Evaluator::new(self.doses, self.problem.goals(), self.ring, self.rules.beams, budget);
        Ok(evaluator.with_threads(self.threads).with_tolerance(TOLERANCE)?)
    }

    /// Costs of these sets, in their order.
    fn costs(&mut self, sets: &[BeamSet]) -> Result<Vec<f64>, GameError> {
        if sets.is_empty() {
            return Ok(Vec::new());
        }
        let solved = self.evaluator(sets.len())?.evaluate_all(sets, None)?;
        self.sets.extend(solved.iter().map(|solved| (solved.beams.beams().to_vec(), solved.cost)));
        Ok(solved.iter().map(|solved| solved.cost).collect())
    }

    fn search(
        &mut self,
        method: &Method,
        solves: usize,
        prior: Option<&dyn Prior>,
        seed: u64,
    ) -> Result<(), GameError> {
        let mut evaluator = self.evaluator(solves)?;
        choose(method, &mut evaluator, prior, seed)?;
        let whole = evaluator.history().iter().filter(|p| p.beams.beams().len() == self.rules.beams);
        let found: Vec<(Vec<u16>, f64)> = whole.map(|p| (p.beams.beams().to_vec(), p.cost)).collect();
        self.sets.extend(found);
        Ok(())
    }
}

impl Game {
    /// Whether this is the game that is due, with the network of this hash.
    pub fn is_of(&self, due: &Due, network: Option<&str>) -> bool {
        (&self.patient, self.seed, self.rules, self.network.as_deref())
            == (&due.patient, due.seed, due.rules, network)
    }

    /// Least cost.
    pub fn best(&self) -> f64 {
        self.sets.iter().map(|(_, cost)| *cost).fold(f64::INFINITY, f64::min)
    }

    /// Its bytes: the same for the same game.
    ///
    /// # Errors
    /// A path of the patient that is no text.
    pub fn to_bytes(&self) -> Result<Vec<u8>, GameError> {
        serde_json::to_vec(self).map_err(|e| GameError::Bytes(e.to_string()))
    }

    /// The game of these bytes.
    ///
    /// # Errors
    /// They are of another form or version, or hold costs that are not above 0 or sets that are none.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, GameError> {
        let game: Self = serde_json::from_slice(bytes).map_err(|e| GameError::Bytes(e.to_string()))?;
        let no = |why: &str| Err(GameError::Bytes(why.to_owned()));
        if game.version != VERSION {
            return no(&format!("version {}, and this build reads {VERSION}", game.version));
        }
        let costs = game.sets.iter().map(|(_, cost)| cost);
        if !costs
            .chain(&game.rotations)
            .chain(&game.proposed)
            .chain(&game.class)
            .all(|c| c.is_finite() && *c > 0.0)
        {
            return no("a cost is not above 0");
        }
        let ring = ring()?;
        for (set, _) in &game.sets {
            if set.len() != game.rules.beams || ring.set(set)?.beams() != set {
                return no("a set has another number of beams, or they do not rise");
            }
        }
        Ok(game)
    }
}
