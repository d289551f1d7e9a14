//! Images of a session with their detections. Detections that the session does not hold are computed by a replay of the
//! operators behind the images, up to the last chosen image.

use std::collections::{BTreeMap, BTreeSet};

use stillpoint_recorder::Topic;
use stillpoint_samples::{
    BytesError, DepthImage, Hull, Pieces, Plane, PointCloud, PoseReport, RefKind, Rejection, Sample,
    SampleKind,
};

use super::camera::{Camera, Found};
use super::overlay::{Image, ImageError, PictureView};
use super::recomputed::recomputed_views;
use super::recording::{Recording, is_any_of};
use super::source::Source;

/// Number of images at the start of a session from which images for a replay are chosen.
pub const REPLAYED: usize = 150;

/// The results that are shown.
const RESULTS: [&SampleKind; 4] = [PointCloud::KIND, Plane::KIND, Hull::KIND, Rejection::KIND];

/// The cameras of a session with their chosen images.
pub fn cameras(source: &Source<'_>) -> Vec<Camera> {
    let mut cameras = found(source);
    for camera in &mut cameras {
        fill(source, camera);
    }
    cameras
}

/// The operators that make a plane or a hull, with the images upstream of them.
fn found(source: &Source<'_>) -> Vec<Camera> {
    let recording = &source.recording;
    let mut cameras = Vec::new();
    for stage in recording.wiring.stages() {
        let mut results = BTreeMap::new();
        for topic in &stage.outputs {
            if let Some(kind) = kind_of(source, topic).filter(|k| RESULTS.contains(k)) {
                results.entry(kind.name).or_insert_with(|| topic.clone());
            }
        }
        if !results.contains_key(Plane::NAME) && !results.contains_key(Hull::NAME) {
            continue;
        }
        let upstream: Vec<&str> = stage.inputs.iter().flat_map(|i| recording.wiring.upstream(i)).collect();
        let first =
            |kind| upstream.iter().find(|t| kind_of(source, t) == Some(kind)).map(ToString::to_string);
        if let Some(image) = first(DepthImage::KIND).or_else(|| first(PointCloud::KIND)) {
            cameras.push(Camera {
                stage: stage.name.clone(),
                image,
                results,
                looked_at: 0,
                refused: 0,
                views: Vec::new(),
                recomputed_views: false,
                missing: None,
            });
        }
    }
    cameras
}

