//! Scripted head motion: a pure function of the time since start and a seed.
//!
//! Offsets are in the couch frame, about a pose of rest: `couch_from_head = T(dt) T(rest) dR R(rest)`.
//! So the head turns about its own origin, between the ear canals.
//! Angles: pitch about the couch's x (nodding), roll about its y (turning to a side on the pillow),
//! yaw about its z (tilting to a shoulder), `dR = Rz(yaw) Ry(roll) Rx(pitch)`, all right-handed.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::involuntary::{Habit, Involuntary, uniform};
use crate::scene::PAD_HEIGHT;

/// Which script the head follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    Still,
    /// Every 10 s the head moves within 1.5 s to another pose and stays:
    /// up to 8 mm in height, 3 mm sideways and along, 1.5 deg in each angle, by the seed. The first 10 s are rest.
    Steps,
    /// Slow nodding (1.5 deg at 0.1 Hz), breathing (0.3 mm and 0.1 deg at 0.25 Hz), drift below 2 mm
    /// over minutes, and in every second window of 20 s, on average, a cough.
    Nods,
    /// In 30 s the height goes from 2.5 to 14 mm over rest, pitch from 0.25 to 1.6 deg and roll from
    /// 35 to 45 deg, then all stay (the range of figure 4.11 of the dissertation).
    Sweep,
    /// One degree of freedom: every 30 s the height rises by 15 mm from 2 to 12 s and falls again from 17 to 27 s.
    Raise,
}

/// A script with its seed and its pose of rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    motion: Motion,
    seed: u64,
    rest: Isometry3<f64>,
}

/// Translation (m) and angles (rad): pitch, roll, yaw.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Offset {
    translation: Vector3<f64>,
    angles: Vector3<f64>,
}

/// The pose at which the adult head lies supine on the pad and looks straight up.
pub fn rest_on_pad() -> Isometry3<f64> {
    // The back of the head is 95 mm below the ear canals, 4 mm of it in the pad.
    Isometry3::translation(0.0, -0.02, PAD_HEIGHT + 0.091)
}

impl Trajectory {
    /// A script about a pose of rest, the `couch_from_head` of a head that has not moved.
    pub fn new(motion: Motion, seed: u64, rest: Isometry3<f64>) -> Self {
        Self { motion, seed, rest }
    }

    /// The head's pose `t` seconds after the start; before the start, and for a
    /// time that is no number, the pose at the start; after 1e9 s the pose at that time.
    pub fn couch_from_head(&self, t: f64) -> Isometry3<f64> {
        // A NaN is not above zero.
        let t = if t > 0.0 { t.min(1e9) } else { 0.0 };
        let offset = match self.motion {
            Motion::Still => Offset::default(),
            Motion::Steps => self.steps(t),
            Motion::Nods => self.nods(t),
            Motion::Sweep => sweep(t),
            Motion::Raise => raise(t),
        };
        let angles = offset.angles;
        let turn = UnitQuaternion::from_euler_angles(angles.x, angles.y, angles.z);
        Isometry3::from_parts(
            Translation3::from(self.rest.translation.vector + offset.translation),
            turn * self.rest.rotation,
        )
    }

    fn steps(&self, t: f64) -> Offset {
        const PERIOD_SECS: f64 = 10.0;
        const MOVE_SECS: f64 = 1.5;
        let period = (t / PERIOD_SECS).floor();
        let part = smooth_step((t - period * PERIOD_SECS) / MOVE_SECS);
        let from = self.level((period as u64).saturating_sub(1));
        let to = self.level(period as u64);
        Offset {
            translation: from.translation.lerp(&to.translation, part),
            angles: from.angles.lerp(&to.angles, part),
        }
    }

    /// Where the head stays in a period of the steps.
    fn level(&self, period: u64) -> Offset {
        if period == 0 {
            return Offset::default();
        }
        let signed = |draw| 2.0 * uniform(self.seed, period, draw) - 1.0;
        let tilt = 1.5f64.to_radians();
        Offset {
            translation: Vector3::new(
                3e-3 * signed(0),
                3e-3 * signed(1),
                8e-3 * uniform(self.seed, period, 2),
            ),
            angles: Vector3::new(signed(3), signed(4), signed(5)) * tilt,
        }
    }

    fn nods(&self, t: f64) -> Offset {
        let involuntary =
            Involuntary { habit: Habit::Nods, seed: self.seed, strength: 1.0, irregularity: 0.0 };
        let (translation, angles) = involuntary.offset(t);
        Offset { translation, angles }
    }
}

fn sweep(t: f64) -> Offset {
    const RAMP_SECS: f64 = 30.0;
    let part = smooth_step(t / RAMP_SECS);
    let between = |from: f64, to: f64| from + (to - from) * part;
    Offset {
        translation: Vector3::new(0.0, 0.0, between(2.5e-3, 14e-3)),
        angles: Vector3::new(between(0.25, 1.6).to_radians(), between(35.0, 45.0).to_radians(), 0.0),
    }
}

