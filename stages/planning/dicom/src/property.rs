//! What the planner says of the material of regions: density overrides, boluses, couches.
//!
//! A case holds Hounsfield units. A density goes into it as the Hounsfield units to which the density table that is shipped
//! gives it; a bolus becomes part of the outline, so that beams pass it and it gets dose.

use stillpoint_patient::Grid;
use stillpoint_patient::case::{Mask, Role, Structure};

use crate::roi::Roi;

/// The density table that is shipped: Hounsfield units and relative density.
const TABLE: [[f64; 2]; 3] = [[-1000.0, 0.0], [100.0, 1.1], [3000.0, 2.492]];
/// What is drawn as a bolus and has more than this was scanned with the patient, HU.
const SCANNED_HU: i16 = -300;

/// A region that says something of its material, with its voxels.
pub(crate) struct Material<'a> {
    pub name: &'a str,
    pub roi: &'a Roi,
    pub mask: Mask,
}

/// Sets densities, joins boluses to the outline, and says what of couches counts.
pub(crate) fn apply(
    grid: &Grid,
    materials: &[Material<'_>],
    hu: &mut [i16],
    structures: &mut [Structure],
    notes: &mut Vec<String>,
) {
    let Some(outline) = structures.iter_mut().find(|s| s.role == Role::External) else { return };
    for Material { name, roi, mask } in materials {
        let density = density(name, roi, notes);
        let volume = |voxels: usize| voxels as f64 * grid.voxel_cm3();
        let outside: Vec<usize> = mask.indices().filter(|&i| !outline.mask.contains(i)).collect();
        match roi.kind.as_deref() {
            Some("BOLUS") => {
                let unscanned: Vec<usize> = outside.iter().copied().filter(|&i| hu[i] <= SCANNED_HU).collect();
                unscanned.iter().for_each(|&i| hu[i] = 0);
                outside.iter().for_each(|&i| outline.mask.insert(i));
                notes.push(format!(
                    "{name:?} is a bolus: its {:.2} cm3 outside of the outline become part of {:?}, {:.2} cm3 of them as water",
                    volume(outside.len()),
                    outline.name,
                    volume(unscanned.len())
                ));
            }
            Some("SUPPORT" | "FIXATION") if !outside.is_empty() => notes.push(format!(
                "{name:?} does not count for the dose: its {:.2} cm3 outside of the outline neither stop nor scatter a beam",
                volume(outside.len())
            )),
            _ => {}
        }
        let Some(density) = density else { continue };
        let set_hu = hounsfield(density);
        let inside: Vec<usize> = mask.indices().filter(|&i| outline.mask.contains(i)).collect();
        inside.iter().for_each(|&i| hu[i] = set_hu);
        notes.push(format!(
            "{name:?} has the density {density} by the structure set: {:.2} cm3 are set to {set_hu} HU, which have it by the table that is shipped{}",
            volume(inside.len()),
            if inside.len() < mask.count() { "; what is outside of the outline counts as air" } else { "" }
        ));
    }
}

/// Whether a region says something of its material.
pub(crate) fn is_material(roi: &Roi) -> bool {
    !roi.properties.is_empty() || matches!(roi.kind.as_deref(), Some("BOLUS" | "SUPPORT" | "FIXATION"))
}

/// The density relative to water that a region is given.
fn density(name: &str, roi: &Roi, notes: &mut Vec<String>) -> Option<f64> {
    let mut density = None;
    for (what, value) in &roi.properties {
        let highest = TABLE[TABLE.len() - 1][1];
        match what.as_str() {
            "REL_ELEC_DENSITY" | "REL_MASS_DENSITY"
                if density.is_none() && (0.0..=highest).contains(value) =>
            {
                density = Some(*value);
            }
            "REL_ELEC_DENSITY" | "REL_MASS_DENSITY" if density == Some(*value) => {}
            "REL_ELEC_DENSITY" | "REL_MASS_DENSITY" => notes.push(format!(
                "{name:?}: its {what} of {value} is not used (allowed: one density from 0 to {highest})"
            )),
            _ => notes.push(format!("{name:?}: its {what} of {value} is not used")),
        }
    }
    density
}

/// Hounsfield units that have this density by the table that is shipped.
fn hounsfield(density: f64) -> i16 {
    let segment = TABLE.windows(2).find(|pair| density <= pair[1][1]).unwrap_or(&TABLE[1..]);
    let [[x0, y0], [x1, y1]] = [segment[0], segment[1]];
    libm::round(x0 + (density - y0) / (y1 - y0) * (x1 - x0)) as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_are_those_of_the_table() {
        assert_eq!([0.0, 1.0, 1.1, 2.492].map(hounsfield), [-1000, 0, 100, 3000]);
    }
}
