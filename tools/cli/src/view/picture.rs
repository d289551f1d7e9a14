//! An image of the camera with the face in it, the face's points in the couch's frame, and the pieces of the reference,
//! as bytes for the page.

use serde_json::{Value, json};
use stillpoint_operator::frames::Rigid;
use stillpoint_report::Indexed;
use stillpoint_report::proposal::{PictureError, image, in_image, pixels};
use stillpoint_samples::{AlignedBytes, PieceState, Pieces, PointCloud, Sample, SurfacePiece, SurfacePieces};

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
    /// The pieces of the reference, where the frame was found on it.
    pub pieces: Option<AlignedBytes>,
}

/// A picture as it is shown.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// The image with the outline of the face.
    pub image: Indexed,
    /// The points of the face: three numbers each, m, in the couch's frame.
    pub points: Vec<f32>,
    /// The pieces that the frame shows.
    pub pieces: Vec<DrawnPiece>,
}

/// A piece of the reference.
#[derive(Clone, Copy, Debug)]
pub struct DrawnPiece {
    /// Column and row of its middle, px.
    at: [f64; 2],
    /// Its middle, m, in the couch's frame, if that is known.
    place: Option<[f64; 3]>,
    /// Its movement over its limit.
    over: f32,
    /// Whether it moves with the rest.
    state: PieceState,
}

impl DrawnPiece {
    /// Column, row, x, y, z (or nothing), movement over its limit, state.
    fn json(&self) -> Value {
        let place = self.place.map(|place| place.map(|c| (c * 1e4).round() / 1e4));
        let at = self.at.map(|c| (c * 10.0).round() / 10.0);
        json!([at, place, (1e3 * f64::from(self.over)).round() / 1e3, self.state.word()])
    }
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
    /// The image with the outline of the face, the points of the face, and the pieces of the reference.
    ///
    /// # Errors
    /// The image cannot be drawn.
    pub fn drawn(&self, camera: &Camera) -> Result<Drawn, PictureError> {
        let face = self.face.as_deref();
        let (from_face, to_couch) = (camera.image_from_face.as_ref(), camera.couch_from_face.as_ref());
        let image = image(camera.kind, &self.image)?;
        let drawn = |piece: &SurfacePiece| {
            let state = PieceState::from_number(piece.state).filter(|state| *state != PieceState::Unseen)?;
            let at = image.project(in_image(piece.xyz, from_face))?;
            let place = to_couch.map(|to_couch| to_couch.apply(piece.xyz.map(f64::from)));
            Some(DrawnPiece { at, place, over: piece.over, state })
        };
        let pieces = self.pieces.as_deref().and_then(|bytes| {
            let view =
                Pieces::split(SurfacePieces::KIND, bytes).and_then(|p| p.view::<SurfacePieces>()).ok()?;
            Some(view.elements.iter().filter_map(drawn).collect())
        });
        let points = face.map_or_else(Vec::new, |face| points(face, to_couch));
        let image = pixels(image, face, from_face)?;
        Ok(Drawn { image, points, pieces: pieces.unwrap_or_default() })
    }

    /// The picture as the page reads it: the length of a head (`u32`, little-endian), the head as JSON, the palette (three
    /// bytes a colour), a byte for each pixel, and the points of the face (three `f32`, little-endian, m, in the couch's
    /// frame).
    ///
    /// # Errors
    /// The image cannot be drawn.
    pub fn bytes(&self, camera: &Camera, given: Given, base: u64) -> Result<Vec<u8>, PictureError> {
        let Drawn { image: picture, points, pieces } = self.drawn(camera)?;
        let head = json!({
            "number": given.number,
            "final": given.is_final,
            "t": (self.origin as f64 - base as f64) * 1e-9,
            "width": picture.width,
            "height": picture.height,
            "colours": picture.colours.len(),
            "points": points.len() / 3,
            "face": self.face.is_some(),
            "pieces": pieces.iter().map(DrawnPiece::json).collect::<Vec<_>>(),
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
