//! The learned prior of beams: from the image and the objectives, without any dose.

use std::path::Path;

use stillpoint_network::{Eye, Judgement, Model};
use stillpoint_patient::case::Case;
use stillpoint_plan::dose::{DoseParams, Machine};
use stillpoint_plan::objectives::ObjectiveTable;

use crate::exit::Failure;

/// Angles at which the network looks.
const ANGLES: usize = 90;
/// Spacing of the grid on which the objectives of structures are looked up, mm.
const GRID_MM: f64 = 8.0;

/// What the network of this file, or the one that comes with the project, says of a case.
pub fn judgement(
    case: &Case,
    objectives: &ObjectiveTable,
    machine: &Machine,
    bixel_mm: f64,
    file: Option<&Path>,
) -> Result<Judgement, Failure> {
    let model = match file {
        None => Model::shipped().map_err(Failure::failed)?,
        Some(file) => {
            let fault = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", file.display()));
            let bytes = std::fs::read(file).map_err(|e| fault(&e))?;
            Model::from_safetensors(&bytes).map_err(|e| fault(&e))?
        }
    };
    let grid = DoseParams::over(case.grid(), GRID_MM).grid;
    let aims = objectives.for_case(case, &grid).map_err(Failure::failed)?;
    let eye = Eye::of_case(case, &aims.structures, machine, ANGLES, bixel_mm).map_err(Failure::failed)?;
    Ok(model.judge(&eye))
}

/// A note for users of the network that comes with the project, where it was not tested or did not help; none where it did.
pub fn caution(is_pelvis: bool, beams: usize) -> Option<String> {
    match (is_pelvis, beams) {
        (false, _) => Some(
            "the network was found useful on pelves alone; on real heads and necks it chose worse than equally spaced beams; compare with --method exchange"
                .to_owned(),
        ),
        (true, 5) => None,
        (true, _) => Some(format!(
            "the network was trained on sets of five beams and not tested with {beams}; compare with --method exchange"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::caution;

    #[test]
    fn a_user_is_told_where_the_network_was_not_tested() {
        assert_eq!(caution(true, 5), None);
        assert!(caution(true, 7).is_some_and(|text| text.contains("not tested with 7")));
        assert!(caution(false, 5).is_some_and(|text| text.contains("--method exchange")));
    }
}
