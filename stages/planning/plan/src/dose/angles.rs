//! Where a beam comes from: the angles of gantry and couch.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// Angles of a beam, degrees (IEC 61217): of the gantry, and of the patient support, which is called the couch. A gantry angle
/// alone stands for a couch at 0 degrees.
///
/// The couch turns about the vertical axis through the isocentre, and a greater angle is a counter-clockwise turn as seen from
/// above: at 90 degrees the end of the couch that points to the gantry at 0 degrees points to the left of a person
/// who faces the gantry.
///
/// As text, `72` is gantry 72 degrees at couch 0, and `72@30` the same at couch 30.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct BeamAngles {
    /// Gantry angle.
    pub gantry_deg: f64,
    /// Couch angle (patient support angle).
    pub couch_deg: f64,
}

/// A text that is not the angles of a beam.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "invalid angles of a beam: {0:?} (examples: `72`, `-40.5`, and `72@30` for gantry 72 and couch 30 degrees)"
)]
pub struct NotAngles(pub String);

impl BeamAngles {
    /// Whether the couch is at 0 degrees.
    pub fn is_coplanar(&self) -> bool {
        self.couch_deg == 0.0
    }

    /// The same with the gantry in [0, 360) and the couch in (-180, 180]. Angles in these ranges stay as they are.
    #[must_use]
    pub fn wrapped(self) -> Self {
        let couch_deg = self.couch_deg.rem_euclid(360.0);
        let couch_deg = if couch_deg > 180.0 { couch_deg - 360.0 } else { couch_deg };
        let is_within = self.couch_deg > -180.0 && self.couch_deg <= 180.0;
        Self {
            gantry_deg: self.gantry_deg.rem_euclid(360.0),
            couch_deg: if is_within { self.couch_deg } else { couch_deg },
        }
    }

    /// Whether both numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.gantry_deg.is_finite() && self.couch_deg.is_finite()
    }

    /// Where the source is as seen from the isocentre, in the frame of a patient who lies head first and supine: x to the left,
    /// y to the back, z to the head.
    pub fn source(&self) -> [f64; 3] {
        let (sin, cos) = libm::sincos(self.gantry_deg.to_radians());
        let (couch_sin, couch_cos) = libm::sincos(self.couch_deg.to_radians());
        [sin * couch_cos, -cos, -sin * couch_sin]
    }

    /// Angle between the axes of two beams in the patient, degrees from 0 to 180.
    pub fn apart_deg(&self, other: &Self) -> f64 {
        let ([a, b, c], [x, y, z]) = (self.source(), other.source());
        libm::acos((a * x + b * y + c * z).clamp(-1.0, 1.0)).to_degrees()
    }
}

impl From<f64> for BeamAngles {
    fn from(gantry_deg: f64) -> Self {
        Self { gantry_deg, couch_deg: 0.0 }
    }
}

impl From<[f64; 2]> for BeamAngles {
    fn from([gantry_deg, couch_deg]: [f64; 2]) -> Self {
        Self { gantry_deg, couch_deg }
    }
}

impl fmt::Display for BeamAngles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.is_coplanar() {
            true => write!(f, "{}", self.gantry_deg),
            false => write!(f, "{}@{}", self.gantry_deg, self.couch_deg),
        }
    }
}

impl FromStr for BeamAngles {
    type Err = NotAngles;

    fn from_str(text: &str) -> Result<Self, NotAngles> {
        let number = |part: &str| match part.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(NotAngles(text.to_owned())),
        };
        let (gantry, couch) =
            text.split_once('@').map_or((text, None), |(gantry, couch)| (gantry, Some(couch)));
        Ok(Self { gantry_deg: number(gantry)?, couch_deg: couch.map_or(Ok(0.0), number)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_read_as_they_are_written() {
        for (text, angles) in [
            ("72", [72.0, 0.0]),
            ("-40.5", [-40.5, 0.0]),
            ("72@30", [72.0, 30.0]),
            ("0@-13.37", [0.0, -13.37]),
        ] {
            let read: BeamAngles = text.parse().unwrap();
            assert_eq!((read, read.to_string().as_str()), (angles.into(), text));
        }
        for wrong in ["", "@", "72@", "@30", "72@30@1", "x", "NaN", "72@inf"] {
            assert_eq!(wrong.parse::<BeamAngles>(), Err(NotAngles(wrong.to_owned())));
        }
    }

    #[test]
    fn wrapping_keeps_directions_and_leaves_usual_angles_alone() {
        for angles in [[0.0, 0.0], [359.99, -90.0], [123.4, 180.0]] {
            assert_eq!(BeamAngles::from(angles).wrapped(), angles.into());
        }
        for (angles, wrapped) in [([-72.0, 330.0], [288.0, -30.0]), ([400.0, -180.0], [40.0, 180.0])] {
            assert_eq!(BeamAngles::from(angles).wrapped(), wrapped.into());
        }
    }

    #[test]
    fn beams_of_one_axis_are_not_apart() {
        let apart = |a: [f64; 2], b: [f64; 2]| BeamAngles::from(a).apart_deg(&b.into());
        assert!((apart([10.0, 0.0], [350.0, 0.0]) - 20.0).abs() < 1e-9);
        // From above, the couch may turn as it will; and half a turn of it mirrors the gantry.
        assert!(apart([0.0, 0.0], [0.0, 77.0]) < 1e-6);
        assert!(apart([90.0, 180.0], [270.0, 0.0]) < 1e-6);
        assert!((apart([90.0, 0.0], [90.0, 90.0]) - 90.0).abs() < 1e-9);
    }
}
