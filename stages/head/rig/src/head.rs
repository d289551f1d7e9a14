//! The project's own head: a union of ellipsoids with the proportions of an adult.
//!
//! Head frame: origin midway between the ear canals, x to the patient's left, y to the crown,
//! z out of the face. For a supine patient who looks straight up the axes are those of the couch.
//!
//! Sizes are of the order of public anthropometric means for adults (head breadth 155 mm,
//! length 195 mm, chin to crown 225 mm). The neck ends in a stump, as a phantom's does.
//! Nose, ears, brow and chin are not quite symmetrical, as faces are not.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::shape::{Ellipsoid, ShapeError};

/// Why a head cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum HeadError {
    /// A scale at which no patient's head is.
    #[error("the head's scale is {0}; give a number from 0.5 (an infant) to 1.5")]
    Scale(f64),
    /// A part that is no ellipsoid.
    #[error(transparent)]
    Shape(#[from] ShapeError),
}

/// Centre (mm), semi-axes (mm) and rotation (degrees about x, then y, then z) of one part.
type Part = ([f64; 3], [f64; 3], [f64; 3]);

const PARTS: [Part; 25] = [
    // Cranium, forehead and back of the head.
    ([0.0, 42.0, 3.0], [77.5, 87.0, 96.0], [0.0, 0.0, 0.0]),
    ([0.0, 58.0, 30.0], [62.0, 56.0, 64.0], [0.0, 0.0, 0.0]),
    ([0.0, 20.0, -42.0], [66.0, 58.0, 53.0], [0.0, 0.0, 0.0]),
    // Mid-face, upper jaw, lower jaw, its two angles and the chin.
    ([0.0, -18.0, 32.0], [63.0, 78.0, 56.0], [0.0, 0.0, 0.0]),
    ([0.0, -40.0, 48.0], [40.0, 40.0, 46.0], [0.0, 0.0, 0.0]),
    ([0.0, -53.0, 36.0], [52.0, 44.0, 50.0], [0.0, 0.0, 0.0]),
    ([38.0, -42.0, 18.0], [25.0, 42.0, 36.0], [-30.0, 0.0, 0.0]),
    ([-38.0, -42.0, 18.0], [25.0, 42.0, 36.0], [-30.0, 0.0, 0.0]),
    ([-0.5, -68.0, 47.0], [37.0, 29.0, 42.0], [0.0, 0.0, 0.0]),
    // Cheekbones and the soft part below them.
    ([34.0, -6.0, 48.0], [33.0, 24.0, 33.0], [0.0, 0.0, -14.0]),
    ([-34.0, -6.0, 48.0], [33.0, 24.0, 33.0], [0.0, 0.0, 14.0]),
    ([26.0, -34.0, 46.0], [31.0, 38.0, 36.0], [0.0, 0.0, 0.0]),
    ([-26.0, -34.0, 46.0], [31.0, 38.0, 36.0], [0.0, 0.0, 0.0]),
    // Brow ridge.
    ([23.0, 29.0, 70.0], [37.0, 13.0, 26.0], [0.0, 14.0, -5.0]),
    ([-23.0, 28.0, 70.0], [37.0, 13.0, 26.0], [0.0, -14.0, 5.0]),
    // Eyes under their lids.
    ([31.0, 10.0, 70.0], [17.0, 12.0, 17.0], [0.0, 0.0, 0.0]),
    ([-31.0, 10.0, 70.0], [17.0, 12.0, 17.0], [0.0, 0.0, 0.0]),
    // Nose: bridge, tip and wings.
    ([0.3, 0.0, 86.0], [12.0, 34.0, 18.0], [-22.0, 0.0, 0.0]),
    ([1.0, -19.0, 101.0], [12.0, 12.0, 18.0], [-10.0, 0.0, 0.0]),
    ([10.0, -23.0, 88.0], [10.0, 10.0, 17.0], [0.0, 0.0, 0.0]),
    ([-9.0, -23.0, 88.0], [10.0, 10.0, 17.0], [0.0, 0.0, 0.0]),
    // Lips, as one.
    ([0.5, -51.0, 74.0], [27.0, 12.0, 24.0], [0.0, 0.0, 0.0]),
    // Ears.
    ([77.0, 2.0, -8.0], [7.0, 31.0, 18.0], [12.0, 22.0, -8.0]),
    ([-77.0, 3.0, -8.0], [7.0, 31.0, 18.0], [12.0, -26.0, 9.0]),
    // Neck.
    ([0.0, -92.0, -24.0], [53.0, 84.0, 50.0], [8.0, 0.0, 0.0]),
];

/// What a part of the head is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tissue {
    /// It follows the skull.
    Bone,
    /// The lower jaw and the chin.
    Jaw,
    /// The soft part of a cheek.
    Cheek,
    /// The lips.
    Lips,
    /// An eye under its lid.
    Lid,
    /// A brow.
    Brow,
    /// The neck.
    Neck,
}

/// Of each part of the adult head.
fn tissue(part: usize) -> Tissue {
    match part {
        5..=8 => Tissue::Jaw,
        11 | 12 => Tissue::Cheek,
        13 | 14 => Tissue::Brow,
        15 | 16 => Tissue::Lid,
        21 => Tissue::Lips,
        24 => Tissue::Neck,
        _ => Tissue::Bone,
    }
}

