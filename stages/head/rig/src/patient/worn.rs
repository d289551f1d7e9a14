//! Objects on a patient's head: hair, a cap and a beard move with the head; a perforated mask is fixed to the couch.

use nalgebra::{Isometry3, Point3, Vector3};

use super::PatientError;
use crate::camera::Pinhole;
use crate::head::Head;
use crate::render::Renderer;
use crate::scene::{Label, Scene};
use crate::shape::{Ellipsoid, ShapeError};
use crate::view::RenderedView;

/// An object that moves with the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Worn {
    Nothing,
    /// A cap over the cranium, 4 mm thick.
    Cap,
    /// Hair that stands 20 mm off the back and the sides of the cranium.
    Hair,
    /// A beard from ear to ear, 15 mm off the chin.
    Beard,
}

/// Every variant of [`Worn`].
pub const WORN: [Worn; 4] = [Worn::Nothing, Worn::Cap, Worn::Hair, Worn::Beard];

impl Worn {
    /// Returns a head of this scale that wears the object.
    ///
    /// # Errors
    /// The scale is not finite or not above 0.
    pub fn on_head(self, scale: f64) -> Result<Head, PatientError> {
        let part = |centre: [f64; 3], semi: [f64; 3]| -> Result<Ellipsoid, ShapeError> {
            let mm = 1e-3 * scale;
            let [x, y, z] = centre.map(|c| c * mm);
            Ellipsoid::new(Isometry3::translation(x, y, z), Vector3::from(semi.map(|s| s * mm)))
        };
        let parts = match self {
            Self::Nothing => Vec::new(),
            Self::Cap => vec![part([0.0, 52.0, 3.0], [81.0, 81.0, 97.0])?],
            Self::Hair => {
                vec![
                    part([0.0, 44.0, -22.0], [95.0, 102.0, 92.0])?,
                    part([0.0, 5.0, -50.0], [80.0, 85.0, 55.0])?,
                ]
            }
            Self::Beard => vec![part([0.0, -66.0, 40.0], [60.0, 46.0, 58.0])?],
        };
        Ok(Head::new(scale)?.with(parts))
    }
}

/// Distance between the centres of neighbouring holes of a mask, m.
const HOLES: f64 = 0.010;
/// Radius of a hole, m.
const HOLE: f64 = 0.0032;
/// Distance between the mask and the face at rest, m.
const OFF: f64 = 0.002;
/// Height of the edge of the mask above the origin of the adult head, m.
const EDGE: f64 = 0.02;

/// The image of a perforated thermoplastic mask over the face. The mask does not move when the head moves under it.
#[derive(Debug, Clone)]
pub struct Mask {
    view: RenderedView,
}

impl Mask {
    /// Makes the mask of a head of this scale at `couch_from_head`, as a camera at `couch_from_camera` sees it.
    ///
    /// # Errors
    /// The scale or a pose is not valid.
    pub fn new(
        camera: Pinhole,
        couch_from_camera: &Isometry3<f64>,
        scale: f64,
        couch_from_head: &Isometry3<f64>,
    ) -> Result<Self, PatientError> {
        let outside =
            |part: &Ellipsoid| Ellipsoid::new(*part.parent_from_shape(), part.semi_axes().add_scalar(OFF));
        let parts = Head::new(scale)?.parts().iter().map(outside).collect::<Result<Vec<_>, _>>()?;
        let nothing = Scene::new(Vec::new(), -100.0);
        let mut renderer = Renderer::new(camera, couch_from_camera, &nothing, Head::of(parts))?;
        let mut view = renderer.render(couch_from_head)?.clone();
        let head_from_camera = couch_from_head.inverse() * couch_from_camera;
        for pixel in 0..camera.pixels() {
            let direction = camera.direction(pixel % camera.width(), pixel / camera.width());
            let depth = f64::from(view.depth_m[pixel]);
            let is_mask = view.label[pixel] == Label::Head as u8
                && is_solid(&(head_from_camera * Point3::from(direction * depth)), scale);
            view.label[pixel] = Label::Clutter as u8;
            if !is_mask {
                view.depth_m[pixel] = f32::INFINITY;
            }
        }
        Ok(Self { view })
    }

    /// Adds the mask to an image of the same camera without the mask.
    pub fn cover(&self, view: &mut RenderedView) {
        for pixel in 0..view.depth_m.len().min(self.view.depth_m.len()) {
            if self.view.depth_m[pixel] < view.depth_m[pixel] {
                view.depth_m[pixel] = self.view.depth_m[pixel];
                view.label[pixel] = self.view.label[pixel];
                view.cosine[pixel] = self.view.cosine[pixel];
            }
        }
    }
}

/// Returns whether a point on the mask, in the frame of the head, lies outside every hole.
fn is_solid(place: &Point3<f64>, scale: f64) -> bool {
    let cell = |along: f64| along - (along / HOLES).round() * HOLES;
    place.z > EDGE * scale && cell(place.x).hypot(cell(place.y)) > HOLE
}
