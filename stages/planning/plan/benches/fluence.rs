//! Fluence solvers side by side on complete problems: ours, the dissertation's ADMM, and Clarabel.
//!
//! `cargo bench -p stillpoint-plan --bench fluence -- [WINDOWS]`. Each window runs every solver once; times are CPU
//! seconds of this process, medians over the windows. The problems are looked for where the tests look.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

#[path = "../tests/fluence/data.rs"]
mod data;
#[path = "../tests/fluence/interior.rs"]
// The tests use more of it.
#[allow(dead_code)]
mod interior;

use data::Case;
use rustix::time::{ClockId, clock_gettime};
use stillpoint_plan::fluence::admm::{self, Admm};
use stillpoint_plan::fluence::{Certificate, Options, solve};

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

fn clarabel(case: &Case) -> Certificate {
    let problem = case.problem();
    Certificate::of(&problem, &interior::weights(&problem))
}
