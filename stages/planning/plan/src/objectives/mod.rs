//! The objectives of each structure: a table by names and roles, and the goals of a case.
//!
//! ```
//! use stillpoint_patient::case::phantom;
//! use stillpoint_plan::dose::DoseParams;
//! use stillpoint_plan::objectives::ObjectiveTable;
//!
//! let case = phantom(0)?;
//! let grid = DoseParams::over(case.grid(), 5.0).grid;
//! let own = r#"{ "objectives": [{ "match": ["rectum"], "wanted": [{ "overdose": { "dose": "30 Gy", "weight": 25 } }] }] }"#;
//! let table = ObjectiveTable::parse(own)?.before(ObjectiveTable::shipped()?);
//! let set = table.for_case(&case, &grid)?;
//! assert_eq!(set.structures[0].name, "PTV");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - `table`: the JSON table
//! - `set`: a table on a case: its objectives
//! - `results`: what a plan makes of them

mod results;
mod set;
mod table;

pub use results::ObjectiveResult;
pub use set::{ObjectiveSet, ObjectiveSetError, follows};
pub use table::{ObjectiveTable, TableError};
