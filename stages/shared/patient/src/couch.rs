//! From the couch to the patient: where a motion seen in the couch's frame takes the points of a plan.
//!
//! The couch is not turned (IEC 61217, patient support angle 0). In the DICOM patient frame (x to the left, y to the
//! back, z to the head) the axes of the couch are, by the patient's position:
//!
//! | axis of the couch (IEC 61217 table top; `couch` in pipelines) | HFS | HFP | FFS | FFP |
//! | --- | --- | --- | --- | --- |
//! | x, to the right of a person who faces the gantry | +x | -x | -x | +x |
//! | y, along the couch to the gantry | +z | +z | -z | -z |
//! | z, up | -y | +y | -y | +y |
//!
//! So `patient_from_couch` is a turn and no mirror: a right-handed turn by an angle about an axis stays one about the axis
//! that it becomes. Gantry angles turn about the couch's y: the source of angle 0 is at +z, of 90 degrees at
//! +x. The two frames have different origins; the isocentre is the point that is known in both.

use nalgebra::{Matrix3, Vector3};

use crate::case::PatientPosition;

/// A rigid motion of points: `rotation * point + shift`, in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Turns about the origin of the frame; orthonormal, determinant 1.
    pub rotation: Matrix3<f64>,
    /// Moves along the axes of the frame, mm.
    pub shift_mm: Vector3<f64>,
}

impl Motion {
    /// No motion.
    pub fn none() -> Self {
        Self { rotation: Matrix3::identity(), shift_mm: Vector3::zeros() }
    }

    /// Where a point goes, mm.
    pub fn apply(&self, point_mm: Vector3<f64>) -> Vector3<f64> {
        self.rotation * point_mm + self.shift_mm
    }
}

/// Takes directions of the couch to those of the DICOM patient frame of a patient who lies like this.
pub fn patient_from_couch(position: PatientPosition) -> Matrix3<f64> {
    let supine = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
    Matrix3::from_diagonal(&Vector3::from(position.signs())) * supine
}

/// A motion seen in the couch's frame, as it moves points of the DICOM patient frame.
///
/// `isocentre_in_couch_mm` and `isocentre_mm` are the isocentre in the couch's and in the patient's frame: with `M` =
/// [`patient_from_couch`], a point of the couch `c` is the point `i + M (c - j)` of the patient, `i` and `j` being the
/// isocentres; the motion `c -> R c + t` is then `p -> M R M^T (p - i) + i + M (R j + t - j)`.
pub fn patient_motion(
    couch: &Motion,
    position: PatientPosition,
    isocentre_in_couch_mm: Vector3<f64>,
    isocentre_mm: Vector3<f64>,
) -> Motion {
    let m = patient_from_couch(position);
    let rotation = m * couch.rotation * m.transpose();
    // How far the point at the isocentre goes.
    let moved = m * (couch.apply(isocentre_in_couch_mm) - isocentre_in_couch_mm);
    Motion { rotation, shift_mm: isocentre_mm + moved - rotation * isocentre_mm }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    const HEAD_FIRST: PatientPosition = PatientPosition::HeadFirstSupine;

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-500.0..500.0_f64).prop_map(Vector3::from)
    }

    #[test]
    fn the_axes_are_those_of_the_table() {
        use PatientPosition::{FeetFirstProne, FeetFirstSupine, HeadFirstProne, HeadFirstSupine};
        let (left, back, head) = (Vector3::x(), Vector3::y(), Vector3::z());
        for (position, right, to_gantry, up) in [
            (HeadFirstSupine, left, head, -back),
            (HeadFirstProne, -left, head, back),
            (FeetFirstSupine, -left, -head, -back),
            (FeetFirstProne, left, -head, back),
        ] {
            let m = patient_from_couch(position);
            assert_eq!(m * Vector3::x(), right, "{position}");
            assert_eq!(m * Vector3::y(), to_gantry, "{position}");
            assert_eq!(m * Vector3::z(), up, "{position}");
            assert_eq!((m.determinant(), m * m.transpose()), (1.0, Matrix3::identity()));
        }
    }

    #[test]
    fn a_nod_lifts_what_is_toward_the_head() {
        // A right-handed turn about the couch's x: from y, to the head, towards z, up.
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.1);
        let couch = Motion { rotation: turn.into_inner(), shift_mm: Vector3::zeros() };
        let isocentre = Vector3::new(5.0, -20.0, 30.0);
        let motion = patient_motion(&couch, HEAD_FIRST, Vector3::zeros(), isocentre);
        let moved = motion.apply(isocentre + Vector3::new(0.0, 0.0, 100.0)) - isocentre;
        let expected = Vector3::new(0.0, -100.0 * 0.1_f64.sin(), 100.0 * 0.1_f64.cos());
        assert!((moved - expected).norm() < 1e-9, "{moved}");
        assert!((motion.apply(isocentre) - isocentre).norm() < 1e-9, "the isocentre stays");
    }

    proptest! {
        #[test]
        fn a_point_goes_where_it_goes_in_the_couch(
            axis in vector(), angle in -3.0..3.0_f64, shift_mm in vector(),
            in_couch in vector(), in_patient in vector(), point in vector(),
            position in prop::sample::select(PatientPosition::ALL.to_vec()),
        ) {
            let axis = nalgebra::Unit::try_new(axis, 1e-6).unwrap_or(Vector3::z_axis());
            let rotation = Rotation3::from_axis_angle(&axis, angle).into_inner();
            let couch = Motion { rotation, shift_mm };
            let motion = patient_motion(&couch, position, in_couch, in_patient);
            let patient = |c: Vector3<f64>| in_patient + patient_from_couch(position) * (c - in_couch);
            prop_assert!((motion.apply(patient(point)) - patient(couch.apply(point))).norm() < 1e-8);
            prop_assert!((motion.rotation.determinant() - 1.0).abs() < 1e-12);
            let still = patient_motion(&Motion::none(), position, in_couch, in_patient);
            prop_assert_eq!(still.rotation, Matrix3::identity());
        }
    }
}
