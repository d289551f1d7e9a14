//! The scenes of the campaign: a drawn patient, what is worn, and what happens once the beam is on.

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

/// Added to a scene's number: the seed of what is drawn here. The limits of the checks were chosen on other patients.
const SEED: u64 = 990_000;
const FIRST_PATIENT: u64 = 10_000;
/// One scene in so many has a mask.
const MASKED: u64 = 12;

/// What happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Event {
    /// Nothing.
    Nothing,
    /// The head moves beyond the limits.
    Moved,
    /// The head goes.
    Gone,
    /// The head goes, and a ball of its size lies in its place.
    Ball,
    /// The head goes, and a head of another size lies in its place.
    OtherHead,
    /// A second head comes beside the head, which moves.
    SecondHead,
    /// A hand lies on the face, and the head moves under it.
    Hand,
    /// The camera sends the same image again and again, and the head moves.
    Frozen,
    /// The camera sends no images, and the head moves.
    Silent,
    /// The camera sends empty images, and the head moves.
    Blind,
}

/// All of them.
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
    /// Body, surroundings and view.
    pub patient: Patient,
    /// What moves with the head.
    pub worn: Worn,
    /// Whether a mask that is fixed to the couch lies over the face.
    pub is_masked: bool,
    /// What happens.
    pub event: Event,
    /// How long the beam is on before it happens, s.
    pub wait: f64,
    /// How far the head moves in it, m and rad, and how long that takes, s.
    shift: Vector3<f64>,
    turn: Vector3<f64>,
    over: f64,
    /// Size of a thing in the head's place over that of the head.
    other: f64,
}

impl Case {
    /// The scene of a number.
    ///
    /// # Errors
    /// Never happens for these sizes; it is passed on.
    pub fn of(number: u64) -> Result<Self, PatientError> {
        let mut rng = ChaCha8Rng::seed_from_u64(SEED + number);
        let patient = patient(FIRST_PATIENT + number)?;
        let worn = WORN[rng.random_range(0..WORN.len())];
        // Patients come by 30 of a kind; so every event meets every kind.
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

    /// Whether the head is no longer there after the event.
    pub fn takes_the_head(&self) -> bool {
        matches!(self.event, Event::Gone | Event::Ball | Event::OtherHead)
    }

    /// The head's pose `since` seconds after the event, from where it would be else.
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

    /// What stands still after the event and was not there before.
    ///
    /// # Errors
    /// Never happens for these sizes; it is passed on.
    pub fn comes(&self) -> Result<Vec<Object>, PatientError> {
        let s = self.patient.scale;
        // Of a scene without a head, its place over the couch's origin.
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

    /// Whether a capture is due: one head, at most a third of it hidden, seen from within 60 degrees of its front, with
    /// no mask over it. `shown` is the part of the head that nothing hides.
    pub fn is_due(&self, shown: f64) -> bool {
        let p = &self.patient;
        p.has_head() && p.is_plain() && !self.is_masked && shown >= 2.0 / 3.0 && p.off_front <= 60.0
    }

    /// Least part of a captured face that must be the head's.
    pub fn pure(&self) -> f64 {
        // A fist on the chin is cut with it; that it is none of the head, its motion tells.
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
