//! The dissertation's games over beams (5.2, 5.3), in costs normalised to [0, 1).

use super::super::evaluator::{Evaluator, Influence};
use super::super::greedy::leaves_room;
use super::super::method::ChoiceError;
use super::super::prior::{Prior, Uniform, checked_scores, set_of_prior};
use super::super::ring::BeamSet;
use super::formulas::softmax;
use super::game::{Game, GameTree, Player};

/// Exploration.
const C: f64 = 1.25;
/// Visits without a solve after which a game ends: what it visits is known.
const IDLE: usize = 2_000;

/// A game over beams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BeamGame {
    /// Beams are added one by one until the set is full: one player.
    Construction,
    /// So many exchanges of a beam, by two players in turn: the first wants a low cost, the second a high one.
    Alternating {
        /// Exchanges.
        depth: usize,
    },
}

struct Beams<'g, 'a, I: Influence + ?Sized> {
    kind: BeamGame,
    evaluator: &'g mut Evaluator<'a, I>,
    prior: &'g dyn Prior,
    start: Vec<u16>,
    /// The cost that counts as one half.
    reference: f64,
}

/// Beams and how many moves led to them.
type Place = (Vec<u16>, usize);

impl<I: Influence + ?Sized> Beams<'_, '_, I> {
    /// For each move the beam that leaves, if one does, and the beam that comes.
    fn all_moves(&self, (beams, made): &Place) -> Vec<(Option<usize>, u16)> {
        let (ring, requested) = (self.evaluator.ring(), self.evaluator.beams());
        match self.kind {
            BeamGame::Construction if beams.len() < requested => {
                let room = |beam: &u16| leaves_room(ring, &[&beams[..], &[*beam]].concat(), requested);
                ring.legal(beams).into_iter().filter(room).map(|beam| (None, beam)).collect()
            }
            BeamGame::Alternating { depth } if *made < depth => {
                let mut moves = Vec::new();
                for slot in 0..beams.len() {
                    let mut others = beams.clone();
                    let left = others.remove(slot);
                    let legal = ring.legal(&others).into_iter().filter(|beam| *beam != left);
                    moves.extend(legal.map(|beam| (Some(slot), beam)));
                }
                moves
            }
            _ => Vec::new(),
        }
    }

    fn set(&self, beams: &[u16]) -> Result<BeamSet, ChoiceError> {
        Ok(self.evaluator.ring().set(beams)?)
    }
}

impl<I: Influence + ?Sized> Game for Beams<'_, '_, I> {
    type Place = Place;
    type Error = ChoiceError;

    fn root(&self) -> Place {
        (self.start.clone(), 0)
    }

    fn player(&self, (_, made): &Place) -> Player {
        match self.kind {
            BeamGame::Alternating { .. } if made % 2 == 1 => Player::Maximiser,
            _ => Player::Minimiser,
        }
    }

    fn moves(&self, place: &Place) -> usize {
        self.all_moves(place).len()
    }

    fn after(&self, place: &Place, action: usize) -> Place {
        let (slot, beam) = self.all_moves(place)[action];
        let mut beams = place.0.clone();
        slot.map(|slot| beams.remove(slot));
        beams.push(beam);
        beams.sort_unstable();
        (beams, place.1 + 1)
    }

    fn priors(&mut self, place: &Place) -> Result<Vec<f64>, ChoiceError> {
        let ring = self.evaluator.ring();
        let mut scores = Vec::new();
        let moves = self.all_moves(place);
        for of_slot in moves.chunk_by(|a, b| a.0 == b.0) {
            let mut retained = place.0.clone();
            of_slot[0].0.map(|slot| retained.remove(slot));
            let candidates: Vec<u16> = of_slot.iter().map(|(_, beam)| *beam).collect();
            scores.extend(checked_scores(self.prior, ring, &retained, &candidates)?);
        }
        Ok(softmax(&scores))
    }

    /// Of a full set by a solve; of a set that is not full yet, one half.
    fn cost(&mut self, (beams, _): &Place) -> Result<f64, ChoiceError> {
        if beams.len() < self.evaluator.beams() {
            return Ok(0.5);
        }
        let solved = self.evaluator.evaluate(&self.set(beams)?, None)?;
        Ok(solved.cost / (solved.cost + self.reference))
    }
}

/// Plays a game until the budget is spent, or what it visits is known. Every set that is solved counts.
pub fn play<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    kind: BeamGame,
    prior: Option<&dyn Prior>,
) -> Result<(), ChoiceError> {
    let prior = prior.unwrap_or(&Uniform);
    let first = set_of_prior(prior, evaluator.ring(), evaluator.beams())?;
    let solved = evaluator.evaluate(&first, None)?;
    let start = if kind == BeamGame::Construction { Vec::new() } else { first.beams().to_vec() };
    let reference = solved.cost.max(f64::MIN_POSITIVE);
    let mut tree = GameTree::new(Beams { kind, evaluator, prior, start, reference }, C, 0.5)?;
    let (mut idle, mut solves) = (0, tree.game().evaluator.solves());
    while idle < IDLE {
        tree.visit()?;
        let now = tree.game().evaluator.solves();
        idle = if now == solves { idle + 1 } else { 0 };
        solves = now;
    }
    Ok(())
}
