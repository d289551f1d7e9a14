//! The picture of an image with its face: as a PNG file for the person who confirms a reference, and as pixels for a page.

use stillpoint_operator::frames::Rigid;
use stillpoint_samples::{BytesError, DepthImage, Pieces, PointCloud, Sample, SampleKind};

use crate::overlay::{Image, ImageError, PictureView, paint};
use crate::picture::Indexed;

/// Why a face is not drawn.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The face is not a cloud.
    #[error("the face: {0}")]
    Face(BytesError),
    /// The image cannot be drawn.
    #[error("the image: {0}")]
    Image(ImageError),
    /// The file cannot be written.
    #[error(transparent)]
    Png(#[from] png::EncodingError),
}

/// A PNG file of an image (a sample of a depth image or of an organised cloud) with a face (a sample of a cloud) and its
/// outline. `image_from_face` leads from the face's frame to that of the image where they differ.
///
/// # Errors
/// A sample is none of its kind, or the image cannot be drawn.
pub fn picture(
    kind: &SampleKind,
    image: &[u8],
    face: &[u8],
    image_from_face: Option<&Rigid>,
) -> Result<Vec<u8>, PictureError> {
    Ok(pixels(kind, image, Some(face), image_from_face)?.png()?)
}

/// The same as pixels; without a face, of the image alone.
///
/// # Errors
/// A sample is none of its kind, or the image cannot be drawn.
pub fn pixels(
    kind: &SampleKind,
    image: &[u8],
    face: Option<&[u8]>,
    image_from_face: Option<&Rigid>,
) -> Result<Indexed, PictureError> {
    let place = |p: [f32; 3]| match image_from_face {
        Some(t) => t.apply(p.map(f64::from)).map(|c| c as f32),
        None => p,
    };
    let mut points = Vec::new();
    if let Some(face) = face {
        let view = Pieces::split(PointCloud::KIND, face).and_then(|p| p.view::<PointCloud>());
        points.extend(view.map_err(PictureError::Face)?.elements.iter().map(|p| place(p.xyz)));
    }
    let image = if *kind == *DepthImage::KIND { Image::of_depth(image) } else { Image::of_cloud(image) };
    Ok(paint(&PictureView {
        origin: 0,
        image: image.map_err(PictureError::Image)?,
        face: points,
        plane: None,
        hull: Vec::new(),
        hull_area: None,
        rejection: None,
        captured: face.map(|_| 1),
    }))
}
