//! How a replay went, and why it cannot begin.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_recorder::SessionError;

use super::Difference;
use crate::placement::PlacementError;
use crate::schedule::ObserverError;

/// How a replay went.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ReplayReport {
    /// Activations that were done again.
    pub activations: u64,
    /// Of them, those whose journal entry was compared with the recorded one.
    pub activations_compared: u64,
    /// By topic: samples compared with the recording, and found the same.
    pub identical: BTreeMap<String, u64>,
    /// By topic: samples that the recording does not hold; they were made again.
    pub recomputed: BTreeMap<String, u64>,
    /// By recorded topic: samples that are not in the recording, whether they were made again or not.
    pub missing: BTreeMap<String, u64>,
    /// By topic: samples that were measured. They are not compared.
    pub measured: BTreeMap<String, u64>,
    /// Channels that readers of the session see and that are not compared: what viewers want beside samples, clock, frames.
    pub not_compared: Vec<String>,
    /// Samples that differ, or were made by no activation.
    pub differences: u64,
    /// The first of them.
    pub first_difference: Option<Difference>,
    /// Incarnations that could not be replayed to their end.
    pub open: Vec<Open>,
    /// What the session itself says is missing.
    pub gaps: Vec<String>,
    /// Incarnations that were replayed from their begin to the last entry that the session holds.
    pub exact_incarnations: u64,
    /// Session time between the first and the last entry, s.
    pub seconds: f64,
}

/// An incarnation that cannot be replayed from some activation on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Open {
    /// Name of the operator.
    pub operator: String,
    /// Its incarnation.
    pub incarnation: u32,
    /// The first activation that is not exact.
    pub from_activation: u64,
    /// What is missing.
    pub reason: String,
}

/// Why a session cannot be replayed at all.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The session cannot be read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// An operator cannot be made or run.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The selection names no operator.
    #[error("the pipeline has no operator `{0}`; it has {1}")]
    Operator(String, String),
    /// The observer ended it: what was made again cannot be written, or is all that it needs.
    #[error(transparent)]
    Observer(#[from] ObserverError),
}

impl ReplayReport {
    /// Samples compared with the recording, and found the same.
    pub fn compared(&self) -> u64 {
        self.identical.values().sum()
    }

    /// Samples of recorded topics that are not in the recording.
    pub fn missing(&self) -> u64 {
        self.missing.values().fold(0, |sum, count| sum.saturating_add(*count))
    }

    /// Whether no activation was done again and compared, neither its entry nor its samples.
    pub fn compared_nothing(&self) -> bool {
        self.activations_compared == 0 && self.differences == 0
    }

    /// Whether the session is complete, everything could be replayed, and all that could be compared is the same.
    pub fn is_identical(&self) -> bool {
        self.differences == 0 && self.open.is_empty() && self.gaps.is_empty()
    }

    /// The result in one sentence.
    pub fn verdict(&self) -> String {
        match &self.first_difference {
            Some(first) => format!("{} differences; the first: {first}", self.differences),
            None if self.compared_nothing() => {
                "nothing could be compared: no activation of these operators can be replayed".to_owned()
            }
            None if self.compared() == 0 && self.open.is_empty() => {
                "the journals match; no sample could be compared, because the recording has no topic of these operators"
                    .to_owned()
            }
            None if self.open.is_empty() && self.gaps.is_empty() => "identical".to_owned(),
            None if self.open.is_empty() => {
                "the recorded parts match; the session is not complete".to_owned()
            }
            None => format!(
                "the parts that can be replayed match; {} incarnations cannot be replayed to their end",
                self.open.len()
            ),
        }
    }
}
