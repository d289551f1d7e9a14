//! What moves of a person besides the skull: a neck of skin, a chest that breathes, a face.
//!
//! Parts of the head are moved as wholes: the jaw turns about its joints, cheeks, lips, lids and brows shift. The neck is a
//! chain of which each link follows the skull by a part, from the skin below the jaw to the torso, which stays. The chest
//! rises and falls. All is a function of the pose of the skull and of the time.

use core::f64::consts::TAU;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::head::{Head, Tissue};
use crate::scene::{Label, Scene};
use crate::shape::{Ellipsoid, ShapeError};

/// Time in which an expression comes and goes, s.
const RAMP: f64 = 0.35;
/// Joints of the jaw in the adult's head frame, m, and how far they turn, rad.
const JOINT: [f64; 3] = [0.0, -8e-3, 8e-3];
const OPEN: f64 = 0.14;
/// Links of a neck: height of the centre in the adult's head frame, m, and the part by which it follows the skull.
const LINKS: [(f64, f64); 4] = [(-0.078, 0.85), (-0.104, 0.6), (-0.130, 0.35), (-0.156, 0.12)];
const LINK: [f64; 3] = [51e-3, 62e-3, 48e-3];
/// Place of the neck behind the ear canals, m.
const LINK_Z: f64 = -24e-3;
/// How far the throat rises in a swallow, m.
const THROAT: [f64; 2] = [4e-3, 3e-3];
/// Rate of the breath, Hz, and how far the chest rises, m.
const BREATH: f64 = 0.25;
const RISE: f64 = 5e-3;
/// Length of the torso over which the breath grows from the neck on, m.
const SHOULDERS: f64 = 0.3;

/// What the neck of a person is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Neck {
    /// One block with the head: a phantom.
    Rigid,
    /// Skin that bends between the head and a torso that stays.
    Skin,
}

/// An expression of a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Act {
    /// Cheeks and corners of the mouth rise.
    Smile,
    /// The mouth opens.
    Jaw,
    /// The mouth opens and closes about four times a second.
    Talk,
    /// Throat and lips move.
    Swallow,
    /// Both eyes are shut.
    Blink,
    /// The brows rise.
    Brow,
}

/// An expression at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expression {
    /// What the face does.
    pub act: Act,
    /// From when, s.
    pub begin: f64,
    /// Until when, s.
    pub end: f64,
    /// Factor of the movement; 1 is a clear expression.
    pub strength: f64,
}

impl Expression {
    /// How far it is made at a time, s: from 0 to its strength.
    fn weight(&self, t: f64) -> f64 {
        self.strength * smooth((t - self.begin) / RAMP) * smooth((self.end - t) / RAMP)
    }
}

/// How far each part of a face is from rest; 1 is a clear expression.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Face {
    smile: f64,
    open: f64,
    lips: f64,
    throat: f64,
    lids: f64,
    brow: f64,
}

impl Face {
    fn at(expressions: &[Expression], t: f64) -> Self {
        expressions.iter().fold(Self::default(), |mut face, expression| {
            let w = expression.weight(t);
            match expression.act {
                Act::Smile => face.smile += w,
                Act::Jaw => face.open += w,
                Act::Talk => {
                    face.open += 0.4 * w * libm::sin(TAU * 2.1 * t).abs();
                    face.lips += w * libm::sin(TAU * 1.3 * t);
                }
                Act::Swallow => {
                    face.throat += w;
                    face.open += 0.1 * w;
                    face.lips += 0.7 * w;
                }
                Act::Blink => face.lids += w,
                Act::Brow => face.brow += w,
            }
            face
        })
    }

