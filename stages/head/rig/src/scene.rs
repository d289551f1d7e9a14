//! What stands still in the room: couch, pads under and beside the head, clutter and floor.
//!
//! Couch frame: right-handed, origin on the couch's surface below the head, z up out of the couch,
//! y towards the head end, x to the left of a patient who lies supine with the head at that end.
//! These are the axes of the table top in IEC 61217 for a head-first supine patient.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::ray::{self, Hit, Ray};
use crate::shape::{Cuboid, Ellipsoid, ShapeError};

/// What a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Label {
    /// The floor, or no object.
    Background = 0,
    Table = 1,
    /// A pad under or beside the head.
    Pad = 2,
    /// Any other object on the couch.
    Clutter = 3,
    Head = 4,
    Body = 5,
}

/// The form of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Form {
    Ellipsoid(Ellipsoid),
    Cuboid(Cuboid),
}

/// One static object, placed in the couch frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Object {
    /// What its pixels are called.
    pub label: Label,
    /// Its form, in the couch frame.
    pub form: Form,
}

/// All objects but the head.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    objects: Vec<Object>,
    floor_z: f64,
}

/// Height of the pad under the head over the couch, in metres.
pub const PAD_HEIGHT: f64 = 0.040;

impl Scene {
    /// A scene of the objects given, over a floor at `floor_z` metres in the couch frame.
    /// Objects at the same depth are seen in the order given, the first before the others.
    pub fn new(objects: Vec<Object>, floor_z: f64) -> Self {
        Self { objects, floor_z }
    }

    /// The couch alone, over the floor: 0.53 m wide, with its head end 0.35 m from the origin.
    ///
    /// # Errors
    /// [`ShapeError`] never happens for these sizes; it is passed on.
    pub fn bare_couch() -> Result<Self, ShapeError> {
        Ok(Self::new(vec![cuboid(Label::Table, [0.0, -0.65, -0.03], [0.265, 1.0, 0.03], 0.0)?], -0.85))
    }

    /// The couch with a pad under the head, one at each side, and four things that were left lying.
    ///
    /// # Errors
    /// [`ShapeError`] never happens for these sizes; it is passed on.
    pub fn treatment_couch() -> Result<Self, ShapeError> {
        let mut scene = Self::bare_couch()?;
        let half_pad = PAD_HEIGHT / 2.0;
        scene.objects.extend([
            cuboid(Label::Pad, [0.0, 0.01, half_pad], [0.095, 0.115, half_pad], 0.0)?,
            ellipsoid(Label::Pad, [0.150, 0.0, 0.030], [0.036, 0.100, 0.045], 0.0)?,
            ellipsoid(Label::Pad, [-0.150, 0.0, 0.030], [0.036, 0.100, 0.045], 0.0)?,
            cuboid(Label::Clutter, [0.205, 0.265, 0.025], [0.040, 0.055, 0.025], 20.0)?,
            ellipsoid(Label::Clutter, [-0.200, 0.270, 0.045], [0.034, 0.034, 0.060], 0.0)?,
            cuboid(Label::Clutter, [-0.195, -0.230, 0.010], [0.045, 0.065, 0.010], -15.0)?,
            ellipsoid(Label::Clutter, [0.205, -0.240, 0.022], [0.026, 0.026, 0.026], 0.0)?,
        ]);
        Ok(scene)
    }

    /// Adds things that stand still.
    pub fn add(&mut self, objects: impl IntoIterator<Item = Object>) {
        self.objects.extend(objects);
    }

    /// Takes the ellipsoids of a body out of the things that stand still.
    pub fn take_body(&mut self) -> Vec<Ellipsoid> {
        let mut body = Vec::new();
        self.objects.retain(|object| match object.form {
            Form::Ellipsoid(shape) if object.label == Label::Body => {
                body.push(shape);
                false
            }
            _ => true,
        });
        body
    }

    /// The things that stand still, in the couch frame.
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// What a ray in the couch frame meets first, and what that is called.
    pub fn first_hit(&self, ray: &Ray) -> Option<(Hit, Label)> {
        let mut nearest = ray::horizontal_plane(ray, self.floor_z).map(|hit| (hit, Label::Background));
        for object in &self.objects {
            let hit = match &object.form {
                Form::Ellipsoid(shape) => ray::ellipsoid(ray, shape),
                Form::Cuboid(shape) => ray::cuboid(ray, shape),
            };
            if let Some(hit) = hit
                && nearest.is_none_or(|(best, _)| hit.t < best.t)
            {
                nearest = Some((hit, object.label));
            }
        }
        nearest
    }
}

fn placed(centre: [f64; 3], turn_degrees: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, turn_degrees.to_radians());
    Isometry3::from_parts(Translation3::from(centre), turn)
}

pub(crate) fn cuboid(
    label: Label,
    centre: [f64; 3],
    half: [f64; 3],
    turn_degrees: f64,
) -> Result<Object, ShapeError> {
    let shape = Cuboid::new(placed(centre, turn_degrees), Vector3::from(half))?;
    Ok(Object { label, form: Form::Cuboid(shape) })
}

pub(crate) fn ellipsoid(
    label: Label,
    centre: [f64; 3],
    semi_axes: [f64; 3],
    turn_degrees: f64,
) -> Result<Object, ShapeError> {
    let shape = Ellipsoid::new(placed(centre, turn_degrees), Vector3::from(semi_axes))?;
    Ok(Object { label, form: Form::Ellipsoid(shape) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    fn straight_down(x: f64, y: f64) -> Ray {
        Ray { origin: Point3::new(x, y, 1.0), direction: -Vector3::z() }
    }

    #[test]
    fn the_couch_surface_is_at_height_zero() {
        let (hit, label) = Scene::bare_couch().unwrap().first_hit(&straight_down(0.1, 0.1)).unwrap();
        assert!((hit.t - 1.0).abs() < 1e-12);
        assert_eq!(label, Label::Table);
    }

    #[test]
    fn beyond_the_couchs_edges_there_is_the_floor() {
        for (x, y) in [(0.27, 0.0), (-0.27, 0.0), (0.0, 0.36)] {
            let (hit, label) = Scene::bare_couch().unwrap().first_hit(&straight_down(x, y)).unwrap();
            assert!((hit.t - 1.85).abs() < 1e-12);
            assert_eq!(label, Label::Background);
        }
    }

    #[test]
    fn the_pad_lies_under_the_head() {
        let (hit, label) = Scene::treatment_couch().unwrap().first_hit(&straight_down(0.0, 0.0)).unwrap();
        assert!((hit.t - (1.0 - PAD_HEIGHT)).abs() < 1e-12);
        assert_eq!(label, Label::Pad);
    }

    #[test]
    fn a_ray_into_the_sky_meets_nothing() {
        let up = Ray { origin: Point3::new(0.0, 0.0, 1.0), direction: Vector3::z() };
        assert_eq!(Scene::treatment_couch().unwrap().first_hit(&up), None);
    }
}
