//! Contours to masks.
//!
//! **In a plane.** Within one contour the even-odd rule holds, so that the channel of a keyhole contour cancels. Of
//! closed contours that are identical one counts. A contour that lies wholly inside another is a hole in it, and a
//! contour wholly inside a hole is an island. All other contours are united, whether they overlap or not. A plane with a
//! contour of the type `CLOSEDPLANAR_XOR` combines all of its contours by exclusive or (DICOM PS3.3, C.8.8.6.3).
//!
//! **Along the patient.** A contour stands for a slab, half of it below and half above its plane. The slab is as thick as
//! the median distance of the structure's planes, at least a slice; where that distance is above 20 mm, it is a slice. A
//! slice takes the contours of the nearest plane whose slab holds its centre; halfway it is the lower. A larger distance
//! between two planes is a gap and stays empty.
//!
//! - `contour`: one contour, and how two of them lie to each other
//! - `spans`: sets of intervals on a row
//! - `plane`: the contours of one plane as one region
//! - `parts`: the islands that lie apart
//! - `slabs`: planes along the patient: thickness, gaps
//! - `drawn`: the volume as drawn, and how the mask differs from it

mod contour;
mod drawn;
mod parts;
mod plane;
mod slabs;
mod spans;

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;

pub use contour::{Contour, ContourKind};
pub use drawn::{Beyond, Drawn};

use plane::Plane;
use slabs::Slabs;

/// A part whose planes are farther apart than the whole's by this factor has slabs of its own.
const APART: f64 = 1.5;

/// A mask, and the volume of the contours that it was made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Rastered {
    /// The voxels.
    pub mask: Mask,
    /// The volume as drawn.
    pub drawn: Drawn,
}

/// The voxels of the volume that are inside these contours.
pub fn rasterise(grid: &Grid, contours: &[Contour]) -> Rastered {
    let slice_mm = grid.spacing_mm[2];
    let contours: Vec<&Contour> = contours.iter().collect();
    let whole = Slabs::of(&contours, slice_mm);
    let mut mask = Mask::empty(grid.len());
    let parts: Vec<Slabs<'_>> =
        parts::apart(&contours).iter().map(|part| Slabs::of_part(part, slice_mm, &whole)).collect();
    let is_thinner = |part: &Slabs<'_>| part.is_regular && whole.thickness_mm * APART < part.thickness_mm;
    let drawn = if parts.len() > 1 && (whole.skips(grid) || parts.iter().any(is_thinner)) {
        let drawn = parts.iter().map(|part| put(grid, part, &mut mask));
        drawn.reduce(Drawn::with).unwrap_or_default()
    } else {
        put(grid, &whole, &mut mask)
    };
    let mask_cm3 = mask.count() as f64 * grid.voxel_cm3();
    Rastered { mask, drawn: Drawn { mask_cm3, ..drawn } }
}

/// Puts the voxels of these planes into the mask.
fn put(grid: &Grid, slabs: &Slabs<'_>, mask: &mut Mask) -> Drawn {
    let slices_of_plane = slabs.slices(grid);
    let mut tally = drawn::Tally::new(grid, slabs);
    for (place, (slab, slices)) in slabs.planes.iter().zip(&slices_of_plane).enumerate() {
        let plane = Plane::of(&slab.contours);
        tally.add(place, &plane, !slices.is_empty());
        if !slices.is_empty() {
            fill(grid, &plane, slices, mask);
        }
    }
    tally.finish()
}

/// Puts the voxels of a plane's region into these slices.
fn fill(grid: &Grid, plane: &Plane<'_>, slices: &[usize], mask: &mut Mask) {
    let [columns, rows, _] = grid.counts;
    let column = |x: f64| {
        let place = libm::ceil((x - grid.origin_mm[0]) / grid.spacing_mm[0]);
        place.clamp(0.0, columns as f64) as usize
    };
    plane.region(grid.origin_mm[1], grid.spacing_mm[1], rows, |row, spans| {
        for [from, to] in spans {
            for x in column(*from)..column(*to) {
                for &z in slices {
                    mask.insert(grid.index([x, row, z]));
                }
            }
        }
    });
}
