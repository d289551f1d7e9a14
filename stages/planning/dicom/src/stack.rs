//! Images that are unevenly spaced or of a tilted gantry, as slices across the patient.
//!
//! Along the stack a point has a *place*: 0 on the first image, 1 on the second, between them in proportion. A tilted image
//! rises along z with y, so that all of it is on one plane `z - tilt y`. Contours are filled in the stack, where they are on
//! the images that they were drawn on, and the voxels then take the nearest image.

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;

use crate::raster::{Contour, Rastered, rasterise};
use crate::slice::{AIR_HU, Slice};

/// Rows with values above this hold the patient, HU.
const BODY_HU: i16 = -300;
/// Contours this far from every image, as a part of the distance of its neighbours, were not drawn on the images.
const OFF: f64 = 0.25;
/// A place is on an image, and a row on a row, if they are this close, as a part of their distance.
const NEAR: f64 = 1e-6;

/// Images as they were taken, rising along the patient.
#[derive(Clone, Debug, PartialEq)]
pub struct Stack {
    /// Where the images cross `y = 0`, mm.
    planes_mm: Vec<f64>,
    /// How far an image rises along z for each mm along y.
    tilt: f64,
    /// Columns and rows of the volume; its third axis counts images, one median distance for each.
    grid: Grid,
}

impl Stack {
    /// The stack of at least two images, whose median distance is `step_mm`.
    pub(crate) fn of(images: &[&Slice], step_mm: f64) -> Self {
        let first = images[0];
        let corners = images.iter().map(|image| image.position_mm[1]);
        let (low, high) = corners.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(y), h.max(y)));
        let [dx, dy] = first.spacing_mm;
        let more = ((high - low) / dy - NEAR).ceil().max(0.0) as usize;
        Self {
            planes_mm: images.iter().map(|image| image.plane_mm()).collect(),
            tilt: first.tilt,
            grid: Grid {
                counts: [first.counts[0], first.counts[1] + more, images.len()],
                spacing_mm: [dx, dy, step_mm],
                origin_mm: [first.position_mm[0], low, 0.0],
            },
        }
    }

    /// The largest distance of two neighbours, mm.
    pub(crate) fn widest_mm(&self) -> f64 {
        self.planes_mm.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
    }

    /// The slices across the patient that the images cover in all rows that hold something; at least two, else `None`.
    pub(crate) fn across(&self, images: &[&Slice]) -> Option<Grid> {
        let rows = self.grid.counts[1];
        let holds = |row: &usize| {
            let y_mm = self.y_mm(*row);
            images.iter().any(|image| {
                let row = ((y_mm - image.position_mm[1]) / image.spacing_mm[1]).round();
                row >= 0.0 && values(image, row as usize).is_some_and(|hu| hu.iter().any(|&v| v > BODY_HU))
            })
        };
        let (front, back) = ((0..rows).find(holds).unwrap_or(0), (0..rows).rfind(holds).unwrap_or(rows - 1));
        let rises = [front, back].map(|row| self.tilt * self.y_mm(row));
        let low_mm = self.planes_mm.first()? + rises[0].max(rises[1]);
        let high_mm = self.planes_mm.last()? + rises[0].min(rises[1]);
        let steps = ((high_mm - low_mm) / self.grid.spacing_mm[2] + NEAR).floor();
        if steps < 1.0 {
            return None;
        }
        let Grid { counts: [columns, rows, _], spacing_mm: [dx, dy, _], origin_mm: [x, y, _] } = self.grid;
        Some(Grid {
            counts: [columns, rows, steps as usize + 1],
            spacing_mm: [dx, dy, (high_mm - low_mm) / steps],
            origin_mm: [x, y, low_mm],
        })
    }

    /// The values of these slices, linear between images and between rows; air where there is no image.
    pub(crate) fn resample(&self, images: &[&Slice], grid: &Grid) -> Vec<i16> {
        let [columns, rows, slices] = grid.counts;
        let mut hu = Vec::with_capacity(grid.len());
        let mut sums = vec![0.0; columns];
        for slice in 0..slices {
            for row in 0..rows {
                let y_mm = self.y_mm(row);
                let place = self.place(z_mm(grid, slice) - self.tilt * y_mm);
                let last = (images.len() - 1) as f64;
                if !(-NEAR..=last + NEAR).contains(&place) {
                    hu.extend(std::iter::repeat_n(AIR_HU, columns));
                    continue;
                }
                sums.fill(0.0);
                for (image, weight) in between(place.clamp(0.0, last)) {
                    if let (Some(image), true) = (images.get(image), weight > 0.0) {
                        add_row(image, y_mm, weight, &mut sums);
                    }
                }
                hu.extend(sums.iter().map(|sum| sum.round() as i16));
            }
        }
        hu
    }

    /// The voxels of a volume that are inside these contours, whose planes are where they cross `y = 0`.
    pub(crate) fn rasterise(&self, contours: &[Contour], grid: &Grid) -> Rastered {
        let is_off = |c: &Contour| {
            let place = self.place(c.z_mm);
            (place - place.round()).abs() > OFF
        };
        match contours.iter().any(is_off) {
            true => self.even().fill(contours, grid),
            false => self.fill(contours, grid),
        }
    }

    /// As many images from the first to the last, evenly spaced, as there would be without gaps.
    fn even(&self) -> Self {
        let (first, last) = (self.planes_mm[0], self.planes_mm[self.planes_mm.len() - 1]);
        let steps = ((last - first) / self.grid.spacing_mm[2]).round().max(1.0);
        let mut grid = self.grid;
        grid.counts[2] = steps as usize + 1;
        grid.spacing_mm[2] = (last - first) / steps;
        let planes_mm = (0..grid.counts[2]).map(|i| first + i as f64 * grid.spacing_mm[2]).collect();
        Self { planes_mm, tilt: self.tilt, grid }
    }

    fn fill(&self, contours: &[Contour], grid: &Grid) -> Rastered {
        let step_mm = self.grid.spacing_mm[2];
        let on_images: Vec<Contour> =
            contours.iter().map(|c| Contour { z_mm: self.place(c.z_mm) * step_mm, ..c.clone() }).collect();
        let Rastered { mask: taken, mut drawn } = rasterise(&self.grid, &on_images);
        let [columns, rows, images] = self.grid.counts;
        let mut mask = Mask::empty(grid.len());
        let row_of = |row: usize, slice: usize| columns * (row + rows * slice);
        for slice in 0..grid.counts[2] {
            for row in 0..rows {
                let place = self.place(z_mm(grid, slice) - self.tilt * self.y_mm(row)).round();
                if !(0.0..images as f64).contains(&place) {
                    continue;
                }
                let (from, to) = (row_of(row, place as usize), row_of(row, slice));
                (0..columns).filter(|c| taken.contains(from + c)).for_each(|c| mask.insert(to + c));
            }
        }
        drawn.mask_cm3 = mask.count() as f64 * grid.voxel_cm3();
        // Slices across the patient do not reach the corners of tilted images.
        let half_mm = 0.5 * grid.spacing_mm[2];
        let ends_mm = [z_mm(grid, 0) - half_mm, z_mm(grid, grid.counts[2] - 1) + half_mm];
        for image in 0..images {
            for row in 0..rows {
                let z_mm = self.planes_mm[image] + self.tilt * self.y_mm(row);
                let beyond = [ends_mm[0] - z_mm, z_mm - ends_mm[1]];
                if beyond.iter().all(|&mm| mm <= NEAR) {
                    continue;
                }
                let lost = (0..columns).filter(|c| taken.contains(row_of(row, image) + c)).count();
                if lost > 0 {
                    drawn.beyond.volume_cm3 += lost as f64 * self.grid.voxel_cm3();
                    drawn.beyond.low_mm = drawn.beyond.low_mm.max(beyond[0]);
                    drawn.beyond.high_mm = drawn.beyond.high_mm.max(beyond[1]);
                }
            }
        }
        let middle_mm = self.tilt * self.y_mm(rows / 2);
        drawn.gaps_mm.iter_mut().flatten().for_each(|mm| *mm = self.plane_mm(*mm / step_mm) + middle_mm);
        Rastered { mask, drawn }
    }

    fn y_mm(&self, row: usize) -> f64 {
        self.grid.origin_mm[1] + row as f64 * self.grid.spacing_mm[1]
    }

    /// The place of a plane among the images; beyond the ends as between the last two.
    fn place(&self, plane_mm: f64) -> f64 {
        let above =
            self.planes_mm.partition_point(|&image| image <= plane_mm).clamp(1, self.planes_mm.len() - 1);
        let [lower, upper] = [self.planes_mm[above - 1], self.planes_mm[above]];
        (above - 1) as f64 + (plane_mm - lower) / (upper - lower)
    }

    /// The plane at this place.
    fn plane_mm(&self, place: f64) -> f64 {
        let below = (place.max(0.0) as usize).min(self.planes_mm.len() - 2);
        let [lower, upper] = [self.planes_mm[below], self.planes_mm[below + 1]];
        lower + (place - below as f64) * (upper - lower)
    }
}

