//! Where a ball of about a head's size is: its centre lies behind the surface, along the normals.
//!
//! Each patch votes for the cells of a coarse grid along its inward normal, from the least radius to the greatest (a
//! Hough transform for balls). The normals of a head meet near its middle; those of a pad, a pillow or a chest run
//! side by side or meet elsewhere. The best cell is then refined to the point nearest to the normals of its voters.

use crate::surface::Patch;
use nalgebra::{Matrix3, Vector3};

/// A ball and the surface that supports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    pub centre: Vector3<f64>,
    /// Mean distance of its surface from the centre, in metres.
    pub radius: f64,
    /// Patches whose normals pass near the centre at the right distance.
    pub voters: usize,
}

/// Width of a cell of the votes as a part of the middle radius.
const CELL: f64 = 0.18;
/// A normal supports a centre if it passes the centre within this fraction of the middle radius.
const NEAR: f64 = 0.4;
/// Balls that are looked for at most.
pub const BALLS: usize = 8;
/// Steps of the refinement at most.
const REFINEMENTS: usize = 6;
/// A step shorter than this is the last one, m.
const STILL: f64 = 1e-5;
/// In middle radii: largest distance of the patches that a refinement uses from its start.
const STRAY: f64 = 1.0;
/// Cells at most: a scene that is wider gets wider cells.
const MAX_CELLS: f64 = 3e5;

/// The search with its buffers; after the first frames of a size it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct BallSearch {
    /// All 0 between two searches.
    votes: Vec<u16>,
    voted: Vec<u32>,
    /// Cells with many votes.
    full: Vec<u32>,
    /// Patches that may speak for a ball around the start of a refinement.
    close: Vec<u32>,
    balls: Vec<Ball>,
}

/// The box of cells that votes fall into.
struct Cells {
    corner: Vector3<f64>,
    side: f64,
    inverse_side: f64,
    counts: [usize; 3],
}

impl Cells {
    fn around(patches: &[Patch], reach: f64, side: f64) -> Self {
        let nothing = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        let (low, high) = patches
            .iter()
            .fold(nothing, |(low, high), patch| (low.inf(&patch.place), high.sup(&patch.place)));
        let corner = low - Vector3::repeat(reach);
        let extent = high - low + Vector3::repeat(2.0 * reach);
        let side = side.max((extent.product() / MAX_CELLS).cbrt());
        // One cell of margin on each side, so that each cell that is voted for has all its neighbours.
        let counts = [0, 1, 2].map(|axis| (extent[axis] / side) as usize + 3);
        Self { corner: corner - Vector3::repeat(side), side, inverse_side: 1.0 / side, counts }
    }

    fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Column, row and layer of a point; of one outside, of the nearest cell.
    fn at(&self, point: &Vector3<f64>) -> [usize; 3] {
        // The cast takes what is below 0 to 0.
        [0, 1, 2].map(|axis| {
            (((point[axis] - self.corner[axis]) * self.inverse_side) as usize).min(self.counts[axis] - 1)
        })
    }

    fn of(&self, point: &Vector3<f64>) -> usize {
        let [x, y, z] = self.at(point);
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    fn middle(&self, cell: usize) -> Vector3<f64> {
        let [nx, ny, _] = self.counts;
        let at = [cell % nx, cell / nx % ny, cell / nx / ny];
        self.corner + Vector3::from_fn(|axis, _| (at[axis] as f64 + 0.5) * self.side)
    }
}

impl BallSearch {
    /// The balls of the last search.
    #[must_use]
    pub fn balls(&self) -> &[Ball] {
        &self.balls
    }

