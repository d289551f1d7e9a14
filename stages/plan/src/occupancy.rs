//! How much of each voxel of a grid a structure takes.
//!
//! A structure is the union of its voxels of the image. A voxel of another grid is whole where all of it lies in them, else
//! at the border: then it counts with the boxes that it shares with the voxels of the image. Where the dose is steep, voxels
//! and boxes are divided, so that a histogram does not depend on where the planes of voxels happen to lie.

use crate::Grid;
use crate::case::Mask;

/// Parts of a voxel below which nothing of it counts, and above which all of it does.
const ROUNDING: f64 = 1e-9;
/// A voxel or box across which the dose changes by more than this is divided, gray.
const STEEP_GY: f64 = 0.5;
/// Most parts of a voxel or box along an axis.
const MOST_PARTS: f64 = 6.0;

/// The voxels of a grid that a structure takes, wholly or in part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Occupancy {
    /// Voxels that lie in it wholly, rising.
    pub whole: Vec<u32>,
    /// Boxes of the voxels at its border, by voxel, rising.
    pub border: Vec<Border>,
}

/// A box that a voxel at the border of a structure shares with a voxel of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Border {
    /// The voxel.
    pub voxel: u32,
    /// Volume of the box, as a part of the voxel's.
    pub part: f64,
    /// Centre of the box, mm.
    pub at_mm: [f64; 3],
    /// Width of the box along each axis, as a part of the voxel's.
    pub width: [f64; 3],
}

/// Where a voxel of the grid and one of the image meet along an axis.
#[derive(Clone, Copy, Debug)]
struct Overlap {
    /// Voxel of the image.
    image: usize,
    /// Part of the grid's voxel.
    part: f64,
    middle_mm: f64,
}

impl Occupancy {
    /// Of a structure whose mask is on `image`.
    pub fn of(grid: &Grid, image: &Grid, mask: &Mask) -> Self {
        let mut found = Self::default();
        let mut extent = [[usize::MAX, 0]; 3];
        for voxel in mask.indices() {
            for (range, place) in extent.iter_mut().zip(image.voxel(voxel)) {
                *range = [range[0].min(place), range[1].max(place)];
            }
        }
        let axes: [Vec<Vec<Overlap>>; 3] =
            std::array::from_fn(|axis| overlaps(grid, image, axis, extent[axis]));
        for z in (0..grid.counts[2]).filter(|z| !axes[2][*z].is_empty()) {
            for y in (0..grid.counts[1]).filter(|y| !axes[1][*y].is_empty()) {
                for x in (0..grid.counts[0]).filter(|x| !axes[0][*x].is_empty()) {
                    let voxel = grid.index([x, y, z]) as u32;
                    let (first, mut part) = (found.border.len(), 0.0);
                    for c in &axes[2][z] {
                        for b in &axes[1][y] {
                            for a in &axes[0][x] {
                                if mask.contains(image.index([a.image, b.image, c.image])) {
                                    let shared = a.part * b.part * c.part;
                                    part += shared;
                                    let at_mm = [a.middle_mm, b.middle_mm, c.middle_mm];
                                    let width = [a.part, b.part, c.part];
                                    found.border.push(Border { voxel, part: shared, at_mm, width });
                                }
                            }
                        }
                    }
                    if part >= 1.0 - ROUNDING {
                        found.border.truncate(first);
                        found.whole.push(voxel);
                    }
                }
            }
        }
        found
    }

