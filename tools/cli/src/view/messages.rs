//! What viewers such as Foxglove are shown of rows, images, figures and logs.

use serde_json::{Value, json};
use stillpoint_pipeline::live::log::{Level as Grave, LogLine};
use stillpoint_pose::{PoseNumbers, orientation};
use stillpoint_samples::{ActuationReason, ActuationState, GateReason, PoseStatus, Proof, Unproven};
use stillpoint_viewer::{Level, Place, Shown, Topic};

use super::picture::Drawn;
use super::rows::Row;

/// The frame of the head, which the estimate places.
const HEAD: &str = "head";
/// The channels of a pose, as rows have them.
const CHANNELS: [&str; 6] = ["x", "y", "z", "pitch", "roll", "yaw"];

/// The frames of what is shown.
pub struct Frames {
    /// That of the estimate.
    couch: String,
    /// That of the images.
    camera: String,
    /// From the camera to the couch.
    couch_from_camera: Option<Place>,
}

impl Frames {
    /// By what does not change.
    pub fn of(about: &Value) -> Self {
        let name = |key: &str, default: &str| about[key].as_str().unwrap_or(default).to_owned();
        Self {
            couch: name("frame", "couch"),
            camera: name("image_frame", "camera"),
            couch_from_camera: serde_json::from_value(about["camera_place"].clone()).ok(),
        }
    }

    /// Where the camera is.
    pub fn camera(&self, time: u64) -> Option<Shown> {
        // A frame is not placed in itself.
        let place = self.couch_from_camera.filter(|_| self.couch != self.camera)?;
        Some(Shown::Frame { time, parent: self.couch.clone(), child: self.camera.clone(), place })
    }

    /// A row: its values, the head and its target.
    pub fn row(&self, time: u64, row: &Row) -> Vec<Shown> {
        let mut shown = vec![Shown::Values { topic: Topic::Held, time, values: held(row) }];
        if let Some(place) = place(row.estimate) {
            let (frame, parent) = (self.couch.clone(), self.couch.clone());
            shown.push(Shown::Pose { topic: Topic::Estimate, time, frame, place });
            shown.push(Shown::Frame { time, parent, child: HEAD.to_owned(), place });
        }
        // A channel without a target is drawn where it is.
        let mut target = row.target;
        let is_aimed = target.iter().any(|value| value.is_finite());
        for (target, value) in target.iter_mut().zip(row.estimate).filter(|(target, _)| !target.is_finite()) {
            *target = value;
        }
        if let Some(place) = place(target).filter(|_| is_aimed) {
            let frame = self.couch.clone();
            shown.push(Shown::Pose { topic: Topic::Target, time, frame, place });
        }
        shown
    }

    /// An image with its face, and the points of the face if there are any, with their bytes.
    pub fn picture(&self, time: u64, Drawn { image, points, .. }: Drawn) -> Vec<(Shown, Vec<u8>)> {
        let (width, height) = (image.width as u32, image.height as u32);
        let shown = Shown::Image { time, frame: self.camera.clone(), width, height };
        let black = [0; 3];
        let colour = |index: &u8| image.colours.get(usize::from(*index)).copied().unwrap_or(black);
        let bytes = image.pixels.iter().flat_map(colour).collect();
        let mut all = vec![(shown, bytes)];
        if !points.is_empty() {
            let shown = Shown::Points { time, frame: self.couch.clone() };
            all.push((shown, points.iter().flat_map(|p| p.to_le_bytes()).collect()));
        }
        all
    }
}

/// The pose of six numbers, if all are known.
fn place([x, y, z, pitch, roll, yaw]: [f64; 6]) -> Option<Place> {
    let all = [x, y, z, pitch, roll, yaw];
    let pose = PoseNumbers { position: [x, y, z], pitch, roll, yaw }.pose();
    let place = Place { position: [x, y, z], orientation: orientation(&pose.rotation) };
    all.iter().all(|value| value.is_finite()).then_some(place)
}

