//! The tree over exchanges: PUCT with the best value backed up, on a root that follows the best set.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use chacha20::ChaCha8Rng;
use rand::RngExt as _;

use super::super::evaluator::{Evaluated, Evaluator, Influence, Stop};
use super::super::method::ChoiceError;
use super::super::prior::{Prior, checked_scores, standardised};
use super::super::random;
use super::super::ring::{BeamSet, Ring};
use super::SearchOptions;
use super::formulas::{dirichlet, puct, softmax};
use super::retained::Retained;

/// A part of the root's cost that counts as 1 in utilities.
const UNIT: f64 = 0.05;
/// How much more likely the lightest beam is exchanged: its weight in standard deviations is multiplied by this.
const BURDEN: f64 = 1.0;
/// The random numbers of the root's noise and of restarts.
const NOISE: u64 = 4;
const KICK: u64 = 5;
/// Draws without a new set after which the search ends.
const PATIENCE: u64 = 10_000;

/// Visits of a set and of its exchanges.
#[derive(Clone, Debug, Default)]
pub struct Node {
    visits: u32,
    /// By the set after the exchange.
    edges: BTreeMap<BeamSet, Edge>,
}

/// Visits of an exchange, and the least cost found below it.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    visits: u32,
    best: f64,
}

/// A set that is under way.
#[derive(Clone, Debug, PartialEq)]
struct Leaf {
    /// The sets from the root down to the one whose exchange this is; none for a new beginning.
    path: Vec<BeamSet>,
    /// The set that is solved: after an exchange, or without the beam that leaves.
    set: BeamSet,
    /// Utility that was expected.
    expected: f64,
    /// New beginnings before it was chosen.
    beginning: u64,
    /// Whether the search goes on from it, whatever it costs.
    is_root: bool,
}

/// What is done next.
enum Chosen {
    /// A leaf is begun.
    Leaf(Leaf),
    /// No leaf is worth it before more results are in.
    Later,
    /// Hardly any set is new.
    Nothing,
}

/// The search.
pub struct Tree<'t, 'a, I: Influence + ?Sized> {
    evaluator: &'t mut Evaluator<'a, I>,
    options: &'t SearchOptions,
    prior: Option<&'t dyn Prior>,
    seed: u64,
    retained: BTreeMap<BeamSet, Retained>,
    nodes: BTreeMap<BeamSet, Node>,
    now: Arc<Evaluated>,
    noise: BTreeMap<BeamSet, Vec<f64>>,
    /// Draws of new beginnings.
    restarts: u64,
    /// Leaves that are under way, in the order in which they were chosen.
    pending: VecDeque<Leaf>,
    /// New beginnings until now.
    beginning: u64,
    /// Solves since the last gain or beginning.
    since_gain: usize,
}

impl<'t, 'a, I: Influence + ?Sized> Tree<'t, 'a, I> {
    /// On a solved set.
    pub fn new(
        evaluator: &'t mut Evaluator<'a, I>,
        options: &'t SearchOptions,
        prior: Option<&'t dyn Prior>,
        seed: u64,
        start: Arc<Evaluated>,
    ) -> Self {
        Self {
            evaluator,
            options,
            prior,
            seed,
            retained: BTreeMap::new(),
            nodes: BTreeMap::new(),
            now: start,
            noise: BTreeMap::new(),
            restarts: 0,
            pending: VecDeque::new(),
            beginning: 0,
            since_gain: 0,
        }
    }

    /// Searches until the budget is spent or hardly any set is new.
    ///
    /// Each leaf is chosen when all results but those of the leaves under way are in.
    pub fn run(&mut self) -> Result<(), ChoiceError> {
        loop {
            let mut ended = None;
            while ended.is_none() && self.evaluator.has_room() {
                match self.choose()? {
                    Chosen::Leaf(leaf) => {
                        let near = (!leaf.is_root).then(|| Arc::clone(&self.now));
                        match self.evaluator.begin(std::slice::from_ref(&leaf.set), near.as_ref())? {
                            true => self.pending.push_back(leaf),
                            false => ended = Some(Err(Stop::Spent.into())),
                        }
                    }
                    Chosen::Later => break,
                    Chosen::Nothing => ended = Some(Ok(())),
                }
            }
            match ended {
                // Nothing can be begun any more, and what was begun counts.
                Some(ended) => {
                    while self.take()? {}
                    return ended;
                }
                None => drop(self.take()?),
            }
        }
    }

    /// The next leaf, chosen as if those under way had been visited in vain; a new beginning where no leaf is worth it.
    fn choose(&mut self) -> Result<Chosen, ChoiceError> {
        let leaf = self.descend()?;
        let is_tired = self.since_gain >= self.options.patience;
        let begins = self.pending.iter().any(|leaf| leaf.is_root);
        match leaf {
            Some(leaf) if leaf.expected >= -self.options.give_up && (begins || !is_tired) => {
                Ok(Chosen::Leaf(leaf))
            }
            // What is under way opens more leaves.
            None if !self.pending.is_empty() => Ok(Chosen::Later),
            _ if begins => Ok(Chosen::Later),
            _ => Ok(self.restart().map_or(Chosen::Nothing, Chosen::Leaf)),
        }
    }

