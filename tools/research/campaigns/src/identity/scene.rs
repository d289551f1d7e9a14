//! The scenes of the campaign: a drawn patient, worn objects, and an event after the beam is on.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;
use serde::Serialize;
use stillpoint_rig::patient::PatientError;
use stillpoint_rig::patient::drawn::{Extra, Patient, head_at, patient};
use stillpoint_rig::patient::worn::{WORN, Worn};
use stillpoint_rig::scene::{Form, Label, Object};
use stillpoint_rig::shape::{Ellipsoid, ShapeError};

/// The seed of a scene is this value plus the scene's number.
const SEED: u64 = 990_000;
/// Number of the patient of scene 0. The limits of the checks were chosen on other patients.
const FIRST_PATIENT: u64 = 10_000;
/// One scene in this many has a mask, if its patient allows one.
const MASKED: u64 = 12;

/// The event of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Event {
    Nothing,
    /// The head moves beyond the limits.
    Moved,
    /// The head is removed.
    Gone,
    /// A ball of the head's size replaces the head.
    Ball,
    /// A head of another size replaces the head.
    OtherHead,
    /// A second head appears beside the head, and the head moves.
    SecondHead,
    /// A hand lies on the face, and the head moves under it.
    Hand,
    /// The camera repeats its last image, and the head moves.
    Frozen,
    /// The camera sends no images, and the head moves.
    Silent,
    /// The camera sends empty images, and the head moves.
    Blind,
}

pub const EVENTS: [Event; 10] = [
    Event::Nothing,
    Event::Moved,
    Event::Gone,
    Event::Ball,
    Event::OtherHead,
    Event::SecondHead,
    Event::Hand,
    Event::Frozen,
    Event::Silent,
    Event::Blind,
];

/// A scene of the campaign.
pub struct Case {
    /// The drawn body, its surroundings and the camera's view.
    pub patient: Patient,
    /// Object that is worn on the head and moves with it.
    pub worn: Worn,
    /// Whether a mask lies over the face. It is fixed to the couch.
    pub is_masked: bool,
    pub event: Event,
    /// Time from beam on to the event, s.
    pub wait: f64,
    /// Translation of the head by the event, m.
    shift: Vector3<f64>,
    /// Rotation vector of the head's rotation by the event, rad.
    turn: Vector3<f64>,
    /// Duration of the head's motion, s.
    over: f64,
    /// Size of the other head, relative to the patient's head.
    other: f64,
}

