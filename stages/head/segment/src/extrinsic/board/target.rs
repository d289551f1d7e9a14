//! The board, where it is, and its axes.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::error::BoardError;

/// A printed checkerboard that lies flat.
///
/// Its inner corners are those where four squares meet: an odd number of them along one side, and an even number along the
/// other. So the two ends of the first side differ: at one, both outermost squares are black, at the other, white. Its axis
/// `a` is along the odd number, from the black end to the white one; the axis `b` is to the left of it as seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    /// Inner corners along `a`, odd.
    pub along: usize,
    /// Inner corners along `b`, even.
    pub across: usize,
    /// Side of a square, m.
    pub square: f64,
    /// Its middle in the couch's frame, m.
    pub at: Vector3<f64>,
    /// Angle from the couch's x axis to `a` about z, rad.
    pub turn: f64,
}

impl Board {
    /// A board of two counts of inner corners, in any order.
    ///
    /// # Errors
    /// The board looks the same when it is turned by half a turn, or a number is out of its range.
    pub fn new(counts: [usize; 2], square: f64, at: Vector3<f64>, turn: f64) -> Result<Self, BoardError> {
        let range = |what, value: f64, [least, most]: [f64; 2], unit| {
            if (least..=most).contains(&value) {
                return Ok(());
            }
            Err(BoardError::Range { what, value, least, most, unit })
        };
        for count in counts {
            range("inner corners of a side", count as f64, [3.0, 60.0], "")?;
        }
        range("side of a square", 1e3 * square, [2.0, 200.0], " mm")?;
        let places = [("x", at.x, [-2.0, 2.0]), ("y", at.y, [-3.0, 3.0]), ("z", at.z, [-1.0, 2.0])];
        for (what, value, [least, most]) in places {
            range(what, 1e3 * value, [1e3 * least, 1e3 * most], " mm")?;
        }
        range("turn", turn.to_degrees(), [-360.0, 360.0], " degrees")?;
        let (along, across) = match counts.map(|count| count % 2) {
            [1, 0] => (counts[0], counts[1]),
            [0, 1] => (counts[1], counts[0]),
            _ => return Err(BoardError::HalfTurn { counts }),
        };
        Ok(Self { along, across, square, at, turn })
    }

    /// The corners in the board's own frame (its middle, `a`, `b`, up), m, those of one place along `a` next to each other.
    pub(super) fn corners(&self) -> Vec<Vector3<f64>> {
        let middle = |count: usize| 0.5 * (count as f64 - 1.0);
        let corner = |place: usize| {
            let (a, b) = ((place / self.across) as f64, (place % self.across) as f64);
            self.square * Vector3::new(a - middle(self.along), b - middle(self.across), 0.0)
        };
        (0..self.along * self.across).map(corner).collect()
    }

    pub(super) fn couch_from_board(&self) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.turn);
        Isometry3::from_parts(Translation3::from(self.at), turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_is_the_same_whichever_count_is_first_and_a_symmetric_one_is_refused() {
        let of = |counts| Board::new(counts, 0.025, Vector3::zeros(), 0.0);
        assert_eq!(of([11, 8]), of([8, 11]));
        let board = of([8, 11]).unwrap();
        assert_eq!((board.along, board.across), (11, 8));
        assert!((board.corners()[1] - Vector3::new(-0.125, -0.0625, 0.0)).norm() < 1e-12);
        for counts in [[7, 9], [8, 6]] {
            assert_eq!(of(counts), Err(BoardError::HalfTurn { counts }));
        }
        assert!(matches!(of([2, 7]), Err(BoardError::Range { what: "inner corners of a side", .. })));
        let nan = Board::new([8, 11], f64::NAN, Vector3::zeros(), 0.0);
        assert!(matches!(nan, Err(BoardError::Range { what: "side of a square", .. })));
    }
}