    /// Takes the leaf that was chosen first. Gives whether there is one.
    fn take(&mut self) -> Result<bool, ChoiceError> {
        let (Some(leaf), Some(solved)) = (self.pending.pop_front(), self.evaluator.take_next()?) else {
            return Ok(false);
        };
        for solved in solved {
            if leaf.is_root {
                (self.now, self.since_gain) = (solved, 0);
                self.beginning += 1;
                continue;
            }
            // A leaf of an earlier beginning is worth going back for if it is the best of all.
            let is_of_now = leaf.beginning == self.beginning;
            self.since_gain += usize::from(is_of_now);
            if solved.beams.beams().len() < self.evaluator.beams() {
                continue;
            }
            self.back_up(&leaf, solved.cost);
            let is_best = self.evaluator.best().is_some_and(|best| best.beams == solved.beams);
            if solved.cost < self.now.cost && (is_of_now || is_best) {
                (self.now, self.since_gain) = (solved, 0);
                self.pending.iter_mut().for_each(|leaf| leaf.is_root = false);
            }
        }
        Ok(true)
    }

    fn descend(&mut self) -> Result<Option<Leaf>, ChoiceError> {
        let mut path = vec![self.now.beams.clone()];
        loop {
            let at = path[path.len() - 1].clone();
            let Some((set, expected)) = self.select(&at, &path)? else { return Ok(None) };
            if !self.evaluator.knows(&set) {
                return Ok(Some(Leaf { path, set, expected, beginning: self.beginning, is_root: false }));
            }
            path.push(set);
        }
    }

    /// The exchange of the highest bound at a set, or the set without a beam if that must be solved first.
    fn select(&mut self, at: &BeamSet, path: &[BeamSet]) -> Result<Option<(BeamSet, f64)>, ChoiceError> {
        let here = self.evaluator.evaluate(at, None)?;
        let slots = slot_probability(&here);
        let visits = self.nodes.get(at).map_or(0, |node| node.visits) + self.pending.len() as u32;
        let deepest = path.len() >= self.options.plies;
        let ring = self.evaluator.ring();
        let mut best: Option<(f64, BeamSet, f64)> = None;
        let mut offer = |score: f64, set: BeamSet, expected: f64| {
            if best.as_ref().is_none_or(|(top, ..)| score > *top) {
                best = Some((score, set, expected));
            }
        };
        for (slot, slot_probability) in slots.iter().enumerate() {
            let mut others = at.beams().to_vec();
            let left = others.remove(slot);
            let stay = ring.set(&others)?;
            if !self.ready(&stay)? {
                if !self.evaluator.is_in_progress(&stay) {
                    // A slot that is not open yet promises what is open at best, no gain otherwise.
                    let q = self.utility(here.cost);
                    offer(puct(q, *slot_probability, 0, visits + 1, self.options.c), stay, 0.0_f64.max(q));
                }
                continue;
            }
            let Some(retained) = self.retained.get(&stay) else { continue };
            let sets: Vec<BeamSet> = retained
                .candidates
                .iter()
                .map(|beam| ring.set(&[&others[..], &[*beam]].concat()))
                .collect::<Result<_, _>>()?;
            let mut costs: Vec<Option<f64>> = Vec::new();
            for set in &sets {
                let known = self.evaluator.knows(set);
                costs.push(if known { Some(self.evaluator.evaluate(set, None)?.cost) } else { None });
            }
            let solved: Vec<(usize, f64)> =
                costs.iter().enumerate().filter_map(|(i, cost)| Some((i, (*cost)?))).collect();
            let expected = retained.expected(ring, &solved);
            let noise = (path.len() == 1).then(|| self.noise.get(&stay)).flatten();
            for (i, set) in sets.into_iter().enumerate() {
                let beam = retained.candidates[i];
                if beam == left || path.contains(&set) || self.evaluator.is_in_progress(&set) {
                    continue;
                }
                if costs[i].is_some() && deepest {
                    continue;
                }
                let edge = self.nodes.get(at).and_then(|node| node.edges.get(&set));
                let cost = match (costs[i], &expected) {
                    (Some(cost), _) => edge.map_or(cost, |edge| edge.best.min(cost)),
                    (None, Some(expected)) => expected[i],
                    (None, None) => here.cost,
                };
                let q = self.utility(cost);
                let epsilon = self.options.noise;
                let prior = match noise {
                    Some(noise) => (1.0 - epsilon) * retained.probability[i] + epsilon * noise[i],
                    None => retained.probability[i],
                };
                let n = edge.map_or(0, |edge| edge.visits);
                offer(puct(q, slot_probability * prior, n, visits + 1, self.options.c), set, q);
            }
        }
        Ok(best.map(|(_, set, expected)| (set, expected)))
    }

