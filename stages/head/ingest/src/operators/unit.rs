//! The unit of the coordinates of a file.

use stillpoint_operator::Choice;

use crate::checks::{self, CheckError, Scale};

/// A unit of coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Unit {
    /// Metres.
    M,
    /// Millimetres.
    Mm,
}

impl Unit {
    /// A point in metres.
    pub fn in_metres(self, point: [f32; 3]) -> [f32; 3] {
        match self {
            Self::M => point,
            // The product of an invalid point is another NaN than the one that marks it.
            Self::Mm if point[0].is_nan() => point,
            Self::Mm => point.map(|c| (f64::from(c) * 1e-3) as f32),
        }
    }

    /// Refuses points that are likely to be in another unit.
    ///
    /// # Errors
    /// As [`checks::scale`] has it.
    pub fn check(self, points: &[[f32; 3]]) -> Result<(), CheckError> {
        checks::scale(points.iter().map(|p| self.in_metres(*p)), self.scale())
    }

    /// What it says about the scale of points.
    pub fn scale(self) -> Scale {
        match self {
            Self::M => Scale::Metres,
            Self::Mm => Scale::Millimetres,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::INVALID_POINT;

    #[test]
    fn millimetres_are_recognised_and_become_metres() {
        let points = [[0.0, 0.0, 430.0], INVALID_POINT, [100.0, 0.0, 500.0]];
        let message = Unit::M.check(&points).unwrap_err().to_string();
        assert!(message.contains("430 m") && message.contains("unit: mm"), "{message}");
        assert!(Unit::Mm.check(&points).is_ok());
        assert!(Unit::M.check(&[INVALID_POINT]).is_ok() && Unit::M.check(&[[0.0, 0.0, 1.2]]).is_ok());
        assert_eq!(Unit::Mm.in_metres(points[0]), [0.0, 0.0, 0.43]);
        assert_eq!(Unit::Mm.in_metres(INVALID_POINT).map(f32::to_bits), INVALID_POINT.map(f32::to_bits));
    }
}