    /// The movement of a part in the head frame of a head of this scale, whose centre is at `x` to the left.
    fn movement(&self, tissue: Tissue, x: f64, scale: f64) -> Isometry3<f64> {
        let shift = |mm: [f64; 3]| {
            let [along, up, out] = mm.map(|c| c * 1e-3 * scale);
            Isometry3::translation(if x < 0.0 { -along } else { along }, up, out)
        };
        match tissue {
            Tissue::Jaw => {
                let joint = Translation3::from(Vector3::from(JOINT) * scale);
                joint * UnitQuaternion::from_scaled_axis(Vector3::x() * (OPEN * self.open)) * joint.inverse()
            }
            Tissue::Cheek => shift([2.5, 3.0, 1.5].map(|c| c * self.smile)),
            Tissue::Lips => shift([0.0, -4.0 * self.open, -1.5 * self.lips - self.smile - 3.0 * self.open]),
            Tissue::Lid => shift([0.0, 0.0, 0.8 * self.lids + 0.4 * self.smile]),
            Tissue::Brow => shift([0.0, 5.0 * self.brow, 0.8 * self.brow]),
            Tissue::Bone | Tissue::Neck => Isometry3::identity(),
        }
    }
}

/// A person: what surrounds the skull and how it moves.
#[derive(Debug, Clone)]
pub struct Person {
    head: Head,
    scale: f64,
    neck: Neck,
    expressions: Vec<Expression>,
    /// Where the skull lies at rest, `couch_from_head`.
    rest: Isometry3<f64>,
    links: Vec<(Ellipsoid, f64)>,
    /// Shoulders, chest and belly in the couch frame, each with its part of the breath.
    torso: Vec<(Ellipsoid, f64)>,
}

impl Person {
    /// A head of this scale at rest. With a neck of skin, the body of the `scene` becomes a part of the person.
    ///
    /// # Errors
    /// A scale at which no link of a neck is an ellipsoid.
    pub fn new(
        head: Head,
        scale: f64,
        neck: Neck,
        expressions: Vec<Expression>,
        rest: Isometry3<f64>,
        scene: &mut Scene,
    ) -> Result<Self, ShapeError> {
        let link = |(y, follows): (f64, f64)| {
            let place = Isometry3::translation(0.0, y * scale, LINK_Z * scale);
            Ok((Ellipsoid::new(place, Vector3::from(LINK) * scale)?, follows))
        };
        let (links, torso) = match neck {
            Neck::Rigid => (Vec::new(), Vec::new()),
            Neck::Skin => {
                let begins = rest.translation.y - 0.15 * scale;
                let breathes = |shape: Ellipsoid| {
                    let y = shape.parent_from_shape().translation.y;
                    (shape, ((begins - y) / SHOULDERS).clamp(0.0, 1.0))
                };
                let links = LINKS.into_iter().map(link).collect::<Result<_, _>>()?;
                (links, scene.take_body().into_iter().map(breathes).collect())
            }
        };
        Ok(Self { head, scale, neck, expressions, rest, links, torso })
    }

    /// All parts in the couch frame, with their labels, with the skull at a pose, `t` seconds after the start.
    pub fn parts(&self, couch_from_head: &Isometry3<f64>, t: f64, parts: &mut Vec<(Ellipsoid, Label)>) {
        let t = if t.is_finite() { t } else { 0.0 };
        let face = Face::at(&self.expressions, t);
        parts.clear();
        for (part, tissue) in self.head.parts().iter().zip(self.head.tissues()) {
            if tissue == Tissue::Neck && self.neck == Neck::Skin {
                continue;
            }
            let x = part.parent_from_shape().translation.x;
            let place = couch_from_head * face.movement(tissue, x, self.scale) * part.parent_from_shape();
            parts.push((part.placed(place), Label::Head));
        }
        for (link, follows) in &self.links {
            let throat = face.throat * self.scale;
            let swallowed = Isometry3::translation(0.0, THROAT[0] * throat, THROAT[1] * throat);
            let in_head = swallowed * link.parent_from_shape();
            let place = between(&(self.rest * in_head), &(couch_from_head * in_head), *follows);
            let label = if *follows > 0.5 { Label::Head } else { Label::Body };
            parts.push((link.placed(place), label));
        }
        let breath = 0.5 * (1.0 - libm::cos(TAU * BREATH * t));
        for (shape, part) in &self.torso {
            let risen = Translation3::new(0.0, 0.0, RISE * part * breath) * shape.parent_from_shape();
            parts.push((shape.placed(risen), Label::Body));
        }
    }
}

/// From one pose to another by a part of the way.
fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, part: f64) -> Isometry3<f64> {
    let shift = from.translation.vector.lerp(&to.translation.vector, part);
    let turn = (to.rotation * from.rotation.inverse()).scaled_axis() * part;
    Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn) * from.rotation)
}

