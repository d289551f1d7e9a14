//! The dose of a weighted beam by superposition.

use super::field::Field;
use super::fluence::{BixelShape, FluenceMap, bounds};
use super::section::Superposition;
use super::{primary, scatter};
use crate::dose::engine::DoseEngine;
use crate::dose::frame::BeamFrame;

/// Dose of bixels with these fluences (centres in mm on the isocentre plane) to the rows of the engine, gray.
pub(in crate::dose) fn weighted(
    engine: &DoseEngine,
    frame: &BeamFrame,
    section: &Superposition,
    bixels: &[([f64; 2], f32)],
) -> Vec<f32> {
    let mut dose = vec![0.0; engine.rows()];
    if bixels.is_empty() {
        return dose;
    }
    let shape = BixelShape::new(engine.params.bixels.width_mm, engine.machine.file().penumbra_fwhm_at_iso_mm);
    let map = FluenceMap::new(bixels, &shape);
    let bounds = bounds(bixels.iter().map(|(bixel, _)| *bixel), &shape);
    let field = Field::new(engine, frame, section, bounds);
    primary::add(engine, frame, section, &field, (&map, bounds), &mut dose);
    scatter::add(engine, frame, section, &field, (&map, bounds), &mut dose);
    let scale = section.gray_per_mev_g as f32;
    dose.iter_mut().for_each(|dose| *dose *= scale);
    dose
}
