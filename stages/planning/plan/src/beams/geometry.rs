//! A prior from the image alone: short ways to the target, little organ on them, beams apart.

use super::prior::Prior;
use super::ring::Ring;
use crate::dose::frame::BeamFrame;
use stillpoint_patient::case::{Case, Mask, Role};

/// Points of the targets that lines are drawn to, at most.
const POINTS: usize = 200;
/// Step along a line, mm.
const STEP_MM: f64 = 5.0;
/// Distance from source to isocentre, mm. The lines hardly depend on it.
const SAD_MM: f64 = 1000.0;
/// What a way through an organ counts beside one through other tissue.
const ORGAN: f64 = 2.0;
/// How far beams overlap, degrees, and what that counts beside the mean way.
const OVERLAP_DEG: f64 = 30.0;
const OVERLAP: f64 = 0.5;

/// The score of a beam is minus its mean way through the body to the points of the targets, ways through organs counted
/// three times, in units of the mean of all beams, and minus its overlap with each kept beam.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    ring: Ring,
    /// By beam of the ring.
    burden: Vec<f64>,
}

impl Geometry {
    /// Of a case. No dose is computed.
    pub fn of_case(case: &Case, ring: Ring) -> Self {
        let grid = case.grid();
        let union = |role: Role| {
            let mut all = Mask::empty(grid.len());
            for structure in case.structures().iter().filter(|s| s.role == role) {
                structure.mask.indices().for_each(|voxel| all.insert(voxel));
            }
            all
        };
        let (targets, organs, outline) = (union(Role::Target), union(Role::Organ), union(Role::External));
        let points: Vec<usize> = targets.indices().collect();
        let every = points.len().div_ceil(POINTS).max(1);
        let points: Vec<[f64; 3]> =
            points.iter().step_by(every).map(|i| grid.centre_mm(grid.voxel(*i))).collect();
        let voxel_at = |at_mm: [f64; 3]| {
            let mut voxel = [0; 3];
            for axis in 0..3 {
                let place = ((at_mm[axis] - grid.origin_mm[axis]) / grid.spacing_mm[axis]).round();
                if !(place >= 0.0 && place < grid.counts[axis] as f64) {
                    return None;
                }
                voxel[axis] = place as usize;
            }
            Some(grid.index(voxel))
        };
        let length = |from: [f64; 3], to: [f64; 3]| {
            let along: [f64; 3] = std::array::from_fn(|axis| to[axis] - from[axis]);
            let length = along.iter().map(|d| d * d).sum::<f64>().sqrt();
            let mut sum = 0.0;
            for step in 1..(length / STEP_MM) as usize {
                let part = step as f64 * STEP_MM / length;
                let Some(voxel) = voxel_at(std::array::from_fn(|axis| from[axis] + part * along[axis]))
                else {
                    break;
                };
                if organs.contains(voxel) && !targets.contains(voxel) {
                    sum += ORGAN * STEP_MM;
                }
                if outline.contains(voxel) {
                    sum += STEP_MM;
                }
            }
            sum
        };
        let of_beam = |beam: u16| {
            let frame = BeamFrame::new(ring.angle_deg(beam), case.position(), case.isocentre_mm(), SAD_MM);
            let source = frame.source_mm();
            points.iter().map(|point| length(*point, source)).sum::<f64>() / points.len().max(1) as f64
        };
        let burden: Vec<f64> = (0..ring.count()).map(of_beam).collect();
        let mean = burden.iter().sum::<f64>() / burden.len() as f64;
        let scale = if mean > 0.0 { mean } else { 1.0 };
        Self { ring, burden: burden.into_iter().map(|b| b / scale).collect() }
    }
}

impl Prior for Geometry {
    fn scores(&self, ring: Ring, retained: &[u16], candidates: &[u16]) -> Vec<f64> {
        let overlap = |beam: u16| {
            let near = |other: &u16| {
                let apart = f64::from(ring.steps_between(beam, *other)) * ring.step_deg() / OVERLAP_DEG;
                libm::exp(-0.5 * apart * apart)
            };
            OVERLAP * retained.iter().map(near).sum::<f64>()
        };
        let of_beam = |beam: u16| self.burden[usize::from(self.ring.nearest(ring.angle_deg(beam)))];
        candidates.iter().map(|beam| -of_beam(*beam) - overlap(*beam)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::prior::set_of_prior;
    use super::*;
    use stillpoint_patient::case::phantom;

    #[test]
    fn beams_through_the_hips_are_worse_than_beams_from_the_front() {
        let ring = Ring::new(36, 2).unwrap();
        let prior = Geometry::of_case(&phantom(0).unwrap(), ring);
        let scores = prior.scores(ring, &[], &[0, 9, 27]);
        assert!(scores[0] > scores[1] && scores[0] > scores[2], "{scores:?}");
        let set = set_of_prior(&prior, ring, 5).unwrap();
        assert_eq!(set, set_of_prior(&prior, ring, 5).unwrap());
        // A beam beside a kept one is worse than the same beam alone.
        assert!(prior.scores(ring, &[1], &[0])[0] < scores[0]);
    }
}
