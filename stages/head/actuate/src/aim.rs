//! The error of a pose against its target, its uncertainty, and the resulting reasons against the beam.

use stillpoint_samples::{GateReason as Reason, TargetElement, TargetStatus, TrackElement};

/// The tolerances. A beam that is on stays on up to the tolerances; a beam that is off needs smaller errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Of each coordinate, m.
    pub position: f64,
    /// Of each angle, rad.
    pub angle: f64,
    /// Part of the tolerances within which errors must lie for the beam to begin, 0 to 1.
    pub begin: f64,
    /// Greatest standard deviation of a coordinate, m.
    pub position_sd: f64,
    /// Greatest standard deviation of an angle, rad.
    pub angle_sd: f64,
}

/// What was judged. What is not known, or not held by the target, is NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Pose less target: x, y, z in m; pitch, roll, yaw in rad, within half a turn.
    pub error: [f64; 6],
    /// Largest standard deviation of a coordinate that is held, m.
    pub position_sd: f64,
    /// Largest standard deviation of an angle that is held, rad.
    pub angle_sd: f64,
    /// The reasons against the beam: bits of [`Reason`].
    pub against: u32,
}

impl Aim {
    /// There is no error to judge, for these reasons.
    #[must_use]
    pub const fn blind(against: u32) -> Self {
        Self { error: [f64::NAN; 6], position_sd: f64::NAN, angle_sd: f64::NAN, against }
    }

    /// Judges a pose that has an estimate against a target in its frame; `is_on` says whether the beam is on.
    #[must_use]
    pub fn at(track: &TrackElement, target: &TargetElement, tolerances: &Tolerances, is_on: bool) -> Self {
        let held = target.channels & 0x3f;
        if target.status == TargetStatus::None as u32 || held == 0 {
            return Self::blind(Reason::NO_TARGET);
        }
        if track.channels & held != held {
            return Self::blind(Reason::NO_POSE);
        }
        let mut aim = Self::blind(0);
        if target.status == TargetStatus::Moving as u32 {
            aim.against |= Reason::TARGET_MOVES;
        }
        let holds = |place: usize| held >> place & 1 == 1;
        let pose = numbers(track, (3..6).any(holds));
        let requested = [target.position, target.angles];
        let part = if is_on { 1.0 } else { tolerances.begin };
        for place in (0..6).filter(|place| holds(*place)) {
            let is_angle = place >= 3;
            let plain = pose[place] - requested[place / 3][place % 3];
            let error = if is_angle { libm::remainder(plain, core::f64::consts::TAU) } else { plain };
            aim.error[place] = error;
            let sd = track.covariance[13 * place].sqrt();
            let (tolerance, largest_sd, known, reason) = if is_angle {
                (tolerances.angle, tolerances.angle_sd, &mut aim.angle_sd, Reason::ANGLE)
            } else {
                (tolerances.position, tolerances.position_sd, &mut aim.position_sd, Reason::POSITION)
            };
            // `max` would pass over a NaN.
            *known = if known.is_nan() || sd.is_nan() || sd > *known { sd } else { *known };
            let within = |value: f64, bound: f64| value <= bound;
            aim.against |= match error.is_finite() {
                false => Reason::NOT_FINITE,
                true if within(error.abs(), part * tolerance) => 0,
                true => reason,
            };
            aim.against |= if within(sd, largest_sd) { 0 } else { Reason::UNCERTAIN };
        }
        aim
    }
}