fn z_mm(grid: &Grid, slice: usize) -> f64 {
    grid.origin_mm[2] + slice as f64 * grid.spacing_mm[2]
}

/// The two neighbours of a place, with their weights.
fn between(place: f64) -> [(usize, f64); 2] {
    let below = (place + NEAR).floor();
    let part = (place - below).max(0.0);
    [(below as usize, 1.0 - part), (below as usize + 1, part)]
}

/// A row of an image, if it has one there.
fn values(image: &Slice, row: usize) -> Option<&[i16]> {
    let columns = image.counts[0];
    image.hu.get(row.checked_mul(columns)?..(row + 1).checked_mul(columns)?)
}

/// Adds the values of an image at this y, linear between its rows; air beyond them.
fn add_row(image: &Slice, y_mm: f64, weight: f64, sums: &mut [f64]) {
    // One more row on each side, of air, keeps places positive.
    let place = ((y_mm - image.position_mm[1]) / image.spacing_mm[1] + 1.0).max(0.0);
    for (row, part) in between(place) {
        if part == 0.0 {
            continue;
        }
        match row.checked_sub(1).and_then(|row| values(image, row)) {
            Some(hu) => sums.iter_mut().zip(hu).for_each(|(sum, &hu)| *sum += weight * part * f64::from(hu)),
            None => sums.iter_mut().for_each(|sum| *sum += weight * part * f64::from(AIR_HU)),
        }
    }
}
