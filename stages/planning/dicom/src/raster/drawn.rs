//! The volume as drawn, and how the mask differs from it.

use stillpoint_patient::Grid;

use super::plane::Plane;
use super::slabs::Slabs;
use super::spans::length;

/// Rows for the area of a plane.
const ROWS: std::ops::RangeInclusive<usize> = 64..=1024;
/// Overlaps below this are rounding, mm2.
const LEAST_SHARED_MM2: f64 = 0.1;

/// The volume of a structure's contours, and how they lie.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawn {
    /// Volume of the mask, cm3.
    pub mask_cm3: f64,
    /// Volume of the slabs, inside the images and beyond, cm3.
    pub drawn_cm3: f64,
    /// The part of it beyond the images.
    pub beyond: Beyond,
    /// Whether contours lie on the first or the last image.
    pub reaches_the_end: bool,
    /// Volume if all contours of a plane were combined by exclusive or, cm3.
    pub exclusive_cm3: f64,
    /// Contours that repeat another and do not count.
    pub repeated: usize,
    /// Planes on which contours overlap and are united.
    pub overlapping: usize,
    /// Planes inside the images that no slice takes.
    pub skipped: usize,
    /// Median distance of the planes, mm; infinite where there is one.
    pub distance_mm: f64,
    /// Thickness of a slab, mm.
    pub thickness_mm: f64,
    /// Volume if each contour stood for a slice, cm3.
    pub slices_cm3: f64,
    /// Volume if each contour reached to the middle between planes, cm3.
    pub filled_cm3: f64,
    /// From where to where there is no contour, mm.
    pub gaps_mm: Vec<[f64; 2]>,
}

/// The part of a structure that lies beyond the images.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Beyond {
    /// Its volume, cm3.
    pub volume_cm3: f64,
    /// How far contours lie beyond the lowest image, mm.
    pub low_mm: f64,
    /// How far contours lie beyond the highest image, mm.
    pub high_mm: f64,
    /// How much of it lies beside the images, cm3.
    pub aside_cm3: f64,
}

impl Drawn {
    /// Both of two parts that lie apart. The distance is that of the part whose planes are farther apart.
    pub(super) fn with(mut self, other: Self) -> Self {
        let is_farther = other.distance_mm.is_finite()
            && (!self.distance_mm.is_finite() || other.distance_mm > self.distance_mm);
        if is_farther {
            (self.distance_mm, self.thickness_mm) = (other.distance_mm, other.thickness_mm);
        }
        self.drawn_cm3 += other.drawn_cm3;
        self.exclusive_cm3 += other.exclusive_cm3;
        self.slices_cm3 += other.slices_cm3;
        self.filled_cm3 += other.filled_cm3;
        self.beyond.volume_cm3 += other.beyond.volume_cm3;
        self.beyond.aside_cm3 += other.beyond.aside_cm3;
        self.beyond.low_mm = self.beyond.low_mm.max(other.beyond.low_mm);
        self.beyond.high_mm = self.beyond.high_mm.max(other.beyond.high_mm);
        self.reaches_the_end |= other.reaches_the_end;
        self.repeated += other.repeated;
        self.overlapping += other.overlapping;
        self.skipped += other.skipped;
        self.gaps_mm.extend(other.gaps_mm);
        self.gaps_mm.sort_by(|a, b| a[0].total_cmp(&b[0]));
        self
    }
}

/// Adds up the planes.
pub(super) struct Tally<'a> {
    slabs: &'a Slabs<'a>,
    slice_mm: f64,
    /// Edges of the images: along x, y and z.
    edges_mm: [[f64; 2]; 3],
    row_mm: f64,
    area_before_mm2: f64,
    drawn: Drawn,
}

