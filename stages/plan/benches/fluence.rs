//! Fluence solvers side by side on complete problems: ours, the source's ADMM, and Clarabel.
//!
//! `cargo bench -p stillpoint-plan --bench fluence -- [WINDOWS]`. Each window runs every solver once; times are CPU
//! seconds of this process, medians over the windows. The problems are looked for where the tests look.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

#[path = "../tests/fluence/data.rs"]
mod data;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SupportedConeT};
use data::Case;
use rustix::time::{ClockId, clock_gettime};
use stillpoint_plan::fluence::admm::{self, Admm};
use stillpoint_plan::fluence::{Certificate, Options, Side, solve};

fn main() {
    let windows = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(5);
    for name in ["fmo5_pelvis_000", "fmo9_tg119"] {
        let Some(case) = data::case(name) else { return };
        let _ = &case.row_start;
        let optimum = case.about["optimum_lbfgsb"].as_f64().unwrap();
        println!(
            "{name}: {} rows, {} columns, {} entries",
            case.hi.len(),
            case.matrix.view().columns(),
            case.matrix.view().value.len()
        );
        let newton = |tolerance| {
            move |case: &Case| {
                solve(&case.problem(), None, Options { tolerance, ..Options::default() }).certificate
            }
        };
        let admm = |iterations| {
            move |case: &Case| {
                let fixed = Admm {
                    rho: 0.02,
                    eps_abs: 0.0,
                    eps_rel: 0.0,
                    max_iterations: iterations,
                    ..Admm::default()
                };
                admm::solve(&case.problem(), &fixed).unwrap().1
            }
        };
        type Solver<'a> = (&'a str, Box<dyn Fn(&Case) -> Certificate>);
        let solvers: Vec<Solver<'_>> = vec![
            ("Newton, tolerance 1e-3", Box::new(newton(1e-3))),
            ("Newton, tolerance 1e-6", Box::new(newton(1e-6))),
            ("Newton, tolerance 1e-8", Box::new(newton(1e-8))),
            ("ADMM, 100 iterations", Box::new(admm(100))),
            ("ADMM, 600 iterations", Box::new(admm(600))),
            ("Clarabel 0.11.1", Box::new(clarabel)),
        ];
        let mut times = vec![Vec::new(); solvers.len()];
        let mut reached = vec![None; solvers.len()];
        for _ in 0..windows {
            for (i, (_, run)) in solvers.iter().enumerate() {
                let began = seconds();
                reached[i] = Some(run(&case));
                times[i].push(seconds() - began);
            }
        }
        println!("| solver | s | excess | proved | KKT |\n| --- | --- | --- | --- | --- |");
        for (i, (what, _)) in solvers.iter().enumerate() {
            times[i].sort_by(f64::total_cmp);
            let found = reached[i].unwrap();
            println!(
                "| {what} | {:.3} | {:.1e} | {:.1e} | {:.1e} |",
                times[i][windows / 2],
                found.objective / optimum - 1.0,
                found.relative_excess(),
                found.kkt
            );
        }
    }
}

/// CPU seconds of this process.
fn seconds() -> f64 {
    let now = clock_gettime(ClockId::ProcessCPUTime);
    now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
}

/// The same problem as a quadratic programme: a slack for every term, `min sum w s^2`, `+-(A x - goal) <= s`, `x >= 0`.
fn clarabel(case: &Case) -> Certificate {
    let problem = case.problem();
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
    let x: Vec<f64> = solver.solution.x[..n].iter().map(|x| x.max(0.0)).collect();
    Certificate::of(&problem, &x)
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
