//! Where games are played: in this process, or elsewhere, with finished games kept in a folder.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use stillpoint_network::game::play;
use stillpoint_network::{Due, Game, Model};

use super::plan;
use crate::TrainError;

pub trait Players {
    /// Plays these games with these weights (none: openings). `done` gets each with its place, in the order in which they
    /// end; and again, where the first one turned out to be in doubt.
    ///
    /// # Errors
    /// A game cannot be played, its players failed again and again, games that were played before are in doubt, or `done`
    /// failed.
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError>;
}

/// Gets a game that has ended, with its place among those that were due.
pub type Done<'a> = &'a mut dyn FnMut(usize, Game) -> Result<(), TrainError>;

/// This process plays, on so many threads for each game.
pub struct Here(pub NonZeroUsize);

impl Players for Here {
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError> {
        for (place, due) in due.iter().enumerate() {
            let game =
                play(network, &due.patient, due.seed, due.rules, self.0).map_err(|e| not_played(due, e))?;
            done(place, game)?;
        }
        Ok(())
    }
}

/// Games in a folder: those that were played before are read, the others are played and kept there.
pub struct Stored<'a> {
    folder: PathBuf,
    players: &'a mut dyn Players,
}

impl<'a> Stored<'a> {
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

impl Players for Stored<'_> {
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError> {
        let hash = network.map(Model::hash).transpose().map_err(plan)?;
        let (mut missing, mut places) = (Vec::new(), Vec::new());
        for (place, due) in due.iter().enumerate() {
            match read(&self.folder, due, hash.as_deref()) {
                Some(game) => done(place, game)?,
                None => {
                    missing.push(due.clone());
                    places.push(place);
                }
            }
        }
        let folder = &self.folder;
        self.players.play(network, &missing, &mut |place, game| {
            keep(folder, &missing[place], &game)?;
            done(places[place], game)
        })
    }
}

/// File of a game.
pub(super) fn file(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.json"))
}

/// The game, if it is in the folder and was played with these weights.
fn read(folder: &Path, due: &Due, network: Option<&str>) -> Option<Game> {
    let game = Game::from_bytes(&std::fs::read(file(folder, &due.name)).ok()?).ok()?;
    game.is_of(due, network).then_some(game)
}

/// Writes the game under another name, and then renames it: a file is whole, or not there.
fn keep(folder: &Path, due: &Due, game: &Game) -> Result<(), TrainError> {
    let path = file(folder, &due.name);
    let part = path.with_extension("part");
    let bytes = game.to_bytes().map_err(|e| not_played(due, e))?;
    std::fs::write(&part, bytes)
        .and_then(|()| std::fs::rename(&part, &path))
        .map_err(|e| TrainError::File { path, why: e.to_string() })
}

/// Why a game is not played.
pub fn not_played(due: &Due, why: impl std::fmt::Display) -> TrainError {
    TrainError::Plan(format!("{}, {}: {why}", due.name, due.patient.name()))
}