    /// The balls of a radius between the two (metres) that `patches` support, the ball with the most votes first, in
    /// different places: at most [`BALLS`].
    pub fn find(&mut self, patches: &[Patch], radii: [f64; 2]) -> &[Ball] {
        self.balls.clear();
        let [least, greatest] = radii;
        let middle = (least + greatest) / 2.0;
        if patches.is_empty() {
            return &self.balls;
        }
        let cells = Cells::around(patches, greatest, CELL * middle);
        self.votes.resize(cells.len().max(self.votes.len()), 0);
        let steps = ((greatest - least) / cells.side).ceil() as usize;
        let mut most = 0;
        for patch in patches {
            for step in 0..=steps {
                let along = least + (greatest - least) * step as f64 / steps.max(1) as f64;
                let cell = cells.of(&(patch.place - along * patch.normal));
                let vote = &mut self.votes[cell];
                if *vote == 0 {
                    self.voted.push(cell as u32);
                }
                *vote = vote.saturating_add(1);
                most = most.max(*vote);
            }
        }
        // A cell with few votes is the best one of no ball.
        self.full.clear();
        self.full.extend(self.voted.iter().filter(|&&cell| self.votes[cell as usize] > most / 8));
        for _ in 0..BALLS {
            let Some(cell) = self.best(&cells) else { break };
            let start = cells.middle(cell);
            self.clear_around(&cells, &start, middle);
            let Some(ball) = refine(patches, &mut self.close, start, radii) else { continue };
            // Two starts may lead to one place, and what is left of its votes would be a third.
            self.clear_around(&cells, &ball.centre, middle);
            if self.balls.iter().all(|other| (other.centre - ball.centre).norm() > middle / 2.0) {
                self.balls.push(ball);
            }
        }
        // Far fewer cells than there are: the rest is 0 already.
        self.voted.drain(..).for_each(|cell| self.votes[cell as usize] = 0);
        &self.balls
    }

    /// Takes the votes away that lie within `radius` of a point.
    fn clear_around(&mut self, cells: &Cells, point: &Vector3<f64>, radius: f64) {
        let [low, high] = [-radius, radius].map(|by| cells.at(&(point + Vector3::repeat(by))));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let cell = (z * cells.counts[1] + y) * cells.counts[0] + x;
                    if (cells.middle(cell) - point).norm() < radius {
                        self.votes[cell] = 0;
                    }
                }
            }
        }
    }

    /// The cell with the most votes in it and around it, the first of equals. Only cells with at least half of the
    /// votes of the fullest are looked around.
    fn best(&self, cells: &Cells) -> Option<usize> {
        let [nx, ny, _] = cells.counts;
        let full = || self.full.iter().map(|&cell| cell as usize);
        let half = full().map(|cell| self.votes[cell]).max().unwrap_or(0).div_ceil(2).max(1);
        let (mut best, mut most) = (0, 0);
        for cell in full().filter(|&cell| self.votes[cell] >= half) {
            let first = cell - (nx * ny + nx + 1);
            let sum = (0..9)
                .map(|row| first + row / 3 * nx * ny + row % 3 * nx)
                .flat_map(|row| &self.votes[row..row + 3])
                .map(|&votes| u32::from(votes))
                .sum();
            if sum > most {
                (best, most) = (cell, sum);
            }
        }
        (most > 0).then_some(best)
    }
}

