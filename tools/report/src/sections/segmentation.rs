//! Face, plane and hull in the images, and the frames without a result.

use serde::Serialize;

use crate::ReportError;
use crate::camera::Camera;
use crate::numbers::{count, fixed};
use crate::overlay::PictureView;
use crate::overlay::paint;
use crate::page::{Block, Picture, Section};
use crate::source::Source;
use crate::views::{REPLAYED, cameras};

#[derive(Serialize)]
struct SegmentationFigures {
    cameras: Vec<CameraFigures>,
}

#[derive(Serialize)]
struct CameraFigures {
    operator: String,
    image: String,
    images: usize,
    refused: usize,
    /// Whether the results were made again by a replay, since the session does not hold them.
    #[serde(rename = "made_again")]
    recomputed_views: bool,
    missing: Option<String>,
    shown: Vec<Shown>,
}

#[derive(Serialize)]
struct Shown {
    at_s: f64,
    face_points: usize,
    plane_normal: Option<[f64; 3]>,
    plane_distance_mm: Option<f64>,
    plane_rms_mm: Option<f64>,
    plane_inliers: Option<u32>,
    hull_area_cm2: Option<f64>,
    rejection: Option<String>,
    /// Number of the reference that the face became, if it did.
    captured: Option<u32>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let cameras = cameras(from);
    let at = |view: &PictureView| from.recording.seconds(view.origin);
    let figures = SegmentationFigures { cameras: cameras.iter().map(|c| figures(c, at)).collect() };
    let mut section = Section::new("segmentation", "Segmentation", &figures)?;
    if cameras.is_empty() {
        let sentence = "No operator of this session finds a plane or a hull in recorded images.";
        return Ok(section.nothing(sentence));
    }
    section.blocks.push(Block::Text(
        "Depth images as reliefs: the face is orange, the supporting plane is blue, and its hull is a green line. A face that was captured as a reference has a red outline.".into(),
    ));
    for (camera, figures) in cameras.iter().zip(&figures.cameras) {
        section.blocks.push(Block::Heading(format!("{} on {}", camera.stage, camera.image)));
        let mut sentence = format!(
            "{} images, {} without a face.",
            count(camera.looked_at as u64),
            count(camera.refused as u64)
        );
        if camera.recomputed_views {
            sentence.push_str(
                " The session does not hold all images, faces, planes and hulls; a replay by this build computed them",
            );
            if camera.looked_at > REPLAYED {
                sentence.push_str(&format!(", among the first {REPLAYED} of them"));
            }
            sentence.push('.');
        }
        section.blocks.push(Block::Text(sentence));
        if let Some(reason) = &camera.missing {
            section.blocks.push(Block::Warning(format!("Not every picture can be drawn: {reason}.")));
        }
        for (view, shown) in camera.views.iter().zip(&figures.shown) {
            let picture = paint(view);
            let png = picture.png().map_err(ReportError::Picture)?;
            section.blocks.push(Block::Picture(Picture {
                png,
                size: [picture.width as u32, picture.height as u32],
                alt: format!("{} at {:.2} s", camera.image, shown.at_s),
                caption: caption(shown),
            }));
        }
    }
    Ok(section)
}

fn figures(camera: &Camera, at: impl Fn(&PictureView) -> f64) -> CameraFigures {
    let shown = camera.views.iter().map(|view| Shown {
        at_s: at(view),
        face_points: view.face.len(),
        plane_normal: view.plane.map(|p| p.normal),
        plane_distance_mm: view.plane.map(|p| p.offset * 1e3),
        plane_rms_mm: view.plane.map(|p| p.rms * 1e3),
        plane_inliers: view.plane.map(|p| p.inliers),
        hull_area_cm2: view.hull_area.map(|a| a * 1e4),
        rejection: view.rejection.clone(),
        captured: view.captured,
    });
    CameraFigures {
        operator: camera.stage.clone(),
        image: camera.image.clone(),
        images: camera.looked_at,
        refused: camera.refused,
        recomputed_views: camera.recomputed_views,
        missing: camera.missing.clone(),
        shown: shown.collect(),
    }
}

fn caption(shown: &Shown) -> String {
    let mut sentence = format!("{:.2} s: ", shown.at_s);
    match &shown.rejection {
        Some(reason) => sentence.push_str(&format!("no face: {reason}")),
        None => sentence.push_str(&format!("face of {} points", count(shown.face_points as u64))),
    }
    if let Some(number) = shown.captured {
        sentence.push_str(&format!(
            "; captured as reference {number}: is it the head, all of it, and nothing else?"
        ));
    }
    if let Some(rms) = shown.plane_rms_mm {
        sentence.push_str(&format!(
            "; plane {} mm from the camera, rms {} mm",
            fixed(shown.plane_distance_mm, 1),
            fixed(rms, 2)
        ));
    }
    sentence
}
