//! Fluence: the weights of the bixels that come nearest to what is wanted (ch. 5.1.4, app. D; SCIENCE F).
//!
//! - `objective`: the objectives of a structure; `goals`: the objectives of all structures, and the problem that they
//!   make of dose matrices
//! - `plan`: its solution, DVH points included; `cost`: what doses cost that are there
//! - `problem`: the one form that every objective comes to, with its errors
//! - `voxels`: structures on the dose grid
//! - `rows`: the dose matrix of a plan by rows
//! - `newton`: the solver; `bounded`, `curvature`, `gram`, `blocks`, `cholesky`, `line` are its parts
//! - `admm`: the dissertation's solver, corrected
//! - `certificate`: how far from the optimum a point is

pub mod admm;
mod blocks;
mod bounded;
mod certificate;
mod cholesky;
mod coordinates;
mod cost;
mod curvature;
mod goals;
mod gram;
mod line;
mod newton;
mod objective;
mod plan;
mod problem;
mod rows;
mod voxels;

pub use certificate::Certificate;
pub use goals::{Goals, GoalsError, PlanProblem, Wanted};
pub use newton::{Options, Solution, solve};
pub use objective::Objective;
pub use plan::{Plan, solve as solve_plan};
pub use problem::{Problem, ProblemError, Side, Term};
pub use rows::Csr;
pub use voxels::voxels_on;
