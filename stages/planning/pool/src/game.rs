//! Patients and rules of games as canonical bytes.
//!
//! A patient: a byte for the body, its seed or the name of its file, a byte for the objectives, spacing and width (mm).
//! Rules: beams, a byte for the class set, rotations, proposed sets, solves of the search, random sets.

use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt, OsStringExt};

use stillpoint_network::patient::{Body, Table};
use stillpoint_network::{Coarseness, Patient, Rules};

use crate::wire::{Reader, WireError, Writer};

/// The longest name of a case file, bytes.
const LONGEST_NAME: usize = 4096;
/// The most sets or solves of one sort in a game.
const MOST: usize = 65_536;
/// Least and greatest spacing of doses and width of bixels, mm.
const LENGTHS_MM: [f64; 2] = [0.5, 200.0];

/// Appends a patient.
pub fn write_patient(out: &mut Writer, patient: &Patient) {
    let Patient { body, table, coarse: Coarseness { grid_mm, bixel_mm } } = patient;
    match body {
        Body::Pelvis(seed) => seeded(out, 0, *seed),
        Body::Varied(seed) => seeded(out, 1, *seed),
        Body::Neck(seed) => seeded(out, 2, *seed),
        Body::File(path) => {
            out.byte(3);
            out.bytes(path.as_os_str().as_bytes());
        }
    }
    out.byte(match table {
        Table::Plain => 0,
        Table::Shipped => 1,
    });
    out.real(*grid_mm);
    out.real(*bixel_mm);
}

fn seeded(out: &mut Writer, kind: u8, seed: u64) {
    out.byte(kind);
    out.number(seed);
}

/// Reads a patient.
pub fn read_patient(from: &mut Reader<'_>) -> Result<Patient, WireError> {
    let body = match from.byte("a body")? {
        0 => Body::Pelvis(from.number("a seed")?),
        1 => Body::Varied(from.number("a seed")?),
        2 => Body::Neck(from.number("a seed")?),
        3 => {
            let name = from.bytes(LONGEST_NAME, "the name of a case file")?;
            Body::File(OsString::from_vec(name.to_vec()).into())
        }
        _ => return Err(WireError::Unknown("a body")),
    };
    let table = match from.byte("objectives")? {
        0 => Table::Plain,
        1 => Table::Shipped,
        _ => return Err(WireError::Unknown("a table of objectives")),
    };
    let mut length = || match from.real("a length")? {
        mm if (LENGTHS_MM[0]..=LENGTHS_MM[1]).contains(&mm) => Ok(mm),
        _ => Err(WireError::Unknown("a spacing or a width that is not within 0.5 mm to 200 mm")),
    };
    Ok(Patient { body, table, coarse: Coarseness { grid_mm: length()?, bixel_mm: length()? } })
}

/// Appends rules.
pub fn write_rules(out: &mut Writer, rules: &Rules) {
    let Rules { beams, class, rotations, proposed, search, random } = *rules;
    out.number(beams as u64);
    out.byte(u8::from(class));
    [rotations, proposed, search, random].into_iter().for_each(|count| out.number(count as u64));
}

/// Reads rules.
pub fn read_rules(from: &mut Reader<'_>) -> Result<Rules, WireError> {
    Ok(Rules {
        beams: from.count(MOST, "the beams of a game")?,
        class: from.flag("whether the class set is solved")?,
        rotations: from.count(MOST, "the rotations of a game")?,
        proposed: from.count(MOST, "the proposed sets of a game")?,
        search: from.count(MOST, "the solves of a game")?,
        random: from.count(MOST, "the random sets of a game")?,
    })
}
