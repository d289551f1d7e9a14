//! The messages of a topic of a recording of ROS 2, held in memory and played as clouds.

use std::collections::{BTreeMap, BTreeSet};

use stillpoint_cdr::{CdrError, Reader};
use stillpoint_operator::{Files, Outputs, SetupError, StepError};

use super::messages::{Cameras, CamerasError, Form, MessageError};
use super::playback::{Due, Pace, Playback};
use super::turn::AtEnd;
use crate::bag::{self, At, Bag, OpenError, Reading, Selected, Selection, TopicError, WalkError};
use crate::camera_info::Image;
use crate::checks::{self, CheckError, Checked, Fault};
use crate::wire::{Admission, Counts, WireRefusal};

/// Largest size of all messages together: 1 GiB.
const MOST_BYTES: usize = 1 << 30;

/// The messages of a recording, in the order of their log times.
pub struct Recording {
    form: Form,
    frames: Vec<Played>,
    cameras: Cameras,
    playback: Playback,
    remarks: Vec<String>,
}

/// A message that is played.
struct Played {
    /// As it was recorded.
    message: Vec<u8>,
    /// Number of its camera.
    camera: usize,
    /// What the wire would have brought since the message before it.
    since: Since,
}

/// What came between two messages that are played.
#[derive(Clone, Debug, Default)]
struct Since {
    camera_infos: u64,
    refused: Vec<WireRefusal>,
}

/// How a recording is read and played.
#[derive(Clone, Debug)]
pub struct Play<'a> {
    /// How its messages become clouds.
    pub form: Form,
    /// Its pace.
    pub pace: Pace,
    /// What follows its last message.
    pub at_end: AtEnd,
    /// The longest time between two messages that is waited for, ns.
    pub max_gap: u64,
    /// Which image it has, where it is stated.
    pub image: Option<Image>,
    /// The most points of a cloud.
    pub max_points: usize,
    /// Whether a damaged message is refused and not left out.
    pub strict: bool,
    /// What the wire refuses, where the recording is played in its place.
    pub wire: Option<Admission<'a>>,
}

