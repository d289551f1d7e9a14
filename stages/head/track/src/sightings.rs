//! In how many of the last frames a face was seen at one place.
//!
//! Noise makes a shoulder, a pad or a fist pass for a head in one frame of many, at one place or another. A head passes
//! in most frames, and lies still for a second. So a face is captured only where faces were seen before.

use nalgebra::Vector3;

/// Frames that are looked back to.
pub const FRAMES: usize = 10;
/// Faces whose middles are nearer to each other, m, are seen at one place. A head that breathes moves by less.
const ONE_PLACE: f64 = 0.025;

/// The middles of the faces of the last frames.
#[derive(Debug, Clone, Default)]
pub struct Sightings {
    /// A ring; `None` of a frame without a face.
    middles: [Option<Vector3<f64>>; FRAMES],
    next: usize,
}

impl Sightings {
    /// Notes a frame: the middle of its face, m, if it has one.
    pub fn note(&mut self, middle: Option<Vector3<f64>>) {
        self.middles[self.next] = middle;
        self.next = (self.next + 1) % FRAMES;
    }

    /// Number of the last frames with a face at this place, m.
    #[must_use]
    pub fn at(&self, place: &Vector3<f64>) -> usize {
        self.middles.iter().flatten().filter(|middle| (*middle - place).norm() < ONE_PLACE).count()
    }
}

/// Mean of the points of a face, m; `None` without points.
#[must_use]
pub fn middle(cloud: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    (!cloud.is_empty()).then(|| cloud.iter().sum::<Vector3<f64>>() / cloud.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_count_at_one_place_and_in_the_last_frames() {
        let (here, there) = (Vector3::new(0.1, 0.0, 0.7), Vector3::new(0.13, 0.0, 0.7));
        let mut sightings = Sightings::default();
        assert_eq!(sightings.at(&here), 0);
        for face in [Some(here), None, Some(there), Some(here * 1.01)] {
            sightings.note(face);
        }
        assert_eq!((sightings.at(&here), sightings.at(&there)), (2, 1));
        // The first is forgotten with the tenth frame after it.
        (0..6).for_each(|_| sightings.note(None));
        assert_eq!(sightings.at(&here), 2);
        sightings.note(None);
        assert_eq!(sightings.at(&here), 1);
    }

    #[test]
    fn a_face_without_points_has_no_middle() {
        assert_eq!(middle(&[]), None);
        assert_eq!(middle(&[Vector3::x(), Vector3::y()]), Some(Vector3::new(0.5, 0.5, 0.0)));
    }
}
