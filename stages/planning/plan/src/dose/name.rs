//! The names of the methods by which dose is computed.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A method by which dose is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineName {
    /// Pencil beams: fast, and wrong in lung and behind air.
    #[default]
    Pencil,
    /// Superposition of point kernels: slower, and near Monte Carlo there.
    Superposition,
}

/// A text that names no method.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("unknown dose engine `{0}` (allowed: pencil, superposition)")]
pub struct UnknownEngine(pub String);

impl EngineName {
    /// All methods.
    pub const ALL: [Self; 2] = [Self::Pencil, Self::Superposition];

    /// The name as it is written.
    pub fn word(self) -> &'static str {
        match self {
            Self::Pencil => "pencil",
            Self::Superposition => "superposition",
        }
    }

    /// What the method does, for people.
    pub fn about(self) -> &'static str {
        match self {
            Self::Pencil => "pencil beams: fast, and too high in lung and behind air",
            Self::Superposition => "superposition of point kernels: slower, and near Monte Carlo there",
        }
    }
}

impl fmt::Display for EngineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl FromStr for EngineName {
    type Err = UnknownEngine;

    fn from_str(text: &str) -> Result<Self, UnknownEngine> {
        let is_named = |name: &Self| name.word() == text;
        Self::ALL.into_iter().find(is_named).ok_or_else(|| UnknownEngine(text.to_owned()))
    }
}
