//! Dose of a machine next to that of a Monte Carlo program, on phantoms with lung, bone and air.
//!
//! ```no_run
//! use std::num::NonZeroUsize;
//! use stillpoint_plan::dose::Machine;
//! use stillpoint_plan::monte_carlo::{SETTINGS, compare};
//!
//! for comparison in compare(&Machine::shipped()?, &SETTINGS, NonZeroUsize::MIN)? {
//!     let missed = comparison.places.iter().filter(|place| place.is_met() == Some(false));
//!     println!("{}: {} bounds are missed", comparison.setting, missed.count());
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - `phantom`: phantoms and fields
//! - `reference`: depth doses and profiles of the Monte Carlo program
//! - `computed`: the same of a machine, by one of the dose engines
//! - `places`: where both are compared, and how far they may be from each other
//! - `comparison`: all of it for a machine

mod comparison;
mod computed;
mod phantom;
mod places;
mod reference;

pub use comparison::{Comparison, MonteCarloError, compare, compare_at};
pub use computed::{Computed, computed};
pub use phantom::{Phantom, SETTINGS, Setting, VOXEL_MM};
pub use places::JudgedPlace;
pub use reference::{Profile, Reference, SPECTRUM, reference};