/// A row as values with words.
fn held(row: &Row) -> Value {
    let channels = |values: [f64; 6]| -> Value {
        let known = CHANNELS.iter().zip(values).filter(|(_, value)| value.is_finite());
        known
            .map(|(name, value)| ((*name).to_owned(), json!(value)))
            .collect::<serde_json::Map<_, _>>()
            .into()
    };
    json!({
        "estimate": channels(row.estimate),
        "target": channels(row.target),
        "beam": row.beam,
        "beam_reasons": GateReason::words(row.reasons).collect::<Vec<_>>(),
        "valves": row.valves.and_then(ActuationState::from_number).map(ActuationState::word),
        "valves_reasons": ActuationReason::words(row.valves_reasons).collect::<Vec<_>>(),
        "valves_fault": ActuationReason::words(row.fault).collect::<Vec<_>>(),
        "tracker": row.tracker.and_then(PoseStatus::from_number).map(PoseStatus::word),
        "proof": row.proof.and_then(Proof::from_number).map(Proof::word),
        "unproven": row.unproven.filter(|u| *u != 0).and_then(Unproven::from_number).map(Unproven::word),
        "confidence": row.confidence,
    })
}

/// The figures, from their text. The log among them has a topic of its own.
pub fn state(time: u64, text: &str) -> Option<Shown> {
    let mut values: Value = serde_json::from_str(text).ok()?;
    values.as_object_mut()?.remove("log");
    Some(Shown::Values { topic: Topic::State, time, values })
}

/// A line of the log.
pub fn line(line: &LogLine) -> Shown {
    let level = match line.level {
        Grave::Error => Level::Error,
        Grave::Warn => Level::Warn,
        Grave::Info => Level::Info,
    };
    Shown::Line { time: line.time, level, name: line.operator.clone(), message: line.message.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row() -> Row {
        Row {
            t: 1.0,
            estimate: [0.0, 0.01, 0.1, 0.0, 0.0, std::f64::consts::FRAC_PI_2],
            target: [f64::NAN, f64::NAN, 0.12, f64::NAN, f64::NAN, f64::NAN],
            beam: Some(false),
            reasons: 1,
            valves: Some(ActuationState::Fault as u32),
            valves_reasons: 0,
            fault: 0,
            tracker: None,
            proof: Some(Proof::Proven as u32),
            unproven: Some(0),
            confidence: f64::NAN,
        }
    }

    #[test]
    fn a_row_is_values_of_the_schema_a_pose_and_a_target_that_moves_along_its_channels_alone() {
        let frames = Frames::of(&json!({ "frame": "couch" }));
        let shown = frames.row(7, &row());
        let Shown::Values { values, .. } = &shown[0] else { panic!("{shown:?}") };
        let (_, schema) = Topic::Held.schema();
        let names = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(values), names(&schema["properties"]));
        assert_eq!(values["target"], json!({ "z": 0.12 }));
        assert_eq!((&values["valves"], &values["proof"]), (&json!("fault"), &json!("proven")));
        assert_eq!(values["beam_reasons"].as_array().unwrap().len(), 1);
        let Shown::Pose { topic: Topic::Estimate, place, .. } = &shown[1] else { panic!("{shown:?}") };
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!((place.orientation[0] - half).abs() < 1e-12 && (place.orientation[3] - half).abs() < 1e-12);
        let Shown::Pose { topic: Topic::Target, place: target, .. } = &shown[3] else { panic!("{shown:?}") };
        assert_eq!((target.position, target.orientation), ([0.0, 0.01, 0.12], place.orientation));
    }

    #[test]
    fn a_row_without_an_estimate_shows_no_pose() {
        let frames = Frames::of(&json!({}));
        assert_eq!(frames.row(7, &Row { estimate: [f64::NAN; 6], ..row() }).len(), 1);
        assert_eq!(frames.camera(7), None);
    }
}
