//! An image of the camera with the face in it, and the face's points in the couch's frame, as bytes for the page.

use serde_json::json;
use stillpoint_operator::frames::Rigid;
use stillpoint_report::Indexed;
use stillpoint_report::proposal::{PictureError, pixels};
use stillpoint_samples::{AlignedBytes, Pieces, PointCloud, Sample};

use super::scene::Camera;

/// Points of a face that are drawn at most.
const MOST_POINTS: usize = 4000;

/// An image with its face, as the samples are.
#[derive(Clone, Debug)]
pub struct Picture {
    /// When it was acquired, ns of session time.
    pub origin: u64,
    /// The image.
    pub image: AlignedBytes,
    /// The face, if there is one.
    pub face: Option<AlignedBytes>,
}

/// What is known of a picture besides its samples.
#[derive(Clone, Copy, Debug)]
pub struct Given {
    /// Its number, of a run.
    pub number: u64,
    /// Whether the same question gets the same picture later.
    pub is_final: bool,
}

impl Picture {
    /// The image with the outline of the face, and the points of the face: three numbers each, m, in the couch's frame.
    ///
    /// # Errors
    /// The image cannot be drawn.
    pub fn drawn(&self, camera: &Camera) -> Result<(Indexed, Vec<f32>), PictureError> {
        let face = self.face.as_deref();
        let picture = pixels(camera.kind, &self.image, face, camera.image_from_face.as_ref())?;
        let points = face.map_or_else(Vec::new, |face| points(face, camera.couch_from_face.as_ref()));
        Ok((picture, points))
    }

    /// The picture as the page reads it: the length of a head (`u32`, little-endian), the head as JSON, the palette (three
    /// bytes a colour), a byte for each pixel, and the points of the face (three `f32`, little-endian, m, in the couch's
    /// frame).
    ///
    /// # Errors
    /// The image cannot be drawn.
    pub fn bytes(&self, camera: &Camera, given: Given, base: u64) -> Result<Vec<u8>, PictureError> {
        let (picture, points) = self.drawn(camera)?;
        let head = json!({
            "number": given.number,
            "final": given.is_final,
            "t": (self.origin as f64 - base as f64) * 1e-9,
            "width": picture.width,
            "height": picture.height,
            "colours": picture.colours.len(),
            "points": points.len() / 3,
            "face": self.face.is_some(),
        });
        // The pixels begin at any place: a page reads them as bytes.
        let head = head.to_string();
        let mut bytes = Vec::with_capacity(4 + head.len() + picture.pixels.len() + 4 * points.len());
        bytes.extend_from_slice(&(head.len() as u32).to_le_bytes());
        bytes.extend_from_slice(head.as_bytes());
        bytes.extend_from_slice(picture.colours.as_flattened());
        bytes.extend_from_slice(&picture.pixels);
        points.iter().for_each(|p| bytes.extend_from_slice(&p.to_le_bytes()));
        Ok(bytes)
    }
}

/// Evenly chosen points of a face, in the couch's frame; none where that frame is not known.
fn points(face: &[u8], couch_from_face: Option<&Rigid>) -> Vec<f32> {
    let (Some(to_couch), Ok(view)) =
        (couch_from_face, Pieces::split(PointCloud::KIND, face).and_then(|p| p.view::<PointCloud>()))
    else {
        return Vec::new();
    };
    let step = view.elements.len().div_ceil(MOST_POINTS).max(1);
    let known = view.elements.iter().step_by(step).filter(|p| p.xyz.iter().all(|c| c.is_finite()));
    known.flat_map(|p| to_couch.apply(p.xyz.map(f64::from)).map(|c| c as f32)).collect()
}
