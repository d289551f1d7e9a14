//! How much of each voxel of a grid a structure takes.
//!
//! A structure is the union of its voxels of the image. A voxel of another grid is whole where all of it lies in them, else
//! at the border: then it counts with the boxes that it shares with the voxels of the image. Where the dose is steep, voxels
//! and boxes are divided, so that a histogram does not depend on where the planes of voxels happen to lie.

use crate::metrics::{Dvh, DvhError};
use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;

/// Parts of a voxel below which nothing of it counts, and above which all of it does.
const ROUNDING: f64 = 1e-9;
/// A voxel or box across which the dose changes by more than this is divided, gray.
const STEEP_GY: f64 = 0.5;
/// Most parts of a voxel or box along an axis.
const MOST_PARTS: f64 = 6.0;
/// Width of a bin of a histogram, gray, unless that would take more than [`MOST_BINS`].
const BIN_GY: f64 = 0.01;
const MOST_BINS: f64 = 65_536.0;
/// Dose between voxels, over the largest at their centres, for which there are bins; what is above shares the last.
const OVERSHOOT: f32 = 1.25;
/// Part of a bin's volume that stands for its least dose, and for its largest.
const END_OF_BIN: f64 = 1e-6;

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

    /// Volume of what the grid meets of it, cm3.
    pub fn volume_cm3(&self, grid: &Grid) -> f64 {
        let border: f64 = self.border.iter().map(|border| border.part).sum();
        (self.whole.len() as f64 + border) * grid.voxel_cm3()
    }

    /// Whether the grid meets nothing of it.
    pub fn is_empty(&self) -> bool {
        self.whole.is_empty() && self.border.is_empty()
    }

    /// The histogram of a dose (gray), volumes in cm3: of the centre of each whole voxel and of each box of a border, or of
    /// the parts into which those are divided, by parabolas through three centres of voxels along each axis. Doses that are
    /// nearer to each other than 0.01 Gy are one step at their mean.
    pub fn histogram(&self, grid: &Grid, gray: &[f32]) -> Result<Dvh, DvhError> {
        let mut bins = Bins::up_to(OVERSHOOT * gray.iter().copied().fold(0.0, f32::max));
        let voxel_cm3 = grid.voxel_cm3();
        for voxel in &self.whole {
            Near::new(grid, gray, *voxel).add(&mut bins, [0.0; 3], [1.0; 3], voxel_cm3);
        }
        for border in &self.border {
            let centre = grid.centre_mm(grid.voxel(border.voxel as usize));
            let offset =
                std::array::from_fn(|axis| (border.at_mm[axis] - centre[axis]) / grid.spacing_mm[axis]);
            let near = Near::new(grid, gray, border.voxel);
            near.add(&mut bins, offset, border.width, border.part * voxel_cm3);
        }
        bins.histogram()
    }
}

/// A voxel of a dose and those around it, whose places along an axis are those at the end of the grid beyond it.
struct Near<'a> {
    grid: &'a Grid,
    gray: &'a [f32],
    place: [usize; 3],
    /// Places before, at and after it along each axis.
    neighbour: [[usize; 3]; 3],
}

impl<'a> Near<'a> {
    fn new(grid: &'a Grid, gray: &'a [f32], voxel: u32) -> Self {
        let place = grid.voxel(voxel as usize);
        let neighbour = std::array::from_fn(|axis| {
            let at: usize = place[axis];
            [at.saturating_sub(1), at, (at + 1).min(grid.counts[axis] - 1)]
        });
        Self { grid, gray, place, neighbour }
    }

    fn dose(&self, place: [usize; 3]) -> f64 {
        f64::from(self.gray.get(self.grid.index(place)).copied().unwrap_or_default())
    }

