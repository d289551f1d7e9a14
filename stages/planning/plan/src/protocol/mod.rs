//! Protocols: the limits by which a plan is accepted, and which of them it keeps.
//!
//! A limit is written in the nomenclature of AAPM TG-263: `V75Gy[%] <= 15`, `D0.03cc[Gy] <= 54`, `Mean[Gy] <= 26`.
//!
//! ```
//! use stillpoint_plan::protocol::{Limit, Of};
//!
//! let rectum = Of::Structure { name: "Rectum".into(), patterns: vec![] };
//! let limit = Limit::new(rectum, "V75Gy[%] <= 15", "RTOG 0126")?;
//! assert_eq!(limit.to_string(), "V75Gy[%] <= 15");
//! # Ok::<(), stillpoint_plan::protocol::LimitError>(())
//! ```
//!
//! - `metric`: what a limit is on, as text and as a number of a dose
//! - `limits`: limits, and a plan beside them
//! - `serve`: which objective serves a limit

mod limits;
mod metric;
mod serve;

pub use limits::{Fractionation, Judged, Limit, LimitError, Of, Protocol};
pub use metric::{Metric, MetricError, Subject};
pub use serve::Served;
