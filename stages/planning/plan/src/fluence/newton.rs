//! The fast solver: semismooth Newton on the curvature of the active terms.
//!
//! Near a point the objective is the quadratic of the terms that are active there. Each step minimises that quadratic
//! over weights that are not negative, goes along the way there to the exact minimum of the objective, and changes the
//! Gram matrix by the rows whose terms switched. On the right piece one step ends it.

use super::blocks::Blocks;
use super::bounded::{self, Effort, Reached};
use super::certificate::Certificate;
use super::coordinates;
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

impl Options {
    /// The defaults.
    pub const DEFAULT: Self = Self { tolerance: 1e-8, max_steps: 400, dense_columns: 12_000 };
}

impl Default for Options {
    fn default() -> Self {
        Self::DEFAULT
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
/// Steps after which it is the quadratics that are hard, and the work on them then.
const HARD_FROM: usize = 25;
const HARD: Effort = Effort { solves: 64, reduction: 1e-2 };
/// Work on the last quadratic: beside large weights the small ones are seen only here.
const LAST: Effort = Effort { solves: 24, reduction: 1e-9 };

/// Where a bound is not proved by then: rounds of sweeps over single weights and of steps from there at most, sweeps of
/// a round at most, what the last one lessens at least, and entries of the matrix over all sweeps of a round at most.
const ROUNDS: usize = 3;
const SWEEPS: usize = 500;
const LEAST_SWEEP: f64 = 1e-10;
const ENTRIES: usize = 1_000_000_000;

/// Steps after which weights are capped, and the factor by which the cap then rises.
const PATIENCE: usize = 50;
const CAP: f64 = 30.0;

/// Minimises a fluence problem, from `start` where there is one; what is no positive number there counts as zero.
///
/// Where weights over many powers of ten make the steps short, it goes by way of problems with capped weights; what the
/// steps leave then, sweeps over single weights find; with costs of regions, whose minimum along a weight is dear, further
/// steps do.
pub fn solve(problem: &Problem, start: Option<&[f64]>, options: Options) -> Solution {
    let mut found = by_caps(problem, start, options);
    let nothing = NOTHING * problem.objective(&vec![0.0; problem.matrix().rows()]);
    for _ in 0..ROUNDS {
        let Certificate { objective, .. } = found.certificate;
        let left = options.max_steps.saturating_sub(found.steps);
        if found.certificate.relative_excess() <= options.tolerance || objective <= nothing || left == 0 {
            break;
        }
        if !problem.regions().is_empty() {
            let next = descend(problem, Some(&found.x), Options { max_steps: left, ..options });
            if next.certificate.objective < objective {
                found = Solution { steps: found.steps + next.steps, ..next };
            }
            break;
        }
        let sweeps = (ENTRIES / problem.matrix().entries().max(1)).clamp(1, SWEEPS);
        coordinates::sweep(problem, &mut found.x, sweeps, LEAST_SWEEP);
        let next = descend(problem, Some(&found.x), Options { max_steps: left.min(PATIENCE), ..options });
        let swept = Certificate::of(problem, &found.x);
        found = if next.certificate.objective < swept.objective {
            Solution { steps: found.steps + next.steps, ..next }
        } else {
            problem.doses(&found.x, &mut found.dose);
            Solution { certificate: swept, steps: found.steps + next.steps, ..found }
        };
    }
    found
}

/// Weights that are roughly the best ones, as a start for a larger problem.
pub fn solve_roughly(problem: &Problem, options: Options) -> Vec<f64> {
    descend(problem, None, options).x
}

/// Steps that end; where they do not within [`PATIENCE`], by way of problems whose weights have a cap that rises.
fn by_caps(problem: &Problem, start: Option<&[f64]>, options: Options) -> Solution {
    let patient = Options { max_steps: options.max_steps.min(PATIENCE), ..options };
    let mut found = descend(problem, start, patient);
    if found.steps < patient.max_steps {
        return found;
    }
    let weights = problem.terms().iter().map(|term| term.weight);
    let (mut cap, largest) = weights.fold((f64::INFINITY, 0.0), |(a, b), w| (w.min(a), w.max(b)));
    while cap < largest && found.steps < options.max_steps {
        cap *= CAP;
        // What a capped problem leaves undone, the next one does.
        let left = options.max_steps - found.steps;
        let max_steps = left.min(if cap < largest { PATIENCE } else { 2 * PATIENCE });
        let left = Options { max_steps, ..options };
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
        Model::Dense(Gram::new(matrix.rows(), scale.clone()), Vec::new())
    } else {
        Model::ByProducts(Blocks::new(matrix.rows(), scale.clone()))
    };
    let (mut pull, mut change) = (vec![0.0; matrix.rows()], vec![0.0; matrix.rows()]);
    let (mut gradient, mut u, mut z, mut direction) =
        (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut damping, mut settled, mut unseen, mut steps) = (DAMPING[1], false, 0, 0);
    let nothing = NOTHING * problem.objective(&pull);
    let mut objective = problem.objective(&dose);
    while steps < options.max_steps {
        steps += 1;
        problem.dose_gradient(&dose, &mut pull);
        problem.slopes(&pull, &mut gradient);
        for j in 0..n {
            gradient[j] *= scale[j];
            u[j] = if scale[j] > 0.0 { x[j] / scale[j] } else { 0.0 };
        }
        let effort = match steps {
            _ if settled => LAST,
            ..=HARD_FROM => EFFORT,
            _ => HARD,
        };
        let around = Around { dose: &dose, scale: &scale, damping, gradient: &gradient, u: &u };
        let reached = model.minimise(problem, &around, effort, &mut z);
        if reached.decrease <= 0.0 && !reached.solved {
            if damping >= DAMPING[2] {
                break;
            }
            damping = (100.0 * damping).min(DAMPING[2]);
            continue;
        }
        for j in 0..n {
            direction[j] = scale[j] * (z[j] - u[j]);
        }
        problem.doses(&direction, &mut change);
        let t = line::minimise(problem, &dose, &change, 1.0);
        for j in 0..n {
            // The whole way ends on the bounds exactly.
            x[j] = if t == 1.0 { scale[j] * z[j] } else { x[j] + t * direction[j] };
        }
        for (dose, change) in dose.iter_mut().zip(&change) {
            *dose += t * change;
        }
        let before = std::mem::replace(&mut objective, problem.objective(&dose));
        unseen = if before - objective <= UNSEEN * before { unseen + 1 } else { 0 };
        if unseen > 4 || objective <= nothing {
            break;
        }
        if settled && unseen > 0 && Certificate::of(problem, &x).relative_excess() <= options.tolerance {
            break;
        }
        if reached.solved && reached.decrease <= 0.1 * options.tolerance * objective {
            if settled && Certificate::of(problem, &x).relative_excess() <= options.tolerance {
                break;
            }
            // Near enough; steps that are exact and without damping make the certificate as tight.
            (settled, damping) = (true, DAMPING[0]);
            continue;
        }
        settled = false;
        // A quadratic that was too hard is made easier, also where the step was a good one.
        let factor = match (reached.solved, t) {
            (false, _) => 10.0,
            (true, 0.9..) => 0.1,
            (true, ..0.3) => 4.0,
            (true, _) => 1.0,
        };
        damping = (factor * damping).clamp(DAMPING[0], DAMPING[2]);
    }
    problem.doses(&x, &mut dose);
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
    problem.doses(&x, &mut dose);
    if start.is_some() && !dose.iter().all(|d| d.is_finite()) {
        return begin(problem, scale, None);
    }
    let t = line::minimise(problem, &zero, &dose, f64::INFINITY);
    x.iter_mut().chain(&mut dose).for_each(|value| *value *= t);
    (x, dose)
}

/// How the quadratic is held.
enum Model {
    /// With room for a factor.
    Dense(Gram, Vec<f64>),
    ByProducts(Blocks),
}

/// Where a quadratic is taken, with what of it is known.
struct Around<'a> {
    dose: &'a [f64],
    scale: &'a [f64],
    /// Relative to the diagonal.
    damping: f64,
    gradient: &'a [f64],
    /// Weights over their scale.
    u: &'a [f64],
}

impl Model {
    /// Lessens the quadratic over `z >= 0`.
    fn minimise(&mut self, problem: &Problem, around: &Around<'_>, effort: Effort, z: &mut [f64]) -> Reached {
        let Around { dose, scale, damping, gradient, u } = *around;
        match self {
            Self::Dense(gram, room) => {
                gram.update(problem, dose);
                let damping = gram.diagonal().map(|g| damping * g.max(LEAST_DIAGONAL)).collect();
                let mut model = Dense { gram: &gram.matrix, damping, room, threads: problem.threads() };
                bounded::minimise(&mut model, gradient, u, effort, z)
            }
            Self::ByProducts(blocks) => {
                let (curvature, bends) = (problem.curvatures(dose), problem.bends(dose));
                blocks.update(problem, &curvature);
                let damping =
                    (0..u.len()).map(|j| damping * blocks.diagonal(j).max(LEAST_DIAGONAL)).collect();
                let mut model =
                    ByProducts { problem, curvature: &curvature, bends: &bends, scale, blocks, damping };
                bounded::minimise(&mut model, gradient, u, effort, z)
            }
        }
    }
}
