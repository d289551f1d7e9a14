//! Which saddles are the corners of one board, in the order of its axes.
//!
//! From one corner, the lattice grows from neighbour to neighbour. The bright sectors of neighbours are on opposite sides of the
//! edge between them, so each step looks for a saddle of the other sense near to where the step before leads.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{Matrix2, Vector2};

use super::picture::Picture;
use super::refine::refine;
use super::saddle::{Saddle, saddles, sectors};
use super::target::Board;

/// Standard deviations of the smoothing that are tried, px.
const SIGMAS: [f64; 4] = [1.0, 1.6, 2.6, 4.0];
/// Smoothing before a corner is refined, px.
const FINE: f64 = 0.7;
/// Corners that a lattice starts from at most.
const STARTS: usize = 25;
/// Farthest of a corner from where it is looked for, in sides of a square.
const NEAR: f64 = 0.3;
/// Saddles around a corner that are tried as its neighbours.
const AROUND: usize = 24;
/// Least share of the corners of a board that a lattice has.
const LEAST: f64 = 0.6;
/// Fewest corners of a lattice that is another board.
const BOARD: usize = 24;
/// Least contrast of an edge between neighbours, in that of a corner.
const EDGE: f64 = 0.25;

/// What is found of a board.
pub(super) enum Search {
    /// All corners in the board's order, px, and the shortest side of a square.
    Whole { corners: Vec<Vector2<f64>>, shortest: f64 },
    /// Corners within the board are missing, and where the first one should be.
    Holes { missing: usize, near: Vector2<f64> },
    /// Corners along both sides of another board, and how many there are.
    Other { counts: [usize; 2], found: usize },
    /// So many corners that are those of no board.
    Piece { found: usize },
}

/// Looks for a board.
pub(super) fn search(picture: &Picture, board: &Board) -> Search {
    let mut best = Search::Piece { found: 0 };
    for sigma in SIGMAS {
        let smooth = picture.smooth(sigma);
        let all = saddles(&smooth, sigma, board.along * board.across);
        let mut is_used = vec![false; all.len()];
        let mut starts = 0;
        for start in 0..all.len() {
            if is_used[start] || starts == STARTS {
                continue;
            }
            starts += 1;
            let Some(lattice) = Lattice::grow(&smooth, &all, start) else { continue };
            lattice.nodes.values().for_each(|node| is_used[node.saddle] = true);
            let found = lattice.judged(picture, &smooth, sigma, board);
            if matches!(found, Search::Whole { .. }) {
                return found;
            }
            if rank(&found) > rank(&best) {
                best = found;
            }
        }
    }
    best
}

/// A board with holes is nearer to a whole one than another board.
fn rank(search: &Search) -> (u8, usize) {
    match search {
        Search::Whole { .. } => (3, 0),
        Search::Holes { missing, .. } => (2, usize::MAX - missing),
        Search::Other { found, .. } => (1, *found),
        Search::Piece { found } => (0, *found),
    }
}

/// A corner of a lattice.
#[derive(Clone, Copy)]
struct Node {
    saddle: usize,
    at: Vector2<f64>,
    sides: [Vector2<f64>; 2],
}

/// Corners by their places along two sides.
struct Lattice {
    nodes: BTreeMap<[i32; 2], Node>,
    /// 1 where the sectors between the two sides are bright at an even place, -1 where they are dark.
    sense: f64,
}

/// 1 if the bright sectors are between the two sides, -1 if they are next to them.
fn sense(saddle: &Saddle, sides: &[Vector2<f64>; 2]) -> f64 {
    let parts = Matrix2::from_columns(sides).try_inverse().map_or(Vector2::zeros(), |of| of * saddle.bright);
    (parts.x * parts.y).signum()
}

