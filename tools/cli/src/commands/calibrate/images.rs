//! The images of a session: depth images or organised clouds of a topic.

use std::path::Path;

use stillpoint_recorder::Session;
use stillpoint_samples::{DepthImage, Pieces, PointCloud, Sample};
use stillpoint_segment::extrinsic::StillImages;

use crate::exit::Failure;
use crate::recorded::with_topics;

/// Most images that are read.
const MOST: usize = 60;

/// The first images of a topic.
pub struct Images {
    pub session: Session,
    /// The frame that they are in, where the session has it.
    pub frame: Option<String>,
    pub images: StillImages,
}

/// Reads them.
pub fn read(path: &Path, topic: &str) -> Result<Images, Failure> {
    let session = with_topics(Session::open(path), path)?;
    let wrong = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}, {topic}: {why}", path.display()));
    let is_image = |name: &str| name == DepthImage::NAME || name == PointCloud::NAME;
    let Some(number) = session.topic_number(topic) else {
        let names: Vec<&str> = session
            .topics()
            .iter()
            .filter(|topic| topic.kind.kind().is_some_and(|kind| is_image(kind.name)))
            .map(|topic| topic.name.as_str())
            .collect();
        return Err(wrong(&format!(
            "there is no such topic (depth images and clouds: {})",
            names.join(", ")
        )));
    };
    let kind = session.topics()[number].kind.kind().filter(|kind| is_image(kind.name));
    let kind = kind
        .ok_or_else(|| wrong(&"its samples are neither DepthImage nor PointCloud; take another --topic"))?;
    let mut images = StillImages::default();
    let numbers: Vec<(u32, u64)> = session.numbers(number).take(MOST).collect();
    for (incarnation, sequence) in numbers {
        let Some(recorded) = session.sample(number, incarnation, sequence).map_err(Failure::failed)? else {
            continue;
        };
        let pieces = Pieces::split(kind, &recorded.sample).map_err(Failure::failed)?;
        if *kind == *DepthImage::KIND {
            let view = pieces.view::<DepthImage>().map_err(Failure::failed)?;
            let body = view.body;
            let depths = view.elements.iter().map(|count| f64::from(*count) * body.depth_unit);
            let ray = |column: usize, row: usize| {
                [(column as f64 - body.cx) / body.fx, (row as f64 - body.cy) / body.fy]
            };
            images.add_depths([body.width as usize, body.height as usize], depths, ray)
        } else {
            let view = pieces.view::<PointCloud>().map_err(Failure::failed)?;
            let size = [view.body.width as usize, view.body.height as usize];
            images.add_cloud(size, view.elements.iter().map(|point| point.xyz))
        }
        .map_err(|fault| wrong(&fault))?;
    }
    let frame = session.topics()[number].frame.clone();
    Ok(Images { session, frame, images })
}
