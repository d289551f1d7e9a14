//! Goals of a plan as canonical bytes: the number of rows of the dose matrices, then each structure with its objectives, then
//! what uneven fluence costs.

use stillpoint_plan::fluence::{Goals, Modulation, StructureObjectives};

use crate::CallError;
use crate::message::LONGEST_CONTENT;
use crate::wire::{Format, WireError, at_most};

const FORMAT: Format = Format { what: "goals", mark: b"SPGOAL03", most: LONGEST_CONTENT as usize };
const MOST_STRUCTURES: usize = 4096;
const MOST_OBJECTIVES: usize = 1024;
const MOST_NAME: usize = 4096;

/// The bytes of goals.
pub fn to_bytes(goals: &Goals) -> Vec<u8> {
    FORMAT.write(&(goals.rows(), goals.structures(), goals.modulation()))
}

/// The goals of bytes that anybody may have made, for dose matrices of `rows`.
///
/// # Errors
/// The bytes are no goals, or they belong to other matrices.
pub fn from_bytes(bytes: &[u8], rows: usize) -> Result<Goals, CallError> {
    let (structures, modulation) = read(bytes, rows).map_err(CallError::Goals)?;
    Goals::new(structures, rows).and_then(|goals| goals.modulated(modulation)).map_err(CallError::of)
}

fn read(bytes: &[u8], rows: usize) -> Result<(Vec<StructureObjectives>, Option<Modulation>), WireError> {
    // Before anything of this size is made: the number of rows, and the length of the list of structures.
    let (_, structures, modulation): (usize, Vec<StructureObjectives>, Option<Modulation>) = FORMAT
        .read_after(bytes, |(found, structures): (usize, usize)| {
            at_most(structures, MOST_STRUCTURES, "the number of structures")?;
            match found == rows {
                true => Ok(()),
                false => Err(WireError::Value("a number of rows that is not that of the dose matrices")),
            }
        })?;
    for structure in &structures {
        at_most(structure.name.len(), MOST_NAME, "the length of the name of a structure")?;
        at_most(structure.objectives.len(), MOST_OBJECTIVES, "the number of objectives")?;
    }
    Ok((structures, modulation))
}