/// Why a recording is not played.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// It cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Its topic is not read.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// A file of it is not read.
    #[error(transparent)]
    Walk(#[from] WalkError),
    /// Its messages are too much for the memory.
    #[error("its messages take more than 1 GiB of memory: set `frames`")]
    TooLarge,
    /// A message of it is refused.
    #[error(transparent)]
    Message(#[from] Fault),
    /// Its times are not those of one run.
    #[error(transparent)]
    Times(#[from] CheckError),
}

impl Recording {
    /// Reads the recording in a file or a folder.
    ///
    /// # Errors
    /// As [`Recording::read`] has it, and a recording that cannot be opened.
    pub fn open(
        files: &dyn Files,
        place: &str,
        selected: &Selected<'_>,
        play: &Play<'_>,
    ) -> Result<Self, RecordingError> {
        Self::read(&Bag::open(files, place)?, selected, play)
    }

    /// Reads the messages that are wanted, and looks at each as a step does. Those that become no cloud are left out.
    ///
    /// # Errors
    /// What is missing or wrong.
    pub fn read(bag: &Bag, selected: &Selected<'_>, play: &Play<'_>) -> Result<Self, RecordingError> {
        let selection = bag::select(bag, selected)?;
        let form = Form { reading: selection.reading, ..play.form };
        let mut bytes = bytes_of(bag, &selection)?;
        let mut cameras = Cameras::of_topic(selected.topic, play.image, play.max_points);
        let (mut times, mut scratch, mut since) = (Vec::new(), Vec::new(), Since::default());
        let mut last_camera = None;
        let mut items = Vec::new();
        for (place, frame) in selection.frames.iter().enumerate() {
            // The number that `skip` counts.
            let by_time = selected.skip + place + 1;
            let message = bytes.remove(&frame.at).unwrap_or_default();
            if frame.camera.is_some() && frame.camera != last_camera {
                since.camera_infos += 1;
                last_camera = frame.camera;
            }
            let looked = (|| {
                let camera = match frame.camera {
                    Some(at) => {
                        cameras.number(bytes.get(&at).map_or(&[], Vec::as_slice)).map_err(of_camera)?
                    }
                    None => 0,
                };
                let mut stamp = stamp_of(&message)
                    .map_err(|e| (Fault::Item(e.to_string()), Some(WireRefusal::Damaged)))?;
                if let Some(wire) = &play.wire {
                    let admitted = wire.admit(&message, frame.log_time);
                    stamp = admitted.map_err(|e| (Fault::Item(e.reason().to_owned()), Some(e)))?;
                }
                form.check(&message, cameras.get(camera), play.max_points, &mut scratch)
                    .map_err(of_message)?;
                Ok((camera, stamp))
            })();
            items.push(match looked {
                Ok((camera, stamp)) => {
                    times.push((stamp, frame.log_time));
                    Ok(Played { message, camera, since: std::mem::take(&mut since) })
                }
                Err((fault, refusal)) => {
                    since.refused.extend(refusal);
                    Err(fault.of(&format_args!("message {by_time} by time")))
                }
            });
        }
        let checked = Checked::of(items, play.strict)?;
        let origins = origins(&times);
        if play.pace == Pace::Recorded {
            checks::gaps(&origins, play.max_gap)?;
        }
        let mut remarks: Vec<String> = checked.remark("messages").into_iter().collect();
        remarks.extend(bag.repeated.iter().map(|name| {
            format!(
                "{} is listed more than once in its metadata.yaml, and is played once",
                checks::quoted(name)
            )
        }));
        let mut frames = checked.items;
        if let Some(last) = frames.last_mut() {
            last.since.camera_infos += since.camera_infos;
            last.since.refused.append(&mut since.refused);
        }
        let playback = Playback::new(&origins, play.pace, play.at_end);
        Ok(Self { form, frames, cameras, playback, remarks })
    }

    /// Mean distance of two messages, ns. `None`: there is one, or all have one time.
    pub fn period(&self) -> Option<u64> {
        self.playback.period().filter(|period| *period > 0)
    }

    /// What was left out, for people.
    pub fn remarks(self) -> Vec<String> {
        self.remarks
    }

    /// Sends what is due at a tick at `now`, session time in ns, and whether that is a message. `counts` are those of the
    /// wire, which the recording is played in place of.
    ///
    /// # Errors
    /// The executor did not take the sample.
    pub fn play(
        &mut self,
        now: u64,
        port: usize,
        counts: Option<&mut Counts>,
        outputs: &mut Outputs<'_>,
    ) -> Result<bool, StepError> {
        match self.playback.at(now) {
            Due::Wait => Ok(false),
            Due::End => {
                outputs.finish();
                Ok(false)
            }
            Due::SelectedMessage(number, time) => {
                if let Some(time) = time {
                    outputs.acquired_at(time);
                }
                let Played { message, camera, since } = &self.frames[number];
                if let Some(counts) = counts {
                    counts.camera_infos += since.camera_infos;
                    since.refused.iter().for_each(|refusal| counts.refuse(*refusal));
                    counts.clouds += 1;
                }
                let sent = self.form.send(message, self.cameras.get(*camera), port, outputs);
                sent.map(|()| true).map_err(|e| StepError(e.to_string()))
            }
        }
    }
}

/// The bytes of the messages of a selection, and of their cameras.
fn bytes_of(bag: &Bag, selection: &Selection) -> Result<BTreeMap<At, Vec<u8>>, RecordingError> {
    let mut bytes = BTreeMap::<At, Vec<u8>>::new();
    for frame in &selection.frames {
        bytes.insert(frame.at, Vec::new());
        frame.camera.map(|camera| bytes.insert(camera, Vec::new()));
    }
    let mut total = 0;
    for message in bag.messages() {
        let (at, message) = message?;
        let Some(checked) = bytes.get_mut(&at) else { continue };
        total += message.data.len();
        if total > MOST_BYTES {
            return Err(RecordingError::TooLarge);
        }
        *checked = message.data;
    }
    Ok(bytes)
}

/// Whose fault it is that a `CameraInfo` is not taken.
fn of_camera(error: CamerasError) -> (Fault, Option<WireRefusal>) {
    let text = format!("its CameraInfo: {error}{}", cure(&error));
    match error {
        CamerasError::Info(_) => (Fault::Item(text), Some(WireRefusal::CameraInfo)),
        CamerasError::TooMany | CamerasError::TooLarge { .. } => (Fault::Params(text), None),
    }
}

/// Whose fault it is that a message becomes no cloud.
fn of_message(error: MessageError) -> (Fault, Option<WireRefusal>) {
    let text = error.to_string();
    match error {
        MessageError::TooLarge { .. } | MessageError::Scale(_) | MessageError::Step(_) => {
            (Fault::Params(text), None)
        }
        other => (Fault::Item(text), WireRefusal::of(&other)),
    }
}

/// The remarks about a recording that is read with these parameters; none where it cannot be read, which its operator says.
pub fn remarks(files: &dyn Files, file: &str, selected: &Selected<'_>, play: &Play<'_>) -> Vec<String> {
    let read = Recording::open(files, file, selected, play);
    read.map_or_else(
        |_| Vec::new(),
        |read| read.remarks().into_iter().map(|r| format!("{file}: {r}")).collect(),
    )
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
) -> Result<Option<Reading>, RecordingError> {
    match Bag::open(files, file) {
        Ok(bag) => Ok(Some(bag::check(&bag, topic, camera_info)?.reading)),
        // A replay goes on without the operators whose files its session lost.
        Err(OpenError::Unreadable(_)) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// The files of recordings with what is wanted of each, and no more.
///
/// # Errors
/// A recording that cannot be read.
pub fn cut(
    selected: &[(&str, Selected<'_>)],
    files: &dyn Files,
) -> Result<BTreeMap<String, Vec<u8>>, SetupError> {
    let mut by_place = BTreeMap::<&str, Vec<&Selected<'_>>>::new();
    for (file, selected) in selected {
        by_place.entry(file).or_default().push(selected);
    }
    let (mut cut, mut seen, mut twice) = (BTreeMap::new(), BTreeSet::new(), BTreeSet::new());
    for (place, selected) in by_place {
        let fault = |e: &dyn std::fmt::Display| SetupError(format!("{place}: {e}"));
        let bag = Bag::open(files, place).map_err(|e| fault(&e))?;
        let selections: Result<Vec<Selection>, TopicError> =
            selected.into_iter().map(|selected| bag::select(&bag, selected)).collect();
        let parts = bag::cut(&bag, &selections.map_err(|e| fault(&e))?).map_err(|e| fault(&e))?;
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

/// Stamp of the header of a message, ns; `None` where it has none.
fn stamp_of(bytes: &[u8]) -> Result<Option<u64>, CdrError> {
    let header = Reader::in_either_order(bytes).and_then(|mut r| r.foreign_header());
    header.map(|(stamp, _)| stamp)
}

/// The time of acquisition of each message, of its stamp and its log time, ns: the stamps, or the log times where a stamp
/// is missing or goes back.
fn origins(times: &[(Option<u64>, u64)]) -> Vec<u64> {
    let stamps: Option<Vec<u64>> = times.iter().map(|(stamp, _)| *stamp).collect();
    match stamps.filter(|stamps| stamps.is_sorted()) {
        Some(stamps) => stamps,
        None => times.iter().map(|(_, log_time)| *log_time).collect(),
    }
}