    /// Adds a box, whole or in parts. Its offset from the centre and its width are parts of the voxel's width.
    fn add(&self, bins: &mut Bins, offset: [f64; 3], width: [f64; 3], cm3: f64) {
        let parts = self.parts(width);
        if parts == [1; 3] && offset == [0.0; 3] {
            bins.add(self.dose(self.place), cm3);
            return;
        }
        let mut around = [[[0.0; 3]; 3]; 3];
        for (z, plane) in self.neighbour[2].iter().zip(&mut around) {
            for (y, row) in self.neighbour[1].iter().zip(plane) {
                for (x, dose) in self.neighbour[0].iter().zip(row) {
                    *dose = self.dose([*x, *y, *z]);
                }
            }
        }
        let cm3 = cm3 / parts.iter().product::<usize>() as f64;
        let between = |axis: usize, part: usize, doses: [f64; 3]| {
            let [before, at, after] = self.neighbour[axis];
            let along = offset[axis] + ((part as f64 + 0.5) / parts[axis] as f64 - 0.5) * width[axis];
            if before < at && at < after { parabola(along, doses) } else { line(along, doses) }
        };
        for z in 0..parts[2] {
            let mut plane = [[0.0; 3]; 3];
            for (y, row) in plane.iter_mut().enumerate() {
                for (x, dose) in row.iter_mut().enumerate() {
                    *dose = between(2, z, [around[0][y][x], around[1][y][x], around[2][y][x]]);
                }
            }
            for y in 0..parts[1] {
                let mut row = [0.0; 3];
                for (x, dose) in row.iter_mut().enumerate() {
                    *dose = between(1, y, [plane[0][x], plane[1][x], plane[2][x]]);
                }
                for x in 0..parts[0] {
                    bins.add(between(0, x, row), cm3);
                }
            }
        }
    }

    /// Into how many parts along each axis a box of this width is divided. Where a neighbour has no dose the patient ends,
    /// and nothing is divided along that axis.
    fn parts(&self, width: [f64; 3]) -> [usize; 3] {
        let own = self.dose(self.place);
        std::array::from_fn(|axis| {
            let [before, at, after] = self.neighbour[axis];
            if before == at || after == at {
                return 1;
            }
            let [before, after] = [before, after].map(|along| {
                let mut place = self.place;
                place[axis] = along;
                self.dose(place)
            });
            if !(before > 0.0 && after > 0.0) {
                return 1;
            }
            let across = 0.5 * ((before - own).abs() + (after - own).abs()) * width[axis];
            (across / STEEP_GY).ceil().clamp(1.0, MOST_PARTS) as usize
        })
    }
}

/// Between the doses before, at and after a centre, at most half a width from it. Straight lines would be above a dose that
/// curves upwards everywhere, as it does in an organ between two parts of a target: with voxels of 2 mm, 0.1 Gy.
fn parabola(offset: f64, doses: [f64; 3]) -> f64 {
    let [before, at, after] = doses;
    if before <= 0.0 || after <= 0.0 {
        return line(offset, doses);
    }
    let (slope, bend) = (0.5 * (after - before), before - 2.0 * at + after);
    (at + offset * (slope + 0.5 * offset * bend)).max(0.0)
}

/// The same by straight lines: at the end of the grid, and beside voxels without a dose.
fn line(offset: f64, [before, at, after]: [f64; 3]) -> f64 {
    let part = offset.abs();
    at * (1.0 - part) + if offset < 0.0 { before } else { after } * part
}

/// Volumes by dose, so that millions of parts need neither be kept nor sorted.
struct Bins {
    width_gy: f64,
    bins: Vec<Bin>,
}

#[derive(Clone, Copy)]
struct Bin {
    cm3: f64,
    gray_cm3: f64,
    least: f64,
    most: f64,
}

impl Bins {
    fn up_to(largest: f32) -> Self {
        let width_gy = (f64::from(largest) / MOST_BINS).max(BIN_GY);
        let empty = Bin { cm3: 0.0, gray_cm3: 0.0, least: f64::INFINITY, most: f64::NEG_INFINITY };
        Self { width_gy, bins: vec![empty; (f64::from(largest) / width_gy) as usize + 2] }
    }

