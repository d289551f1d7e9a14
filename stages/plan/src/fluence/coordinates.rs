//! The exact minimum along each weight in turn: beside large weights it still sees small ones.

use super::line;
use super::problem::Problem;

/// Goes over all weights up to `sweeps` times, until a whole sweep lowers the objective by less than `least` of it.
///
/// A quadratic of all weights hides what is below its rounding; the quadratic of one weight does not.
pub fn sweep(problem: &Problem, x: &mut [f64], sweeps: usize, least: f64) {
    let matrix = problem.matrix();
    let (starts, row, value) = matrix.by_columns();
    let mut dose = vec![0.0; matrix.rows()];
    let mut before = f64::INFINITY;
    for _ in 0..sweeps {
        matrix.forward(x, &mut dose);
        let objective = problem.objective(&dose);
        if before - objective <= least * before {
            return;
        }
        before = objective;
        for j in 0..x.len() {
            let entries = starts[j]..starts[j + 1];
            let change = best_change(problem, &row[entries.clone()], &value[entries.clone()], &dose, x[j]);
            x[j] += change;
            for (i, v) in row[entries.clone()].iter().zip(&value[entries]) {
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
