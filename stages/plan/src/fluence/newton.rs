//! The fast solver: semismooth Newton on the curvature of the active terms.
//!
//! Near a point the objective is the quadratic of the terms that are active there. Each step minimises that quadratic
//! over weights that are not negative, goes along the way there to the exact minimum of the objective, and changes the
//! Gram matrix by the rows whose terms switched. On the right piece one step ends it.

use super::bounded::{self, Effort, Reached};
use super::certificate::Certificate;
use super::curvature::{ByProducts, Dense};
use super::gram::Gram;
use super::line;
use super::problem::Problem;

/// When the solver ends, and how it works.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Relative excess over the optimum that is aimed at; the certificate says what was reached.
    pub tolerance: f64,
    /// Most Newton steps.
    pub max_steps: usize,
    /// Most columns for which the Gram matrix is formed; beyond, conjugate gradients take its place.
    pub dense_columns: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { tolerance: 1e-8, max_steps: 400, dense_columns: 3000 }
    }
}

/// Weights of the bixels, with what they give.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Weight of each column.
    pub x: Vec<f64>,
    /// Dose of each row, Gy.
    pub dose: Vec<f64>,
    /// How good it is.
    pub certificate: Certificate,
    /// Newton steps taken.
    pub steps: usize,
}

/// Smallest, first and largest damping, relative to the diagonal of the Gram matrix.
const DAMPING: [f64; 3] = [1e-10, 1e-4, 1e-1];
/// Diagonal that a column is taken to have at least, where 1 is that of all terms active.
const LEAST_DIAGONAL: f64 = 1e-14;
/// Decrease, over the objective, that rounding hides; five such steps in a row end it.
const UNSEEN: f64 = 1e-14;
/// Objective, over that at zero fluence, that is none: it ends problems whose optimum is zero.
const NOTHING: f64 = 1e-22;
/// Work on the quadratic of one step.
const EFFORT: Effort = Effort { solves: 8, reduction: 1e-2 };

/// Steps after which weights are capped, and the factor by which the cap then rises.
const PATIENCE: usize = 50;
const CAP: f64 = 30.0;

/// Minimises a fluence problem, from `start` where there is one; what is no positive number there counts as zero.
///
/// Where weights over many powers of ten make the steps short, it goes by way of problems with capped weights.
pub fn solve(problem: &Problem, start: Option<&[f64]>, options: Options) -> Solution {
    let patient = Options { max_steps: options.max_steps.min(PATIENCE), ..options };
    let mut found = descend(problem, start, patient);
    if found.steps < patient.max_steps {
        return found;
    }
    let weights = problem.terms().iter().map(|term| term.weight);
    let (mut cap, largest) = weights.fold((f64::INFINITY, 0.0), |(a, b), w| (w.min(a), w.max(b)));
    while cap < largest && found.steps < options.max_steps {
        cap *= CAP;
        let left = Options { max_steps: options.max_steps - found.steps, ..options };
        let next = descend(&problem.capped(cap), Some(&found.x), left);
        found = Solution { steps: found.steps + next.steps, ..next };
    }
    Solution { certificate: Certificate::of(problem, &found.x), ..found }
}

