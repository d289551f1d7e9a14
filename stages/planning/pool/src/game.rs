//! Patients and rules of games on the wire.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use stillpoint_network::patient::{Body, Table};
use stillpoint_network::{Coarseness, Patient, Rules};

use crate::wire::{WireError, at_most};

/// The longest name of a case file, bytes.
const LONGEST_NAME: usize = 4096;
/// The most sets or solves of one sort in a game.
const MOST: usize = 65_536;
/// Least and greatest spacing of doses and width of bixels, mm.
const LENGTHS_MM: [f64; 2] = [0.5, 200.0];

/// A patient, with the name of a case file as bytes: it need not be text.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Patient")]
pub struct PatientFields {
    #[serde(with = "BodyFields")]
    body: Body,
    table: Table,
    coarse: Coarseness,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Body")]
enum BodyFields {
    Pelvis(u64),
    Varied(u64),
    Neck(u64),
    File(#[serde(with = "path")] PathBuf),
}

/// A path as bytes.
mod path {
    use std::ffi::OsString;
    use std::os::unix::ffi::{OsStrExt, OsStringExt};
    use std::path::{Path, PathBuf};

    use serde::{Deserializer, Serializer};

    use crate::wire::bytes;

    pub fn serialize<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
        bytes::serialize(path.as_os_str().as_bytes(), to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<PathBuf, D::Error> {
        Ok(OsString::from_vec(bytes::deserialize(from)?).into())
    }
}

/// Refuses patients and rules out of their bounds.
pub fn check(patient: &Patient, rules: &Rules) -> Result<(), WireError> {
    if let Body::File(path) = &patient.body {
        at_most(path.as_os_str().len(), LONGEST_NAME, "the length of the name of a case file")?;
    }
    let Coarseness { grid_mm, bixel_mm } = patient.coarse;
    if ![grid_mm, bixel_mm].iter().all(|mm| (LENGTHS_MM[0]..=LENGTHS_MM[1]).contains(mm)) {
        return Err(WireError::Value("a spacing or a width that is not within 0.5 mm to 200 mm"));
    }
    let Rules { beams, class: _, rotations, proposed, search, random } = *rules;
    at_most(beams, MOST, "the number of beams of a game")?;
    at_most(rotations, MOST, "the number of rotations of a game")?;
    at_most(proposed, MOST, "the number of proposed sets of a game")?;
    at_most(search, MOST, "the number of solves of a game")?;
    at_most(random, MOST, "the number of random sets of a game")
}
