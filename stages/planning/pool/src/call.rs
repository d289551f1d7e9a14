//! A call: what is asked, as canonical bytes, and its key.

use serde::{Deserialize, Serialize};
use stillpoint_network::patient::Body;
use stillpoint_network::{Patient, Rules};
use stillpoint_plan::dose::BeamAngles;

use crate::wire::{Format, WireError, at_most};
use crate::{Build, Hash, game};

/// The most beams of a call.
pub const MOST_BEAMS: usize = 1024;
/// The most set-ups of the patient.
pub const MOST_SETUPS: usize = 256;
/// The most bytes of a call.
pub const MOST_BYTES: usize = 4 << 20;

const FORMAT: Format = Format { what: "a call", mark: b"SPCALL03", most: MOST_BYTES };

/// Names of the dose matrices of one beam, one for each set-up of the patient.
pub type BeamDoses = Vec<Hash>;

/// A pure function with its arguments. Large arguments are named by the hash of their bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Call {
    /// The dose of a beam. The engine holds all of case, machine and parameters that the dose depends on. The answer is a
    /// dose file.
    Dose {
        /// `DoseEngine::to_bytes`.
        engine: Hash,
        /// Gantry angle, degrees.
        gantry_deg: f64,
        /// Couch angle, degrees.
        couch_deg: f64,
    },
    /// The best fluence of a set of beams. The answer is a plan; see [`crate::answer`].
    Solve {
        /// The goals; see [`crate::goals`].
        goals: Hash,
        /// Dose files of each beam.
        beams: Vec<BeamDoses>,
        /// Weights to begin with, of all bixels.
        start: Option<Vec<f64>>,
        /// Relative excess over the optimum that is aimed at.
        tolerance: f64,
    },
    /// The prices of beams beside a plan. The answer is one number for each candidate.
    Price {
        /// The goals.
        goals: Hash,
        /// The plan: the answer of a solve. None stands for no beam.
        base: Option<Hash>,
        /// Dose files of each candidate.
        candidates: Vec<BeamDoses>,
    },
    /// A game of a training; see [`stillpoint_network::game`]. The answer is `Game::to_bytes`.
    Game {
        /// The model file. None stands for an opening.
        network: Option<Hash>,
        /// The case file of a patient who is one; a phantom has none.
        case: Option<Hash>,
        /// Whose beams are chosen.
        #[serde(with = "game::PatientFields")]
        patient: Patient,
        /// The seed.
        seed: u64,
        /// The rules.
        rules: Rules,
    },
}

/// The kinds of calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// [`Call::Dose`].
    Dose,
    /// [`Call::Solve`].
    Solve,
    /// [`Call::Price`].
    Price,
    /// [`Call::Game`].
    Game,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Dose, Self::Solve, Self::Price, Self::Game];

    /// The longest answer to such a call, bytes: what is said to be longer is not fetched.
    pub fn longest_answer(self) -> u64 {
        match self {
            Self::Dose => 1 << 30,
            Self::Solve | Self::Game => 256 << 20,
            Self::Price => 64 << 10,
        }
    }

    /// Whether a worker computes such a call before others that wait: it takes little, and a search chooses nothing without it.
    pub fn is_hasty(self) -> bool {
        self == Self::Price
    }

    /// Its name.
    pub fn word(self) -> &'static str {
        match self {
            Self::Dose => "dose",
            Self::Solve => "solve",
            Self::Price => "price",
            Self::Game => "game",
        }
    }
}

impl Call {
    /// Its kind.
    pub fn kind(&self) -> Kind {
        match self {
            Self::Dose { .. } => Kind::Dose,
            Self::Solve { .. } => Kind::Solve,
            Self::Price { .. } => Kind::Price,
            Self::Game { .. } => Kind::Game,
        }
    }

    /// Candidates of a call for prices; none of other calls.
    pub fn candidates(&self) -> usize {
        match self {
            Self::Price { candidates, .. } => candidates.len(),
            Self::Dose { .. } | Self::Solve { .. } | Self::Game { .. } => 0,
        }
    }

    /// The dose of a beam by the engine of this name.
    pub fn dose(engine: Hash, angles: impl Into<BeamAngles>) -> Self {
        let BeamAngles { gantry_deg, couch_deg } = angles.into();
        Self::Dose { engine, gantry_deg, couch_deg }
    }

    /// A solve to this part of the optimum.
    pub fn solve(goals: Hash, beams: Vec<BeamDoses>, start: Option<Vec<f64>>, tolerance: f64) -> Self {
        Self::Solve { goals, beams, start, tolerance }
    }

    /// The key: SHA-256 of all that the answer depends on.
    pub fn key(&self, build: &Build) -> Hash {
        Self::key_of(&self.to_bytes(), build)
    }

    /// The key of the call with these bytes.
    pub fn key_of(bytes: &[u8], build: &Build) -> Hash {
        Hash::of_parts(&[build.text().as_bytes(), bytes])
    }

    /// Names of all large arguments, without repetition.
    pub fn inputs(&self) -> Vec<Hash> {
        let mut inputs: Vec<Hash> = match self {
            Self::Dose { engine, .. } => vec![*engine],
            Self::Solve { goals, beams, .. } => {
                std::iter::once(goals).chain(beams.iter().flatten()).copied().collect()
            }
            Self::Price { goals, base, candidates } => {
                std::iter::once(goals).chain(base).chain(candidates.iter().flatten()).copied().collect()
            }
            Self::Game { network, case, .. } => network.iter().chain(case).copied().collect(),
        };
        inputs.sort_unstable();
        inputs.dedup();
        inputs
    }

    /// The canonical bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        FORMAT.write(self)
    }

    /// Reads a call from bytes that anybody may have made.
    ///
    /// # Errors
    /// The bytes are no call, or not its canonical ones.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let call: Self = FORMAT.read(bytes)?;
        match &call {
            Self::Dose { .. } => {}
            Self::Solve { beams, .. } | Self::Price { candidates: beams, .. } => check_beams(beams)?,
            Self::Game { case, patient, rules, .. } => {
                if case.is_some() != matches!(patient.body, Body::File(_)) {
                    return Err(WireError::Value("a patient without a case, or a phantom with one"));
                }
                game::check(patient, rules)?;
            }
        }
        Ok(call)
    }
}

/// At least one beam, each with as many set-ups.
fn check_beams(beams: &[BeamDoses]) -> Result<(), WireError> {
    at_most(beams.len(), MOST_BEAMS, "the number of beams")?;
    let setups = beams.first().map_or(0, Vec::len);
    at_most(setups, MOST_SETUPS, "the number of set-ups")?;
    match setups > 0 && beams.iter().all(|beam| beam.len() == setups) {
        true => Ok(()),
        false => Err(WireError::Value("a list of beams that is empty or uneven")),
    }
}
