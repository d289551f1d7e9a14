//! Contours to masks.
//!
//! In a plane a voxel is inside if its centre is inside an odd number of a structure's contours. So a contour within a
//! contour is a hole (DICOM's CLOSED_PLANAR and CLOSEDPLANAR_XOR alike), and the two sides of the channel of a keyhole
//! contour cancel.
//!
//! Along the patient a contour stands for a slab, half of it below and half above its plane: as thick as the closest two
//! contour planes of the structure are apart, at least a slice; where they are more than 10 mm apart, a slice. A slice
//! takes the contours of the nearest plane whose slab holds its centre; halfway it is the lower. What lies between slabs
//! is empty: a gap that someone drew stays a gap.

use stillpoint_plan::Grid;
use stillpoint_plan::case::Mask;

/// Contours are in one plane if they are this close, mm.
const SAME_PLANE_MM: f64 = 0.01;
/// Slices and contour planes are no farther apart than this where a structure is whole, mm.
const THICKEST_MM: f64 = 10.0;
/// A slice this close to the edge of a slab, as a part of its thickness, is on the edge.
const EDGE: f64 = 1e-6;

/// A closed polygon across the patient.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// Its plane, mm.
    pub z_mm: f64,
    /// Its corners, mm; the last is joined to the first.
    pub xy_mm: Vec<[f64; 2]>,
}

/// A mask, and what of its contours it does not show.
#[derive(Clone, Debug, PartialEq)]
pub struct Rastered {
    /// The voxels.
    pub mask: Mask,
    /// Planes of contours to which no slice of the volume is nearest.
    pub planes_unused: usize,
}

/// The voxels of the volume that are inside these contours.
pub fn rasterise(grid: &Grid, contours: &[Contour]) -> Rastered {
    let mut sorted: Vec<&Contour> = contours.iter().collect();
    sorted.sort_by(|a, b| a.z_mm.total_cmp(&b.z_mm));
    let mut planes: Vec<(f64, Vec<&Contour>)> = Vec::new();
    for contour in sorted {
        match planes.last_mut() {
            Some((z_mm, plane)) if contour.z_mm - *z_mm <= SAME_PLANE_MM => plane.push(contour),
            _ => planes.push((contour.z_mm, vec![contour])),
        }
    }
    let closest = planes.windows(2).map(|pair| pair[1].0 - pair[0].0).fold(f64::INFINITY, f64::min);
    let thickness = if closest <= THICKEST_MM { closest.max(grid.spacing_mm[2]) } else { grid.spacing_mm[2] };
    let half = 0.5 * thickness;
    let edge = EDGE * half;
    let mut mask = Mask::empty(grid.len());
    let mut used = vec![false; planes.len()];
    for z in 0..grid.counts[2] {
        let z_mm = grid.origin_mm[2] + z as f64 * grid.spacing_mm[2];
        // Of two slabs that touch, the lower has the slice between: it is closed above its plane and open below.
        let above = planes.partition_point(|(plane_mm, _)| *plane_mm <= z_mm + edge);
        let lower = above.checked_sub(1).map(|p| (p, z_mm - planes[p].0)).filter(|(_, d)| *d <= half + edge);
        let upper = planes.get(above).map(|(plane_mm, _)| (above, plane_mm - z_mm));
        let upper = upper.filter(|(_, d)| *d < half - edge);
        let nearest = match (lower, upper) {
            (Some((_, below)), Some((p, over))) if over < below - edge => p,
            (Some((p, _)), _) | (None, Some((p, _))) => p,
            (None, None) => continue,
        };
        used[nearest] = true;
        fill(grid, z, &planes[nearest].1, &mut mask);
    }
    Rastered { mask, planes_unused: used.iter().filter(|used| !**used).count() }
}

/// Exchanges the voxels of a slice that are inside each contour.
fn fill(grid: &Grid, z: usize, plane: &[&Contour], mask: &mut Mask) {
    let [columns, rows, _] = grid.counts;
    let y_mm = |row: usize| grid.origin_mm[1] + row as f64 * grid.spacing_mm[1];
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); rows];
    for contour in plane {
        let after = contour.xy_mm.iter().cycle().skip(1);
        for (&[x0, y0], &[x1, y1]) in contour.xy_mm.iter().zip(after) {
            let (low, high) = (y0.min(y1), y0.max(y1));
            let row = |y: f64| ((y - grid.origin_mm[1]) / grid.spacing_mm[1]).clamp(0.0, rows as f64);
            let first = (libm::floor(row(low)) as usize).saturating_sub(1);
            for (row, crossings) in crossings.iter_mut().enumerate().skip(first) {
                let y = y_mm(row);
                if y > high {
                    break;
                }
                // Each edge has its lower end and not its upper: a corner is crossed once.
                if (y0 <= y) != (y1 <= y) {
                    crossings.push(x0 + (y - y0) / (y1 - y0) * (x1 - x0));
                }
            }
        }
    }
    for (row, crossings) in crossings.iter_mut().enumerate() {
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let column = |x: f64| {
                let place = libm::ceil((x - grid.origin_mm[0]) / grid.spacing_mm[0]);
                place.clamp(0.0, columns as f64) as usize
            };
            for x in column(pair[0])..column(pair[1]) {
                mask.toggle(grid.index([x, row, z]));
            }
        }
    }
}
