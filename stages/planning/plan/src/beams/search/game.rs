//! Tree search of games with costs: algorithm 1 of the dissertation, as SCIENCE G3 and G6 correct it.
//!
//! Values are costs in [0, 1] in the frame of the first player, who minimises; the second maximises. Nothing changes sign
//! on the way up.

use super::formulas::puct;

/// Whose move it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Player {
    /// The first, who wants a low cost.
    Minimiser,
    /// The second, who wants a high cost.
    Maximiser,
}

/// A game with full knowledge whose end has a cost.
pub trait Game {
    /// A place in the game.
    type Place: Clone;
    /// Why a place could not be judged.
    type Error;

    /// Where it begins.
    fn root(&self) -> Self::Place;
    /// Whose move it is.
    fn player(&self, place: &Self::Place) -> Player;
    /// How many moves there are; none at the end.
    fn moves(&self, place: &Self::Place) -> usize;
    /// The place after a move.
    fn after(&self, place: &Self::Place, action: usize) -> Self::Place;
    /// Prior probability of each move.
    fn priors(&mut self, place: &Self::Place) -> Result<Vec<f64>, Self::Error>;
    /// The cost: of an end exactly, of another place by an estimate, asked for once.
    fn cost(&mut self, place: &Self::Place) -> Result<f64, Self::Error>;
}

struct Node<P> {
    place: P,
    player: Player,
    /// Empty until it is expanded, and at ends.
    children: Vec<Child>,
    expanded: bool,
}

struct Child {
    prior: f64,
    visits: u32,
    total: f64,
    node: Option<usize>,
}

/// The tree of a game.
pub struct GameTree<G: Game> {
    game: G,
    nodes: Vec<Node<G::Place>>,
    c: f64,
    first_play: f64,
}

impl<G: Game> GameTree<G> {
    /// With exploration `c`; a move without visits is taken for `first_play`.
    pub fn new(game: G, c: f64, first_play: f64) -> Result<Self, G::Error> {
        let place = game.root();
        let mut tree = Self { game, nodes: Vec::new(), c, first_play };
        tree.add(place);
        tree.expand(0)?;
        Ok(tree)
    }

    /// The game.
    pub fn game(&self) -> &G {
        &self.game
    }

    /// One descent: down by the bound, the cost of what is found there back up.
    pub fn visit(&mut self) -> Result<(), G::Error> {
        let mut path: Vec<(usize, usize)> = Vec::new();
        let mut at = 0;
        while self.nodes[at].expanded && !self.nodes[at].children.is_empty() {
            let action = self.select(at);
            path.push((at, action));
            at = match self.nodes[at].children[action].node {
                Some(node) => node,
                None => {
                    let place = self.game.after(&self.nodes[at].place, action);
                    let node = self.add(place);
                    self.nodes[at].children[action].node = Some(node);
                    node
                }
            };
        }
        let cost = self.game.cost(&self.nodes[at].place)?;
        self.expand(at)?;
        for (node, action) in path {
            let child = &mut self.nodes[node].children[action];
            child.visits += 1;
            child.total += cost;
        }
        Ok(())
    }

    /// Visits of the root's moves.
    #[cfg(test)]
    pub(super) fn root_visits(&self) -> Vec<u32> {
        self.nodes[0].children.iter().map(|child| child.visits).collect()
    }

    fn add(&mut self, place: G::Place) -> usize {
        let player = self.game.player(&place);
        self.nodes.push(Node { place, player, children: Vec::new(), expanded: false });
        self.nodes.len() - 1
    }

    fn expand(&mut self, at: usize) -> Result<(), G::Error> {
        if self.nodes[at].expanded {
            return Ok(());
        }
        self.nodes[at].expanded = true;
        if self.game.moves(&self.nodes[at].place) == 0 {
            return Ok(());
        }
        let priors = self.game.priors(&self.nodes[at].place)?;
        let child = |prior| Child { prior, visits: 0, total: 0.0, node: None };
        self.nodes[at].children = priors.into_iter().map(child).collect();
        Ok(())
    }

    /// The move of the highest bound, the first among equals; by the prior alone where none was visited.
    fn select(&self, at: usize) -> usize {
        let node = &self.nodes[at];
        let all: u32 = node.children.iter().map(|child| child.visits).sum();
        let bound = |child: &Child| {
            if all == 0 {
                return child.prior;
            }
            let cost =
                if child.visits == 0 { self.first_play } else { child.total / f64::from(child.visits) };
            let utility = match node.player {
                Player::Minimiser => -cost,
                Player::Maximiser => cost,
            };
            puct(utility, child.prior, child.visits, all, self.c)
        };
        let mut best = (0, f64::NEG_INFINITY);
        for (action, child) in node.children.iter().enumerate() {
            let bound = bound(child);
            if bound > best.1 {
                best = (action, bound);
            }
        }
        best.0
    }
}
