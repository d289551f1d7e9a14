//! Where an image shows faces: a funnel-structured cascade (Wu, Kan, He, Shan, Chen, 2017), by the crate `rustface`.

use std::io;

use rustface::{ImageData, Model};

use crate::view::{Area, Top, UprightImage, Viewing};

/// Side of the smallest face that the model knows, in pixels.
pub const SMALLEST: u32 = 40;
/// The model that the crate ships.
static MODEL: &[u8] = include_bytes!("../data/seeta_fd_frontal_v1.0.bin");

/// How faces are searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectParams {
    /// Which way the tops of the heads point in the image.
    pub top: Top,
    /// Side of the smallest face, in pixels; from `SMALLEST`.
    pub smallest: u32,
    /// Side of the largest face, in pixels.
    pub largest: u32,
    /// Smallest certainty of a face.
    pub least_score: f64,
}

/// A face in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Area of the image.
    pub area: Area,
    /// How certain the detector is, in its own unit.
    pub score: f64,
}

/// Finds faces. It keeps no state from image to image.
pub struct FaceDetector {
    model: Model,
    view: UprightImage,
}

impl FaceDetector {
    /// A detector with the model that comes with the project.
    ///
    /// # Errors
    /// The model cannot be read: the program is damaged.
    pub fn new() -> io::Result<Self> {
        Ok(Self { model: rustface::read_model(MODEL)?, view: UprightImage::default() })
    }

    /// The faces in an image of rows of `width` pixels, the most certain first. Of equally certain faces the one
    /// farther left comes first, then the one farther up.
    pub fn find(&mut self, image: &[u8], width: usize, params: &DetectParams) -> Vec<Face> {
        let reduce = (params.smallest / SMALLEST).max(1);
        let largest = (params.largest / reduce).max(SMALLEST);
        // The crate reads the candidates' pixels without looking whether a candidate has left the image at its right or
        // lower edge. A margin as wide as the largest one keeps it inside: there, nothing is a face.
        let viewing = Viewing { top: params.top, reduce: reduce as usize, margin: largest as usize };
        self.view.show(image, width, &viewing);
        let [across, down] = self.view.size();
        let data = ImageData::new(self.view.pixels(), across as u32, down as u32);
        let mut detector = rustface::create_detector_with_model(self.model.clone());
        detector.set_max_face_size(largest);
        detector.set_score_thresh(params.least_score.max(f64::MIN_POSITIVE));
        detector.set_pyramid_scale_factor(0.8);
        detector.set_slide_window_step(4, 4);
        let mut faces: Vec<Face> = detector
            .detect(&data)
            .iter()
            .filter(|found| found.score().is_finite())
            .map(|found| {
                let place = found.bbox();
                let [left, top, width, height] = [
                    i64::from(place.x()),
                    i64::from(place.y()),
                    i64::from(place.width()),
                    i64::from(place.height()),
                ]
                .map(|n| n.clamp(-1_000_000, 1_000_000) as i32);
                let area = Area { left, top, width: width as u32, height: height as u32 };
                Face { area: self.view.in_image(area, &viewing), score: found.score() }
            })
            .collect();
        let place = |face: &Face| (face.area.left, face.area.top);
        faces.sort_by(|a, b| b.score.total_cmp(&a.score).then(place(a).cmp(&place(b))));
        faces
    }
}
