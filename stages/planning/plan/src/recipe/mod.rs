//! The one recipe of a plan: every program that plans sets a patient up and searches in the same way.
//!
//! ```
//! use stillpoint_patient::case::phantom;
//! use stillpoint_plan::recipe::{PlanRequest, SetupSpec, plan};
//!
//! // Coarse points, wide bixels and few solves, so that the example is fast.
//! let spec = SetupSpec { grid_mm: 12.0, bixel_mm: 20.0, ..SetupSpec::shipped()? };
//! let request = PlanRequest::of_angles(vec![0.0, 120.0, 240.0]);
//! let plan = plan(phantom(0)?, spec, &request)?;
//! assert_eq!(plan.angles_deg(), [0.0, 120.0, 240.0]);
//! assert!(plan.best().plan.certificate.relative_excess() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - `name`: the names of methods and priors
//! - `spec`: the parameters of a set-up; `setup`: points, goals and dose engines of a case
//! - `doses`: the doses of the beams of a set-up; `engine`: by which method
//! - `request`: how beams are chosen, with its only validation; `search`: the checked request
//! - `leaves`: beams that leaves cannot shape are refused before doses
//! - `arc`: a plan of arcs
//! - `couch`: the search goes on with couch angles
//! - `settle`: the last solve of a plan by superposition, on corrected columns
//! - `plan`: all of it in one call; `given`: a plan of weights that another program made; `start`: a plan that begins with the
//!   fluence of another one
//! - `delivery`: the check of a plan before it leaves

mod arc;
mod couch;
mod delivery;
mod doses;
mod engine;
mod given;
mod leaves;
mod name;
mod plan;
mod request;
mod search;
mod settle;
mod setup;
mod spec;
mod start;

pub use arc::{ArcPlanError, ArcProgress, PlannedArcs};
pub use couch::{CouchError, CouchRun, Higher};
pub use delivery::Delivery;
pub use doses::PlanDoses;
pub use engine::{LEAST_SHARE_CROSSING, PlanEngine};
pub use given::GivenError;
pub use leaves::UnshapedError;
pub use name::{MethodName, PriorName, UnknownName};
pub use plan::{PlanError, Planned, plan};
pub use request::{BUDGET, MOST_LEAVES, PROPOSALS, PlanRequest, RequestError};
pub use search::{LearnedBeams, PlanRun, PlanSearch};
pub use setup::{PlanSetup, SetupError};
pub use spec::{PointScheme, RobustBy, SetupSpec, set_up_errors};
pub use start::{StartError, StartFluence};
