//! The messages of a topic of a recording of ROS 2, held in memory and played as clouds.

use std::collections::{BTreeMap, BTreeSet};

use stillpoint_cdr::Reader;
use stillpoint_operator::{Files, Outputs, SetupError, StepError};

use super::messages::{Cameras, CamerasError, points_of, send_message};
use super::playback::{Due, Pace, Playback};
use super::turn::AtEnd;
use crate::bag::{self, At, Bag, OpenError, Reading, Selection, Wanted};

/// Largest size of all messages together: 1 GiB.
const MOST_BYTES: usize = 1 << 30;

/// The messages of a recording, in the order of their log times.
pub struct Recording {
    reading: Reading,
    /// Each message as it was recorded, and the number of its camera.
    frames: Vec<(Vec<u8>, usize)>,
    cameras: Cameras,
    playback: Playback,
}

impl Recording {
    /// Reads the messages that are wanted, and looks at each as a step does.
    ///
    /// # Errors
    /// What is missing or wrong.
    pub fn read(
        bag: &Bag,
        wanted: &Wanted<'_>,
        (pace, at_end): (Pace, AtEnd),
        max_points: usize,
    ) -> Result<Self, String> {
        let Selection { reading, frames, .. } = bag::select(bag, wanted)?;
        let mut bytes = BTreeMap::<At, Vec<u8>>::new();
        for frame in &frames {
            bytes.insert(frame.at, Vec::new());
            frame.camera.map(|camera| bytes.insert(camera, Vec::new()));
        }
        let mut total = 0;
        for message in bag.messages() {
            let (at, message) = message?;
            let Some(kept) = bytes.get_mut(&at) else { continue };
            total += message.data.len();
            if total > MOST_BYTES {
                return Err("its messages take more than 1 GiB of memory: set `frames`".to_string());
            }
            *kept = message.data.into_owned();
        }
        let mut cameras = Cameras::of_topic(wanted.topic, max_points);
        let (mut times, mut read, mut scratch) = (Vec::new(), Vec::new(), Vec::new());
        for (place, frame) in frames.iter().enumerate() {
            // The number that `skip` counts.
            let by_time = wanted.skip + place + 1;
            let fault = |e: String| format!("message {by_time} by time: {e}");
            let camera = match frame.camera {
                Some(at) => cameras
                    .number(bytes.get(&at).map_or(&[], Vec::as_slice))
                    .map_err(|e| fault(format!("its CameraInfo: {e}{}", cure(&e))))?,
                None => 0,
            };
            let message = bytes.remove(&frame.at).unwrap_or_default();
            times.push((message_time(&message).map_err(fault)?, frame.log_time));
            let points = points_of(reading, &message, cameras.get(camera), &mut scratch)
                .map_err(|e| fault(e.to_string()))?;
            if points > max_points {
                return Err(fault(format!("it has {points} points: raise `max_points`")));
            }
            read.push((message, camera));
        }
        let playback = Playback::new(&origins(&times), pace, at_end);
        Ok(Self { reading, frames: read, cameras, playback })
    }

    /// Mean distance of two messages, ns. `None`: there is one.
    pub fn period(&self) -> Option<u64> {
        self.playback.period()
    }

    /// Sends what is due at a tick at `now`, session time in ns.
    ///
    /// # Errors
    /// The executor did not take the sample.
    pub fn play(&mut self, now: u64, port: usize, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        match self.playback.at(now) {
            Due::Wait => Ok(()),
            Due::End => {
                outputs.finish();
                Ok(())
            }
            Due::Frame(number, time) => {
                if let Some(time) = time {
                    outputs.acquired_at(time);
                }
                let (bytes, camera) = &self.frames[number];
                send_message(self.reading, bytes, self.cameras.get(*camera), port, outputs)
                    .map_err(|e| StepError(e.to_string()))
            }
        }
    }
}

/// Checks that a recording has the topic, with messages of a type that is read.
///
/// # Errors
/// What is missing or of another type.
pub fn check(
    files: &dyn Files,
    file: &str,
    topic: &str,
    camera_info: Option<&str>,
) -> Result<Option<Reading>, String> {
    match Bag::open(files, file) {
        Ok(bag) => bag::check(&bag, topic, camera_info).map(|named| Some(named.reading)),
        // A replay goes on without the operators whose files its session lost.
        Err(OpenError::Unreadable(_)) => Ok(None),
        Err(OpenError::Other(reason)) => Err(reason),
    }
}

/// The files of recordings with what is wanted of each, and no more.
///
/// # Errors
/// A recording that cannot be read.
pub fn cut(
    wanted: &[(&str, Wanted<'_>)],
    files: &dyn Files,
) -> Result<BTreeMap<String, Vec<u8>>, SetupError> {
    let mut by_place = BTreeMap::<&str, Vec<&Wanted<'_>>>::new();
    for (file, wanted) in wanted {
        by_place.entry(file).or_default().push(wanted);
    }
    let (mut cut, mut seen, mut twice) = (BTreeMap::new(), BTreeSet::new(), BTreeSet::new());
    for (place, wanted) in by_place {
        let fault = |e: String| SetupError(format!("{place}: {e}"));
        let bag = Bag::open(files, place).map_err(|e| fault(e.to_string()))?;
        let selections: Result<Vec<Selection>, String> =
            wanted.into_iter().map(|wanted| bag::select(&bag, wanted)).collect();
        let parts = bag::cut(&bag, &selections.map_err(fault)?).map_err(fault)?;
        for ((name, part), (_, whole)) in parts.into_iter().zip(&bag.files) {
            if !seen.insert(name.clone()) {
                twice.insert(name);
            } else if part.len() < whole.len() {
                // Else the compression of the whole is the better one.
                cut.insert(name, part);
            }
        }
    }
    // A file that is named by its own name and by that of its folder stays whole.
    cut.retain(|name, _| !twice.contains(name));
    Ok(cut)
}

/// What helps against a recording whose camera is not taken.
fn cure(error: &CamerasError) -> &'static str {
    match error {
        CamerasError::TooMany => ": read a part with `skip` and `frames`",
        _ => "",
    }
}

/// Stamp of the header of a message, ns.
fn message_time(bytes: &[u8]) -> Result<u64, String> {
    Reader::in_either_order(bytes).and_then(|mut r| r.header()).map_err(|e| e.to_string())
}

/// The time of acquisition of each message, of its stamp and its log time, ns: the stamps, or the log times where a stamp
/// is missing or goes back.
fn origins(times: &[(u64, u64)]) -> Vec<u64> {
    let stamped = times.iter().all(|(stamp, _)| *stamp > 0) && times.is_sorted_by_key(|(stamp, _)| *stamp);
    times.iter().map(|(stamp, log_time)| if stamped { *stamp } else { *log_time }).collect()
}
