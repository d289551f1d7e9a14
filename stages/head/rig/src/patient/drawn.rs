//! Random patients: build of the body, blanket, arms, objects and other people beside the patient, and views.

use std::f64::consts::{PI, TAU};

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;

use super::PatientError;
use super::view::{KINECT_V1, KINECT_V2, Kind, STRUCTURED, look};
use crate::head::Head;
use crate::scene::{Form, Label, Object, Scene};
use crate::shape::{Cuboid, Ellipsoid, ShapeError};

/// The special feature of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extra {
    None,
    /// A blanket over the chest.
    Blanket,
    /// Both arms lie beside the head.
    ArmsUp,
    Breasts,
    /// A fist lies on the chin.
    Fist,
    /// A ball of a head's size lies on the couch.
    Ball,
    /// A second head lies beside the patient's.
    SecondHead,
    /// A second head is held over the patient's chest, higher than the patient's.
    Visitor,
    /// The couch is empty.
    Nobody,
    /// A body whose head is out of view, or hidden by a screen.
    Headless,
}

/// Every variant of [`Extra`].
pub const EXTRAS: [Extra; 10] = [
    Extra::None,
    Extra::Blanket,
    Extra::ArmsUp,
    Extra::Breasts,
    Extra::Fist,
    Extra::Ball,
    Extra::SecondHead,
    Extra::Visitor,
    Extra::Nobody,
    Extra::Headless,
];

#[derive(Debug, Clone)]
pub struct Patient {
    pub kind: Kind,
    /// Pose of the camera.
    pub couch_from_camera: Isometry3<f64>,
    /// Every object except the head.
    pub scene: Scene,
    /// Scale of the head; the adult head has 1.
    pub scale: f64,
    /// Pose of the head; far below the couch if the scene has no head.
    pub couch_from_head: Isometry3<f64>,
    pub extra: Extra,
    /// Angle between the line of sight and the direction in which the face looks, degrees.
    pub off_front: f64,
    /// A line of text that describes the scene.
    pub about: String,
}

impl Patient {
    /// Returns whether the scene has a patient with a visible head.
    pub fn has_head(&self) -> bool {
        !matches!(self.extra, Extra::Nobody | Extra::Headless)
    }

    /// Returns whether the scene has no object that resembles a head, and a patient with a head.
    pub fn is_plain(&self) -> bool {
        !matches!(self.extra, Extra::SecondHead | Extra::Visitor | Extra::Nobody | Extra::Headless)
    }
}

fn ellipsoid(label: Label, centre: [f64; 3], semi: [f64; 3]) -> Result<Object, ShapeError> {
    let at = Isometry3::from_parts(Translation3::from(centre), UnitQuaternion::identity());
    Ok(Object { label, form: Form::Ellipsoid(Ellipsoid::new(at, Vector3::from(semi))?) })
}

fn cuboid(label: Label, centre: [f64; 3], half: [f64; 3]) -> Result<Object, ShapeError> {
    let at = Isometry3::from_parts(Translation3::from(centre), UnitQuaternion::identity());
    Ok(Object { label, form: Form::Cuboid(Cuboid::new(at, Vector3::from(half))?) })
}

/// Returns the parts of a second head, which does not move.
///
/// # Errors
/// The scale is not finite or not above 0.
pub fn head_at(couch_from_head: &Isometry3<f64>, scale: f64) -> Result<Vec<Object>, PatientError> {
    let placed = |part: &Ellipsoid| {
        let shape = Ellipsoid::new(couch_from_head * part.parent_from_shape(), *part.semi_axes())?;
        Ok(Object { label: Label::Clutter, form: Form::Ellipsoid(shape) })
    };
    Head::new(scale)?.parts().iter().map(placed).collect()
}

/// Returns shoulders, chest and belly next to the neck of a head of scale `s` at `head`. Their thickness is `stout` times
/// that of the rig's torso, and they lie higher than it by `raised`, m.
fn torso(s: f64, head: &Vector3<f64>, stout: f64, raised: f64) -> Result<Vec<Object>, ShapeError> {
    let (x, top) = (head.x, head.y - 0.155 * s);
    let z = head.z - 0.055 * s + raised;
    let part = |dx: f64, dy: f64, dz: f64, semi: [f64; 3]| {
        ellipsoid(Label::Body, [x + dx * s, top + dy * s, z + dz * s], semi.map(|a| a * s))
    };
    Ok(vec![
        part(0.0, -0.085, 0.0, [0.150, 0.090, 0.070 * stout])?,
        part(0.145, -0.105, -0.005, [0.075, 0.090, 0.066 * stout])?,
        part(-0.145, -0.105, -0.005, [0.075, 0.090, 0.066 * stout])?,
        part(0.0, -0.330, 0.01, [0.185 * stout.sqrt(), 0.270, 0.100 * stout])?,
    ])
}

fn put(
    scene: &mut Scene,
    things: impl IntoIterator<Item = Result<Object, ShapeError>>,
) -> Result<(), ShapeError> {
    for thing in things {
        scene.add([thing?]);
    }
    Ok(())
}