/// A head, as ellipsoids in the head frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    parts: Vec<Ellipsoid>,
    /// The first parts are those of the adult head, in its order; what is worn follows the skull.
    natural: usize,
}

impl Head {
    /// The adult head, every length multiplied by `scale`.
    ///
    /// # Errors
    /// [`HeadError::Scale`] when the scale is not from 0.5 to 1.5.
    pub fn new(scale: f64) -> Result<Self, HeadError> {
        if !(0.5..=1.5).contains(&scale) {
            return Err(HeadError::Scale(scale));
        }
        let metres = scale * 1e-3;
        let parts = PARTS
            .iter()
            .map(|(centre, semi_axes, degrees)| {
                let angles = degrees.map(f64::to_radians);
                let rotation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
                let translation = Translation3::from(Vector3::from(*centre) * metres);
                Ellipsoid::new(
                    Isometry3::from_parts(translation, rotation),
                    Vector3::from(*semi_axes) * metres,
                )
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { parts, natural: PARTS.len() })
    }

    /// A head of parts of one's own, placed in the head frame.
    #[must_use]
    pub fn of(parts: Vec<Ellipsoid>) -> Self {
        Self { parts, natural: 0 }
    }

    /// The head with further parts, which move with it.
    #[must_use]
    pub fn with(mut self, parts: impl IntoIterator<Item = Ellipsoid>) -> Self {
        self.parts.extend(parts);
        self
    }

    /// The ellipsoids whose union is the head, placed in the head frame.
    pub fn parts(&self) -> &[Ellipsoid] {
        &self.parts
    }

    /// What each part is of; parts of one's own follow the skull.
    pub fn tissues(&self) -> impl Iterator<Item = Tissue> + '_ {
        (0..self.parts.len()).map(|part| if part < self.natural { tissue(part) } else { Tissue::Bone })
    }

    /// Depth of a place (head frame, m) below the skin, m, to the first order; negative outside.
    pub fn depth(&self, place: [f64; 3]) -> f64 {
        let place = Point3::from(place);
        let depth = |part: &Ellipsoid| {
            let p = part.parent_from_shape().inverse_transform_point(&place).coords;
            let unit = p.component_div(part.semi_axes());
            let (level, gradient) = (unit.norm(), unit.component_div(part.semi_axes()).norm());
            if gradient > 0.0 { level * (1.0 - level) / gradient } else { part.semi_axes().min() }
        };
        self.parts.iter().map(depth).fold(f64::NEG_INFINITY, f64::max)
    }

    /// How far the head reaches along each axis of the head frame: least and greatest corner, in metres.
    pub fn extent(&self) -> (Vector3<f64>, Vector3<f64>) {
        let mut least = Vector3::repeat(f64::INFINITY);
        let mut greatest = Vector3::repeat(f64::NEG_INFINITY);
        for part in &self.parts {
            let pose = part.parent_from_shape();
            let scaled = pose.rotation.to_rotation_matrix().into_inner()
                * nalgebra::Matrix3::from_diagonal(part.semi_axes());
            // The support of an ellipsoid along an axis is the norm of that row of R diag(r).
            let reach = Vector3::from_fn(|axis, _| scaled.row(axis).norm());
            least = least.inf(&(pose.translation.vector - reach));
            greatest = greatest.sup(&(pose.translation.vector + reach));
        }
        (least, greatest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_skin_is_where_the_depth_is_zero() {
        let head = Head::new(1.0).unwrap();
        for part in head.parts() {
            for i in 0..200 {
                let z = (f64::from(i) + 0.5) / 100.0 - 1.0;
                let (angle, across) = (f64::from(i) * 2.4, (1.0 - z * z).sqrt());
                let unit = Vector3::new(across * angle.cos(), across * angle.sin(), z);
                let on = |scale: f64| {
                    let place = part.semi_axes().component_mul(&unit) * scale;
                    head.depth((part.parent_from_shape() * Point3::from(place)).into())
                };
                // On a part it is on the skin or below it; inside it is deeper.
                assert!(on(1.0) > -1e-12 && on(0.9) > 0.0);
            }
        }
        let (least, greatest) = head.extent();
        for axis in 0..3 {
            for corner in [least, greatest] {
                let mut outside = Vector3::zeros();
                outside[axis] = corner[axis] * 1.01;
                assert!(head.depth(outside.into()) < 0.0);
            }
        }
    }

    #[test]
    fn the_head_has_the_proportions_of_an_adult() {
        let (least, greatest) = Head::new(1.0).unwrap().extent();
        let breadth_over_ears = greatest.x - least.x;
        let back_to_nose = greatest.z - least.z;
        assert!((0.160..0.195).contains(&breadth_over_ears), "{breadth_over_ears}");
        assert!((0.205..0.230).contains(&back_to_nose), "{back_to_nose}");
        assert!((0.120..0.135).contains(&greatest.y), "{}", greatest.y);
    }

    #[test]
    fn the_scale_multiplies_every_length() {
        let (_, adult) = Head::new(1.0).unwrap().extent();
        let (_, child) = Head::new(0.8).unwrap().extent();
        assert!((child - adult * 0.8).norm() < 1e-12);
    }

    #[test]
    fn a_scale_that_is_no_head_is_refused_with_its_number() {
        for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0, 3.0] {
            let message = Head::new(bad).unwrap_err().to_string();
            assert!(message.contains(&format!("scale is {bad};")), "{message}");
        }
    }
}
