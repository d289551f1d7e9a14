//! Solving the goals on some beams, DVH points included.

use super::certificate::Certificate;
use super::goals::PlanProblem;
use super::newton::{self, Options};
use super::objective::DvhPoint;
use super::problem::{Problem, ProblemError, Side, Term};

/// Most times that the voxels of DVH points are chosen anew.
const MAX_ROUNDS: usize = 30;
/// Part of a volume that sums of volumes may be off by.
const ROUNDING: f64 = 1e-9;

/// Bixels from which a solve begins with a part of the voxels, and voxels for each bixel that it takes.
const LARGE: usize = 3000;
const ENOUGH: usize = 16;
/// One voxel in so many is in that part, and how far it is solved.
const THINNING: usize = 8;
const ROUGH: Options = Options { tolerance: 1e-2, max_steps: 8, ..Options::DEFAULT };

/// A fluence with what it gives.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Weight of each bixel, in the order of the beams.
    pub weights: Vec<f64>,
    /// Dose of the voxels that an objective needs, Gy, in the order of [`super::Goals::voxels`].
    pub dose: Vec<f64>,
    /// How good it is. With DVH points it is that of the convex problem in which the voxels that cost are those chosen
    /// by the last doses: then it proves a stationary point, not the best plan.
    pub certificate: Certificate,
    /// Slope of the objective in the dose of each voxel row, by which beams outside the plan are priced.
    pub pull: Vec<f64>,
    /// Curvature of the objective in the dose of each voxel row.
    pub curvature: Vec<f64>,
    /// Newton steps, over all rounds.
    pub steps: usize,
    /// Rounds of choosing the voxels of DVH points: 1 without any.
    pub rounds: usize,
}

/// Solves it, from weights of the bixels where there are some.
///
/// A DVH point lets the `k` voxels go that would cost most: its cost is the least over the choice of the others. So
/// choosing by dose and solving with that choice both lessen the objective; it ends where the choice stays.
pub fn solve(goals: &PlanProblem, start: Option<&[f64]>, options: Options) -> Result<Plan, ProblemError> {
    let mut problem = goals.convex.clone();
    let first = if start.is_none() { rough_start(goals) } else { None };
    let mut found = newton::solve(&problem, start.or(first.as_deref()), options);
    let (mut steps, mut rounds) = (found.steps, 1);
    let mut chosen: Vec<Vec<(u32, f64)>> = Vec::new();
    while !goals.dvh.is_empty() && rounds < MAX_ROUNDS {
        let choice: Vec<Vec<(u32, f64)>> = goals.dvh.iter().map(|point| point.costing(&found.dose)).collect();
        if choice == chosen {
            break;
        }
        let points = goals.dvh.iter().zip(&choice).flat_map(|(point, rows)| point.terms(rows));
        let terms: Vec<Term> = goals.convex.terms().iter().copied().chain(points).collect();
        problem = Problem::new(goals.convex.shared_matrix(), terms)?.on_threads(problem.threads());
        found = newton::solve(&problem, Some(&found.x), options);
        steps += found.steps;
        rounds += 1;
        chosen = choice;
    }
    let mut pull = vec![0.0; found.dose.len()];
    problem.dose_gradient(&found.dose, &mut pull);
    let curvature = (0..goals.voxel_rows).map(|row| problem.curvature(row, found.dose[row])).collect();
    // Rows that average voxels hand their slope on to them.
    for (i, averaged) in goals.averages.iter().enumerate() {
        let whole = pull[goals.voxel_rows + i];
        averaged.iter().for_each(|(row, share)| pull[*row as usize] += share * whole);
    }
    pull.truncate(goals.voxel_rows);
    found.x.truncate(goals.bixels);
    found.dose.truncate(goals.voxel_rows);
    let newton::Solution { x: weights, dose, certificate, .. } = found;
    Ok(Plan { weights, dose, certificate, pull, curvature, steps, rounds })
}

/// Where there are so many bixels that each step is dear, weights to begin with: those for a part of the voxels.
fn rough_start(goals: &PlanProblem) -> Option<Vec<f64>> {
    let worth = goals.bixels >= LARGE && goals.voxel_rows >= ENOUGH * goals.bixels;
    worth.then(|| newton::solve_roughly(&goals.convex.thinned(goals.voxel_rows, THINNING), ROUGH))
}

impl DvhPoint {
    /// The rows that cost at these doses, rising, with their volumes: those that would cost least.
    pub(super) fn costing(&self, dose: &[f64]) -> Vec<(u32, f64)> {
        let over = self.side == Side::Over;
        let mut rows = self.rows.clone();
        rows.sort_by(|(a, _), (b, _)| {
            let hottest_first = dose[*b as usize].total_cmp(&dose[*a as usize]);
            hottest_first.then(if over { b.cmp(a) } else { a.cmp(b) })
        });
        // Over: the hottest go free as long as they fit into the volume. Under: the hottest cost until they fill it.
        let limit = self.volume * if over { 1.0 + ROUNDING } else { 1.0 - ROUNDING };
        let mut above = 0.0;
        let hottest = rows.iter().take_while(|(_, volume)| {
            let before = above;
            above += volume;
            if over { above <= limit } else { before < limit }
        });
        let hottest = hottest.count();
        let mut costing = if over { rows.split_off(hottest) } else { rows[..hottest].to_vec() };
        costing.sort_unstable_by_key(|(row, _)| *row);
        costing
    }

    fn terms<'a>(&'a self, rows: &'a [(u32, f64)]) -> impl Iterator<Item = Term> + 'a {
        let of = |&(row, volume): &(u32, f64)| {
            let weight = self.weight * volume;
            Term { row, side: self.side, goal: self.dose, weight }
        };
        rows.iter().map(of)
    }
}