impl Lattice {
    fn grow(smooth: &Picture, all: &[Saddle], start: usize) -> Option<Self> {
        let sides = sides_at(smooth, all, start)?;
        let own = sense(&all[start], &sides);
        let first = Node { saddle: start, at: all[start].at, sides };
        let mut nodes = BTreeMap::from([([0, 0], first)]);
        let mut is_taken = vec![false; all.len()];
        is_taken[start] = true;
        let mut open = VecDeque::from([[0, 0]]);
        while let Some(place) = open.pop_front() {
            let node = nodes[&place];
            for (side, by) in [(0, 1), (0, -1), (1, 1), (1, -1)] {
                let mut next = place;
                next[side] += by;
                if nodes.contains_key(&next) {
                    continue;
                }
                let expected = if (next[0] + next[1]) % 2 == 0 { own } else { -own };
                let step = f64::from(by) * node.sides[side];
                let Some(saddle) = nearest(all, &is_taken, node.at + step, &node.sides, expected) else {
                    continue;
                };
                if !is_edge(smooth, &all[node.saddle], &(all[saddle].at - node.at)) {
                    continue;
                }
                is_taken[saddle] = true;
                let mut sides = node.sides;
                sides[side] = f64::from(by) * (all[saddle].at - node.at);
                nodes.insert(next, Node { saddle, at: all[saddle].at, sides });
                open.push_back(next);
            }
        }
        Some(Self { nodes, sense: own })
    }

    /// Least and greatest places along both sides, without rows that are mostly empty.
    fn bounds(&self) -> [[i32; 2]; 2] {
        let mut bounds = [0, 1].map(|side| {
            let places = || self.nodes.keys().map(|place| place[side]);
            [places().min().unwrap_or(0), places().max().unwrap_or(0)]
        });
        loop {
            let before = bounds;
            for side in 0..2 {
                let other = bounds[1 - side];
                for end in 0..2 {
                    let row = bounds[side][end];
                    let is_in = |place: &&[i32; 2]| {
                        place[side] == row && (other[0]..=other[1]).contains(&place[1 - side])
                    };
                    let count = self.nodes.keys().filter(is_in).count() as i32;
                    if 2 * count <= other[1] - other[0] && bounds[side][0] < bounds[side][1] {
                        bounds[side][end] += if end == 0 { 1 } else { -1 };
                    }
                }
            }
            if bounds == before {
                return bounds;
            }
        }
    }

    fn judged(&self, picture: &Picture, smooth: &Picture, sigma: f64, board: &Board) -> Search {
        let bounds = self.bounds();
        let counts = bounds.map(|[least, most]| (most - least + 1) as usize);
        let is_in =
            |place: &&[i32; 2]| (0..2).all(|side| (bounds[side][0]..=bounds[side][1]).contains(&place[side]));
        let found = self.nodes.keys().filter(is_in).count();
        if counts.contains(&1)
            || counts.contains(&2)
            || (found as f64) < LEAST * (counts[0] * counts[1]) as f64
        {
            return Search::Piece { found: self.nodes.len() };
        }
        let along = match (counts == [board.along, board.across], counts == [board.across, board.along]) {
            (true, _) => 0,
            (_, true) => 1,
            // Noise has lattices of a few saddles.
            _ if found < BOARD => return Search::Piece { found },
            _ => return Search::Other { counts, found },
        };
        // The corner at places along `a` and `b` from one of the four outermost ones.
        let place = |a: usize, b: usize| {
            let mut place = [0; 2];
            place[along] = bounds[along][0] + a as i32;
            place[1 - along] = bounds[1 - along][0] + b as i32;
            place
        };
        let mut corners = Vec::new();
        let mut missing: Vec<Vector2<f64>> = Vec::new();
        let fine = picture.smooth(FINE);
        let mut shortest = f64::INFINITY;
        for a in 0..board.along {
            for b in 0..board.across {
                let Some((at, sides)) = self.start(place(a, b)) else { continue };
                let is_corner =
                    self.nodes.contains_key(&place(a, b)) || sectors(smooth, at, 2.5 * sigma).is_some();
                match refine(&fine, at, sides).filter(|_| is_corner) {
                    Some(corner) => corners.push(corner),
                    None => missing.push(at),
                }
                shortest = sides.iter().map(|side| side.norm()).fold(shortest, f64::min);
            }
        }
        let all = board.along * board.across;
        // Noise has saddles, too, but few of them are corners.
        if (corners.len() as f64) < LEAST * all as f64 {
            return Search::Piece { found: corners.len() };
        }
        if let Some(near) = missing.first() {
            return Search::Holes { missing: missing.len(), near: *near };
        }
        if corners.len() < all {
            return Search::Piece { found: corners.len() };
        }
        let first = place(0, 0);
        let is_odd = (first[0] + first[1]).rem_euclid(2) == 1;
        let is_bright = (self.sense > 0.0) != is_odd;
        Search::Whole { corners: ordered(&corners, board, is_bright), shortest }
    }

