//! Doses measured in a water tank, and the machine that is fitted to them.
//!
//! ```no_run
//! use stillpoint_plan::dose::Machine;
//! use stillpoint_plan::measured::{Bounds, Measured, fit, read};
//!
//! let mut measured = Measured::default();
//! for name in ["depth-doses.csv", "profiles.asc"] {
//!     measured.add(read(name, &std::fs::read(name)?)?)?;
//! }
//! let fitted = fit(&Machine::shipped()?, &measured, Bounds::default())?;
//! std::fs::write("machine.json", fitted.machine.file().to_json()?)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - `curve`: curves and readings, with the checks that hold for every file
//! - `read`: which reader takes a file; `csv`, `w2cad`, `mcc`: the readers; `number`: numbers of a text file
//! - `spectrum`: the spectra that a fit may find
//! - `tank`: the dose of such a spectrum at the places of the curves
//! - `levenberg`: least squares of a smooth function
//! - `lateral`: penumbra and fluence of the open field, from profiles
//! - `fit`: all of it in turn, and the machine
//! - `residual`: how far a machine is from the curves
//! - `error`: what can be wrong

mod csv;
mod curve;
mod error;
mod fit;
mod lateral;
mod levenberg;
mod mcc;
mod number;
mod read;
mod residual;
mod spectrum;
mod tank;
mod w2cad;

pub use curve::{Across, Curve, CurvePoint, Kind, Measured, Reading, Setup};
pub use error::{FitError, MeasuredError, MeasuredFault};
pub use fit::{Bounds, Calibration, Fitted, OutputResidual, fit};
pub use read::read;
pub use residual::{Residual, ResidualPoint};