/// From 0 to 1 with no velocity at either end.
fn smooth(part: f64) -> f64 {
    let p = part.clamp(0.0, 1.0);
    p * p * (3.0 - 2.0 * p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setting::Setting;

    fn person(neck: Neck, act: Act) -> Person {
        let smile = Expression { act, begin: 1.0, end: 3.0, strength: 1.0 };
        let mut scene = Setting::Patient.scene(1.0).unwrap();
        let rest = Setting::Patient.rest(1.0);
        Person::new(Head::new(1.0).unwrap(), 1.0, neck, vec![smile], rest, &mut scene).unwrap()
    }

    fn parts(person: &Person, moved: f64, t: f64) -> Vec<(Ellipsoid, Label)> {
        let mut parts = Vec::new();
        person.parts(&(Translation3::new(0.0, 0.0, moved) * Setting::Patient.rest(1.0)), t, &mut parts);
        parts
    }

    fn shifts(one: &[(Ellipsoid, Label)], other: &[(Ellipsoid, Label)]) -> Vec<f64> {
        let place = |part: &(Ellipsoid, Label)| part.0.parent_from_shape().translation.vector;
        one.iter().zip(other).map(|(a, b)| (place(a) - place(b)).norm()).collect()
    }

    #[test]
    fn a_neck_of_skin_follows_the_skull_less_the_nearer_it_is_to_a_torso_that_stays() {
        let person = person(Neck::Skin, Act::Smile);
        let (head, whole) = (24, 24 + 4 + 4);
        let moved = shifts(&parts(&person, 0.0, 0.0), &parts(&person, 0.01, 0.0));
        assert_eq!(moved.len(), whole);
        assert!(moved[..head].iter().all(|m| (m - 0.01).abs() < 1e-12));
        assert!(
            moved[head..head + 4].is_sorted_by(|a, b| a > b) && moved[head] < 0.01 && moved[head + 3] > 0.0
        );
        assert!(moved[head + 4..].iter().all(|m| *m == 0.0));
    }

    #[test]
    fn a_chest_breathes_and_the_skull_does_not() {
        let person = person(Neck::Skin, Act::Smile);
        let moved = shifts(&parts(&person, 0.0, 0.0), &parts(&person, 0.0, 0.8));
        assert!(moved[..28].iter().all(|m| *m == 0.0));
        // The nearer to the neck, the less.
        let torso = &moved[28..];
        assert!(torso.iter().all(|m| (0.2e-3..5e-3).contains(m)), "{torso:?}");
        assert!(torso.last().unwrap() > &1.5e-3 && torso.is_sorted(), "{torso:?}");
    }

    #[test]
    fn each_expression_moves_parts_of_the_face_by_millimetres_and_no_bone_and_then_rests() {
        for act in [Act::Smile, Act::Jaw, Act::Talk, Act::Swallow, Act::Blink, Act::Brow] {
            let person = person(Neck::Rigid, act);
            let rest = parts(&person, 0.0, 0.5);
            let tissues: Vec<Tissue> = person.head.tissues().collect();
            let moved = shifts(&rest, &parts(&person, 0.0, 2.1));
            for (tissue, moved) in tissues.iter().zip(&moved) {
                assert!(
                    *moved < 0.012 && (*tissue != Tissue::Bone || *moved == 0.0),
                    "{act:?} {tissue:?} {moved}"
                );
            }
            assert!(moved.iter().any(|m| *m > 0.5e-3), "{act:?} {moved:?}");
            assert_eq!(rest, parts(&person, 0.0, 3.5));
        }
    }

    #[test]
    fn a_smile_is_symmetrical() {
        let smile = parts(&person(Neck::Rigid, Act::Smile), 0.0, 2.0);
        let rest = parts(&person(Neck::Rigid, Act::Smile), 0.0, 0.0);
        let by = |i: usize| {
            let place = |all: &[(Ellipsoid, Label)]| all[i].0.parent_from_shape().translation.vector;
            place(&smile) - place(&rest)
        };
        assert!((by(11) - by(12).component_mul(&Vector3::new(-1.0, 1.0, 1.0))).norm() < 1e-12);
        assert!(by(11).x > 0.0);
    }
}