/// Draws the patient with this number.
///
/// # Errors
/// A shape is not valid. The sizes that are drawn do not cause this error.
pub fn patient(number: u64) -> Result<Patient, PatientError> {
    let mut rng = ChaCha8Rng::seed_from_u64(77_000 + number);
    let rng = &mut rng;
    let kind = [STRUCTURED, KINECT_V1, KINECT_V2][number as usize % 3];
    let extra = EXTRAS[number as usize / 3 % EXTRAS.len()];
    let s: f64 = rng.random_range(0.55..1.2);
    let mut within = |most: f64| rng.random_range(-most..most);
    let place = Vector3::new(within(0.05), within(0.05), 0.0);
    let turn = UnitQuaternion::from_euler_angles(within(0.15), within(0.3), within(0.12));
    let rest: f64 = rng.random_range(0.0..0.06);
    let head = Vector3::new(place.x, place.y, 0.095 * s + rest);
    let couch_from_head = Isometry3::from_parts(Translation3::from(head), turn);
    let mut scene = Scene::bare_couch()?;
    match rng.random_range(0..3) {
        // The head lies on a flat rest, on a ring, or on a pillow.
        0 if rest > 0.005 => {
            put(
                &mut scene,
                [cuboid(Label::Pad, [head.x, head.y + 0.01, rest / 2.0], [0.09, 0.11, rest / 2.0])],
            )?;
        }
        1 => put(
            &mut scene,
            (0..10).map(|k| {
                let angle = TAU * f64::from(k) / 10.0;
                let at =
                    [head.x + 0.075 * angle.cos(), head.y + 0.02 + 0.075 * angle.sin(), 0.5 * rest + 0.01];
                ellipsoid(Label::Pad, at, [0.032, 0.032, 0.5 * rest + 0.02])
            }),
        )?,
        _ => put(
            &mut scene,
            [ellipsoid(Label::Pad, [head.x, head.y + 0.015, 0.3 * rest], [0.2, 0.15, 0.7 * rest + 0.02])],
        )?,
    }
    let (stout, raised) = (rng.random_range(0.75..1.5_f64), rng.random_range(-0.01..0.06) * s);
    if extra != Extra::Nobody {
        scene.add(torso(s, &head, stout, raised)?);
    }
    let chest = head.z - 0.055 * s + raised + 0.1 * stout * s;
    let mut shown = couch_from_head;
    match extra {
        Extra::None => {}
        Extra::Blanket => put(
            &mut scene,
            [ellipsoid(
                Label::Clutter,
                [head.x, head.y - 0.50 * s, 0.4 * chest],
                [0.26, 0.30 * s, 0.62 * chest],
            )],
        )?,
        Extra::ArmsUp => put(
            &mut scene,
            [-1.0, 1.0].into_iter().flat_map(|side| {
                let arm = |dx: f64, dy: f64, z: f64, semi: [f64; 3]| {
                    let at = [head.x + side * dx * s, head.y + dy * s, z];
                    ellipsoid(Label::Body, at, semi.map(|a| a * s))
                };
                [
                    arm(0.19, -0.08, 0.05 + 0.5 * rest, [0.05, 0.15, 0.05]),
                    arm(0.15, 0.12, 0.05 + 0.5 * rest, [0.045, 0.13, 0.045]),
                    arm(0.08, 0.24, 0.05 + 0.5 * rest, [0.045, 0.06, 0.04]),
                ]
            }),
        )?,
        Extra::Breasts => put(
            &mut scene,
            [-1.0, 1.0].map(|side| {
                let r = rng.random_range(0.055..0.085) * s;
                ellipsoid(
                    Label::Body,
                    [head.x + side * 0.085 * s, head.y - 0.38 * s, chest - 0.015],
                    [r, r, r],
                )
            }),
        )?,
        Extra::Fist => {
            let r = 0.045 * s.max(0.7);
            put(
                &mut scene,
                [ellipsoid(
                    Label::Body,
                    [head.x + 0.03 * s, head.y - 0.09 * s, head.z + 0.09 * s],
                    [r, r, r],
                )],
            )?;
        }
        Extra::Ball => {
            let r = rng.random_range(0.06..0.1);
            let side = if rng.random_range(0..2) == 0 { -1.0 } else { 1.0 };
            put(&mut scene, [ellipsoid(Label::Clutter, [head.x + side * 0.2, head.y + 0.1, r], [r, r, r])])?;
        }
        Extra::SecondHead => {
            let at =
                Vector3::new(head.x + 0.2 * if place.x > 0.0 { -1.0 } else { 1.0 }, head.y + 0.03, head.z);
            scene.add(head_at(&Isometry3::from_parts(Translation3::from(at), turn), s)?);
        }
        Extra::Visitor => {
            let at = Vector3::new(head.x + 0.12, head.y - 0.3 * s, chest + 0.16);
            let upright = UnitQuaternion::from_euler_angles(-1.2, 0.2, 0.0);
            scene.add(head_at(&Isometry3::from_parts(Translation3::from(at), upright), 1.0)?);
        }
        Extra::Nobody | Extra::Headless => {
            shown.translation.vector.z = -20.0;
        }
    }
    if extra == Extra::Headless && number.is_multiple_of(2) {
        put(&mut scene, [cuboid(Label::Clutter, [head.x, head.y + 0.02, 0.12], [0.2, 0.13, 0.12])])?;
    }
    let tilt: f64 = rng.random_range(0.0..75.0_f64).to_radians();
    let around: f64 = rng.random_range(-PI..PI);
    let reach = ((kind.noise)().near + 0.2).max(rng.random_range(0.5..0.95));
    let camera_view = Vector3::new(tilt.sin() * around.sin(), -tilt.sin() * around.cos(), tilt.cos());
    let target = head + Vector3::new(rng.random_range(-0.03..0.03), -0.12 * s, 0.0);
    let off_front = camera_view.angle(&(turn * Vector3::z())).to_degrees();
    let about = format!(
        "{number:4} {:10} {extra:?} scale {s:.2} stout {stout:.2} raised {:.0} mm, {:.2} m, {:.0} degrees off, {:.0} around",
        kind.name,
        raised * 1e3,
        reach,
        tilt.to_degrees(),
        around.to_degrees(),
    );
    let couch_from_camera = look(target + reach * camera_view, target, rng.random_range(-0.3..0.3));
    Ok(Patient { kind, couch_from_camera, scene, scale: s, couch_from_head: shown, extra, off_front, about })
}