fn raise(t: f64) -> Offset {
    const PERIOD_SECS: f64 = 30.0;
    const MOVE_SECS: f64 = 10.0;
    let since = t - (t / PERIOD_SECS).floor() * PERIOD_SECS;
    let part = smooth_step((since - 2.0) / MOVE_SECS) - smooth_step((since - 17.0) / MOVE_SECS);
    Offset { translation: Vector3::new(0.0, 0.0, 15e-3 * part), angles: Vector3::zeros() }
}

/// From 0 to 1 with no velocity at either end: the cubic with zero slope at 0 and 1.
fn smooth_step(part: f64) -> f64 {
    let p = part.clamp(0.0, 1.0);
    p * p * (3.0 - 2.0 * p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALL: [Motion; 5] = [Motion::Still, Motion::Steps, Motion::Nods, Motion::Sweep, Motion::Raise];

    fn height_and_angles(motion: Motion, t: f64) -> (f64, (f64, f64, f64)) {
        let pose = Trajectory::new(motion, 7, Isometry3::identity()).couch_from_head(t);
        let (pitch, roll, yaw) = pose.rotation.euler_angles();
        (pose.translation.z * 1e3, (pitch.to_degrees(), roll.to_degrees(), yaw.to_degrees()))
    }

    #[test]
    fn raise_lifts_and_lowers_without_a_turn() {
        for (t, height) in [
            (0.0, 0.0),
            (2.0, 0.0),
            (7.0, 7.5),
            (12.0, 15.0),
            (16.0, 15.0),
            (22.0, 7.5),
            (28.0, 0.0),
            (42.0, 15.0),
        ] {
            let (found, angles) = height_and_angles(Motion::Raise, t);
            assert!((found - height).abs() < 1e-9 && angles == (0.0, 0.0, 0.0), "{t}: {found} mm");
        }
    }

    #[test]
    fn every_motion_stays_below_60_mm_and_20_degrees_a_second() {
        const STEP_SECS: f64 = 2e-3;
        for motion in ALL {
            for seed in 0..4 {
                let script = Trajectory::new(motion, seed, rest_on_pad());
                let mut before = script.couch_from_head(0.0);
                for step in 1..100_000 {
                    let now = script.couch_from_head(f64::from(step) * STEP_SECS);
                    let speed = (now.translation.vector - before.translation.vector).norm() / STEP_SECS;
                    let turning = now.rotation.angle_to(&before.rotation).to_degrees() / STEP_SECS;
                    assert!(speed < 0.06, "{motion:?} seed {seed} step {step}: {speed} m/s");
                    assert!(turning < 20.0, "{motion:?} seed {seed} step {step}: {turning} deg/s");
                    before = now;
                }
            }
        }
    }

    #[test]
    fn the_sweep_has_the_range_of_the_figure() {
        let (z, (pitch, roll, yaw)) = height_and_angles(Motion::Sweep, 0.0);
        assert!((z - 2.5).abs() < 1e-9 && (pitch - 0.25).abs() < 1e-9 && (roll - 35.0).abs() < 1e-9);
        assert!(yaw.abs() < 1e-9);
        let (z, (pitch, roll, _)) = height_and_angles(Motion::Sweep, 1e6);
        assert!((z - 14.0).abs() < 1e-9 && (pitch - 1.6).abs() < 1e-9 && (roll - 45.0).abs() < 1e-9);
    }

    #[test]
    fn still_is_the_pose_of_rest_for_ever() {
        let script = Trajectory::new(Motion::Still, 3, rest_on_pad());
        assert_eq!(script.couch_from_head(0.0), rest_on_pad());
        assert_eq!(script.couch_from_head(1e9), rest_on_pad());
    }

    #[test]
    fn steps_and_nods_start_at_rest() {
        for motion in [Motion::Steps, Motion::Nods] {
            let (z, (pitch, roll, yaw)) = height_and_angles(motion, 0.0);
            assert!(z.abs() < 1e-12 && pitch.abs() + roll.abs() + yaw.abs() < 1e-12, "{motion:?}");
        }
    }

    #[test]
    fn steps_move_every_direction_by_the_seed() {
        let at = |seed, t| Trajectory::new(Motion::Steps, seed, rest_on_pad()).couch_from_head(t);
        assert_ne!(at(1, 15.0), at(2, 15.0));
        assert_eq!(at(1, 15.0), at(1, 19.9));
        assert_ne!(at(1, 15.0), at(1, 25.0));
    }

    proptest! {
        #[test]
        fn every_time_gives_a_finite_pose_with_a_unit_quaternion(
            t in prop_oneof![any::<f64>(), Just(f64::NAN), Just(f64::INFINITY), 0.0..1e5f64],
            seed in any::<u64>(),
        ) {
            for motion in ALL {
                let pose = Trajectory::new(motion, seed, rest_on_pad()).couch_from_head(t);
                prop_assert!(pose.translation.vector.norm() < 1.0, "{motion:?} {}", pose);
                prop_assert!((pose.rotation.norm() - 1.0).abs() < 1e-12, "{motion:?} {}", pose);
            }
        }
    }
}
