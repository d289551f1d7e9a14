//! The few words of HTTP that the programs speak: `view`, and `--metrics` of `run`, `worker` and `router`.
//!
//! - `request`: a request, and its answer
//! - `figures`: figures in the text format of Prometheus
//! - `metrics`: the server of such figures

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod figures;
mod metrics;
mod request;

pub use figures::{FigureKind, Figures};
pub use metrics::{Metrics, MetricsError};
pub use request::{Request, head, respond};