fn descend(problem: &Problem, start: Option<&[f64]>, options: Options) -> Solution {
    let matrix = problem.matrix();
    let n = matrix.columns();
    // u = x / scale has unit curvature along each column, so that columns in any unit are treated alike.
    let scale: Vec<f64> =
        problem.largest_diagonal().iter().map(|d| if *d > 0.0 { 1.0 / d.sqrt() } else { 0.0 }).collect();
    let (mut x, mut dose) = begin(problem, &scale, start);
    let mut model = if n <= options.dense_columns {
        Model::Dense(Gram::new(matrix.rows(), scale.clone()))
    } else {
        Model::ByProducts
    };
    let (mut pull, mut change) = (vec![0.0; matrix.rows()], vec![0.0; matrix.rows()]);
    let (mut gradient, mut u, mut z, mut way) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut damping, mut settled, mut unseen, mut steps) = (DAMPING[1], false, 0, 0);
    let nothing = NOTHING * problem.objective(&pull);
    let mut objective = problem.objective(&dose);
    while steps < options.max_steps {
        steps += 1;
        problem.dose_gradient(&dose, &mut pull);
        matrix.adjoint(&pull, &mut gradient);
        for j in 0..n {
            gradient[j] *= scale[j];
            u[j] = if scale[j] > 0.0 { x[j] / scale[j] } else { 0.0 };
        }
        let reached = model.minimise(problem, &dose, &scale, damping, &gradient, &u, &mut z);
        if reached.decrease <= 0.0 && !reached.solved {
            if damping >= DAMPING[2] {
                break;
            }
            damping = (100.0 * damping).min(DAMPING[2]);
            continue;
        }
        for j in 0..n {
            way[j] = scale[j] * (z[j] - u[j]);
        }
        matrix.forward(&way, &mut change);
        let t = line::minimise(problem, &dose, &change, 1.0);
        for j in 0..n {
            // The whole way ends on the bounds exactly.
            x[j] = if t == 1.0 { scale[j] * z[j] } else { x[j] + t * way[j] };
        }
        for (dose, change) in dose.iter_mut().zip(&change) {
            *dose += t * change;
        }
        let before = std::mem::replace(&mut objective, problem.objective(&dose));
        unseen = if before - objective <= UNSEEN * before { unseen + 1 } else { 0 };
        if unseen > 4 || objective <= nothing {
            break;
        }
        if reached.solved && reached.decrease <= 0.1 * options.tolerance * objective {
            if settled || damping <= DAMPING[0] {
                break;
            }
            // Near enough; one more step without damping makes the certificate as tight.
            (settled, damping) = (true, DAMPING[0]);
            continue;
        }
        let factor = if t >= 0.9 {
            0.1
        } else if t < 0.3 {
            4.0
        } else {
            1.0
        };
        damping = (factor * damping).clamp(DAMPING[0], DAMPING[2]);
    }
    matrix.forward(&x, &mut dose);
    Solution { certificate: Certificate::of(problem, &x), x, dose, steps }
}

/// Weights and doses to begin with: those given, or equal curvature along each column; in either case at the best
/// height.
fn begin(problem: &Problem, scale: &[f64], start: Option<&[f64]>) -> (Vec<f64>, Vec<f64>) {
    let mut x = match start {
        Some(start) => {
            let usable = |(x, s): (&f64, &f64)| if *x > 0.0 && *s > 0.0 && x.is_finite() { *x } else { 0.0 };
            start.iter().zip(scale).map(usable).collect()
        }
        None => scale.to_vec(),
    };
    x.resize(scale.len(), 0.0);
    let zero = vec![0.0; problem.matrix().rows()];
    let mut dose = zero.clone();
    problem.matrix().forward(&x, &mut dose);
    if start.is_some() && !dose.iter().all(|d| d.is_finite()) {
        return begin(problem, scale, None);
    }
    let t = line::minimise(problem, &zero, &dose, f64::INFINITY);
    x.iter_mut().chain(&mut dose).for_each(|value| *value *= t);
    (x, dose)
}

/// How the quadratic is held.
enum Model {
    Dense(Gram),
    ByProducts,
}

impl Model {
    /// Lessens the quadratic around `u` over `z >= 0`.
    #[expect(clippy::too_many_arguments)]
    fn minimise(
        &mut self,
        problem: &Problem,
        dose: &[f64],
        scale: &[f64],
        damping: f64,
        gradient: &[f64],
        u: &[f64],
        z: &mut [f64],
    ) -> Reached {
        match self {
            Self::Dense(gram) => {
                gram.update(problem, dose);
                let damping = gram.diagonal().map(|g| damping * g.max(LEAST_DIAGONAL)).collect();
                bounded::minimise(&Dense { gram: &gram.matrix, damping }, gradient, u, EFFORT, z)
            }
            Self::ByProducts => {
                let curvature = (0..dose.len()).map(|row| problem.curvature(row, dose[row])).collect();
                let model = ByProducts { problem, curvature, scale, damping };
                bounded::minimise(&model, gradient, u, EFFORT, z)
            }
        }
    }
}