/// The kind of a topic, recorded or not.
fn kind_of(source: &Source<'_>, topic: &str) -> Option<&'static SampleKind> {
    let recorded = source.recording.session.topics().iter().find(|t| t.name == topic);
    let recorded =
        recorded.and_then(|t| RESULTS.into_iter().chain([DepthImage::KIND]).find(|k| is_any_of(t, &[k])));
    let graph = source.pipeline.as_ref().ok().map(|(graph, _)| graph);
    recorded.or_else(|| {
        let graph = graph?;
        let (operator, port) = graph.topic(topic)?;
        Some(graph.operators[operator].stage.kind.outputs.get(port)?.sample)
    })
}

/// What an operator sent on a port, by origin: incarnation and sequence, the last where it sent several.
fn sent(recording: &Recording<'_>, topic: &str) -> BTreeMap<u64, (u32, u64)> {
    let Some((stage, port)) = recording.wiring.producer(topic) else { return BTreeMap::new() };
    let entries = recording.session.journals().get(&stage.name).into_iter().flatten();
    let mut sent = BTreeMap::new();
    for entry in entries {
        for r in entry.refs_of(RefKind::Output).filter(|r| r.port as usize == port && r.count > 0) {
            let last = r.first.saturating_add(u64::from(r.count) - 1);
            sent.insert(entry.header.origin, (entry.header.incarnation, last));
        }
    }
    sent
}

fn fill(source: &Source<'_>, camera: &mut Camera) {
    let recording = &source.recording;
    let images = sent(recording, &camera.image);
    let results: BTreeMap<&str, _> = camera.results.iter().map(|(k, t)| (*k, sent(recording, t))).collect();
    let origins: BTreeSet<u64> = results.values().flat_map(|r| r.keys().copied()).collect();
    let looked_at: Vec<u64> = origins.into_iter().filter(|o| images.contains_key(o)).collect();
    let is_refused = |origin: &u64| results.get(Rejection::NAME).is_some_and(|r| r.contains_key(origin));
    camera.looked_at = looked_at.len();
    camera.refused = looked_at.iter().filter(|o| is_refused(o)).count();
    let is_retained = |topic: &String| recording.session.topic_number(topic).is_some();
    let needed = [PointCloud::NAME, Plane::NAME, Hull::NAME];
    let all_retained = is_retained(&camera.image)
        && needed.iter().all(|kind| camera.results.get(kind).is_none_or(is_retained));
    let choice = if all_retained { &looked_at[..] } else { &looked_at[..looked_at.len().min(REPLAYED)] };
    let captured = captures(recording, camera);
    let requested = chosen(choice, source.pictures, is_refused, |origin| captured.contains_key(origin));
    let mut found = retained(recording, camera, &images, &results, &requested);
    if !all_retained && !requested.is_empty() {
        match recomputed_views(source, camera, &requested, &mut found) {
            Ok(()) => camera.recomputed_views = true,
            Err(error) => camera.missing = Some(error.to_string()),
        }
    }
    for origin in &requested {
        match view(source, camera, *origin, &found) {
            Ok(view) => camera.views.push(PictureView { captured: captured.get(origin).copied(), ..view }),
            Err(error) => camera.missing = Some(error.to_string()),
        }
    }
}

/// The numbers of the references that were captured from faces of a camera, by the origin of the image.
fn captures(recording: &Recording<'_>, camera: &Camera) -> BTreeMap<u64, u32> {
    let Some(face) = camera.results.get(PointCloud::NAME) else { return BTreeMap::new() };
    let trackers: BTreeSet<&String> = recording.wiring.consumers(face).flat_map(|s| &s.outputs).collect();
    let mut captured = BTreeMap::new();
    let mut last: BTreeMap<usize, u32> = BTreeMap::new();
    let is_report = |t: &Topic| is_any_of(t, &[PoseReport::KIND]) && trackers.contains(&t.name);
    for recorded in recording.session.samples_where(is_report).flatten() {
        let Ok(pieces) = Pieces::split(PoseReport::KIND, &recorded.sample) else { continue };
        let Some(report) = pieces.view::<PoseReport>().ok().and_then(|v| v.first().copied()) else {
            continue;
        };
        if report.reference != 0 && last.insert(recorded.topic, report.reference) != Some(report.reference) {
            captured.insert(pieces.header().origin, report.reference);
        }
    }
    captured
}

/// Evenly spaced images from the first to the last. Among them are the last that became references, and one refused image
/// if there is any.
fn chosen(
    origins: &[u64],
    most: usize,
    is_refused: impl Fn(&u64) -> bool,
    is_captured: impl Fn(&u64) -> bool,
) -> Vec<u64> {
    let count = most.min(origins.len());
    let place = |i: usize| if count > 1 { i * (origins.len() - 1) / (count - 1) } else { 0 };
    let mut chosen: Vec<u64> = (0..count).map(|i| origins[place(i)]).collect();
    let refused = origins.iter().find(|o| is_refused(o)).filter(|_| !chosen.iter().any(&is_refused));
    let captured = origins.iter().rev().filter(|o| is_captured(o)).take(count);
    let mut retained = BTreeSet::new();
    for origin in captured.chain(refused) {
        // In place of its nearest neighbour.
        let free = chosen.iter_mut().filter(|o| !retained.contains(*o));
        if let Some(nearest) = free.min_by_key(|o| o.abs_diff(*origin)) {
            *nearest = *origin;
            retained.insert(*origin);
        }
    }
    chosen.sort_unstable();
    chosen
}

/// What the session holds of the wanted images and results.
fn retained(
    recording: &Recording<'_>,
    camera: &Camera,
    images: &BTreeMap<u64, (u32, u64)>,
    results: &BTreeMap<&str, BTreeMap<u64, (u32, u64)>>,
    requested: &[u64],
) -> Found {
    let mut found = Found::new();
    let topics = camera.results.iter().filter_map(|(kind, topic)| Some((topic, results.get(kind)?)));
    for (topic, sent) in topics.chain([(&camera.image, images)]) {
        let Some(number) = recording.session.topic_number(topic) else { continue };
        for origin in requested {
            let Some((incarnation, sequence)) = sent.get(origin) else { continue };
            if let Ok(Some(recorded)) = recording.session.sample(number, *incarnation, *sequence) {
                found.insert((topic.clone(), *origin), recorded.sample);
            }
        }
    }
    found
}

/// Why a session does not show an image with its detections.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
enum ViewError {
    #[error("{0} does not hold all images")]
    NotAll(String),
    #[error("{stage}: {error}")]
    Detection { stage: String, error: BytesError },
    #[error("{topic}: {error}")]
    Image { topic: String, error: ImageError },
}

fn view(source: &Source<'_>, camera: &Camera, origin: u64, found: &Found) -> Result<PictureView, ViewError> {
    let bytes = |topic: &String| found.get(&(topic.clone(), origin)).map(|b| &b[..]);
    let of = |kind: &str| camera.results.get(kind).and_then(bytes);
    let broken = |error: BytesError| ViewError::Detection { stage: camera.stage.clone(), error };
    let raw = bytes(&camera.image).ok_or_else(|| ViewError::NotAll(camera.image.clone()))?;
    let image = match kind_of(source, &camera.image) {
        Some(kind) if *kind == *DepthImage::KIND => Image::of_depth(raw),
        _ => Image::of_cloud(raw),
    };
    let image = image.map_err(|error| ViewError::Image { topic: camera.image.clone(), error })?;
    let image_from = |kind: &str| {
        let topic = camera.results.get(kind)?;
        source.transform(&camera.image, topic)
    };
    let mut face = Vec::new();
    if let Some(bytes) = of(PointCloud::NAME) {
        let view =
            Pieces::split(PointCloud::KIND, bytes).and_then(|p| p.view::<PointCloud>()).map_err(broken)?;
        face.extend(view.elements.iter().map(|p| moved(p.xyz, image_from(PointCloud::NAME))));
    }
    let (mut hull, mut hull_area) = (Vec::new(), None);
    if let Some(bytes) = of(Hull::NAME) {
        let view = Pieces::split(Hull::KIND, bytes).and_then(|p| p.view::<Hull>()).map_err(broken)?;
        hull.extend(view.elements.iter().map(|c| moved(c.xyz, image_from(Hull::NAME))));
        hull_area = Some(view.body.area);
    }
    let mut plane = None;
    if let Some(bytes) = of(Plane::NAME) {
        let view = Pieces::split(Plane::KIND, bytes).and_then(|p| p.view::<Plane>()).map_err(broken)?;
        plane = view.first().copied();
    }
    let mut rejection = None;
    if let Some(bytes) = of(Rejection::NAME) {
        let view =
            Pieces::split(Rejection::KIND, bytes).and_then(|p| p.view::<Rejection>()).map_err(broken)?;
        rejection = view.first().map(|r| r.reason().to_owned());
    }
    Ok(PictureView { origin, image, face, plane, hull, hull_area, rejection, captured: None })
}

fn moved(p: [f32; 3], transform: Option<stillpoint_operator::frames::Rigid>) -> [f32; 3] {
    transform.map_or(p, |t| t.apply(p.map(f64::from)).map(|c| c as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_chosen_evenly_and_a_refused_one_is_among_them() {
        let origins: Vec<u64> = (0..101).collect();
        let none = |_: &u64| false;
        assert_eq!(chosen(&origins, 5, none, none), [0, 25, 50, 75, 100]);
        assert_eq!(chosen(&origins, 5, |o| *o == 53, none), [0, 25, 53, 75, 100]);
        assert_eq!(chosen(&origins, 1, none, none), [0]);
        assert_eq!(chosen(&origins[..2], 5, none, none), [0, 1]);
        assert!(chosen(&origins, 0, |_| true, none).is_empty() && chosen(&[], 5, |_| true, none).is_empty());
    }

    #[test]
    fn images_that_became_references_are_among_the_chosen() {
        let origins: Vec<u64> = (0..101).collect();
        let none = |_: &u64| false;
        assert_eq!(chosen(&origins, 5, none, |o| *o == 5), [5, 25, 50, 75, 100]);
        assert_eq!(chosen(&origins, 5, |o| *o == 6, |o| *o == 5), [5, 6, 50, 75, 100]);
        assert_eq!(chosen(&origins, 3, none, |o| [1, 2, 3, 4].contains(o)), [2, 3, 4]);
        assert_eq!(chosen(&origins, 1, |o| *o == 6, |o| *o == 5), [5]);
    }
}