    /// Whether the candidates beside these beams are known; makes them where that takes no solve.
    fn ready(&mut self, stay: &BeamSet) -> Result<bool, ChoiceError> {
        if self.retained.contains_key(stay) {
            return Ok(true);
        }
        let ring = self.evaluator.ring();
        let candidates = ring.legal(stay.beams());
        let by_price = self.options.price > 0.0;
        // A single beam is priced beside nothing, which is no set to solve.
        let alone = stay.beams().is_empty();
        if by_price && !alone && !self.evaluator.knows(stay) {
            return Ok(false);
        }
        let priced = match (by_price, alone) {
            (false, _) => None,
            (true, true) => {
                let prices = self.evaluator.price(None, &candidates)?;
                Some((f64::INFINITY, prices))
            }
            (true, false) => {
                let solved = self.evaluator.evaluate(stay, None)?;
                Some((solved.cost, self.evaluator.price(Some(&solved), &candidates)?))
            }
        };
        let scores = match self.prior {
            Some(prior) if self.options.prior > 0.0 => {
                Some((self.options.prior, checked_scores(prior, ring, stay.beams(), &candidates)?))
            }
            _ => None,
        };
        if self.options.noise > 0.0 {
            let mut rng = random::draw(self.seed, NOISE, self.retained.len() as u64);
            let alpha = 10.0 / candidates.len().max(1) as f64;
            self.noise.insert(stay.clone(), dirichlet(candidates.len(), alpha, &mut rng));
        }
        self.retained.insert(stay.clone(), Retained::new(candidates, priced, self.options.price, scores));
        Ok(true)
    }

    fn back_up(&mut self, leaf: &Leaf, cost: f64) {
        let below = leaf.path.iter().skip(1).chain(std::iter::once(&leaf.set));
        for (from, to) in leaf.path.iter().zip(below) {
            let node = self.nodes.entry(from.clone()).or_default();
            node.visits += 1;
            let edge = node.edges.entry(to.clone()).or_insert(Edge { visits: 0, best: f64::INFINITY });
            edge.visits += 1;
            edge.best = edge.best.min(cost);
        }
    }

    /// How much better than the root's a cost is.
    fn utility(&self, cost: f64) -> f64 {
        (self.now.cost - cost) / (UNIT * self.now.cost.abs().max(f64::MIN_POSITIVE))
    }

    /// A new beginning: the best set with some beams drawn anew, or a random one. None if hardly any set is new.
    fn restart(&mut self) -> Option<Leaf> {
        let (ring, beams) = (self.evaluator.ring(), self.evaluator.beams());
        for _ in 0..PATIENCE {
            let mut rng = random::draw(self.seed, KICK, self.restarts);
            self.restarts += 1;
            let fresh = random::set(ring, beams, &mut rng).ok()?;
            let best = self.evaluator.best().map(|best| best.beams.clone());
            let set = match best {
                Some(best) if self.options.kick > 0 => {
                    let Some(set) = kicked(ring, &best, &fresh, self.options.kick, &mut rng) else {
                        continue;
                    };
                    set
                }
                _ => fresh,
            };
            if !self.evaluator.knows(&set) && !self.evaluator.is_in_progress(&set) {
                let beginning = self.beginning;
                return Some(Leaf { path: Vec::new(), set, expected: 0.0, beginning, is_root: true });
            }
        }
        None
    }
}

/// `best` with `count` beams, drawn, exchanged for beams of `fresh` where those fit.
fn kicked(
    ring: Ring,
    best: &BeamSet,
    fresh: &BeamSet,
    count: usize,
    rng: &mut ChaCha8Rng,
) -> Option<BeamSet> {
    let mut beams = best.beams().to_vec();
    for _ in 0..count.min(beams.len()) {
        beams.remove(rng.random_range(0..beams.len()));
    }
    for beam in fresh.beams() {
        if beams.len() < best.beams().len() && ring.fits(*beam, &beams) {
            beams.push(*beam);
        }
    }
    (beams.len() == best.beams().len()).then(|| ring.set(&beams).ok()).flatten()
}

/// How likely each slot is exchanged: the lighter its beam, the likelier.
fn slot_probability(set: &Evaluated) -> Vec<f64> {
    let burden = |slot: usize| set.plan.weights[set.starts[slot]..set.starts[slot + 1]].iter().sum::<f64>();
    let burdens: Vec<f64> = (0..set.beams.beams().len()).map(burden).collect();
    softmax(&standardised(&burdens).into_iter().map(|b| -BURDEN * b).collect::<Vec<_>>())
}