    /// Where a corner is or should be, and the sides of a square there.
    fn start(&self, place: [i32; 2]) -> Option<(Vector2<f64>, [Vector2<f64>; 2])> {
        if let Some(node) = self.nodes.get(&place) {
            return Some((node.at, node.sides));
        }
        // From the nearest corner that is known, by its sides.
        let (near, node) = self
            .nodes
            .iter()
            .min_by_key(|(other, _)| (other[0] - place[0]).pow(2) + (other[1] - place[1]).pow(2))?;
        let [first, second] = [0, 1].map(|side| f64::from(place[side] - near[side]) * node.sides[side]);
        Some((node.at + first + second, node.sides))
    }
}

/// The nearest saddle to a place of a sense, within part of a square.
fn nearest(
    all: &[Saddle],
    is_taken: &[bool],
    at: Vector2<f64>,
    sides: &[Vector2<f64>; 2],
    expected: f64,
) -> Option<usize> {
    let squares = Matrix2::from_columns(sides).try_inverse()?;
    let reach = NEAR * (sides[0].norm() + sides[1].norm());
    let off = |number: usize| {
        let off = all[number].at - at;
        if off.norm_squared() > reach * reach { f64::INFINITY } else { (squares * off).amax() }
    };
    (0..all.len())
        .map(|number| (off(number), number))
        .filter(|(off, number)| *off < NEAR && !is_taken[*number] && sense(&all[*number], sides) == expected)
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, number)| number)
}

/// The two sides of a square at a corner: the steps to the nearest corners of the other sense, along edges.
fn sides_at(smooth: &Picture, all: &[Saddle], start: usize) -> Option<[Vector2<f64>; 2]> {
    let own = &all[start];
    let mut near: Vec<(f64, Vector2<f64>)> = all
        .iter()
        .filter(|other| other.bright.dot(&own.bright).abs() < std::f64::consts::FRAC_1_SQRT_2)
        .map(|other| other.at - own.at)
        .map(|step| (step.norm(), step))
        .filter(|(length, _)| *length > 2.0)
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut edges = near.iter().take(AROUND).filter(|(_, step)| is_edge(smooth, own, step));
    let (_, first) = *edges.next()?;
    let is_across =
        |(length, step): &&(f64, Vector2<f64>)| first.perp(step).abs() > 0.5 * length * first.norm();
    edges.find(is_across).map(|(_, second)| [first, *second])
}

/// Whether a step from a corner follows an edge: its two sides differ, and in the same sense in both of its halves.
fn is_edge(smooth: &Picture, own: &Saddle, step: &Vector2<f64>) -> bool {
    let across = 0.2 * Vector2::new(-step.y, step.x);
    let differs = |part: f64| {
        let at = own.at + part * step;
        smooth.sample(at + across) - smooth.sample(at - across)
    };
    let [first, second] = [0.3, 0.7].map(differs);
    first * second > 0.0 && first.abs().min(second.abs()) > EDGE * own.contrast
}

/// Corners in the order of the board: the black end first, and seen from above.
fn ordered(corners: &[Vector2<f64>], board: &Board, is_first_bright: bool) -> Vec<Vector2<f64>> {
    let at = |a: usize, b: usize| corners[a * board.across + b];
    // The outermost squares of an end have the colour of the sectors between the sides of its corner.
    let a_is_back = is_first_bright;
    let side_a = at(1, 0) - at(0, 0);
    let side_b = at(0, 1) - at(0, 0);
    // Rows of an image run down, so `b` to the left of `a` as seen from above is a negative turn.
    let b_is_back = (side_a.perp(&side_b) > 0.0) != a_is_back;
    let turned = |count: usize, place: usize, is_back: bool| if is_back { count - 1 - place } else { place };
    (0..board.along)
        .flat_map(|a| (0..board.across).map(move |b| (a, b)))
        .map(|(a, b)| at(turned(board.along, a, a_is_back), turned(board.across, b, b_is_back)))
        .collect()
}
