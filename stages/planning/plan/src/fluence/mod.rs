//! Fluence: the weights of the bixels that come nearest to what is wanted (ch. 5.1.4, app. D; SCIENCE F).
//!
//! - `shapes`: the shapes of objectives, one to a file, and their table; `text`: quantities in their text form
//! - `goals`: the objectives of all structures, and the problem that they make of dose matrices
//! - `modulation`: how uneven the fluence of a beam may be
//! - `aim`: what the dose is like where an objective is fulfilled
//! - `dvh`: the cost of a DVH point; `region`: costs of the rows of a region together
//! - `plan`: its solution, DVH points included; `cost`: what doses cost that are there; `value`: what weights cost
//! - `problem`: the one form that every objective comes to, with its errors
//! - `running`: the objective while doses change, for the leaves of arcs
//! - `rows`: the dose matrix of a plan by rows
//! - `newton`: the solver; `bounded`, `curvature`, `gram`, `blocks`, `cholesky`, `line` are its parts
//! - `admm`: the dissertation's solver, corrected
//! - `certificate`: how far from the optimum a point is

pub mod admm;
mod aim;
mod blocks;
mod bounded;
mod certificate;
mod cholesky;
mod coordinates;
mod cost;
mod curvature;
mod dvh;
mod goals;
mod gram;
mod line;
mod modulation;
mod newton;
mod plan;
mod problem;
mod region;
mod rows;
mod running;
mod shapes;
mod text;
mod value;

pub use aim::Aim;
pub use certificate::Certificate;
pub use goals::{Goals, GoalsError, PlanProblem, StructureObjectives};
pub use modulation::Modulation;
pub use newton::{Options, Solution, solve};
pub use plan::{Plan, given as given_plan, solve as solve_plan};
pub use problem::{Problem, ProblemError, Side, Term};
pub use rows::Csr;
pub use running::{DoseChange, RunningCost};
pub use shapes::{
    Bound, DvhAtLeast, DvhAtMost, DvhPoint, FallOff, Geud, Homogeneity, MeanAtLeast, MeanDose, Measured,
    Objective, ObjectiveSpec, Overdose, StructurePart, Underdose,
};
pub use text::{Dose, DoseBound, DvhText, Length, Reading, Volume};
pub use value::ObjectiveValue;
