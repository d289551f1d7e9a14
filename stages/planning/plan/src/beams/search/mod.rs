//! Tree search over sets of beams (ch. 5.2, as SCIENCE G1-G6 corrects it).
//!
//! - `formulas`: (5.5)-(5.8): bounds, policy, noise
//! - `retained`: what a beam is expected to bring beside those that stay
//! - `tree`: PUCT over exchanges, the default
//! - `game`: tree search of games with costs (algorithm 1); `beam_games`: construction beam by beam, and two players
//! - `matrix`: matrix games, which no search needs: the tests compare them with the reference vectors

mod beam_games;
mod formulas;
mod game;
#[cfg(test)]
mod matrix;
mod retained;
#[cfg(test)]
mod tests;
mod tree;

pub use beam_games::BeamGame;
pub use formulas::{dirichlet, puct, softmax};
pub use game::{Game, GameTree, Player};

pub(super) use beam_games::play;

use std::sync::Arc;

use super::evaluator::{Evaluated, Evaluator, Influence};
use super::exchange::some_rotations;
use super::method::ChoiceError;
use super::prior::{Prior, set_of_prior};
use super::ring::BeamSet;
use tree::Tree;

/// How the tree search goes.
#[derive(Clone, Debug, PartialEq)]
pub struct SearchOptions {
    /// Sets to begin with, degrees: the best of them is the first root. Without any, the set that the
    /// prior builds, or some rotations of equal beams where there is no prior.
    pub starts: Vec<Vec<f64>>,
    /// Weight of prices beside the beams that stay among the priors of the moves. Above 0, a set without the beam that
    /// leaves is solved before its replacements are tried.
    pub price: f64,
    /// Weight of the given prior.
    pub prior: f64,
    /// Exploration: the factor of the prior in the bound of a move.
    pub c: f64,
    /// Exchanges below the root that a leaf may be away.
    pub plies: usize,
    /// Part of Dirichlet noise in the priors at the root.
    pub noise: f64,
    /// Solves without a gain after which the search begins elsewhere.
    pub patience: usize,
    /// It also begins elsewhere if every move is expected to lose this much, in twentieths of the root's cost.
    pub give_up: f64,
    /// Beams of the best set that are drawn anew for a new beginning; 0 for a random set.
    pub kick: usize,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            starts: Vec::new(),
            price: 1.0,
            prior: 0.0,
            c: 0.5,
            plies: 1,
            noise: 0.0,
            patience: 20,
            give_up: 0.3,
            kick: 2,
        }
    }
}

/// Searches by the options, from `starts` or from the set that the prior builds, until the budget is spent, with as many
/// leaves under way as the evaluator allows.
pub fn search<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    options: &SearchOptions,
    starts: &[BeamSet],
    prior: Option<&dyn Prior>,
    seed: u64,
) -> Result<(), ChoiceError> {
    let first = match (starts, prior) {
        ([], Some(prior)) => vec![set_of_prior(prior, evaluator.ring(), evaluator.beams())?],
        ([], None) => some_rotations(evaluator)?,
        (starts, _) => starts.to_vec(),
    };
    let solved = evaluator.evaluate_all(&first, None)?;
    let Some(start) = best_of(solved) else { return Ok(()) };
    Tree::new(evaluator, options, prior, seed, start).run()
}

fn best_of(solved: Vec<Arc<Evaluated>>) -> Option<Arc<Evaluated>> {
    solved.into_iter().reduce(|a, b| if b.cost < a.cost { b } else { a })
}
