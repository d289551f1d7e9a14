//! The settings of the head on the couch: the objects that it rests on and touches.

use nalgebra::{Isometry3, Translation3};

use crate::scene::{Label, Object, PAD_HEIGHT, Scene, cuboid, ellipsoid};
use crate::shape::ShapeError;

/// What surrounds the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setting {
    /// A flat pad under the head and one at each side, which do not touch it.
    Pads,
    /// The pads at the sides are pressed against the head.
    TightPads,
    /// The head lies sunk into a soft pillow.
    Pillow,
    /// Shoulders and chest join the neck; the head lies on the flat pad.
    Shoulders,
    /// Shoulders, chest and pillow.
    Patient,
}

pub const SETTINGS: [Setting; 5] =
    [Setting::Pads, Setting::TightPads, Setting::Pillow, Setting::Shoulders, Setting::Patient];

/// Height of the pillow's top over the couch, in metres.
const PILLOW_TOP: f64 = 0.085;
/// How deep the head sinks into the pillow, in metres.
const SUNK: f64 = 0.030;
/// Back of the adult head below its origin, in metres.
const BACK: f64 = 0.095;
/// How deep the head sinks into the flat pad, in metres.
const PRESSED: f64 = 0.004;

impl Setting {
    /// The couch with all that stands still around a head of this scale (1 is the adult).
    ///
    /// # Errors
    /// [`ShapeError`] for a scale that is not finite and above 0.
    pub fn scene(self, head_scale: f64) -> Result<Scene, ShapeError> {
        if self == Self::Pads {
            return Scene::treatment_couch();
        }
        let mut scene = Scene::bare_couch()?;
        let half_pad = PAD_HEIGHT / 2.0;
        let flat = cuboid(Label::Pad, [0.0, 0.01, half_pad], [0.095, 0.115, half_pad], 0.0);
        match self {
            Self::Pads => {}
            Self::TightPads => {
                // The cranium is 155 mm broad: each pad is pressed in by some millimetres.
                let x = 0.073 * head_scale + 0.036;
                let middle = self.rest(head_scale).translation.z - 0.025;
                let half = (middle + 0.015) / 2.0;
                scene.add([
                    flat?,
                    ellipsoid(Label::Pad, [x, 0.0, middle], [0.036, 0.100, middle], 0.0)?,
                    cuboid(Label::Pad, [-x, -0.01, half], [0.036, 0.080, half], 4.0)?,
                ]);
            }
            Self::Pillow => scene.add(pillow(head_scale)?),
            Self::Shoulders => {
                scene.add([flat?]);
                scene.add(torso(head_scale)?);
            }
            Self::Patient => {
                scene.add(pillow(head_scale)?);
                scene.add(torso(head_scale)?);
            }
        }
        scene.add([
            cuboid(Label::Clutter, [0.205, 0.265, 0.025], [0.040, 0.055, 0.025], 20.0)?,
            ellipsoid(Label::Clutter, [-0.200, 0.270, 0.045], [0.034, 0.034, 0.060], 0.0)?,
        ]);
        Ok(scene)
    }

    /// Where a supine head of this scale lies at rest, `couch_from_head`.
    #[must_use]
    pub fn rest(self, head_scale: f64) -> Isometry3<f64> {
        let lowest = match self {
            Self::Pads | Self::TightPads | Self::Shoulders => PAD_HEIGHT - PRESSED,
            Self::Pillow | Self::Patient => PILLOW_TOP - SUNK,
        };
        Isometry3::from_parts(Translation3::new(0.0, -0.02, lowest + BACK * head_scale), Default::default())
    }
}

/// A pillow that rises at both sides of a head of this scale, up to where the head is broadest.
fn pillow(head_scale: f64) -> Result<[Object; 3], ShapeError> {
    // Both bolsters are pressed in by the head by some millimetres.
    let x = 0.072 * head_scale + 0.085;
    let middle = (PILLOW_TOP - SUNK + BACK * head_scale) / 2.0;
    Ok([
        ellipsoid(Label::Pad, [0.0, 0.015, 0.035], [0.215, 0.155, PILLOW_TOP - 0.035], 0.0)?,
        ellipsoid(Label::Pad, [x, 0.015, middle], [0.085, 0.140, middle], 0.0)?,
        ellipsoid(Label::Pad, [-x, 0.015, middle], [0.085, 0.140, middle], 0.0)?,
    ])
}

