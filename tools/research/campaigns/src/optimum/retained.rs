//! Proofs that are kept in a folder.

use std::path::Path;

use serde::{Deserialize, Serialize};
use stillpoint_patient::case::content_hash;

use super::prove::{Proved, prove};
use super::subject::Subject;

/// Version of the files, and of the goals and doses of a patient.
const VERSION: u32 = 2;

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

/// The best set of a patient: from the folder if it was proved before, else proved now and kept there.
pub fn proved(
    folder: Option<&Path>,
    subject: &Subject,
    beams: usize,
) -> Result<Proved, Box<dyn std::error::Error>> {
    let case = content_hash(subject.problem.case())?.to_string();
    let path =
        folder.map(|folder| folder.join(format!("optimum-{}-{}.json", subject.ring.count(), subject.name)));
    if let Some(path) = &path
        && let Ok(bytes) = std::fs::read(path)
    {
        let file: File = serde_json::from_slice(&bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        if (file.version, &file.case, file.angles, file.beams.len())
            == (VERSION, &case, subject.ring.count(), beams)
        {
            let set = subject.ring.set(&file.beams)?;
            return Ok(Proved { set, cost: file.cost, sets: file.sets, solves: file.solves });
        }
    }
    let proved = prove(&subject.doses, subject.problem.goals(), subject.ring, beams, |solves| {
        if solves % 1000 == 0 {
            errln!("{}: {solves} sets are solved", subject.name);
        }
    })?;
    errln!("{}: proved by {} solves: {:?} at {}", subject.name, proved.solves, proved.set, proved.cost);
    if let Some(path) = &path {
        let file = File {
            version: VERSION,
            case,
            angles: subject.ring.count(),
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
