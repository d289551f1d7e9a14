//! A phantom in place of the head: it moves by known steps and ramps, and no bladder moves it.
//!
//! Offsets are in the couch frame, about the pose of rest, as those of [`crate::trajectory`]: the phantom turns about its own
//! origin.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// A move of the phantom, at constant speed from where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhantomMove {
    /// When it begins, ns after the start.
    pub at: u64,
    /// How long it takes, ns; 0 for a jump.
    pub over: u64,
    /// Where to: x, y, z from rest, m.
    pub shift: [f64; 3],
    /// Where to: pitch, roll, yaw from rest, rad.
    pub turn: [f64; 3],
}

/// Why moves are refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PhantomError {
    /// A move begins before the one before it has ended.
    #[error(
        "move {index} begins at {at} s, and the move before it ends at {end} s; let each move end before the next begins"
    )]
    Order {
        /// Number of the move in the list, from 0.
        index: usize,
        /// When it begins, s.
        at: f64,
        /// When the move before it ends, s.
        end: f64,
    },
}

/// A phantom through time.
#[derive(Debug, Clone, PartialEq)]
pub struct Phantom {
    moves: Vec<PhantomMove>,
}

impl Phantom {
    /// A phantom that makes these moves, in the order of their times.
    ///
    /// # Errors
    /// Moves that overlap.
    pub fn new(moves: Vec<PhantomMove>) -> Result<Self, PhantomError> {
        for (index, pair) in moves.windows(2).enumerate() {
            let end = pair[0].at.saturating_add(pair[0].over);
            if pair[1].at < end {
                let [at, end] = [pair[1].at, end].map(|ns| ns as f64 * 1e-9);
                return Err(PhantomError::Order { index: index + 1, at, end });
            }
        }
        Ok(Self { moves })
    }

    /// Shift, m, and pitch, roll and yaw, rad, from rest, at a time after the start, ns.
    pub fn offset(&self, now: u64) -> [f64; 6] {
        let mut offset = [0.0; 6];
        for step in self.moves.iter().take_while(|step| step.at <= now) {
            let [x, y, z] = step.shift;
            let [pitch, roll, yaw] = step.turn;
            let since = now - step.at;
            // A jump has no part.
            let part = if since >= step.over { 1.0 } else { since as f64 / step.over as f64 };
            for (is, to) in offset.iter_mut().zip([x, y, z, pitch, roll, yaw]) {
                // The end is exact.
                *is = if part >= 1.0 { to } else { *is + (to - *is) * part };
            }
        }
        offset
    }

    /// The pose of the phantom that lay at `rest` at the start, at a time after the start, ns.
    pub fn couch_from_head(&self, now: u64, rest: &Isometry3<f64>) -> Isometry3<f64> {
        let [x, y, z, pitch, roll, yaw] = self.offset(now);
        let turn = UnitQuaternion::from_euler_angles(pitch, roll, yaw);
        let place = rest.translation.vector + Vector3::new(x, y, z);
        Isometry3::from_parts(Translation3::from(place), turn * rest.rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::rest_on_pad;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;

    fn step(at: u64, over: u64, z: f64, pitch: f64) -> PhantomMove {
        PhantomMove { at: at * MS, over: over * MS, shift: [0.0, 0.0, z], turn: [pitch, 0.0, 0.0] }
    }

    #[test]
    fn a_ramp_has_constant_speed_and_a_jump_takes_no_time() {
        let phantom = Phantom::new(vec![step(100, 200, 4e-3, 0.0), step(500, 0, -1e-3, 0.1)]).unwrap();
        for (ms, z, pitch) in [
            (0, 0.0, 0.0),
            (100, 0.0, 0.0),
            (150, 1e-3, 0.0),
            (300, 4e-3, 0.0),
            (499, 4e-3, 0.0),
            (500, -1e-3, 0.1),
            (900, -1e-3, 0.1),
        ] {
            let [_, _, height, angle, _, _] = phantom.offset(ms * MS);
            assert!((height - z).abs() < 1e-12 && (angle - pitch).abs() < 1e-12, "{ms}: {height} {angle}");
        }
    }

    #[test]
    fn it_turns_about_its_own_origin() {
        let rest = rest_on_pad();
        let phantom = Phantom::new(vec![step(0, 0, 2e-3, 0.1)]).unwrap();
        let pose = phantom.couch_from_head(MS, &rest);
        let moved = pose.translation.vector - rest.translation.vector;
        assert!((moved - Vector3::new(0.0, 0.0, 2e-3)).norm() < 1e-12);
        assert!((pose.rotation.angle_to(&rest.rotation) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn moves_that_overlap_are_refused_with_their_times() {
        let error = Phantom::new(vec![step(0, 200, 1e-3, 0.0), step(100, 0, 0.0, 0.0)]).unwrap_err();
        assert_eq!(error, PhantomError::Order { index: 1, at: 0.1, end: 0.2 });
        assert!(error.to_string().contains("move 1 begins at 0.1 s"), "{error}");
    }

    proptest! {
        #[test]
        fn it_is_never_outside_of_its_moves(ms in 0u64..2_000, to in prop::collection::vec(-0.01..0.01f64, 1..6)) {
            let moves = to.iter().enumerate().map(|(i, z)| step(300 * i as u64, 200, *z, 0.0)).collect();
            let z = Phantom::new(moves).unwrap().offset(ms * MS)[2];
            let [least, most] = to.iter().fold([0.0f64; 2], |[a, b], z| [a.min(*z), b.max(*z)]);
            prop_assert!((least..=most).contains(&z), "{} {} {}", z, least, most);
        }
    }
}