/// Shoulders and chest of a patient whose head has this scale, up against the stump of the neck.
fn torso(head_scale: f64) -> Result<[Object; 4], ShapeError> {
    // The neck's stump ends 176 mm below the origin of the adult head, which lies at y = -20 mm.
    let top = -0.02 - 0.150 * head_scale;
    Ok([
        ellipsoid(Label::Body, [0.0, top - 0.085, 0.080], [0.150, 0.090, 0.078], 0.0)?,
        ellipsoid(Label::Body, [0.145, top - 0.105, 0.075], [0.075, 0.090, 0.072], 0.0)?,
        ellipsoid(Label::Body, [-0.145, top - 0.105, 0.075], [0.075, 0.090, 0.072], 0.0)?,
        ellipsoid(Label::Body, [0.0, top - 0.330, 0.090], [0.185, 0.270, 0.110], 0.0)?,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Pinhole, couch_from_camera};
    use crate::head::Head;
    use crate::render::Renderer;
    use crate::scene::Form;
    use nalgebra::{Point3, Vector3};

    /// Pixels of each label as a camera at the feet sees the head at rest.
    fn seen(setting: Setting, scale: f64) -> [usize; 6] {
        let camera = Pinhole::new(566.0, 566.0, 319.5, 239.5, 640, 480).unwrap();
        let pose = couch_from_camera(Vector3::new(0.0, -0.48, 0.59), [45f64.to_radians(), 0.0, 0.0]);
        let scene = setting.scene(scale).unwrap();
        let mut renderer = Renderer::new(camera, &pose, &scene, Head::new(scale).unwrap()).unwrap();
        let mut counts = [0; 6];
        for &label in renderer.render(&setting.rest(scale)).unwrap().label() {
            counts[usize::from(label)] += 1;
        }
        counts
    }

    fn holds(form: &Form, point: &Point3<f64>) -> bool {
        match form {
            Form::Ellipsoid(shape) => {
                let p = shape.parent_from_shape().inverse_transform_point(point);
                p.coords.component_div(shape.semi_axes()).norm() <= 1.0
            }
            Form::Cuboid(shape) => {
                let p = shape.parent_from_shape().inverse_transform_point(point);
                p.coords.abs().component_div(shape.half_sizes()).max() <= 1.0
            }
        }
    }

    /// Whether the head at rest reaches into a thing of this name, higher over the couch than `over` metres.
    fn touches(setting: Setting, scale: f64, label: Label, over: f64) -> bool {
        let scene = setting.scene(scale).unwrap();
        let rest = setting.rest(scale);
        let head = Head::new(scale).unwrap();
        let surface = head.parts().iter().flat_map(|part| {
            (0..2000).map(|i| {
                let z = (f64::from(i) + 0.5) / 1000.0 - 1.0;
                let (angle, across) = (f64::from(i) * 2.4, (1.0 - z * z).sqrt());
                let unit = Vector3::new(across * angle.cos(), across * angle.sin(), z);
                part.parent_from_shape() * Point3::from(part.semi_axes().component_mul(&unit))
            })
        });
        let mut surface = surface.map(|point| rest * point).filter(|point| point.z > over);
        surface.any(|point| scene.objects().iter().any(|o| o.label == label && holds(&o.form, &point)))
    }

    #[test]
    fn the_head_is_seen_in_every_setting_and_touches_what_it_should() {
        for scale in [0.8, 1.0, 1.2] {
            for setting in SETTINGS {
                let counts = seen(setting, scale);
                assert!(counts[Label::Head as usize] > 8000, "{setting:?} {scale}: {counts:?}");
                let body = matches!(setting, Setting::Shoulders | Setting::Patient);
                assert_eq!(counts[Label::Body as usize] > 5000, body, "{setting:?} {scale}: {counts:?}");
                assert_eq!(touches(setting, scale, Label::Body, 0.0), body, "{setting:?} {scale}");
                assert!(touches(setting, scale, Label::Pad, 0.0), "{setting:?} {scale}");
                // Over the flat pad, only what lies beside the head is a pad.
                let is_raised = !matches!(setting, Setting::Pads | Setting::Shoulders);
                assert_eq!(
                    touches(setting, scale, Label::Pad, PAD_HEIGHT + 0.02),
                    is_raised,
                    "{setting:?} {scale}"
                );
            }
        }
    }
}
