//! Scenes of the virtual rig drawn by chance: camera, its place and tilt, head, what it lies on and touches, and what lies
//! about.

#![allow(clippy::unwrap_used)]

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use stillpoint_rig::patient::view::{KINECT_V1, KINECT_V2, Kind, STRUCTURED, look};
use stillpoint_rig::scene::{Form, Label, Object, Scene};
use stillpoint_rig::setting::{SETTINGS, Setting};
use stillpoint_rig::shape::{Cuboid, Ellipsoid};

/// A scene that was drawn.
#[derive(Clone)]
pub struct Drawn {
    pub kind: Kind,
    pub couch_from_camera: Isometry3<f64>,
    pub setting: Setting,
    pub scene: Scene,
    pub scale: f64,
    pub couch_from_head: Isometry3<f64>,
    pub about: String,
}

/// The numbers of the scenes to draw: `$STILLPOINT_SCENES`, as `300` from 0 on or as `300..600`, else `most` from 0 on.
pub fn numbers(most: u64) -> Range<u64> {
    let Ok(text) = std::env::var("STILLPOINT_SCENES") else { return 0..most };
    let (first, end) = text.split_once("..").unwrap_or(("0", &text));
    first.parse().unwrap()..end.parse().unwrap()
}

/// The scene of a number.
pub fn drawn(number: u64) -> Drawn {
    let mut rng = ChaCha8Rng::seed_from_u64(1000 + number);
    let rng = &mut rng;
    let kind = [STRUCTURED, KINECT_V1, KINECT_V2][number as usize % 3];
    let setting = SETTINGS[number as usize / 3 % SETTINGS.len()];
    let scale = rng.random_range(0.9..1.1);
    let mut scene = setting.scene(scale).unwrap();
    let left_lying = rng.random_range(0..4);
    scene.add((0..left_lying).map(|_| thing(rng)));
    // The head turns to a side more than it nods.
    let mut within = |most: f64| rng.random_range(-most..most);
    let turned = UnitQuaternion::from_euler_angles(within(0.1), within(0.35), within(0.1));
    let mut couch_from_head = setting.rest(scale);
    couch_from_head.translation.vector += Vector3::new(within(5e-3), within(5e-3), within(4e-3) + 4e-3);
    couch_from_head.rotation = turned * couch_from_head.rotation;
    let target = couch_from_head.translation.vector + Vector3::new(within(0.04), within(0.04), 0.0);
    let tilt: f64 = rng.random_range(0.0..0.85);
    let around: f64 = rng.random_range(-0.6 * PI..0.6 * PI);
    // What is nearer than a camera is made for, it does not see.
    let least = target.z + ((kind.noise)().near + 0.17) * tilt.cos();
    let height: f64 = rng.random_range(0.5..0.9_f64).max(least);
    let aside = (height - target.z) * tilt.tan();
    let at = Vector3::new(target.x + aside * around.sin(), target.y - aside * around.cos(), height);
    let turn = rng.random_range(-0.3..0.3)
        + if number % 4 == 3 { TAU / 4.0 * f64::from(rng.random_range(1..4)) } else { 0.0 };
    let about = format!(
        "{number:4} {:10} {:9} scale {scale:.2}, {height:.2} m over the couch, {:.0} degrees off, {:.0} around, turned {:.0}",
        kind.name,
        format!("{setting:?}"),
        tilt.to_degrees(),
        around.to_degrees(),
        turn.to_degrees()
    );
    Drawn { kind, couch_from_camera: look(at, target, turn), setting, scene, scale, couch_from_head, about }
}

/// A thing on the couch, away from the head.
fn thing(rng: &mut impl Rng) -> Object {
    let side = if rng.random_range(0..2) == 0 { -1.0 } else { 1.0 };
    let half = Vector3::from_fn(|_, _| rng.random_range(0.015..0.05));
    let place = [side * rng.random_range(0.19..0.25), rng.random_range(-0.35..0.30), half.z * 0.8];
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..PI));
    let at = Isometry3::from_parts(Translation3::from(place), turn);
    let form = if rng.random_range(0..2) == 0 {
        Form::Ellipsoid(Ellipsoid::new(at, half).unwrap())
    } else {
        Form::Cuboid(Cuboid::new(at, half).unwrap())
    };
    Object { label: Label::Clutter, form }
}
