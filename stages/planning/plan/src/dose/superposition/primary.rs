//! Dose of the charged particles that photons of the source set free.

use super::field::{Field, FieldBox};
use super::fluence::FluenceMap;
use super::gather::{Cell, Gather, Start};
use super::section::Superposition;
use crate::dose::engine::DoseEngine;
use crate::dose::frame::BeamFrame;

/// Longest way of a charged particle, through lung and air, mm.
pub(super) const REACH_MM: f64 = 150.0;

/// Adds the dose of a fluence to the rows of the engine, MeV/g.
pub(super) fn add(
    engine: &DoseEngine,
    frame: &BeamFrame,
    section: &Superposition,
    field: &Field,
    (map, bounds): (&FluenceMap, [[f64; 2]; 2]),
    dose: &mut [f32],
) {
    let cut = FieldBox::around(field, &engine.params.grid);
    let mut cells: Vec<Cell> = cut.cut(&engine.density).into_iter().map(|density| [density, 0.0]).collect();
    for voxel in &field.voxels {
        let fluence = map.mean(voxel.plane_mm.map(f64::from), f64::from(voxel.side_mm));
        cells[cut.grid.index(cut.voxel(voxel.voxel))][1] = voxel.terma[0] * fluence as f32;
    }
    let gather = Gather::new(&cut.grid, frame, &section.primary, REACH_MM, bounds);
    for voxel in &field.voxels {
        if engine.voxels.binary_search(&voxel.voxel).is_ok() {
            let start = Start {
                voxel: cut.voxel(voxel.voxel),
                beam_mm: voxel.beam_mm,
                level: gather.level(voxel.hardening),
            };
            dose[engine.row_of(voxel.voxel) as usize] += gather.at(&cells, &start);
        }
    }
}
