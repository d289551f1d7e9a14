//! The beam's eye: where a point of the patient lies as seen from the source.

use nalgebra::Vector3;

use super::angles::BeamAngles;
use stillpoint_patient::case::PatientPosition;
use stillpoint_patient::couch::Motion;

/// The frame of one beam. Its origin is the radiation source, `y` runs from there through the isocentre, and for gantry
/// angle 0 its axes are those of the DICOM patient frame of a patient who lies head first and supine. For the other
/// positions the axes are turned with [`PatientPosition::signs`]. A patient on a
/// couch that is turned is first turned with it about the vertical axis through the isocentre.
///
/// The gantry angle is that of IEC 61217: at 0 degrees the source is above the couch. A patient who lies head first and
/// supine has it in front of him at 0 degrees and on his left at 90.
///
/// Of a patient who moved, the patient frame is that of his voxels: points go where the motion takes them, and then into
/// the frame of the beam, which stands still in the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BeamFrame {
    sin: f64,
    cos: f64,
    /// Sine and cosine of the couch angle; nothing at 0 degrees.
    couch: Option<(f64, f64)>,
    isocentre_mm: [f64; 3],
    signs: [f64; 3],
    sad_mm: f64,
    /// Of the patient, in his frame; nothing where he lies as planned.
    motion: Option<Motion>,
}

impl BeamFrame {
    pub fn new(
        angles: impl Into<BeamAngles>,
        position: PatientPosition,
        isocentre_mm: [f64; 3],
        sad_mm: f64,
    ) -> Self {
        let angles = angles.into();
        let (sin, cos) = libm::sincos(angles.gantry_deg.to_radians());
        let couch = (!angles.is_coplanar()).then(|| libm::sincos(angles.couch_deg.to_radians()));
        Self { sin, cos, couch, isocentre_mm, signs: position.signs(), sad_mm, motion: None }
    }

    /// The same beam on a patient who moved like this.
    pub fn of_moved(self, motion: &Motion) -> Self {
        Self { motion: Some(*motion), ..self }
    }

    /// A point of the patient frame (mm), in the beam's.
    pub fn beam_from_patient(&self, point_mm: [f64; 3]) -> [f64; 3] {
        let point_mm = match &self.motion {
            Some(motion) => motion.apply(point_mm.into()).into(),
            None => point_mm,
        };
        let [x, y, z] = [0, 1, 2].map(|axis| self.signs[axis] * (point_mm[axis] - self.isocentre_mm[axis]));
        let [x, z] = match self.couch {
            Some((sin, cos)) => [cos * x - sin * z, sin * x + cos * z],
            None => [x, z],
        };
        [self.cos * x + self.sin * y, self.cos * y - self.sin * x + self.sad_mm, z]
    }

    /// A point of the beam's frame (mm), in the patient's.
    pub fn patient_from_beam(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let y = y - self.sad_mm;
        let [x, y] = [self.cos * x - self.sin * y, self.sin * x + self.cos * y];
        let turned = match self.couch {
            Some((sin, cos)) => [cos * x + sin * z, y, cos * z - sin * x],
            None => [x, y, z],
        };
        let point_mm = [0, 1, 2].map(|axis| self.signs[axis] * turned[axis] + self.isocentre_mm[axis]);
        match &self.motion {
            Some(motion) => {
                (motion.rotation.transpose() * (Vector3::from(point_mm) - motion.shift_mm)).into()
            }
            None => point_mm,
        }
    }

    /// Distance from the source to the isocentre, mm.
    pub fn sad_mm(&self) -> f64 {
        self.sad_mm
    }

    /// The source, in the patient frame, mm.
    pub fn source_mm(&self) -> [f64; 3] {
        self.patient_from_beam([0.0; 3])
    }

    /// Where the line from the source through a point of the beam's frame meets the isocentre plane: x and z, mm.
    pub fn on_isocentre_plane(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        [self.sad_mm * x / y, self.sad_mm * z / y]
    }
}

