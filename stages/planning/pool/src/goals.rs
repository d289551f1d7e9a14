//! Goals of a plan as canonical bytes.
//!
//! `SPGOAL01`, the number of rows of the dose matrices, then each structure: name, voxels (u32), volumes, distances to the
//! targets (mm), objectives. An objective is a byte for its kind and its numbers, in the order of their declaration.

use stillpoint_plan::fluence::{Goals, Objective, Wanted};

use crate::wire::{Reader, WireError, Writer};

const MAGIC: &[u8; 8] = b"SPGOAL01";
const MOST_STRUCTURES: usize = 4096;
const MOST_OBJECTIVES: usize = 1024;
const MOST_NAME: usize = 4096;

/// The bytes of goals.
pub fn to_bytes(goals: &Goals) -> Vec<u8> {
    let mut out = Writer(MAGIC.to_vec());
    out.number(goals.rows() as u64);
    out.number(goals.wanted().len() as u64);
    for Wanted { name, voxels, volumes, to_target_mm, objectives } in goals.wanted() {
        out.bytes(name.as_bytes());
        out.words(voxels);
        out.reals(volumes);
        out.reals(to_target_mm);
        out.number(objectives.len() as u64);
        objectives.iter().for_each(|objective| write(&mut out, objective));
    }
    out.0
}

/// The goals of bytes that anybody may have made, for dose matrices of `rows`.
///
/// # Errors
/// The bytes are no goals, or they belong to other matrices.
pub fn from_bytes(bytes: &[u8], rows: usize) -> Result<Goals, String> {
    let wanted = read(bytes, rows).map_err(|e| format!("the goals cannot be read: {e}"))?;
    Goals::new(wanted, rows).map_err(|e| e.to_string())
}

fn read(bytes: &[u8], rows: usize) -> Result<Vec<Wanted>, WireError> {
    let mut from = Reader::new(bytes);
    if from.raw(8, "goals")? != MAGIC {
        return Err(WireError::Unknown("the version of the goals"));
    }
    // Before anything of this size is made.
    if from.count(rows, "the number of rows")? != rows {
        return Err(WireError::Unknown("a number of rows that is not that of the dose matrices"));
    }
    let wanted = from.list(MOST_STRUCTURES, "the number of structures", |from| {
        Ok(Wanted {
            name: from.text(MOST_NAME, "the name of a structure")?,
            voxels: from.words("the voxels of a structure")?,
            volumes: from.reals("the volumes of a structure")?,
            to_target_mm: from.reals("the distances of a structure")?,
            objectives: from.list(MOST_OBJECTIVES, "the number of objectives", objective)?,
        })
    })?;
    from.end()?;
    Ok(wanted)
}

fn write(out: &mut Writer, objective: &Objective) {
    let (kind, numbers) = match *objective {
        Objective::Overdose { dose, weight } => (0, vec![dose, weight]),
        Objective::FallOff { near, far, over_mm, weight } => (1, vec![near, far, over_mm, weight]),
        Objective::Underdose { dose, weight } => (2, vec![dose, weight]),
        Objective::MeanDose { dose, weight } => (3, vec![dose, weight]),
        Objective::Homogeneity { weight } => (4, vec![weight]),
        Objective::DvhAtMost { dose, volume, weight } => (5, vec![dose, volume, weight]),
        Objective::DvhAtLeast { dose, volume, weight } => (6, vec![dose, volume, weight]),
    };
    out.byte(kind);
    numbers.into_iter().for_each(|number| out.real(number));
}

fn objective(from: &mut Reader<'_>) -> Result<Objective, WireError> {
    let kind = from.byte("the kind of an objective")?;
    let mut next = || from.real("a number of an objective");
    Ok(match kind {
        0 => Objective::Overdose { dose: next()?, weight: next()? },
        1 => Objective::FallOff { near: next()?, far: next()?, over_mm: next()?, weight: next()? },
        2 => Objective::Underdose { dose: next()?, weight: next()? },
        3 => Objective::MeanDose { dose: next()?, weight: next()? },
        4 => Objective::Homogeneity { weight: next()? },
        5 => Objective::DvhAtMost { dose: next()?, volume: next()?, weight: next()? },
        6 => Objective::DvhAtLeast { dose: next()?, volume: next()?, weight: next()? },
        _ => return Err(WireError::Unknown("the kind of an objective")),
    })
}