impl Case {
    /// Draws the scene of a number. The same number always gives the same scene.
    ///
    /// # Errors
    /// A size at which no shape exists. No size that is drawn here is one.
    pub fn of(number: u64) -> Result<Self, PatientError> {
        let mut rng = ChaCha8Rng::seed_from_u64(SEED + number);
        let patient = patient(FIRST_PATIENT + number)?;
        let worn = WORN[rng.random_range(0..WORN.len())];
        // The kind of the patient depends on `number % 30`. The shift by `number / 30` gives every kind every event.
        let event = EVENTS[(number + number / 30) as usize % EVENTS.len()];
        let direction = |rng: &mut ChaCha8Rng| {
            Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0_f64))
                .try_normalize(1e-3)
                .unwrap_or(Vector3::z())
        };
        let (far, aside) = (rng.random_range(3e-3..10e-3), direction(&mut rng));
        let (angle, about) = (rng.random_range(0.0..0.05), direction(&mut rng));
        Ok(Self {
            is_masked: patient.has_head() && patient.is_plain() && number % MASKED == MASKED - 1,
            patient,
            worn,
            event,
            wait: rng.random_range(0.3..1.0),
            shift: far * aside,
            turn: angle * about,
            over: rng.random_range(0.05..0.5),
            other: [rng.random_range(0.82..0.92), rng.random_range(1.09..1.2)][rng.random_range(0..2)],
        })
    }

    /// Whether the event removes the head.
    pub fn takes_the_head(&self) -> bool {
        matches!(self.event, Event::Gone | Event::Ball | Event::OtherHead)
    }

    /// Pose of the head `since` seconds after the event. `couch_from_head` is its pose without the event.
    pub fn pose(&self, couch_from_head: &Isometry3<f64>, since: f64) -> Isometry3<f64> {
        let mut pose = *couch_from_head;
        if self.takes_the_head() {
            pose.translation.vector.z = -20.0;
        } else if self.event != Event::Nothing {
            let part = (since / self.over).clamp(0.0, 1.0);
            pose.translation.vector += part * self.shift;
            pose.rotation = UnitQuaternion::from_scaled_axis(part * self.turn) * pose.rotation;
        }
        pose
    }

    /// Static objects that the event adds to the scene.
    ///
    /// # Errors
    /// A size at which no shape exists. No size that is drawn here is one.
    pub fn comes(&self) -> Result<Vec<Object>, PatientError> {
        let s = self.patient.scale;
        // In a scene without a head, the objects appear over the origin of the couch.
        let rest = match self.patient.has_head() {
            true => self.patient.couch_from_head,
            false => Isometry3::translation(0.0, 0.0, 0.1 * s + 0.03),
        };
        let in_head = |at: [f64; 3], semi: [f64; 3]| -> Result<Object, ShapeError> {
            let [x, y, z] = at.map(|c| c * s);
            let place = rest * Isometry3::translation(x, y, z);
            let shape = Ellipsoid::new(place, Vector3::from(semi.map(|r| r * s)))?;
            Ok(Object { label: Label::Clutter, form: Form::Ellipsoid(shape) })
        };
        Ok(match self.event {
            Event::Ball => vec![in_head([0.0, 0.03, 0.0], [0.088; 3])?],
            Event::OtherHead => head_at(&rest, (s * self.other).clamp(0.5, 1.5))?,
            Event::SecondHead => {
                let side = if rest.translation.x > 0.0 { -0.21 } else { 0.21 };
                head_at(&(Translation3::new(side, 0.02, 0.03) * rest), (s * self.other).clamp(0.5, 1.5))?
            }
            Event::Hand => vec![
                in_head([0.01, -0.03, 0.115], [0.045, 0.055, 0.02])?,
                in_head([-0.02, 0.04, 0.105], [0.012, 0.05, 0.011])?,
                in_head([0.01, 0.045, 0.105], [0.012, 0.055, 0.011])?,
                in_head([0.04, 0.035, 0.10], [0.012, 0.05, 0.011])?,
            ],
            _ => Vec::new(),
        })
    }

    /// Whether a capture is due. It is due if the scene has one head without a mask, at least two thirds of the head
    /// are visible, and the camera is within 60 degrees of its front. `shown` is the visible fraction of the head.
    pub fn is_time(&self, shown: f64) -> bool {
        let p = &self.patient;
        p.has_head() && p.is_plain() && !self.is_masked && shown >= 2.0 / 3.0 && p.off_front <= 60.0
    }

    /// Minimum fraction of the captured points that must lie on the head.
    pub fn pure(&self) -> f64 {
        // The segmentation does not separate a fist from the chin. Only its motion shows that it is not part of the
        // head.
        if self.patient.extra == Extra::Fist { 0.5 } else { 0.7 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_event_meets_every_kind_of_patient() {
        let mut met = std::collections::BTreeSet::new();
        for number in 0..300 {
            let case = Case::of(number).unwrap();
            met.insert((format!("{:?}", case.patient.extra), case.event));
        }
        assert_eq!(met.len(), 100);
    }

    #[test]
    fn a_head_that_moves_ends_beyond_the_limits_and_one_that_goes_is_gone() {
        for number in 0..60 {
            let case = Case::of(number).unwrap();
            let rest = Isometry3::translation(0.0, 0.0, 0.1);
            let moved = case.pose(&rest, 1.0).translation.vector - rest.translation.vector;
            match case.event {
                Event::Nothing => assert_eq!(moved.norm(), 0.0),
                _ if case.takes_the_head() => assert!(moved.norm() > 10.0),
                _ => assert!((3e-3..11e-3).contains(&moved.norm()), "{moved}"),
            }
        }
    }
}