#[cfg(test)]
mod tests {
    use super::PatientPosition::HeadFirstSupine;
    use super::*;
    use stillpoint_patient::couch::patient_from_couch;

    #[test]
    fn source_goes_round_from_the_front_over_the_left_as_iec_61217_says() {
        let centre = [1.0, -2.0, 3.0];
        let at = |deg| BeamFrame::new(deg, HeadFirstSupine, centre, 1000.0).source_mm();
        for (deg, expected) in [
            (0.0, [1.0, -1002.0, 3.0]),
            (90.0, [1001.0, -2.0, 3.0]),
            (180.0, [1.0, 998.0, 3.0]),
            (270.0, [-999.0, -2.0, 3.0]),
        ] {
            let source = at(deg);
            assert!((0..3).all(|i| (source[i] - expected[i]).abs() < 1e-9), "{deg}: {source:?}");
        }
    }

    #[test]
    fn the_source_goes_round_the_couch_as_it_goes_round_the_patient() {
        for position in PatientPosition::ALL {
            for angles in [0.0, 48.0, 90.0, 180.0, 275.0_f64] {
                let (sin, cos) = angles.to_radians().sin_cos();
                let seen = patient_from_couch(position) * Vector3::new(sin, 0.0, cos) * 1000.0;
                let frame = BeamFrame::new(angles, position, [0.0; 3], 1000.0);
                assert!((seen - Vector3::from(frame.source_mm())).norm() < 1e-9, "{position}, {angles}");
                // What lies to the gantry is above the beam's centre, in every position.
                let beam = frame.beam_from_patient((patient_from_couch(position) * Vector3::y()).into());
                assert_eq!(beam[2], 1.0, "{position}, {angles}");
            }
        }
    }

    #[test]
    fn the_couch_turns_the_patient_counter_clockwise_as_seen_from_above() {
        // In the couch's frame: x to the right of a person who faces the gantry, y to the gantry, z up.
        for position in PatientPosition::ALL {
            for [gantry_deg, couch_deg] in [[0.0, 77.0], [90.0, 90.0], [270.0, 90.0], [48.0, -30.0_f64]] {
                let (sin, cos) = gantry_deg.to_radians().sin_cos();
                let room = Vector3::new(sin, 0.0, cos) * 1000.0;
                // The room as seen from the couch turns the other way.
                let up = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), -couch_deg.to_radians());
                let seen = patient_from_couch(position) * (up * room);
                let angles = BeamAngles { gantry_deg, couch_deg };
                let frame = BeamFrame::new(angles, position, [0.0; 3], 1000.0);
                assert!((seen - Vector3::from(frame.source_mm())).norm() < 1e-9, "{position}, {angles}");
                if position == HeadFirstSupine {
                    assert!((seen - Vector3::from(angles.source()) * 1000.0).norm() < 1e-9, "{angles}");
                }
            }
        }
        // A quarter turn takes the head to the side of the source at 270 degrees.
        let vertex = BeamFrame::new([270.0, 90.0], HeadFirstSupine, [0.0; 3], 1000.0).source_mm();
        assert!((Vector3::from(vertex) - Vector3::new(0.0, 0.0, 1000.0)).norm() < 1e-9, "{vertex:?}");
    }

    #[test]
    fn there_and_back_is_the_same_point() {
        for position in PatientPosition::ALL {
            let frame = BeamFrame::new([123.0, -35.0], position, [4.0, 5.0, 6.0], 1000.0);
            let rotation = nalgebra::Rotation3::from_scaled_axis(Vector3::new(0.3, -0.2, 0.5)).into_inner();
            let motion = Motion { rotation, shift_mm: Vector3::new(7.0, -3.0, 2.0) };
            for frame in [frame, frame.of_moved(&motion)] {
                let point = [10.0, -70.0, 33.0];
                let back = frame.patient_from_beam(frame.beam_from_patient(point));
                assert!((0..3).all(|i| (back[i] - point[i]).abs() < 1e-9));
            }
        }
    }
}
