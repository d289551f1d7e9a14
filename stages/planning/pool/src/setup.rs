//! What a search on the pool stands on, with the names of its contents.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::num::NonZeroUsize;

use stillpoint_plan::Setups;
use stillpoint_plan::beams::{
    BeamSet, Evaluated, Influence, Local, RingDoses, price_beams, solve_beams, start_weights,
};
use stillpoint_plan::dose::BeamFile;
use stillpoint_plan::fluence::Goals;
use stillpoint_plan::threads::on_threads;

use crate::call::BeamDoses;
use crate::{Call, CallError, Hash, answer, goals};

/// Neighbouring angles of the ring whose prices are one call. A call has those of the same angles beside every plan: so the
/// worker that holds their doses prices them.
const SHARD: u16 = 16;

/// The doses of the beams of a ring, each as files.
pub trait DoseFiles: Influence {
    /// The dose files of a beam, one for each set-up; none where it has no dose.
    fn files_of(&self, beam: u16) -> Vec<&BeamFile>;
}

impl DoseFiles for RingDoses {
    fn files_of(&self, beam: u16) -> Vec<&BeamFile> {
        self.files(beam).collect()
    }
}

impl DoseFiles for [BeamFile] {
    fn files_of(&self, beam: u16) -> Vec<&BeamFile> {
        self.get(usize::from(beam)).into_iter().collect()
    }
}

/// Names of goals and doses.
#[derive(Clone)]
pub struct Names {
    goals: Vec<u8>,
    goals_hash: Hash,
    /// Names of the dose files of each beam of the ring.
    beams: Vec<BeamDoses>,
    /// Beam and set-up of each dose file.
    places: BTreeMap<Hash, (u16, usize)>,
}

impl Names {
    /// Of the doses of a ring of `beams` angles. It reads all of them once, on these threads.
    pub fn new<I: DoseFiles + ?Sized>(doses: &I, goals: &Goals, beams: u16, threads: NonZeroUsize) -> Self {
        let all: Vec<u16> = (0..beams).collect();
        let of_beam = |beam: &u16| -> Result<BeamDoses, Infallible> {
            Ok(doses.files_of(*beam).into_iter().map(|file| Hash::of(file.bytes())).collect())
        };
        let Ok(beams) = on_threads(&all, threads, of_beam);
        let mut places = BTreeMap::new();
        for (beam, setups) in all.into_iter().zip(&beams) {
            places.extend(setups.iter().enumerate().map(|(setup, hash)| (*hash, (beam, setup))));
        }
        let goals = goals::to_bytes(goals);
        Self { goals_hash: Hash::of(&goals), goals, beams, places }
    }

    /// A content that workers need: the goals, or one of the doses that were named.
    pub fn content<'a, I: DoseFiles + ?Sized>(&'a self, doses: &'a I, hash: &Hash) -> Option<&'a [u8]> {
        if *hash == self.goals_hash {
            return Some(&self.goals);
        }
        let (beam, setup) = *self.places.get(hash)?;
        doses.files_of(beam).get(setup).map(|file| file.bytes())
    }
}

/// What a search stands on, with the names of its contents.
pub struct PoolSetup<'a, I: DoseFiles + ?Sized> {
    doses: &'a I,
    goals: &'a Goals,
    names: Cow<'a, Names>,
}

impl<'a, I: DoseFiles + ?Sized> PoolSetup<'a, I> {
    /// Of the doses of a ring of `beams` angles. It reads all of them once, on these threads.
    pub fn new(doses: &'a I, goals: &'a Goals, beams: u16, threads: NonZeroUsize) -> Self {
        Self { doses, goals, names: Cow::Owned(Names::new(doses, goals, beams, threads)) }
    }

    /// Of doses and goals with these names.
    pub fn named(doses: &'a I, goals: &'a Goals, names: &'a Names) -> Self {
        Self { doses, goals, names: Cow::Borrowed(names) }
    }

