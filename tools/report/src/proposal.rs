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

/// The image of a sample of a depth image or of an organised cloud.
///
/// # Errors
/// The sample is none of its kind, or no image.
pub fn image(kind: &SampleKind, bytes: &[u8]) -> Result<Image, PictureError> {
    let image = if *kind == *DepthImage::KIND { Image::of_depth(bytes) } else { Image::of_cloud(bytes) };
    image.map_err(PictureError::Image)
}

/// A PNG file of an image with a face (a sample of a cloud) and its outline. `image_from_face` leads from the face's frame
/// to that of the image where they differ.
///
/// # Errors
/// The face is no cloud, or the file cannot be written.
pub fn picture(image: Image, face: &[u8], image_from_face: Option<&Rigid>) -> Result<Vec<u8>, PictureError> {
    Ok(pixels(image, Some(face), image_from_face)?.png()?)
}

/// The same as pixels; without a face, of the image alone.
///
/// # Errors
/// The face is no cloud.
pub fn pixels(
    image: Image,
    face: Option<&[u8]>,
    image_from_face: Option<&Rigid>,
) -> Result<Indexed, PictureError> {
    let mut points = Vec::new();
    if let Some(face) = face {
        let view = Pieces::split(PointCloud::KIND, face).and_then(|p| p.view::<PointCloud>());
        let view = view.map_err(PictureError::Face)?;
        points.extend(view.elements.iter().map(|p| in_image(p.xyz, image_from_face)));
    }
    Ok(paint(&PictureView {
        origin: 0,
        image,
        face: points,
        plane: None,
        hull: Vec::new(),
        hull_area: None,
        rejection: None,
        captured: face.map(|_| 1),
    }))
}

/// A point of the face's frame in that of the image.
pub fn in_image(point: [f32; 3], image_from_face: Option<&Rigid>) -> [f32; 3] {
    match image_from_face {
        Some(t) => t.apply(point.map(f64::from)).map(|c| c as f32),
        None => point,
    }
}
