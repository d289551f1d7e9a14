//! Clarabel on a fluence problem: an interior-point solver that shares nothing with ours.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use stillpoint_plan::fluence::{
    Bound, Geud, MeanAtLeast, Objective, Overdose, Problem, Side, StructureObjectives,
};

/// Weights of the columns, not negative: a slack for every term, `min sum w s^2`, `+-(A x - goal) <= s`, `x >= 0`.
pub fn weights(problem: &Problem) -> Vec<f64> {
    let (n, terms) = (problem.matrix().columns(), problem.terms());
    let mut columns: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n + terms.len()];
    let mut bounds = Vec::new();
    for (i, term) in terms.iter().enumerate() {
        let sign = if term.side == Side::Over { 1.0 } else { -1.0 };
        let (row_columns, values) = problem.matrix().row(term.row as usize);
        for (c, v) in row_columns.iter().zip(values) {
            columns[*c as usize].push((i, sign * f64::from(*v)));
        }
        columns[n + i].push((i, -1.0));
        bounds.push(sign * term.goal);
    }
    for (j, column) in columns[..n].iter_mut().enumerate() {
        column.push((terms.len() + j, -1.0));
        bounds.push(0.0);
    }
    let constraints = csc(bounds.len(), columns);
    let weights = |j: usize| if j < n { Vec::new() } else { vec![(j, 2.0 * terms[j - n].weight)] };
    let quadratic = csc(n + terms.len(), (0..n + terms.len()).map(weights).collect());
    let settings = DefaultSettings { verbose: false, max_threads: 1, ..DefaultSettings::default() };
    let linear = vec![0.0; n + terms.len()];
    let cones = [SupportedConeT::NonnegativeConeT(bounds.len())];
    let mut solver =
        DefaultSolver::new(&quadratic, &linear, &constraints, &bounds, &cones, settings).unwrap();
    solver.solve();
    solver.solution.x[..n].iter().map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 }).collect()
}

/// Rows of `G x + s = h`, `s` in a cone, under the making.
#[derive(Default)]
struct Cones {
    entries: Vec<Vec<(usize, f64)>>,
    bounds: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
    weights: Vec<(usize, f64)>,
    variables: usize,
}

impl Cones {
    fn variable(&mut self) -> usize {
        self.variables += 1;
        self.variables - 1
    }

    /// `sum of entries + s = bound`.
    fn row(&mut self, entries: Vec<(usize, f64)>, bound: f64) {
        self.entries.push(entries);
        self.bounds.push(bound);
    }

    /// `sum of entries <= bound`.
    fn at_most(&mut self, entries: Vec<(usize, f64)>, bound: f64) {
        self.row(entries, bound);
        self.cones.push(SupportedConeT::NonnegativeConeT(1));
    }

    /// A slack that costs its square: returns it.
    fn slack(&mut self, weight: f64) -> usize {
        let slack = self.variable();
        self.weights.push((slack, 2.0 * weight));
        slack
    }

    /// `x^power y^(1 - power) >= |z|` for variables, of which `z` is a sum with a constant.
    fn power(&mut self, power: f64, x: (Vec<(usize, f64)>, f64), y: usize, z: (Vec<(usize, f64)>, f64)) {
        let negative = |sum: Vec<(usize, f64)>| sum.into_iter().map(|(j, v)| (j, -v)).collect();
        self.row(negative(x.0), x.1);
        self.row(vec![(y, -1.0)], 0.0);
        self.row(negative(z.0), z.1);
        self.cones.push(SupportedConeT::PowerConeT(power));
    }
}