/// The point nearest to the normals of the patches that support it, and their mean distance.
fn refine(
    patches: &[Patch],
    close: &mut Vec<u32>,
    start: Vector3<f64>,
    [least, greatest]: [f64; 2],
) -> Option<Ball> {
    let middle = (least + greatest) / 2.0;
    let near = NEAR * middle;
    let farthest = greatest * greatest + near * near;
    let stray = STRAY * middle;
    let mut ball = Ball { centre: start, radius: middle, voters: 0 };
    let mut around = None;
    for _ in 0..REFINEMENTS {
        // Most patches are of other things, wherever the centre goes from here.
        if around.is_none_or(|around: Vector3<f64>| (around - ball.centre).norm() > stray) {
            let reach = (farthest.sqrt() + stray) * (1.0 + 1e-9);
            let is_close = |patch: &Patch| (patch.place - ball.centre).norm_squared() < reach * reach;
            close.clear();
            close.extend((0..).zip(patches).filter(|(_, patch)| is_close(patch)).map(|(number, _)| number));
            around = Some(ball.centre);
        }
        let (mut across, mut feet) = (Matrix3::zeros(), Vector3::zeros());
        let (mut distances, mut voters) = (0.0, 0);
        for patch in close.iter().map(|&number| &patches[number as usize]) {
            let from_centre = patch.place - ball.centre;
            if from_centre.norm_squared() > farthest {
                continue;
            }
            let along = from_centre.dot(&patch.normal);
            let lateral = (from_centre - along * patch.normal).norm();
            if !(lateral < near && along > least && along < greatest) {
                continue;
            }
            let projector = Matrix3::identity() - patch.normal * patch.normal.transpose();
            across += projector;
            feet += projector * patch.place;
            distances += from_centre.norm();
            voters += 1;
        }
        if voters < 3 {
            return None;
        }
        // A little weight on the point of before keeps a bundle of parallel normals solvable.
        let hold = 1e-3 * voters as f64;
        let sum = across + Matrix3::from_diagonal_element(hold);
        let centre = sum.try_inverse()? * (feet + hold * ball.centre);
        let moved = (centre - ball.centre).norm();
        ball = Ball { centre, radius: distances / voters as f64, voters };
        if moved < STILL {
            break;
        }
    }
    Some(ball)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The side of a ball that the camera sees, and a flat board beside it with three times as many patches.
    fn ball_beside_a_board(centre: Vector3<f64>, radius: f64) -> Vec<Patch> {
        let mut patches = Vec::new();
        for i in 0..400 {
            // A spiral spreads points evenly over the half that faces the camera.
            let z = -(f64::from(i) + 0.5) / 400.0;
            let (angle, across) = (f64::from(i) * 2.4, (1.0 - z * z).sqrt());
            let normal = Vector3::new(across * libm::cos(angle), across * libm::sin(angle), z);
            patches.push(Patch { place: centre + radius * normal, normal, bend: 0.0, voxels: 1 });
        }
        for i in 0..1200 {
            let place = Vector3::new(f64::from(i % 40) * 0.01, f64::from(i / 40) * 0.01 + 0.2, 1.0);
            patches.push(Patch { place, normal: -Vector3::z(), bend: 0.0, voxels: 1 });
        }
        patches
    }

    #[test]
    fn a_ball_is_found_beside_something_larger() {
        for (centre, radius) in [
            (Vector3::new(0.0, 0.0, 0.9), 0.09),
            (Vector3::new(-0.3, 0.1, 0.7), 0.07),
            (Vector3::new(0.2, -0.1, 1.1), 0.11),
        ] {
            let mut search = BallSearch::default();
            let ball = search.find(&ball_beside_a_board(centre, radius), [0.06, 0.12])[0];
            assert!((ball.centre - centre).norm() < 1e-3, "{ball:?}");
            assert!((ball.radius - radius).abs() < 1e-3 && ball.voters >= 400, "{ball:?}");
        }
    }

    #[test]
    fn two_balls_are_both_found_the_one_with_more_surface_first() {
        let mut patches = ball_beside_a_board(Vector3::new(0.0, 0.0, 0.9), 0.09);
        let other = ball_beside_a_board(Vector3::new(-0.3, 0.0, 0.9), 0.08);
        patches.extend(other[..400].iter().step_by(2));
        let mut search = BallSearch::default();
        let balls = search.find(&patches, [0.06, 0.12]);
        assert!((balls[0].centre.x - 0.0).abs() < 1e-2 && balls[0].voters >= 400, "{balls:?}");
        assert!(balls[1..].iter().any(|ball| (ball.centre.x + 0.3).abs() < 1e-2), "{balls:?}");
    }

    #[test]
    fn a_search_remembers_nothing_of_the_one_before() {
        let (mut used, mut fresh) = (BallSearch::default(), BallSearch::default());
        used.find(&ball_beside_a_board(Vector3::new(-0.3, 0.1, 0.7), 0.07), [0.05, 0.12]);
        let patches = ball_beside_a_board(Vector3::new(0.2, -0.1, 1.1), 0.1);
        assert_eq!(used.find(&patches, [0.06, 0.12]), fresh.find(&patches, [0.06, 0.12]));
    }

    #[test]
    fn nothing_speaks_for_a_ball_where_there_is_nothing() {
        assert!(BallSearch::default().find(&[], [0.06, 0.12]).is_empty());
    }
}
