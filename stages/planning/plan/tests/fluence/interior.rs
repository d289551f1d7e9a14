//! Clarabel on a fluence problem: an interior-point solver that shares nothing with ours.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SupportedConeT};
use stillpoint_plan::fluence::{Problem, Side};

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

fn csc(rows: usize, columns: Vec<Vec<(usize, f64)>>) -> CscMatrix<f64> {
    let (mut starts, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
    for column in &columns {
        row.extend(column.iter().map(|entry| entry.0));
        value.extend(column.iter().map(|entry| entry.1));
        starts.push(row.len());
    }
    CscMatrix::new(rows, columns.len(), starts, row, value)
}
