//! A call: what is asked, as canonical bytes, and its key.

use stillpoint_network::patient::Body;
use stillpoint_network::{Patient, Rules};

use crate::wire::{Reader, WireError, Writer};
use crate::{Build, Hash, game};

const MAGIC: &[u8; 8] = b"SPCALL01";
/// The most beams of a call.
pub const MOST_BEAMS: usize = 1024;
/// The most set-ups of the patient.
pub const MOST_SETUPS: usize = 256;
/// The most bytes of a call.
pub const MOST_BYTES: usize = 4 << 20;

/// Names of the dose matrices of one beam, one for each set-up of the patient.
pub type BeamDoses = Vec<Hash>;

/// A pure function with its arguments. Large arguments are named by the hash of their bytes.
#[derive(Clone, Debug, PartialEq)]
pub enum Call {
    /// The dose of a beam. The engine holds all of case, machine and parameters that the dose depends on. The answer is a
    /// dose file.
    Dose {
        /// `DoseEngine::to_bytes`.
        engine: Hash,
        /// Gantry angle, degrees.
        gantry_deg: f64,
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
        beside: Option<Hash>,
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
            Self::Price { goals, beside, candidates } => {
                std::iter::once(goals).chain(beside).chain(candidates.iter().flatten()).copied().collect()
            }
            Self::Game { network, case, .. } => network.iter().chain(case).copied().collect(),
        };
        inputs.sort_unstable();
        inputs.dedup();
        inputs
    }

    /// The canonical bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Writer(MAGIC.to_vec());
        match self {
            Self::Dose { engine, gantry_deg } => {
                out.byte(0);
                out.hash(engine);
                out.real(*gantry_deg);
            }
            Self::Solve { goals, beams, start, tolerance } => {
                out.byte(1);
                out.hash(goals);
                write_beams(&mut out, beams);
                out.byte(u8::from(start.is_some()));
                out.reals(start.as_deref().unwrap_or_default());
                out.real(*tolerance);
            }
            Self::Price { goals, beside, candidates } => {
                out.byte(2);
                out.hash(goals);
                write_name(&mut out, beside.as_ref());
                write_beams(&mut out, candidates);
            }
            Self::Game { network, case, patient, seed, rules } => {
                out.byte(3);
                write_name(&mut out, network.as_ref());
                write_name(&mut out, case.as_ref());
                game::write_patient(&mut out, patient);
                out.number(*seed);
                game::write_rules(&mut out, rules);
            }
        }
        out.0
    }

    /// Reads a call from bytes that anybody may have made.
    ///
    /// # Errors
    /// The bytes are no call, or not its canonical ones.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        if bytes.len() > MOST_BYTES {
            let (found, most) = (bytes.len() as u64, MOST_BYTES as u64);
            return Err(WireError::Bound { what: "the length of a call", found, most });
        }
        let mut from = Reader::new(bytes);
        if from.raw(8, "a call")? != MAGIC {
            return Err(WireError::Unknown("the version of a call"));
        }
        let call = match from.byte("the kind of a call")? {
            0 => Self::Dose { engine: from.hash("an engine")?, gantry_deg: from.real("an angle")? },
            1 => Self::Solve {
                goals: from.hash("goals")?,
                beams: read_beams(&mut from)?,
                start: {
                    let is_some = from.flag("a flag")?;
                    let weights = from.reals("weights")?;
                    if !is_some && !weights.is_empty() {
                        return Err(WireError::Unknown("a list of weights that is not there"));
                    }
                    is_some.then_some(weights)
                },
                tolerance: from.real("a tolerance")?,
            },
            2 => Self::Price {
                goals: from.hash("goals")?,
                beside: read_name(&mut from, "a plan")?,
                candidates: read_beams(&mut from)?,
            },
            3 => {
                let network = read_name(&mut from, "a network")?;
                let case = read_name(&mut from, "a case")?;
                let patient = game::read_patient(&mut from)?;
                if case.is_some() != matches!(patient.body, Body::File(_)) {
                    return Err(WireError::Unknown("a patient without a case, or a phantom with one"));
                }
                let seed = from.number("a seed")?;
                Self::Game { network, case, patient, seed, rules: game::read_rules(&mut from)? }
            }
            _ => return Err(WireError::Unknown("the kind of a call")),
        };
        from.end()?;
        Ok(call)
    }
}

fn write_name(out: &mut Writer, name: Option<&Hash>) {
    out.byte(u8::from(name.is_some()));
    name.into_iter().for_each(|hash| out.hash(hash));
}

fn read_name(from: &mut Reader<'_>, what: &'static str) -> Result<Option<Hash>, WireError> {
    Ok(if from.flag("a flag")? { Some(from.hash(what)?) } else { None })
}

fn write_beams(out: &mut Writer, beams: &[BeamDoses]) {
    out.number(beams.len() as u64);
    for setups in beams {
        out.number(setups.len() as u64);
        setups.iter().for_each(|hash| out.hash(hash));
    }
}

/// At least one beam, each with as many set-ups.
fn read_beams(from: &mut Reader<'_>) -> Result<Vec<BeamDoses>, WireError> {
    let beams = from.list(MOST_BEAMS, "the number of beams", |from| {
        from.list(MOST_SETUPS, "the number of set-ups", |from| from.hash("a dose"))
    })?;
    match beams.first().map(Vec::len) {
        Some(setups) if setups > 0 && beams.iter().all(|beam| beam.len() == setups) => Ok(beams),
        _ => Err(WireError::Unknown("a list of beams that is empty or uneven")),
    }
}
