//! Planes along the patient: thickness, gaps.

use stillpoint_patient::Grid;

use super::contour::Contour;

/// Contours are in one plane if they are this close, mm, and this close as a part of the distance of slices.
const SAME_PLANE_MM: f64 = 0.1;
const SAME_PLANE: f64 = 0.1;
/// Where planes are clearly apart, the contours of one plane may lie this far apart, as a part of the distance of slices.
const JITTER: f64 = 0.3;
/// Planes are clearly apart if the distance between them is this many times the distance within them.
const CLEARLY: f64 = 3.0;
/// Planes farther apart than this stand for a slice each, mm.
const THICKEST_MM: f64 = 20.0;
/// A distance of planes that is larger than the slab's thickness by this factor is a gap.
const GAP: f64 = 1.5;
/// A slice this close to the edge of a slab, as a part of its thickness, is on the edge.
const EDGE: f64 = 1e-6;

/// The planes of a structure, rising.
pub(super) struct Slabs<'a> {
    pub planes: Vec<Slab<'a>>,
    /// Median distance of the planes, mm; infinite where there is one.
    pub distance_mm: f64,
    /// Thickness of a slab, mm.
    pub thickness_mm: f64,
    /// Whether there are three planes at least and no gap among them.
    pub is_regular: bool,
}

pub(super) struct Slab<'a> {
    /// The middle between its lowest and its highest contour, mm.
    pub z_mm: f64,
    first_mm: f64,
    last_mm: f64,
    pub contours: Vec<&'a Contour>,
}

impl<'a> Slabs<'a> {
    pub fn of(contours: &[&'a Contour], slice_mm: f64) -> Self {
        let mut sorted: Vec<&Contour> = contours.to_vec();
        sorted.sort_by(|a, b| a.z_mm.total_cmp(&b.z_mm));
        let planes = planes(&sorted, slice_mm);
        let mut steps: Vec<f64> = planes.windows(2).map(|pair| pair[1].z_mm - pair[0].z_mm).collect();
        steps.sort_by(f64::total_cmp);
        // Of an even number the lower of the two in the middle: two parts far apart do not grow towards each other.
        let distance_mm = steps.get(steps.len().saturating_sub(1) / 2).copied().unwrap_or(f64::INFINITY);
        let is_regular = steps.len() > 1 && steps.last().is_some_and(|&last| last <= GAP * distance_mm);
        let thickness_mm = if distance_mm <= THICKEST_MM { distance_mm.max(slice_mm) } else { slice_mm };
        Self { planes, distance_mm, thickness_mm, is_regular }
    }

    /// The planes of a part of a structure: where its own do not tell how thick they are, they are as thick as the whole's.
    pub fn of_part(contours: &[&'a Contour], slice_mm: f64, whole: &Slabs<'_>) -> Self {
        let own = Self::of(contours, slice_mm);
        match own.is_regular {
            true => own,
            false => Self { thickness_mm: own.thickness_mm.min(whole.thickness_mm), ..own },
        }
    }

    /// The plane whose contours hold at this position.
    pub fn at(&self, z_mm: f64) -> Option<usize> {
        let half = 0.5 * self.thickness_mm;
        let edge = EDGE * half;
        let below = |place: usize| z_mm - self.planes[place].z_mm;
        // Of two slabs that touch, the lower has the slice between: it is closed above its plane and open below.
        let above = self.planes.partition_point(|plane| plane.z_mm <= z_mm + edge);
        let lower = above.checked_sub(1).filter(|&p| below(p) <= half + edge);
        let upper = (above < self.planes.len()).then_some(above).filter(|&p| -below(p) < half - edge);
        match (lower, upper) {
            (Some(l), Some(u)) if -below(u) < below(l) - edge => Some(u),
            (lower, upper) => lower.or(upper),
        }
    }

    /// The slices that each plane has.
    pub fn slices(&self, grid: &Grid) -> Vec<Vec<usize>> {
        let mut slices = vec![Vec::new(); self.planes.len()];
        for z in 0..grid.counts[2] {
            if let Some(plane) = self.at(grid.origin_mm[2] + z as f64 * grid.spacing_mm[2]) {
                slices[plane].push(z);
            }
        }
        slices
    }

    /// Whether a plane between the first and the last image has no slice.
    pub fn skips(&self, grid: &Grid) -> bool {
        let first_mm = grid.origin_mm[2];
        let last_mm = first_mm + (grid.counts[2] - 1) as f64 * grid.spacing_mm[2];
        let is_inside = |slab: &Slab<'_>| (first_mm..=last_mm).contains(&slab.z_mm);
        self.planes.iter().zip(self.slices(grid)).any(|(slab, slices)| slices.is_empty() && is_inside(slab))
    }

    /// From where to where the slab of a plane reaches, mm: not beyond the middle to the next plane.
    pub fn reach_mm(&self, place: usize) -> [f64; 2] {
        let half = 0.5 * self.thickness_mm;
        let z_mm = self.planes[place].z_mm;
        let other =
            |place: Option<usize>| place.and_then(|p| self.planes.get(p)).map(|p| 0.5 * (p.z_mm - z_mm));
        let low = other(place.checked_sub(1)).map_or(-half, |d| d.max(-half));
        let high = other(Some(place + 1)).map_or(half, |d| d.min(half));
        [z_mm + low, z_mm + high]
    }

    /// Whether the distance to the next plane is a gap.
    pub fn gap_after(&self, place: usize) -> bool {
        let next = self.planes.get(place + 1).map(|next| next.z_mm - self.planes[place].z_mm);
        next.is_some_and(|step| step > GAP * self.thickness_mm)
    }
}

/// The contours plane by plane, rising.
///
/// Writers round positions, and tools draw islands and holes each on a plane of its own: contours of one plane lie some
/// hundredths to some tenths of a millimetre apart. What is far less than the distance of the planes is taken for that;
/// where all distances are alike they are planes, however fine.
fn planes<'a>(sorted: &[&'a Contour], slice_mm: f64) -> Vec<Slab<'a>> {
    let loose = linked(sorted, |z_mm, last: &Slab<'_>| z_mm - last.last_mm <= JITTER * slice_mm);
    let within = loose.iter().map(|slab| slab.last_mm - slab.first_mm).fold(0.0, f64::max);
    let between =
        loose.windows(2).map(|pair| pair[1].first_mm - pair[0].last_mm).fold(f64::INFINITY, f64::min);
    let is_clear = loose.len() > 1 && within <= JITTER * slice_mm && between >= CLEARLY * within;
    if is_clear {
        return loose;
    }
    let same_mm = SAME_PLANE_MM.min(SAME_PLANE * slice_mm);
    linked(sorted, |z_mm, last: &Slab<'_>| z_mm - last.first_mm <= same_mm)
}

/// Joins each contour to the plane before it or begins another.
fn linked<'a>(sorted: &[&'a Contour], joins: impl Fn(f64, &Slab<'a>) -> bool) -> Vec<Slab<'a>> {
    let mut planes: Vec<Slab<'a>> = Vec::new();
    for &contour in sorted {
        let z_mm = contour.z_mm;
        match planes.last_mut() {
            Some(plane) if joins(z_mm, plane) => {
                plane.contours.push(contour);
                plane.last_mm = z_mm;
                plane.z_mm = 0.5 * (plane.first_mm + z_mm);
            }
            _ => planes.push(Slab { z_mm, first_mm: z_mm, last_mm: z_mm, contours: vec![contour] }),
        }
    }
    planes
}
