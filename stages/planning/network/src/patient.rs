//! The patients of training: phantoms by their seeds, so that anyone can make them again, and cases from files.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use stillpoint_patient::case::{Case, CaseError, CaseFileError, neck, phantom, read, varied_phantom};
use stillpoint_plan::dose::{Machine, MachineError};
use stillpoint_plan::objectives::{ObjectiveTable, TableError};
use thiserror::Error;

use crate::problem::{Coarseness, Problem, ProblemError};

/// Objectives for pelves without fall-off and entry dose: those of the comparisons of methods.
const PLAIN: &str = include_str!("../data/plain.json");

/// Whose body it is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Body {
    /// The ordinary pelvis of a seed.
    Pelvis(u64),
    /// The varied pelvis of a seed.
    Varied(u64),
    /// The head and neck of a seed.
    Neck(u64),
    /// A case file.
    File(PathBuf),
}

/// What is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Table {
    /// The objectives of the comparisons of methods: targets, organs, body.
    Plain,
    /// The shipped objectives, with fall-off and entry dose.
    Shipped,
}

/// A patient with objectives and a kind of doses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Patient {
    /// The body.
    pub body: Body,
    /// The objectives.
    pub table: Table,
    /// How coarse doses are.
    pub coarse: Coarseness,
}

/// Why there is no such patient.
#[derive(Debug, Error)]
pub enum PatientError {
    /// The phantom is no case.
    #[error("the phantom is not a case: {0}")]
    Case(#[from] CaseError),
    /// The case file.
    #[error("{}: {why}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: Box<CaseFileError>,
    },
    /// The objectives that come with the project.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The machine that comes with the project.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// Nothing can be solved.
    #[error(transparent)]
    Problem(#[from] ProblemError),
}

impl Patient {
    /// The phantom of a number: every number is another one. Of ten, five are ordinary pelves and two varied ones.
    pub fn of_number(number: u64, coarse: Coarseness) -> Self {
        let (body, table) = match number % 10 {
            1 | 5 | 9 => (Body::Neck(number), Table::Shipped),
            3 => (Body::Varied(number), Table::Plain),
            7 => (Body::Varied(number), Table::Shipped),
            _ => (Body::Pelvis(number), Table::Plain),
        };
        Self { body, table, coarse }
    }

    /// A case file, with the shipped objectives.
    pub fn of_file(path: &Path, coarse: Coarseness) -> Self {
        Self { body: Body::File(path.to_owned()), table: Table::Shipped, coarse }
    }

    /// A name for files and tables: of body and objectives.
    pub fn name(&self) -> String {
        let body = match &self.body {
            Body::Pelvis(seed) => format!("pelvis-{seed}"),
            Body::Varied(seed) => format!("varied-{seed}"),
            Body::Neck(seed) => format!("neck-{seed}"),
            Body::File(path) => path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        };
        match self.table {
            Table::Plain => format!("{body}-plain"),
            Table::Shipped => body,
        }
    }

    /// The case.
    pub fn case(&self) -> Result<Case, PatientError> {
        Ok(match &self.body {
            Body::Pelvis(seed) => phantom(*seed)?,
            Body::Varied(seed) => varied_phantom(*seed)?,
            Body::Neck(seed) => neck(*seed)?,
            Body::File(path) => {
                read(path).map_err(|why| PatientError::File { path: path.clone(), why: Box::new(why) })?
            }
        })
    }

    /// The objectives.
    pub fn objectives(&self) -> Result<ObjectiveTable, PatientError> {
        Ok(match self.table {
            Table::Plain => ObjectiveTable::parse(PLAIN)?,
            Table::Shipped => ObjectiveTable::shipped()?,
        })
    }

    /// The case with its goals and doses, for the shipped machine.
    pub fn problem(&self) -> Result<Problem, PatientError> {
        self.problem_of(self.case()?)
    }

    /// The same of a case that was read before.
    ///
    /// # Errors
    /// Nothing can be solved.
    pub fn problem_of(&self, case: Case) -> Result<Problem, PatientError> {
        Ok(Problem::new(case, &self.objectives()?, Machine::shipped()?, self.coarse)?)
    }
}
