//! The features of patients, kept in a folder: they take longer than a step of the descent.

use std::path::{Path, PathBuf};

use stillpoint_network::eye::{FEATURES_VERSION, PAIR, STRUCTURE, TARGET};
use stillpoint_network::game::ring;
use stillpoint_network::patient::Body;
use stillpoint_network::{Coarseness, Eye, Patient};
use stillpoint_plan::dose::Machine;

use super::plan;
use crate::TrainError;

/// A folder of features.
pub struct Features(PathBuf);

impl Features {
    /// In this folder, which is made.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn new(folder: &Path) -> Result<Self, TrainError> {
        let fault = |e: std::io::Error| TrainError::File { path: folder.to_owned(), why: e.to_string() };
        std::fs::create_dir_all(folder).map_err(fault)?;
        Ok(Self(folder.to_owned()))
    }

    /// The features of a patient: from the folder, else from the case. Of a case file they are not
    /// kept, because another file may take its name.
    ///
    /// # Errors
    /// There is no such patient, or it cannot be seen.
    pub fn of(&self, patient: &Patient) -> Result<Eye, TrainError> {
        let Coarseness { grid_mm, bixel_mm } = patient.coarse;
        let path = self.0.join(format!("{}-{grid_mm}-{bixel_mm}.features", patient.name()));
        let retained = !matches!(patient.body, Body::File(_));
        if let Some(eye) = std::fs::read(&path).ok().filter(|_| retained).and_then(|bytes| from_bytes(&bytes))
        {
            return Ok(eye);
        }
        let problem = patient.problem().map_err(plan)?;
        let angles = usize::from(ring().map_err(plan)?.count());
        let machine = Machine::shipped().map_err(plan)?;
        let eye =
            Eye::of_case(problem.case(), problem.requested(), &machine, angles, bixel_mm).map_err(plan)?;
        if !retained {
            return Ok(eye);
        }
        let part = path.with_extension("part");
        std::fs::write(&part, to_bytes(&eye))
            .and_then(|()| std::fs::rename(&part, &path))
            .map_err(|e| TrainError::File { path, why: e.to_string() })?;
        Ok(eye)
    }
}

/// Version, numbers of features, angles and structures, u32 little endian; then the numbers, f32.
fn to_bytes(eye: &Eye) -> Vec<u8> {
    let head = [FEATURES_VERSION as usize, TARGET, STRUCTURE, PAIR, eye.angles, eye.structures.len()];
    let mut bytes: Vec<u8> = head.iter().flat_map(|n| (*n as u32).to_le_bytes()).collect();
    let numbers = eye.target.iter().flatten().chain(eye.structures.iter().flatten().flatten());
    bytes.extend(numbers.chain(eye.pairs.iter().flatten()).flat_map(|v| v.to_le_bytes()));
    bytes
}

fn from_bytes(bytes: &[u8]) -> Option<Eye> {
    let (head, numbers) = bytes.split_at_checked(24)?;
    let head: Vec<usize> = head.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b) as usize).collect();
    let [version, target, structure, pair, angles, structures] = head[..] else { return None };
    let rows = angles.checked_mul(TARGET + structures.checked_mul(STRUCTURE)? + angles.checked_mul(PAIR)?)?;
    if (version, target, structure, pair) != (FEATURES_VERSION as usize, TARGET, STRUCTURE, PAIR)
        || numbers.len() != rows.checked_mul(4)?
    {
        return None;
    }
    let mut next = numbers.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b));
    let mut number = || next.next().unwrap_or_default();
    Some(Eye {
        angles,
        target: (0..angles).map(|_| [0.0; TARGET].map(|_| number())).collect(),
        structures: (0..structures)
            .map(|_| (0..angles).map(|_| [0.0; STRUCTURE].map(|_| number())).collect())
            .collect(),
        pairs: (0..angles * angles).map(|_| [0.0; PAIR].map(|_| number())).collect(),
    })
}