impl<'a> Tally<'a> {
    pub fn new(grid: &Grid, slabs: &'a Slabs<'a>) -> Self {
        let edges_mm = [0, 1, 2].map(|axis| {
            let (first, step) = (grid.origin_mm[axis], grid.spacing_mm[axis]);
            [first - 0.5 * step, first + (grid.counts[axis] as f64 - 0.5) * step]
        });
        let drawn =
            Drawn { distance_mm: slabs.distance_mm, thickness_mm: slabs.thickness_mm, ..Drawn::default() };
        let [_, row_mm, slice_mm] = grid.spacing_mm;
        Self { slabs, slice_mm, edges_mm, row_mm, area_before_mm2: 0.0, drawn }
    }

    /// Adds the plane at this place; planes come in their order.
    pub fn add(&mut self, place: usize, plane: &Plane<'_>, is_used: bool) {
        let area = self.area(plane);
        let z_mm = self.slabs.planes[place].z_mm;
        let [from, to] = self.slabs.reach_mm(place);
        let drawn = &mut self.drawn;
        drawn.repeated += if plane.exclusive { 0 } else { plane.repeated };
        drawn.overlapping += usize::from(area.shared_mm2 > LEAST_SHARED_MM2);
        drawn.drawn_cm3 += area.mm2 * (to - from) / 1000.0;
        drawn.exclusive_cm3 += area.exclusive_mm2 * (to - from) / 1000.0;
        drawn.slices_cm3 += area.mm2 * self.slice_mm / 1000.0;
        drawn.filled_cm3 += area.mm2 * (to - from) / 1000.0;
        if let Some(before) = place.checked_sub(1)
            && self.slabs.gap_after(before)
        {
            let gap = [self.slabs.planes[before].z_mm, z_mm];
            let empty_mm = from - self.slabs.reach_mm(before)[1];
            drawn.filled_cm3 += 0.5 * (area.mm2 + self.area_before_mm2) * empty_mm / 1000.0;
            drawn.gaps_mm.push(gap);
        }
        self.area_before_mm2 = area.mm2;
        let [low, high] = self.edges_mm[2];
        let beyond = &mut drawn.beyond;
        if (low..=high).contains(&z_mm) {
            drawn.skipped += usize::from(!is_used && area.mm2 > 0.0);
            drawn.reaches_the_end |=
                area.mm2 > 0.0 && (z_mm < low + self.slice_mm || z_mm > high - self.slice_mm);
            beyond.aside_cm3 += area.aside_mm2 * (to - from) / 1000.0;
            beyond.volume_cm3 += area.aside_mm2 * (to - from) / 1000.0;
        } else if area.mm2 > 0.0 {
            beyond.low_mm = beyond.low_mm.max(low - z_mm);
            beyond.high_mm = beyond.high_mm.max(z_mm - high);
            let inside = (to.min(high) - from.max(low)).max(0.0);
            beyond.volume_cm3 += area.mm2 * (to - from - inside) / 1000.0;
        }
    }

    pub fn finish(self) -> Drawn {
        self.drawn
    }

    fn area(&self, plane: &Plane<'_>) -> Area {
        let mut area = Area::default();
        let Some([low, high]) = plane.bounds() else { return area };
        let height = high[1] - low[1];
        let count = (libm::ceil(height / self.row_mm).min(1e6) as usize).clamp(*ROWS.start(), *ROWS.end());
        let step = height / count as f64;
        let [[left, right], [front, back], _] = self.edges_mm;
        plane.rows(low[1] + 0.5 * step, step, count, |row, found| {
            let y = low[1] + (row as f64 + 0.5) * step;
            let inside = if (front..=back).contains(&y) {
                found.spans.iter().map(|[from, to]| (to.min(right) - from.max(left)).max(0.0)).sum()
            } else {
                0.0
            };
            let whole = length(&found.spans);
            area.mm2 += whole * step;
            area.aside_mm2 += (whole - inside) * step;
            area.exclusive_mm2 += length(&found.exclusive) * step;
            area.shared_mm2 += found.shared_mm * step;
        });
        area
    }
}

#[derive(Default)]
struct Area {
    mm2: f64,
    exclusive_mm2: f64,
    shared_mm2: f64,
    aside_mm2: f64,
}
