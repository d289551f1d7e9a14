//! Planes along the patient: thickness, gaps.

use super::contour::Contour;

/// Contours are in one plane if they are this close, mm.
const SAME_PLANE_MM: f64 = 0.01;
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
}

pub(super) struct Slab<'a> {
    pub z_mm: f64,
    pub contours: Vec<&'a Contour>,
}

impl<'a> Slabs<'a> {
    pub fn of(contours: &'a [Contour], slice_mm: f64) -> Self {
        let mut sorted: Vec<&Contour> = contours.iter().collect();
        sorted.sort_by(|a, b| a.z_mm.total_cmp(&b.z_mm));
        let mut planes: Vec<Slab<'a>> = Vec::new();
        for contour in sorted {
            match planes.last_mut() {
                Some(plane) if contour.z_mm - plane.z_mm <= SAME_PLANE_MM => plane.contours.push(contour),
                _ => planes.push(Slab { z_mm: contour.z_mm, contours: vec![contour] }),
            }
        }
        let mut steps: Vec<f64> = planes.windows(2).map(|pair| pair[1].z_mm - pair[0].z_mm).collect();
        steps.sort_by(f64::total_cmp);
        // Of an even number the lower of the two in the middle: two parts far apart do not grow towards each other.
        let distance_mm = steps.get(steps.len().saturating_sub(1) / 2).copied().unwrap_or(f64::INFINITY);
        let thickness_mm = if distance_mm <= THICKEST_MM { distance_mm.max(slice_mm) } else { slice_mm };
        Self { planes, distance_mm, thickness_mm }
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
