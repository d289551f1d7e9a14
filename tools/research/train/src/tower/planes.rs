//! The 36 input planes of a case (SCIENCE G8): 6 structures, the 5 beams, and 25 beams of the five sets before.

use stillpoint_patient::case::{Case, Role, Structure};
use stillpoint_patient::couch::patient_from_couch;
use stillpoint_plan::beams::Ring;

pub const PLANES: usize = 36;
/// Beams of a set, and sets that are kept in mind.
const BEAMS: usize = 5;
const HISTORY: usize = 5;
const STRUCTURES: usize = 6;
/// Rows and columns of a slice.
const SIZE: usize = 64;
/// Half width of the strip by which a beam is drawn, mm.
const STRIP_MM: f64 = 10.0;

/// The planes `(36, slices, 64, 64)`, one number for each voxel: first the targets, the outline and the first four organs;
/// then each beam of the set; then each beam of the sets before, the latest first. Planes of structures and sets that are
/// not there are empty.
///
/// The image is cut into equal parts, 64 by 64 and `slices` along z, and each takes the voxel in its middle. A beam is a
/// strip from the isocentre to its source.
pub fn planes(case: &Case, ring: Ring, set: &[u16], before: &[Vec<u16>], slices: usize) -> Vec<f32> {
    let of_role = |role: Role| case.structures().iter().filter(move |s| s.role == role);
    let mut groups: Vec<Vec<&Structure>> =
        vec![of_role(Role::Target).collect(), of_role(Role::External).collect()];
    groups.extend(of_role(Role::Organ).take(STRUCTURES - 2).map(|organ| vec![organ]));
    groups.resize(STRUCTURES, Vec::new());
    let beams = std::iter::once(set).chain(before.iter().take(HISTORY).map(Vec::as_slice));
    let mut drawn: Vec<Option<u16>> = beams.flat_map(|set| (0..BEAMS).map(|i| set.get(i).copied())).collect();
    drawn.resize(PLANES - STRUCTURES, None);
    let m = patient_from_couch(case.position());
    let ways: Vec<Option<[f64; 3]>> = drawn
        .into_iter()
        .map(|beam| {
            let (sin, cos) = libm::sincos(ring.angle_deg(beam?).to_radians());
            Some([0, 1, 2].map(|row| m[(row, 0)] * sin + m[(row, 2)] * cos))
        })
        .collect();
    let (grid, centre) = (case.grid(), case.isocentre_mm());
    let plane = slices * SIZE * SIZE;
    let mut all = vec![0.0; PLANES * plane];
    for place in 0..plane {
        let parts = [place % SIZE, place / SIZE % SIZE, place / (SIZE * SIZE)];
        let counts = [SIZE, SIZE, slices];
        let voxel: [usize; 3] =
            std::array::from_fn(|axis| (2 * parts[axis] + 1) * grid.counts[axis] / (2 * counts[axis]));
        let index = grid.index(voxel);
        for (number, group) in groups.iter().enumerate() {
            if group.iter().any(|s| s.mask.contains(index)) {
                all[number * plane + place] = 1.0;
            }
        }
        let at = grid.centre_mm(voxel);
        let from: [f64; 3] = std::array::from_fn(|axis| at[axis] - centre[axis]);
        for (number, direction) in ways.iter().enumerate() {
            let Some(direction) = direction else { continue };
            let along: f64 = (0..3).map(|axis| from[axis] * direction[axis]).sum();
            let square: f64 = from.iter().map(|v| v * v).sum::<f64>() - along * along;
            if along >= 0.0 && square <= STRIP_MM * STRIP_MM {
                all[(STRUCTURES + number) * plane + place] = 1.0;
            }
        }
    }
    all
}