/// Weights of the bixels for overdoses, means and equivalent uniform doses, the latter by power cones.
///
/// `sum s d^a <= t^a` is `d <= r^(1/a) t^(1 - 1/a)` with `sum s r = t`; `sum s y^-p <= m^-p` is
/// `m <= y^(p/(1+p)) r^(1/(1+p))` with `sum s r = m`. Also whether it says that it solved the problem.
pub fn region_weights(
    rows: &[Vec<f32>],
    columns: usize,
    structures: &[StructureObjectives],
) -> (Vec<f64>, bool) {
    let mut cones = Cones { variables: columns, ..Cones::default() };
    for j in 0..columns {
        cones.at_most(vec![(j, -1.0)], 0.0);
    }
    for structure in structures {
        let share = 1.0 / structure.voxels.len() as f64;
        let dose = |voxel: u32, by: f64| -> Vec<(usize, f64)> {
            let row = rows[voxel as usize].iter().enumerate();
            row.filter(|(_, v)| **v != 0.0).map(|(j, v)| (j, by * f64::from(*v))).collect()
        };
        for objective in &structure.objectives {
            match *objective {
                Objective::Overdose(Overdose { dose: limit, weight }) => {
                    for voxel in &structure.voxels {
                        let slack = cones.slack(weight * share);
                        cones.at_most([dose(*voxel, 1.0), vec![(slack, -1.0)]].concat(), limit);
                    }
                }
                Objective::MeanAtLeast(MeanAtLeast { dose: limit, weight }) => {
                    let slack = cones.slack(weight);
                    let mut mean = vec![0.0; columns];
                    for (j, v) in structure.voxels.iter().flat_map(|voxel| dose(*voxel, share)) {
                        mean[j] += v;
                    }
                    let mean = mean.into_iter().enumerate().map(|(j, v)| (j, -v)).collect::<Vec<_>>();
                    cones.at_most([mean, vec![(slack, -1.0)]].concat(), -limit);
                }
                Objective::Geud(Geud { a, bound: Bound::AtMost, dose: limit, weight }) => {
                    let (slack, mean) = (cones.slack(weight), cones.variable());
                    cones.at_most(vec![(mean, 1.0), (slack, -1.0)], limit);
                    let mut sum = vec![(mean, -1.0)];
                    for voxel in &structure.voxels {
                        let r = cones.variable();
                        sum.push((r, share));
                        cones.power(1.0 / a, (vec![(r, 1.0)], 0.0), mean, (dose(*voxel, 1.0), 0.0));
                    }
                    cones.at_most(sum, 0.0);
                }
                Objective::Geud(Geud { a, bound: Bound::AtLeast, dose: limit, weight }) => {
                    let (slack, mean) = (cones.slack(weight), cones.variable());
                    let raise = 0.01 * limit;
                    cones.at_most(vec![(mean, -1.0), (slack, -1.0)], -limit - raise);
                    let mut sum = vec![(mean, -1.0)];
                    for voxel in &structure.voxels {
                        let r = cones.variable();
                        sum.push((r, share));
                        cones.power(-a / (1.0 - a), (dose(*voxel, 1.0), raise), r, (vec![(mean, 1.0)], 0.0));
                    }
                    cones.at_most(sum, 0.0);
                }
                ref other => unreachable!("{other:?}"),
            }
        }
    }
    let n = cones.variables;
    let mut by_column: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n];
    for (i, entries) in cones.entries.iter().enumerate() {
        entries.iter().for_each(|(j, v)| by_column[*j].push((i, *v)));
    }
    let mut quadratic: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n];
    cones.weights.iter().for_each(|(j, weight)| quadratic[*j].push((*j, *weight)));
    let settings = DefaultSettings { verbose: false, max_threads: 1, ..DefaultSettings::default() };
    let (quadratic, constraints) = (csc(n, quadratic), csc(cones.bounds.len(), by_column));
    let linear = vec![0.0; n];
    let mut solver =
        DefaultSolver::new(&quadratic, &linear, &constraints, &cones.bounds, &cones.cones, settings).unwrap();
    solver.solve();
    let weights = solver.solution.x[..columns].iter();
    let weights = weights.map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 }).collect();
    (weights, solver.solution.status == SolverStatus::Solved)
}

fn csc(rows: usize, columns: Vec<Vec<(usize, f64)>>) -> CscMatrix<f64> {
    let (mut starts, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
    for column in &columns {
        row.extend(column.iter().map(|entry| entry.0));
        value.extend(column.iter().map(|entry| entry.1));
        starts.push(row.len());
    }
    CscMatrix::new(rows, columns.len(), starts, row, value)
}
