//! The games of a training over the pool.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::Path;

use stillpoint_map::MappedFile;
use stillpoint_network::game::play;
use stillpoint_network::patient::Body;
use stillpoint_network::{Due, Game, Model};

use crate::{Call, CallError, Courier, Hash, Home, Pool};

/// Takes a game, by its place among those that are due. An error ends the games.
pub type Played<'a> = &'a mut dyn FnMut(usize, Game) -> Result<(), CallError>;

/// Plays games on a pool.
pub struct PoolGames {
    threads: NonZeroUsize,
    /// Names of the games that were played, by the keys of their calls.
    played: BTreeMap<Hash, String>,
}

impl PoolGames {
    /// A game that this process plays takes so many threads.
    pub fn new(threads: NonZeroUsize) -> Self {
        Self { threads, played: BTreeMap::new() }
    }

    /// Plays these games. `done` gets each as soon as it has ended, in any order; and once more, if it came from a worker
    /// that gave a wrong answer later.
    ///
    /// It gives the names of games that were played before and are in doubt now, for the same reason.
    ///
    /// # Errors
    /// A game cannot be played, neither there nor here, or `done` failed.
    pub fn play<C: Courier>(
        &mut self,
        pool: &mut Pool<C>,
        network: Option<&Model>,
        due: &[Due],
        done: Played<'_>,
    ) -> Result<Vec<String>, CallError> {
        let round = Round::new(network, due, self.threads)?;
        let mut doubtful = BTreeSet::new();
        let mut left: Vec<usize> = (0..due.len()).collect();
        while !left.is_empty() {
            let calls: Vec<Call> = left.iter().map(|place| round.calls[*place].clone()).collect();
            let keys: Vec<Hash> = calls.iter().map(|call| pool.key(call)).collect();
            pool.call_each(&calls, &Asking { round: &round, places: &left }, |at, answer| {
                done(left[at], Game::from_bytes(answer).map_err(CallError::of)?)
            })?;
            self.played.extend(keys.iter().zip(&left).map(|(key, place)| (*key, due[*place].name.clone())));
            let tainted = pool.take_tainted();
            doubtful.extend(tainted.iter().filter(|key| !keys.contains(key)).copied());
            left = keys.iter().zip(left).filter(|(key, _)| tainted.contains(key)).map(|(_, at)| at).collect();
        }
        Ok(doubtful.iter().filter_map(|key| self.played.remove(key)).collect())
    }
}

/// Games that are due, with the contents that they need.
struct Round<'a> {
    network: Option<&'a Model>,
    due: &'a [Due],
    threads: NonZeroUsize,
    calls: Vec<Call>,
    model_file: Option<(Hash, Vec<u8>)>,
    case_files: BTreeMap<Hash, MappedFile>,
}

impl<'a> Round<'a> {
    fn new(network: Option<&'a Model>, due: &'a [Due], threads: NonZeroUsize) -> Result<Self, CallError> {
        let model_file = network.map(Model::to_safetensors).transpose().map_err(CallError::of)?;
        let model_file = model_file.map(|bytes| (Hash::of(&bytes), bytes));
        let (mut case_files, mut names) = (BTreeMap::new(), BTreeMap::new());
        let mut calls = Vec::new();
        for Due { patient, seed, rules, .. } in due {
            let case = match &patient.body {
                Body::File(path) => match names.get(path) {
                    Some(hash) => Some(*hash),
                    None => {
                        let (hash, file) = case_file(path)?;
                        case_files.insert(hash, file);
                        names.insert(path.clone(), hash);
                        Some(hash)
                    }
                },
                Body::Pelvis(_) | Body::Varied(_) | Body::Neck(_) => None,
            };
            let network = model_file.as_ref().map(|(hash, _)| *hash);
            calls.push(Call::Game { network, case, patient: patient.clone(), seed: *seed, rules: *rules });
        }
        Ok(Self { network, due, threads, calls, model_file, case_files })
    }
}

fn case_file(path: &Path) -> Result<(Hash, MappedFile), CallError> {
    let file = MappedFile::open(path).map_err(|error| CallError::File { path: path.to_owned(), error })?;
    Ok((Hash::of(file.bytes()), file))
}

/// Some games of a round, by their places.
struct Asking<'a> {
    round: &'a Round<'a>,
    places: &'a [usize],
}

impl Home for Asking<'_> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        let model = self.round.model_file.as_ref().filter(|(of, _)| of == hash);
        let model = model.map(|(_, bytes)| bytes.as_slice());
        model.or_else(|| self.round.case_files.get(hash).map(MappedFile::bytes))
    }

    fn check(&self, call: usize, answer: &[u8]) -> Result<(), CallError> {
        let game = Game::from_bytes(answer).map_err(CallError::of)?;
        let network = self.round.model_file.as_ref().map(|(hash, _)| hash.to_string());
        match game.is_of(&self.round.due[self.places[call]], network.as_deref()) {
            true => Ok(()),
            false => Err(CallError::OtherGame),
        }
    }

    fn compute(&self, call: usize) -> Result<Vec<u8>, CallError> {
        let Due { name, patient, seed, rules } = &self.round.due[self.places[call]];
        let game = play(self.round.network, patient, *seed, *rules, self.round.threads);
        game.and_then(|game| game.to_bytes()).map_err(|e| CallError::Game {
            name: name.clone(),
            patient: patient.name(),
            error: e.into(),
        })
    }
}