/// The six numbers of a track; its angles only where they are wanted.
pub(crate) fn numbers(track: &TrackElement, angles: bool) -> [f64; 6] {
    let mut numbers = [f64::NAN; 6];
    numbers[..3].copy_from_slice(&track.position);
    if let Some(angles) = angles.then(|| stillpoint_pose::angles(track.orientation)).flatten() {
        numbers[3..].copy_from_slice(&angles);
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCES: Tolerances =
        Tolerances { position: 1e-3, angle: 0.01, begin: 0.8, position_sd: 0.5e-3, angle_sd: 5e-3 };
    /// z, pitch and roll.
    const CHANNELS: u32 = 4 | 8 | 16;

    fn track() -> TrackElement {
        let mut track = TrackElement { channels: 0x3f, standing: 1, ..TrackElement::NONE };
        (track.position, track.orientation) = ([0.2, 0.3, 0.1], [1.0, 0.0, 0.0, 0.0]);
        (0..6).for_each(|i| track.covariance[13 * i] = 1e-8);
        track
    }

    fn target() -> TargetElement {
        TargetElement {
            position: [f64::NAN, f64::NAN, 0.1],
            angles: [0.0, 0.0, f64::NAN],
            velocity: [0.0; 3],
            angle_rates: [0.0; 3],
            channels: CHANNELS,
            status: TargetStatus::Held as u32,
            unreachable: 0,
            asked: 1,
            refusal: 0,
            reserved: 0,
        }
    }

    fn against(track: &TrackElement, target: &TargetElement, is_on: bool) -> u32 {
        Aim::at(track, target, &TOLERANCES, is_on).against
    }

    #[test]
    fn only_the_channels_of_the_target_are_judged() {
        let aim = Aim::at(&track(), &target(), &TOLERANCES, false);
        assert_eq!((aim.against, aim.error[2], aim.error[3]), (0, 0.0, 0.0));
        assert!(aim.error[0].is_nan() && aim.error[5].is_nan());
        assert_eq!((aim.position_sd, aim.angle_sd), (1e-4, 1e-4));
    }

    #[test]
    fn errors_begin_within_less_than_they_end_at() {
        let mut track = track();
        for (z, off, on) in
            [(0.79e-3, 0, 0), (0.9e-3, Reason::POSITION, 0), (1.1e-3, Reason::POSITION, Reason::POSITION)]
        {
            track.position[2] = 0.1 - z;
            assert_eq!(
                (against(&track, &target(), false), against(&track, &target(), true)),
                (off, on),
                "{z}"
            );
        }
    }

    #[test]
    fn angles_are_those_of_the_couch_and_wrap_around() {
        let (mut track, mut target) = (track(), target());
        // A roll of 0.02 rad about y.
        track.orientation = [libm::cos(0.01), 0.0, libm::sin(0.01), 0.0];
        assert_eq!(against(&track, &target, true), Reason::ANGLE);
        target.angles[1] = 0.02 + core::f64::consts::TAU;
        assert_eq!(against(&track, &target, true), 0);
    }

    #[test]
    fn what_is_not_known_speaks_against_it() {
        let (good, held) = (track(), target());
        let with = |change: fn(&mut TrackElement, &mut TargetElement)| {
            let (mut track, mut target) = (good, held);
            change(&mut track, &mut target);
            against(&track, &target, true)
        };
        assert_eq!(with(|_, t| t.status = TargetStatus::None as u32), Reason::NO_TARGET);
        assert_eq!(with(|_, t| t.channels = 0), Reason::NO_TARGET);
        assert_eq!(with(|_, t| t.status = TargetStatus::Moving as u32), Reason::TARGET_MOVES);
        assert_eq!(with(|t, _| t.channels = 7), Reason::NO_POSE);
        assert_eq!(with(|t, _| t.position[2] = f64::NAN), Reason::NOT_FINITE);
        assert_eq!(with(|t, _| t.orientation = [0.0; 4]), Reason::NOT_FINITE);
        assert_eq!(with(|_, t| t.position[2] = f64::INFINITY), Reason::NOT_FINITE);
        assert_eq!(with(|t, _| t.covariance[26] = 1e-6), Reason::UNCERTAIN);
        assert_eq!(with(|t, _| t.covariance[39] = f64::NAN), Reason::UNCERTAIN);
        assert_eq!(with(|t, _| t.covariance[39] = f64::INFINITY), Reason::UNCERTAIN);
        // Yaw is not held.
        assert_eq!(with(|t, _| t.covariance[65] = f64::INFINITY), 0);
    }
}