    fn add(&mut self, gray: f64, cm3: f64) {
        let last = self.bins.len() - 1;
        let bin = &mut self.bins[((gray / self.width_gy) as usize).min(last)];
        bin.cm3 += cm3;
        bin.gray_cm3 += gray * cm3;
        bin.least = bin.least.min(gray);
        bin.most = bin.most.max(gray);
    }

    /// A bin is three steps, nearly all of it at its mean, so that doses between bins are where the bins meet.
    fn histogram(&self) -> Result<Dvh, DvhError> {
        let steps = |bin: &Bin| {
            // An even dose stays what it is, however its mean is rounded.
            let mean = (bin.gray_cm3 / bin.cm3).max(bin.least).min(bin.most);
            let end = END_OF_BIN * bin.cm3;
            [(bin.least, end), (mean, bin.cm3 - 2.0 * end), (bin.most, end)]
        };
        let filled = self.bins.iter().filter(|bin| bin.cm3 > 0.0);
        let (doses, volumes): (Vec<f64>, Vec<f64>) = filled.flat_map(steps).unzip();
        Dvh::weighted(&doses, &volumes)
    }
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
            Occupancy::of(&grid, &image, &mask).histogram(&grid, &gray).unwrap().volume_at(40.0)
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

    #[test]
    fn a_histogram_is_that_of_the_doses_between_the_centres_of_voxels() {
        let image = Grid { counts: [6; 3], spacing_mm: [2.5; 3], origin_mm: [1.0; 3] };
        let mask = Mask::from_fn(216, |i| (i * 7) % 11 < 8);
        let grid = Grid { counts: [11; 3], spacing_mm: [2.0; 3], origin_mm: [-3.7; 3] };
        let curved = |[x, y, z]: [f64; 3]| {
            1.0 + 0.09 * (x - 5.0).powi(2)
                + 0.08 * (y - 7.0).powi(2)
                + 0.07 * (z - 6.0).powi(2)
                + 0.02 * x * y
        };
        let gray: Vec<f32> = (0..grid.len()).map(|i| curved(grid.centre_mm(grid.voxel(i))) as f32).collect();
        let found = Occupancy::of(&grid, &image, &mask);
        let dvh = found.histogram(&grid, &gray).unwrap();
        let (mut sum, mut volume, mut above) = (0.0, 0.0, 0.0);
        let mut add = |at_mm: [f64; 3], width: [f64; 3], parts: [usize; 3], cm3: f64| {
            let count = parts.iter().product::<usize>();
            for i in 0..count {
                let place = [i % parts[0], i / parts[0] % parts[1], i / (parts[0] * parts[1])];
                let dose = curved([0, 1, 2].map(|axis: usize| {
                    at_mm[axis]
                        + ((place[axis] as f64 + 0.5) / parts[axis] as f64 - 0.5)
                            * width[axis]
                            * grid.spacing_mm[axis]
                }));
                sum += dose * cm3 / count as f64;
                volume += cm3 / count as f64;
                above += if dose >= 8.0 { cm3 / count as f64 } else { 0.0 };
            }
        };
        for voxel in &found.whole {
            let parts = Near::new(&grid, &gray, *voxel).parts([1.0; 3]);
            add(grid.centre_mm(grid.voxel(*voxel as usize)), [1.0; 3], parts, grid.voxel_cm3());
        }
        for b in &found.border {
            let parts = Near::new(&grid, &gray, b.voxel).parts(b.width);
            add(b.at_mm, b.width, parts, b.part * grid.voxel_cm3());
        }
        assert!((dvh.volume() - volume).abs() < 1e-9);
        assert!((dvh.mean() - sum / volume).abs() < 1e-5, "{} {}", dvh.mean(), sum / volume);
        assert!(
            (dvh.volume_at(8.0) - above / volume).abs() < 2e-3,
            "{} {}",
            dvh.volume_at(8.0),
            above / volume
        );
    }

