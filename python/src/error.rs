//! Failures as exceptions.

use std::fmt::Display;

use pyo3::PyErr;
use pyo3::exceptions::PyException;
use stillpoint::{Failure, RerunError};

pyo3::create_exception!(
    stillpoint_rt,
    StillpointError,
    PyException,
    "What stillpoint refuses, or fails to do. The text states what is wrong, where, and what to do."
);

/// An error as an exception with its text.
pub fn raise(error: impl Display) -> PyErr {
    StillpointError::new_err(error.to_string())
}

/// The failure of a command as an exception.
pub fn raise_failure(failure: Failure) -> PyErr {
    StillpointError::new_err(failure.text)
}

/// The failure of a what-if as an exception.
pub fn raise_rerun(error: RerunError) -> PyErr {
    raise_failure(error.into())
}