    /// All its voxels, rising.
    pub fn voxels(&self) -> Vec<u32> {
        let mut all: Vec<u32> =
            self.whole.iter().copied().chain(self.border.iter().map(|b| b.voxel)).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Whether the grid meets nothing of it.
    pub fn is_empty(&self) -> bool {
        self.whole.is_empty() && self.border.is_empty()
    }

    /// Doses of its parts (gray) with their volumes (cm3): at the centre of each whole voxel and of each box of a border, or
    /// of the parts into which those are divided; linear between the centres of voxels.
    pub fn doses(&self, grid: &Grid, gray: &[f32]) -> (Vec<f64>, Vec<f64>) {
        let (mut doses, mut volumes) = (Vec::new(), Vec::new());
        let voxel_cm3 = grid.voxel_cm3();
        let mut add = |voxel: u32, at_mm: [f64; 3], width: [f64; 3], part: f64| {
            let parts = parts(grid, gray, voxel as usize, width);
            let count = parts.iter().product::<usize>() as f64;
            let along = |axis: usize, i: usize| {
                let place = (i as f64 + 0.5) / parts[axis] as f64 - 0.5;
                at_mm[axis] + place * width[axis] * grid.spacing_mm[axis]
            };
            for z in 0..parts[2] {
                for y in 0..parts[1] {
                    for x in 0..parts[0] {
                        let at = [along(0, x), along(1, y), along(2, z)];
                        doses.push(f64::from(grid.value_at(gray, at)));
                        volumes.push(part * voxel_cm3 / count);
                    }
                }
            }
        };
        for voxel in &self.whole {
            add(*voxel, grid.centre_mm(grid.voxel(*voxel as usize)), [1.0; 3], 1.0);
        }
        for border in &self.border {
            add(border.voxel, border.at_mm, border.width, border.part);
        }
        (doses, volumes)
    }
}

/// Into how many parts along each axis a box of this width in a voxel is divided. Where a neighbour has no dose the patient
/// ends, and nothing is divided along that axis.
fn parts(grid: &Grid, gray: &[f32], voxel: usize, width: [f64; 3]) -> [usize; 3] {
    let place = grid.voxel(voxel);
    let own = gray.get(voxel).copied().unwrap_or_default();
    std::array::from_fn(|axis| {
        let beside = |along: Option<usize>| {
            let mut neighbour = place;
            neighbour[axis] = along.filter(|along| *along < grid.counts[axis])?;
            gray.get(grid.index(neighbour)).filter(|dose| **dose > 0.0)
        };
        let (Some(before), Some(after)) = (beside(place[axis].checked_sub(1)), beside(Some(place[axis] + 1)))
        else {
            return 1;
        };
        let across = 0.5 * f64::from((before - own).abs() + (after - own).abs()) * width[axis];
        (across / STEEP_GY).ceil().clamp(1.0, MOST_PARTS) as usize
    })
}

/// For each voxel of the grid along an axis, the voxels of the image from the first to the last of `extent` that it meets.
fn overlaps(grid: &Grid, image: &Grid, axis: usize, extent: [usize; 2]) -> Vec<Vec<Overlap>> {
    let (width, image_width) = (grid.spacing_mm[axis], image.spacing_mm[axis]);
    let of = |i: usize| {
        let low = grid.origin_mm[axis] + (i as f64 - 0.5) * width;
        let first = image.origin_mm[axis] - 0.5 * image_width;
        let place = |mm: f64| ((mm - first) / image_width).floor();
        let (from, to) = (place(low).max(extent[0] as f64), place(low + width).min(extent[1] as f64));
        if extent[0] > extent[1] || from > to {
            return Vec::new();
        }
        let with = |image: usize| {
            let begin = low.max(first + image as f64 * image_width);
            let end = (low + width).min(first + (image + 1) as f64 * image_width);
            Overlap { image, part: (end - begin) / width, middle_mm: 0.5 * (begin + end) }
        };
        (from as usize..=to as usize).map(with).filter(|overlap| overlap.part > ROUNDING).collect()
    };
    (0..grid.counts[axis]).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_voxel_at_the_border_has_the_part_and_the_place_that_are_in_the_structure() {
        let image = Grid { counts: [4, 1, 1], spacing_mm: [3.0, 3.0, 3.0], origin_mm: [0.0; 3] };
        let mask = Mask::from_fn(4, |i| i == 1 || i == 2);
        // The structure runs from 1.5 mm to 7.5 mm; voxels of 2 mm have their borders at -1, 1, 3, 5, 7 and 9 mm.
        let grid = Grid { counts: [5, 1, 1], spacing_mm: [2.0, 3.0, 3.0], origin_mm: [0.0; 3] };
        let found = Occupancy::of(&grid, &image, &mask);
        assert_eq!(found.whole, [2, 3]);
        let border: Vec<(u32, f64, f64)> =
            found.border.iter().map(|b| (b.voxel, b.part, b.at_mm[0])).collect();
        assert_eq!(border, [(1, 0.75, 2.25), (4, 0.25, 7.25)]);
        assert_eq!(found.voxels(), [1, 2, 3, 4]);
    }

    #[test]
    fn a_steep_dose_gives_the_same_volumes_wherever_the_planes_of_voxels_lie() {
        let image = Grid { counts: [20; 3], spacing_mm: [2.0; 3], origin_mm: [0.0; 3] };
        let mask = Mask::from_fn(8000, |i| image.voxel(i)[1] >= 4);
        // 40 Gy at 10 mm, 5 Gy a millimetre.
        let part_above_40 = |origin: f64| {
            let grid =
                Grid { counts: [20, 19, 20], spacing_mm: [2.0, 2.2, 2.0], origin_mm: [0.0, origin, 0.0] };
            let dose = |i| (90.0 - 5.0 * grid.centre_mm(grid.voxel(i))[1]).max(1.0) as f32;
            let gray: Vec<f32> = (0..grid.len()).map(dose).collect();
            let (doses, volumes) = Occupancy::of(&grid, &image, &mask).doses(&grid, &gray);
            let above: f64 =
                doses.iter().zip(&volumes).filter(|(dose, _)| **dose >= 40.0).map(|(_, v)| v).sum();
            above / volumes.iter().sum::<f64>()
        };
        // Of 32 mm the 3 mm from 7 to 10 get as much.
        for origin in [0.0, 0.3, 0.7, 1.1, 1.6] {
            assert!(
                (part_above_40(origin) - 3.0 / 32.0).abs() < 0.006,
                "{origin}: {}",
                part_above_40(origin)
            );
        }
    }

    proptest! {
        #[test]
        fn parts_add_up_to_the_volume_of_the_structure(
            bits in prop::collection::vec(any::<bool>(), 60), spacing_mm in prop::array::uniform3(0.7..4.0_f64),
            origin in -1.0..1.0_f64,
        ) {
            let image = Grid { counts: [3, 4, 5], spacing_mm: [3.0, 2.0, 2.5], origin_mm: [1.0, 2.0, 3.0] };
            let mask = Mask::from_fn(60, |i| bits[i]);
            let grid = Grid { counts: [40; 3], spacing_mm, origin_mm: [origin - 3.0; 3] };
            let found = Occupancy::of(&grid, &image, &mask);
            let (_, volumes) = found.doses(&grid, &vec![1.0; grid.len()]);
            let whole: f64 = volumes.iter().sum();
            prop_assert!((whole - mask.count() as f64 * image.voxel_cm3()).abs() < 1e-9, "{whole}");
        }
    }
}