    /// A round organ within a target: by straight lines between voxels of 2 mm 1.3 % too much of it got 10 Gy.
    #[test]
    fn a_dose_that_curves_upwards_gives_the_same_volumes_on_voxels_of_any_width() {
        let image = Grid { counts: [40, 40, 8], spacing_mm: [1.0; 3], origin_mm: [-19.5, -19.5, 0.5] };
        let from_axis = |[x, y, _]: [f64; 3]| libm::hypot(x, y);
        let mask = Mask::from_fn(image.len(), |i| from_axis(image.centre_mm(image.voxel(i))) < 10.0);
        let part_above_10 = |spacing_mm: f64, shift_mm: f64| {
            let counts = [48.0, 48.0, 16.0].map(|mm| (mm / spacing_mm) as usize);
            let origin_mm = [shift_mm - 23.0, 0.4 * shift_mm - 23.0, -3.0];
            let grid = Grid { counts, spacing_mm: [spacing_mm; 3], origin_mm };
            let dose = |i| (5.0 + 0.2 * from_axis(grid.centre_mm(grid.voxel(i))).powi(2)) as f32;
            let gray: Vec<f32> = (0..grid.len()).map(dose).collect();
            Occupancy::of(&grid, &image, &mask).histogram(&grid, &gray).unwrap().volume_at(10.0)
        };
        // Outside of a radius of 5 mm.
        let columns = (0..1600).filter(|i| mask.contains(*i)).count() as f64;
        let expected = 1.0 - std::f64::consts::PI * 25.0 / columns;
        for (spacing_mm, shift_mm) in [(2.0, 0.0), (2.0, 0.7), (1.5, 0.3), (1.0, 0.2)] {
            let found = part_above_10(spacing_mm, shift_mm);
            assert!((found - expected).abs() < 0.004, "{spacing_mm} {shift_mm}: {found}, not {expected}");
        }
    }

    #[test]
    fn a_large_even_part_shifts_no_dose_of_the_rest() {
        // A quarter gets nothing, a half 70 Gy; from the one to the other it rises evenly.
        let grid = Grid { counts: [1, 1, 400], spacing_mm: [2.0; 3], origin_mm: [0.0; 3] };
        let all = Occupancy::of(&grid, &grid, &Mask::from_fn(400, |_| true));
        let dose = |i: usize| ((i as f32 - 99.5) * 0.7).clamp(0.0, 70.0);
        let dvh = all.histogram(&grid, &(0..400).map(dose).collect::<Vec<f32>>()).unwrap();
        for (percent, dose) in
            [(99.0, 0.0), (80.0, 0.0), (62.5, 35.0), (51.0, 67.2), (49.0, 70.0), (2.0, 70.0)]
        {
            assert!((dvh.dose_at(percent) - dose).abs() < 0.4, "D{percent}: {}", dvh.dose_at(percent));
        }
    }

    #[test]
    fn an_even_dose_is_not_rounded_and_what_is_no_dose_makes_no_histogram() {
        let grid = Grid { counts: [3; 3], spacing_mm: [2.0; 3], origin_mm: [0.0; 3] };
        let all = Occupancy::of(&grid, &grid, &Mask::from_fn(27, |_| true));
        let even = all.histogram(&grid, &[70.3; 27]).unwrap();
        assert_eq!(
            (even.min(), even.max(), even.volume_at(f64::from(70.3_f32))),
            (70.3_f32.into(), 70.3_f32.into(), 1.0)
        );
        for wrong in [f32::NAN, f32::INFINITY] {
            assert!(all.histogram(&grid, &[wrong; 27]).is_err());
        }
        assert!(all.histogram(&grid, &[1e30; 27]).is_ok());
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
            let whole = found.histogram(&grid, &vec![1.0; grid.len()]).map_or(0.0, |dvh| dvh.volume());
            prop_assert!((whole - mask.count() as f64 * image.voxel_cm3()).abs() < 1e-9, "{whole}");
        }
    }
}
