//! A machine next to the reference, on every phantom and by both dose engines.

use std::num::NonZeroUsize;

use thiserror::Error;

use super::computed::{Computed, computed};
use super::phantom::Setting;
use super::places::{JudgedPlace, judged};
use super::reference::{Reference, reference};
use crate::dose::{DoseError, EngineName, Machine, MachineError};
use crate::threads::on_threads;

/// A setting by the reference and by both dose engines.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Phantom and field.
    pub setting: Setting,
    /// The Monte Carlo program.
    pub reference: Reference,
    /// The machine by superposition.
    pub superposition: Computed,
    /// The machine by pencil beams.
    pub pencil: Computed,
    /// Where they are compared.
    pub places: Vec<JudgedPlace>,
}

/// Why a machine cannot be compared with the reference.
#[derive(Debug, Error)]
pub enum MonteCarloError {
    /// A reference that comes with stillpoint is damaged.
    #[error("a reference of the Monte Carlo program is damaged: {0}; install stillpoint once more")]
    Damaged(#[from] serde_json::Error),
    /// There is no reference.
    #[error("there is no reference for {0}; take one of the settings of the comparison")]
    Missing(Setting),
    /// The machine has another geometry.
    #[error(
        "the machine has {found} mm from the source to the isocentre, and the reference {expected} mm: they cannot be compared"
    )]
    Distance {
        /// Of the machine.
        found: f64,
        /// Of the reference.
        expected: f64,
    },
    /// The machine is not valid on the phantoms.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// Dose cannot be computed.
    #[error(transparent)]
    Dose(#[from] DoseError),
}

/// These settings, such as [`super::SETTINGS`]. Any number of threads gives the same numbers.
///
/// # Errors
/// The machine has another distance from the source to the isocentre than the reference, or no point kernels; or there is no
/// reference for a setting.
pub fn compare(
    machine: &Machine,
    settings: &[Setting],
    threads: NonZeroUsize,
) -> Result<Vec<Comparison>, MonteCarloError> {
    on_threads(settings, threads, |setting| compare_at(machine, *setting))
}

/// One setting.
///
/// # Errors
/// As [`compare`]; or there is no reference.
pub fn compare_at(machine: &Machine, setting: Setting) -> Result<Comparison, MonteCarloError> {
    let reference = reference(setting)?.ok_or(MonteCarloError::Missing(setting))?;
    let by = |engine| computed(machine, setting, engine, &reference);
    let (superposition, pencil) = (by(EngineName::Superposition)?, by(EngineName::Pencil)?);
    let places = judged(setting, &reference, &superposition, &pencil);
    Ok(Comparison { setting, reference, superposition, pencil, places })
}
