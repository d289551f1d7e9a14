//! The exact minimum along each weight in turn: beside large weights it still sees small ones.

use super::line;
use super::problem::Problem;

/// Goes over all weights up to `sweeps` times, until a whole sweep lowers the objective by less than `least` of it.
///
/// A quadratic of all weights hides what is below its rounding; the quadratic of one weight does not.
pub fn sweep(problem: &Problem, x: &mut [f64], sweeps: usize, least: f64) {
    let matrix = problem.matrix();
    let columns = matrix.to_columns();
    let mut dose = vec![0.0; matrix.rows()];
    let mut before = f64::INFINITY;
    for _ in 0..sweeps {
        problem.doses(x, &mut dose);
        let objective = problem.objective(&dose);
        if before - objective <= least * before {
            return;
        }
        before = objective;
        for (j, x) in x.iter_mut().enumerate() {
            let (row, value) = columns.view().column(j);
            let change = best_change(problem, row, value, &dose, *x);
            *x += change;
            for (i, v) in row.iter().zip(value) {
                dose[*i as usize] += f64::from(*v) * change;
            }
        }
    }
}

/// Change of a weight `x` that minimises the objective and leaves it at zero or above.
fn best_change(problem: &Problem, row: &[u32], value: &[f32], dose: &[f64], x: f64) -> f64 {
    let slope = |t: f64| {
        let (mut slope, mut curvature) = (0.0, 0.0);
        for (i, v) in row.iter().zip(value) {
            let v = f64::from(*v);
            for term in problem.terms_of(*i as usize) {
                let d = dose[*i as usize] + t * v;
                slope += term.slope(d) * v;
                curvature += term.curvature(d) * v * v;
            }
        }
        (slope, curvature)
    };
    line::root(slope, [-x, f64::INFINITY], 0.0)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::problem::{Side, Term};
    use super::super::rows::Csr;
    use super::*;
    use crate::Csc;

    #[test]
    fn a_small_weight_beside_a_large_one_comes_to_its_best() {
        // Rows: 1e8 x, 1e-4 y, and both in a third; each goal is met by x = 1e-7 and y = 3e4, the third one by neither.
        let (starts, row) = (vec![0, 2, 4], vec![0, 2, 1, 2]);
        let matrix = Csc::new(3, starts, row, vec![1e8, 1.0, 1e-4, 1e-8]).unwrap();
        let term = |row, side, goal, weight| Term { row, side, goal, weight };
        let terms = [
            term(0, Side::Over, 10.0, 1e6),
            term(0, Side::Under, 10.0, 1e6),
            term(1, Side::Under, 3.0, 1e-6),
            term(2, Side::Over, -1.0, 1e-12),
        ];
        let problem = Problem::new(Csr::from_columns(matrix.view()), terms).unwrap();
        let mut x = [4.0, 0.0];
        sweep(&problem, &mut x, 50, 0.0);
        assert!((x[0] / 1e-7 - 1.0).abs() < 1e-6 && (x[1] / 3e4 - 1.0).abs() < 1e-3, "{x:?}");
        // No weight goes below zero, however much its slope would have it.
        let alone = Csr::from_columns(Csc::new(1, vec![0, 1], vec![0], vec![1.0]).unwrap().view());
        let problem = Problem::new(alone, [term(0, Side::Over, -5.0, 1.0)]).unwrap();
        let mut x = [2.0];
        sweep(&problem, &mut x, 9, 0.0);
        assert_eq!(x, [0.0]);
    }
}
