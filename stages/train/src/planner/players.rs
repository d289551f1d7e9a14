//! Where games are played: in this process, or elsewhere, with finished games kept in a folder.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use stillpoint_network::game::play;
use stillpoint_network::{Game, Model, Patient, Rules};

use super::plan;
use crate::TrainError;

/// A game that is to be played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Due {
    /// Its name, which is that of its file.
    pub name: String,
    /// Whose beams are chosen.
    pub patient: Patient,
    /// The seed.
    pub seed: u64,
    /// The rules.
    pub rules: Rules,
}

/// Who plays games.
pub trait Players {
    /// Plays these games with these weights (none: openings). `done` gets each with its place, in the order in which they
    /// end.
    ///
    /// # Errors
    /// A game cannot be played, its players failed again and again, or `done` failed.
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError>;
}

/// Gets a game that has ended, with its place among those that were due.
pub type Done<'a> = &'a mut dyn FnMut(usize, Game) -> Result<(), TrainError>;

/// This process plays, on so many threads for each game.
pub struct Here(pub NonZeroUsize);

impl Players for Here {
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError> {
        for (place, due) in due.iter().enumerate() {
            let game = play(network, &due.patient, due.seed, due.rules, self.0).map_err(|e| due.fault(e))?;
            done(place, game)?;
        }
        Ok(())
    }
}

/// Games in a folder: those that were played before are read, the others are played and kept there.
pub struct Kept<'a> {
    folder: PathBuf,
    players: &'a mut dyn Players,
}

impl<'a> Kept<'a> {
    /// In this folder, which is made.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn new(folder: &Path, players: &'a mut dyn Players) -> Result<Self, TrainError> {
        let fault = |e: std::io::Error| TrainError::File { path: folder.to_owned(), why: e.to_string() };
        std::fs::create_dir_all(folder).map_err(fault)?;
        Ok(Self { folder: folder.to_owned(), players })
    }
}

impl Players for Kept<'_> {
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError> {
        let hash = network.map(Model::hash).transpose().map_err(plan)?;
        let (mut missing, mut places) = (Vec::new(), Vec::new());
        for (place, due) in due.iter().enumerate() {
            match due.read(&self.folder, hash.as_deref()) {
                Some(game) => done(place, game)?,
                None => {
                    missing.push(due.clone());
                    places.push(place);
                }
            }
        }
        let folder = &self.folder;
        self.players.play(network, &missing, &mut |place, game| {
            missing[place].keep(folder, &game)?;
            done(places[place], game)
        })
    }
}

impl Due {
    fn path(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}.json", self.name))
    }

    /// The game, if it is in the folder and was played with these weights.
    fn read(&self, folder: &Path, network: Option<&str>) -> Option<Game> {
        let game = Game::from_bytes(&std::fs::read(self.path(folder)).ok()?).ok()?;
        let same = (&game.patient, game.seed, game.rules) == (&self.patient, self.seed, self.rules);
        (same && game.network.as_deref() == network).then_some(game)
    }

    /// Writes the game under another name, and then renames it: a file is whole, or not there.
    fn keep(&self, folder: &Path, game: &Game) -> Result<(), TrainError> {
        let path = self.path(folder);
        let part = path.with_extension("part");
        let bytes = game.to_bytes().map_err(|e| self.fault(e))?;
        std::fs::write(&part, bytes)
            .and_then(|()| std::fs::rename(&part, &path))
            .map_err(|e| TrainError::File { path, why: e.to_string() })
    }

    /// Why it is not played.
    pub fn fault(&self, why: impl std::fmt::Display) -> TrainError {
        TrainError::Plan(format!("{}, {}: {why}", self.name, self.patient.name()))
    }
}