    /// The same on one thread of this process.
    pub fn local(&self) -> Local<'a, I> {
        Local { influence: self.doses, goals: self.goals, threads: NonZeroUsize::MIN }
    }

    /// A content that workers need: the goals or a dose.
    pub fn content(&self, hash: &Hash) -> Option<&[u8]> {
        self.names.content(self.doses, hash)
    }

    /// Whether all these beams have a dose; a problem without is this process's own to refuse.
    pub fn holds(&self, beams: &[u16]) -> bool {
        beams
            .iter()
            .all(|beam| self.names.beams.get(usize::from(*beam)).is_some_and(|names| !names.is_empty()))
    }

    /// A call for each set, which has beams, all with doses.
    pub fn solve_calls(&self, sets: &[&BeamSet], near: Option<&Evaluated>, tolerance: f64) -> Vec<Call> {
        let call = |set: &&BeamSet| {
            let start = start_weights(set, &self.columns(set.beams()), near);
            Call::solve(self.names.goals_hash, self.of(set.beams()), start, tolerance)
        };
        sets.iter().map(call).collect()
    }

    /// Calls for the prices of candidates beside a plan, all with doses; and that plan, by name, as a content.
    pub fn price_calls(
        &self,
        base: Option<&Evaluated>,
        candidates: &[u16],
    ) -> (Vec<Call>, Option<(Hash, Vec<u8>)>) {
        let plan = base.map(|base| answer::of_plan(&base.plan));
        let plan = plan.map(|bytes| (Hash::of(&bytes), bytes));
        let call = |shard: &[u16]| Call::Price {
            goals: self.names.goals_hash,
            base: plan.as_ref().map(|(hash, _)| *hash),
            candidates: self.of(shard),
        };
        (candidates.chunk_by(|a, b| a / SHARD == b / SHARD).map(call).collect(), plan)
    }

    /// The sets with the answers of their calls.
    ///
    /// # Errors
    /// An answer is no plan of its set.
    pub fn evaluated<B: AsRef<[u8]>>(
        &self,
        sets: &[&BeamSet],
        answers: &[B],
    ) -> Result<Vec<Evaluated>, CallError> {
        let one = |(set, bytes): (&&BeamSet, &B)| {
            let columns = self.columns(set.beams());
            let plan = answer::plan(bytes.as_ref(), Some(columns.iter().sum()), self.goals.voxels().len());
            plan.map(|plan| Evaluated::new(set, &columns, plan)).map_err(CallError::of)
        };
        sets.iter().zip(answers).map(one).collect()
    }

    /// Whether an answer has the form that this call asks for.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check(&self, call: &Call, bytes: &[u8]) -> Result<(), CallError> {
        match call {
            Call::Solve { beams, .. } => {
                let bixels = self.columns(&self.beams_of(beams)?).iter().sum();
                answer::plan(bytes, Some(bixels), self.goals.voxels().len()).map(drop)
            }
            Call::Price { candidates, .. } => answer::prices(bytes, candidates.len()).map(drop),
            Call::Dose { .. } | Call::Game { .. } => return Err(CallError::NotOfSearch(call.kind())),
        }
        .map_err(CallError::of)
    }

    /// The answer of a solve or a price, computed by this process. `plan` is the content that a price names.
    ///
    /// # Errors
    /// The call is none of this ground.
    pub fn compute(&self, call: &Call, plan: Option<&[u8]>) -> Result<Vec<u8>, CallError> {
        let matrices = |beams: &[BeamDoses]| -> Result<Vec<Setups<'_>>, CallError> {
            Ok(self.beams_of(beams)?.iter().map(|beam| self.doses.beam(*beam)).collect())
        };
        match call {
            Call::Solve { beams, start, tolerance, .. } => {
                let plan = solve_beams(
                    self.goals,
                    &matrices(beams)?,
                    start.as_deref(),
                    *tolerance,
                    NonZeroUsize::MIN,
                );
                Ok(answer::of_plan(&plan.map_err(CallError::of)?))
            }
            Call::Price { base, candidates, .. } => {
                let plan = match base {
                    Some(hash) => {
                        let bytes = plan.ok_or(CallError::NoPlan(*hash))?;
                        Some(answer::plan(bytes, None, self.goals.voxels().len()).map_err(CallError::of)?)
                    }
                    None => None,
                };
                let prices = price_beams(self.goals, plan.as_ref(), &matrices(candidates)?);
                Ok(answer::of_prices(&prices.map_err(CallError::of)?))
            }
            Call::Dose { .. } | Call::Game { .. } => Err(CallError::NotOfSearch(call.kind())),
        }
    }

    fn of(&self, beams: &[u16]) -> Vec<BeamDoses> {
        let names = |beam: &u16| self.names.beams.get(usize::from(*beam)).cloned().unwrap_or_default();
        beams.iter().map(names).collect()
    }

    fn beams_of(&self, doses: &[BeamDoses]) -> Result<Vec<u16>, CallError> {
        let beam = |of_beam: &BeamDoses| {
            let place = of_beam.first().and_then(|first| self.names.places.get(first));
            place.map(|(beam, _)| *beam).ok_or(CallError::NoDose)
        };
        doses.iter().map(beam).collect()
    }

    fn columns(&self, beams: &[u16]) -> Vec<usize> {
        beams.iter().map(|beam| self.doses.beam(*beam).columns()).collect()
    }
}
