//! The view of a scene with the head at a pose.
//!
//! What stands still is cast once. A frame then costs the pixels that the head covers, or covered before.

use nalgebra::Isometry3;

use crate::camera::Pinhole;
use crate::head::Head;
use crate::quadric::Quadric;
use crate::ray::Ray;
use crate::scene::{Label, Scene};
use crate::shape::{Ellipsoid, first_non_finite};
use crate::view::{Rect, RenderedView};

/// The reason why an image cannot be rendered.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// A pose that is not finite.
    #[error("{transform} contains {value}; give a finite translation and rotation")]
    Pose {
        /// `couch_from_camera`, `couch_from_head` or `couch_from_part`.
        transform: &'static str,
        /// The first component that is not finite.
        value: f64,
    },
}

const NO_PART: u8 = u8::MAX;

/// Camera, scene and head, with the buffers that a frame needs; no allocation after construction.
#[derive(Debug, Clone)]
pub struct Renderer {
    camera: Pinhole,
    camera_from_couch: Isometry3<f64>,
    head: Head,
    background: RenderedView,
    view: RenderedView,
    /// The moving part that each pixel shows, by number.
    part: Vec<u8>,
    /// x of the direction of each column.
    x_of_column: Vec<f64>,
    parts_seen: Vec<(Quadric, Label)>,
    head_rect: Rect,
}

impl Renderer {
    /// Renders the static objects. `couch_from_camera` places the camera frame (x right, y down, z forward).
    ///
    /// # Errors
    /// [`RenderError::Pose`] when `couch_from_camera` is not finite.
    pub fn new(
        camera: Pinhole,
        couch_from_camera: &Isometry3<f64>,
        scene: &Scene,
        head: Head,
    ) -> Result<Self, RenderError> {
        check("couch_from_camera", couch_from_camera)?;
        let background = cast(&camera, couch_from_camera, scene);
        Ok(Self {
            camera,
            camera_from_couch: couch_from_camera.inverse(),
            view: background.clone(),
            background,
            part: vec![NO_PART; camera.pixels()],
            x_of_column: (0..camera.width()).map(|u| camera.direction(u, 0).x).collect(),
            parts_seen: Vec::with_capacity(head.parts().len()),
            head,
            head_rect: Rect::EMPTY,
        })
    }

    /// The intrinsics that the view has.
    pub fn camera(&self) -> &Pinhole {
        &self.camera
    }

    /// The view with the head at `couch_from_head`. It depends on that pose only, not on earlier ones.
    ///
    /// # Errors
    /// [`RenderError::Pose`] when the pose is not finite; the view stays what it was.
    pub fn render(&mut self, couch_from_head: &Isometry3<f64>) -> Result<&RenderedView, RenderError> {
        check("couch_from_head", couch_from_head)?;
        let camera_from_head = self.camera_from_couch * couch_from_head;
        self.parts_seen.clear();
        let seen = |part| Some((Quadric::new(&camera_from_head, part)?, Label::Head));
        self.parts_seen.extend(self.head.parts().iter().filter_map(seen));
        Ok(self.show())
    }

    /// The view with these parts in the place of the head, in the couch frame, at most 255.
    ///
    /// # Errors
    /// [`RenderError::Pose`] when the place of a part is not finite; the view stays what it was.
    pub fn render_parts(&mut self, parts: &[(Ellipsoid, Label)]) -> Result<&RenderedView, RenderError> {
        for (part, _) in parts {
            check("couch_from_part", part.parent_from_shape())?;
        }
        let Self { parts_seen, camera_from_couch, .. } = self;
        parts_seen.clear();
        let seen =
            |(part, label): &(Ellipsoid, Label)| Some((Quadric::new(camera_from_couch, part)?, *label));
        parts_seen.extend(parts.iter().take(usize::from(NO_PART)).filter_map(seen));
        Ok(self.show())
    }

    /// Draws the parts that are seen.
    fn show(&mut self) -> &RenderedView {
        self.erase_head();
        for part in 0..self.parts_seen.len() {
            self.draw(part);
        }
        self.label_parts();
        &self.view
    }

    fn erase_head(&mut self) {
        let rect = self.head_rect;
        self.view.restore(&rect, &self.background);
        if !rect.is_empty() {
            for v in rect.v0..rect.v1 {
                self.part[v * self.view.width..][rect.u0..rect.u1].fill(NO_PART);
            }
        }
        self.head_rect = Rect::EMPTY;
    }

    fn draw(&mut self, part: usize) {
        let (quadric, _) = self.parts_seen[part];
        let width = self.view.width;
        for v in 0..self.view.height {
            let row = quadric.on_row(self.camera.direction(0, v).y);
            let columns = row.columns(&self.camera);
            if columns.is_empty() {
                continue;
            }
            self.head_rect.cover(columns.start, columns.end, v);
            let depths = &mut self.view.depth_m[v * width..][columns.clone()];
            let parts = &mut self.part[v * width..][columns.clone()];
            let pixels = depths.iter_mut().zip(parts).zip(&self.x_of_column[columns]);
            for ((depth, shown), &x) in pixels {
                let t = row.depth(x) as f32;
                // Both written always, so that the loop has no branch. A NaN is never nearer.
                let nearer = t > 0.0 && t < *depth;
                *depth = if nearer { t } else { *depth };
                *shown = if nearer { part as u8 } else { *shown };
            }
        }
    }

    fn label_parts(&mut self) {
        let rect = self.head_rect;
        if rect.is_empty() {
            return;
        }
        for v in rect.v0..rect.v1 {
            let y = self.camera.direction(0, v).y;
            for u in rect.u0..rect.u1 {
                let pixel = v * self.view.width + u;
                if let Some((quadric, label)) = self.parts_seen.get(usize::from(self.part[pixel])) {
                    let t = f64::from(self.view.depth_m[pixel]);
                    self.view.label[pixel] = *label as u8;
                    self.view.cosine[pixel] = quadric.cosine(self.x_of_column[u], y, t) as f32;
                }
            }
        }
    }
}

fn check(transform: &'static str, pose: &Isometry3<f64>) -> Result<(), RenderError> {
    match first_non_finite(pose) {
        Some(value) => Err(RenderError::Pose { transform, value }),
        None => Ok(()),
    }
}

/// The view of the static objects, one ray per pixel.
fn cast(camera: &Pinhole, couch_from_camera: &Isometry3<f64>, scene: &Scene) -> RenderedView {
    let mut view = RenderedView::empty(camera);
    let origin = couch_from_camera.translation.vector.into();
    for v in 0..camera.height() {
        for u in 0..camera.width() {
            let direction = couch_from_camera.transform_vector(&camera.direction(u, v));
            if let Some((hit, label)) = scene.first_hit(&Ray { origin, direction }) {
                let pixel = v * camera.width() + u;
                view.depth_m[pixel] = hit.t as f32;
                view.label[pixel] = label as u8;
                view.cosine[pixel] = hit.cosine as f32;
            }
        }
    }
    view
}
