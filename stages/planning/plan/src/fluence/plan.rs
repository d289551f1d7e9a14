//! Solving the goals on some beams, DVH points included.

use super::certificate::Certificate;
use super::goals::PlanProblem;
use super::newton::{self, Options};
use super::problem::{Problem, ProblemError, Term};

/// Most times that the voxels of DVH points are chosen anew.
const MAX_ROUNDS: usize = 30;

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
        problem = goals.convex.with_terms(terms)?;
        found = newton::solve(&problem, Some(&found.x), options);
        steps += found.steps;
        rounds += 1;
        chosen = choice;
    }
    found.steps = steps;
    Ok(finished(goals, &problem, found, rounds))
}

/// The plan of given weights, one for each bixel: nothing is solved but the means of homogeneity objectives. Its certificate
/// says how far it is from the best plan of these bixels.
///
/// # Errors
/// There is not one weight for each bixel, or one is negative or not finite.
pub fn given(goals: &PlanProblem, weights: &[f64]) -> Result<Plan, ProblemError> {
    if weights.len() != goals.bixels {
        let (found, expected) = (weights.len(), goals.bixels);
        return Err(ProblemError::Length { what: "the list of weights", found, expected });
    }
    if let Some((bixel, weight)) = weights.iter().enumerate().find(|(_, w)| !(w.is_finite() && **w >= 0.0)) {
        return Err(ProblemError::Fluence { bixel, weight: *weight });
    }
    let matrix = goals.convex.matrix();
    let mut x = weights.to_vec();
    x.resize(matrix.columns(), 0.0);
    let mut dose = vec![0.0; matrix.rows()];
    goals.convex.doses(&x, &mut dose);
    let means = goals.best_means(&dose);
    x[goals.bixels..].copy_from_slice(&means);
    goals.convex.doses(&x, &mut dose);
    let choice = goals.dvh.iter().map(|point| (point, point.costing(&dose)));
    let points: Vec<Term> = choice.flat_map(|(point, rows)| point.terms(&rows).collect::<Vec<_>>()).collect();
    let terms: Vec<Term> = goals.convex.terms().iter().copied().chain(points).collect();
    let problem = goals.convex.clone().with_terms(terms)?;
    let certificate = Certificate::of(&problem, &x);
    Ok(finished(goals, &problem, newton::Solution { x, dose, certificate, steps: 0 }, 1))
}

/// What a solution of the problem is as a plan.
fn finished(goals: &PlanProblem, problem: &Problem, mut found: newton::Solution, rounds: usize) -> Plan {
    let mut pull = vec![0.0; found.dose.len()];
    problem.dose_gradient(&found.dose, &mut pull);
    let mut curvature = problem.curvatures(&found.dose);
    curvature.truncate(goals.voxel_rows);
    // Rows that average voxels hand their slope on to them.
    for (i, averaged) in goals.averages.iter().enumerate() {
        let whole = pull[goals.voxel_rows + i];
        averaged.iter().for_each(|(row, share)| pull[*row as usize] += share * whole);
    }
    pull.truncate(goals.voxel_rows);
    found.x.truncate(goals.bixels);
    found.dose.truncate(goals.voxel_rows);
    let newton::Solution { x: weights, dose, certificate, steps } = found;
    Plan { weights, dose, certificate, pull, curvature, steps, rounds }
}

/// Where there are so many bixels that each step is dear, weights to begin with: those for a part of the voxels.
fn rough_start(goals: &PlanProblem) -> Option<Vec<f64>> {
    let worth = goals.bixels >= LARGE && goals.voxel_rows >= ENOUGH * goals.bixels;
    worth.then(|| newton::solve_roughly(&goals.convex.thinned(goals.voxel_rows, THINNING), ROUGH))
}
