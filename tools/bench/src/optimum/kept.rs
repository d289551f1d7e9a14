//! Proofs that are kept in a folder.

use std::path::Path;

use serde::{Deserialize, Serialize};
use stillpoint_plan::case::content_hash;

use super::pelvis::Pelvis;
use super::prove::{Proved, prove};

/// Version of the files, and of the goals and doses of a pelvis.
const VERSION: u32 = 1;
/// Beams of a plan.
const BEAMS: usize = 5;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    /// Content hash of the case.
    case: String,
    angles: u16,
    beams: Vec<u16>,
    cost: f64,
    sets: usize,
    solves: usize,
}

/// The best set of a pelvis: from the folder if it was proved before, else proved now and kept there.
pub fn proved(folder: Option<&Path>, pelvis: &Pelvis) -> Result<Proved, Box<dyn std::error::Error>> {
    let case = content_hash(&pelvis.case)?.to_string();
    let path =
        folder.map(|folder| folder.join(format!("optimum-{}-{}.json", pelvis.ring.count(), pelvis.seed)));
    if let Some(path) = &path
        && let Ok(bytes) = std::fs::read(path)
    {
        let file: File = serde_json::from_slice(&bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        if (file.version, &file.case, file.angles) == (VERSION, &case, pelvis.ring.count()) {
            let set = pelvis.ring.set(&file.beams)?;
            return Ok(Proved { set, cost: file.cost, sets: file.sets, solves: file.solves });
        }
    }
    let proved = prove(&pelvis.doses, &pelvis.goals, pelvis.ring, BEAMS, |solves, left| {
        if solves % 500 == 0 {
            errln!("pelvis {}: {solves} solves, {left} sets are open", pelvis.seed);
        }
    })?;
    errln!("pelvis {}: proved by {} solves: {:?} at {}", pelvis.seed, proved.solves, proved.set, proved.cost);
    if let Some(path) = &path {
        let file = File {
            version: VERSION,
            case,
            angles: pelvis.ring.count(),
            beams: proved.set.beams().to_vec(),
            cost: proved.cost,
            sets: proved.sets,
            solves: proved.solves,
        };
        path.parent().map(std::fs::create_dir_all).transpose()?;
        let part = path.with_extension("part");
        std::fs::write(&part, serde_json::to_vec(&file)?)?;
        std::fs::rename(&part, path)?;
    }
    Ok(proved)
}
