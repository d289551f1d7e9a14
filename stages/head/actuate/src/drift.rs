//! Whether a head slides in a channel that its target does not hold.
//!
//! A rig of three bladders holds height, pitch and roll: nothing brings a head back that slides sideways or turns about the
//! vertical. Where it was when the beam first began for a target is where it was set up; from there it may drift by a
//! limited distance.

use stillpoint_samples::{TargetElement, TrackElement};

use crate::aim::numbers;

/// How far a head may drift from where it was when the beam first began, in channels that the target does not hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriftLimits {
    /// In each coordinate, m.
    pub position: f64,
    /// In each angle, rad.
    pub angle: f64,
}

/// What a place belongs to: another target, other channels or another reference have another.
type Setting = (u32, u32, u32);

/// Where the head was when the beam first began.
#[derive(Clone, Debug)]
pub struct Drift {
    limits: DriftLimits,
    begun: Option<(Setting, [f64; 6])>,
}

impl Drift {
    /// Before the first beam.
    #[must_use]
    pub fn new(limits: DriftLimits) -> Self {
        Self { limits, begun: None }
    }

    /// Goes on with other limits.
    pub fn set_limits(&mut self, limits: DriftLimits) {
        self.limits = limits;
    }

    /// Notes that the beam is on, with the pose of a reference of this number at a target. A channel counts from where it
    /// was first known.
    pub fn begin(&mut self, track: &TrackElement, target: &TargetElement, reference: u32) {
        let setting = (target.asked, target.channels, reference);
        let now = self.known(track);
        match &mut self.begun {
            Some((begun, places)) if *begun == setting => {
                places
                    .iter_mut()
                    .zip(now)
                    .filter(|(place, _)| place.is_nan())
                    .for_each(|(place, now)| *place = now);
            }
            _ => self.begun = Some((setting, now)),
        }
    }

    /// Whether the head is too far from there. A channel that was never known as well as its limit says nothing; one that
    /// was, and no longer is, may be anywhere.
    #[must_use]
    pub fn is_beyond(&self, track: &TrackElement, target: &TargetElement, reference: u32) -> bool {
        let Some((setting, begun)) = &self.begun else { return false };
        if *setting != (target.asked, target.channels, reference) {
            return false;
        }
        let now = self.known(track);
        let is_free = |place: &usize| !target.channels & (1 << *place) != 0;
        (0..6).filter(is_free).filter(|place| !begun[*place].is_nan()).any(|place| {
            let plain = now[place] - begun[place];
            let moved = if place < 3 { plain } else { libm::remainder(plain, core::f64::consts::TAU) };
            moved.is_nan() || moved.abs() > self.limit(place)
        })
    }

    fn limit(&self, place: usize) -> f64 {
        if place < 3 { self.limits.position } else { self.limits.angle }
    }

    /// The coordinates that are known as well as their limits; NaN for the others.
    fn known(&self, track: &TrackElement) -> [f64; 6] {
        let now = numbers(track, true);
        std::array::from_fn(|place| {
            let is_known = track.channels & (1 << place) != 0
                && track.covariance[13 * place].sqrt() <= self.limit(place)
                && now[place].is_finite();
            if is_known { now[place] } else { f64::NAN }
        })
    }
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::{Standing, TargetStatus};

    use super::*;

    const LIMITS: DriftLimits = DriftLimits { position: 2e-3, angle: 0.02 };

    fn track(x: f64, yaw: f64) -> TrackElement {
        let mut track =
            TrackElement { channels: 0x3f, standing: Standing::Measured as u32, ..TrackElement::NONE };
        (track.position, track.orientation) =
            ([x, 0.0, 0.1], [libm::cos(0.5 * yaw), 0.0, 0.0, libm::sin(0.5 * yaw)]);
        (0..6).for_each(|i| track.covariance[13 * i] = 1e-8);
        track
    }

    /// A target of z, pitch and roll.
    fn target(asked: u32) -> TargetElement {
        TargetElement {
            position: [f64::NAN, f64::NAN, 0.1],
            angles: [0.0, 0.0, f64::NAN],
            velocity: [0.0; 3],
            angle_rates: [0.0; 3],
            channels: 4 | 8 | 16,
            status: TargetStatus::Held as u32,
            unreachable: 0,
            asked,
            refusal: 0,
            reserved: 0,
        }
    }

    fn begun() -> Drift {
        let mut drift = Drift::new(LIMITS);
        drift.begin(&track(0.01, 0.1), &target(1), 1);
        drift
    }

    #[test]
    fn a_head_that_slides_sideways_or_turns_is_beyond_and_one_at_rest_is_not() {
        let drift = begun();
        assert!(!drift.is_beyond(&track(0.0119, 0.119), &target(1), 1));
        assert!(drift.is_beyond(&track(0.0121, 0.1), &target(1), 1));
        assert!(drift.is_beyond(&track(0.0079, 0.1), &target(1), 1));
        assert!(drift.is_beyond(&track(0.01, 0.121), &target(1), 1));
    }

    #[test]
    fn what_the_target_holds_is_not_judged_here() {
        let mut track = track(0.01, 0.1);
        track.position[2] = 1.0;
        assert!(!begun().is_beyond(&track, &target(1), 1));
    }

    #[test]
    fn the_place_stays_while_the_beam_comes_and_goes_and_is_another_with_another_target_or_reference() {
        let mut drift = begun();
        drift.begin(&track(0.0115, 0.1), &target(1), 1);
        assert!(drift.is_beyond(&track(0.013, 0.1), &target(1), 1));
        assert!(!drift.is_beyond(&track(0.013, 0.1), &target(2), 1));
        assert!(!drift.is_beyond(&track(0.013, 0.1), &target(1), 2));
        drift.begin(&track(0.013, 0.1), &target(2), 1);
        assert!(drift.is_beyond(&track(0.01, 0.1), &target(2), 1));
    }

    #[test]
    fn a_channel_that_was_never_known_says_nothing_and_one_that_is_lost_is_beyond() {
        let mut unknown = track(0.01, 0.1);
        unknown.covariance[0] = f64::INFINITY;
        let mut drift = Drift::new(LIMITS);
        drift.begin(&unknown, &target(1), 1);
        assert!(!drift.is_beyond(&unknown, &target(1), 1));
        assert!(!drift.is_beyond(&track(0.1, 0.1), &target(1), 1), "nothing is known of where it was");
        // From here on x is known, and counts.
        drift.begin(&track(0.02, 0.1), &target(1), 1);
        assert!(!drift.is_beyond(&track(0.02, 0.1), &target(1), 1));
        assert!(drift.is_beyond(&track(0.0225, 0.1), &target(1), 1));
        for lost in [f64::INFINITY, f64::NAN, -1.0] {
            unknown.covariance[0] = lost;
            assert!(drift.is_beyond(&unknown, &target(1), 1), "{lost}");
        }
        let mut missing = track(0.02, 0.1);
        missing.channels = 4 | 8 | 16;
        assert!(drift.is_beyond(&missing, &target(1), 1), "the channel is missing");
    }
}
