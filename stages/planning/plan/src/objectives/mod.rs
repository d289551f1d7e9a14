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
//! let aims = table.for_case(&case, &grid)?;
//! assert_eq!(aims.wanted[0].name, "PTV");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - `table`: the JSON table
//! - `aims`: a table on a case

mod aims;
mod table;

pub use aims::{Aims, AimsError, follows};
pub use table::{ObjectiveTable, TableError};
