//! Which messages of a recording are read.

use super::files::Bag;
use super::topics::{Named, Reading, check, is_named};

/// Where a message is: numbers of its file and of its place in the file.
pub type At = (usize, u64);

/// What of a recording is wanted.
#[derive(Clone, Debug)]
pub struct Wanted<'a> {
    /// Topic of clouds or of depth images.
    pub topic: &'a str,
    /// Topic of the images' camera; where it is not given, it is looked for beside them.
    pub camera_info: Option<&'a str>,
    /// Messages to skip at the beginning, in the order of their log times.
    pub skip: usize,
    /// The most messages to read.
    pub frames: Option<usize>,
}

/// The messages that are read.
#[derive(Clone, Debug)]
pub struct Selection {
    /// How they are read.
    pub reading: Reading,
    /// Those that are skipped.
    pub skipped: Vec<At>,
    /// Those that are read, in the order of their log times.
    pub frames: Vec<Frame>,
}

/// A message that is read.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// The message.
    pub at: At,
    /// Time at which it was recorded, ns.
    pub log_time: u64,
    /// The `CameraInfo` of an image: the last that was recorded until then, or the first.
    pub camera: Option<At>,
}

/// Finds the messages that are wanted. A recorder may write messages of one topic out of order.
///
/// # Errors
/// A topic that is missing or of another type, a damaged file, or nothing left to read.
pub fn select(bag: &Bag, wanted: &Wanted<'_>) -> Result<Selection, String> {
    let Named { reading, camera_info } = check(bag, wanted.topic, wanted.camera_info)?;
    let (mut all, mut infos) = (Vec::new(), Vec::new());
    for message in bag.messages() {
        let (at, message) = message?;
        if is_named(&message.channel, wanted.topic) {
            all.push((message.log_time, at));
        } else if camera_info.as_ref().is_some_and(|topic| message.channel.topic == *topic) {
            infos.push((message.log_time, at));
        }
    }
    all.sort_unstable();
    infos.sort_unstable();
    let camera_at = |time: u64| {
        let before = infos.partition_point(|(log_time, _)| *log_time <= time);
        infos.get(before.saturating_sub(1)).map(|(_, at)| *at)
    };
    let most = wanted.frames.unwrap_or(usize::MAX);
    let read = all.iter().skip(wanted.skip).take(most);
    let frames: Vec<Frame> = read
        .map(|(log_time, at)| Frame { at: *at, log_time: *log_time, camera: camera_at(*log_time) })
        .collect();
    if frames.is_empty() {
        return Err(format!("all {} messages of {} are skipped: lower `skip`", all.len(), wanted.topic));
    }
    let skipped = all.iter().take(wanted.skip).map(|(_, at)| *at).collect();
    Ok(Selection { reading, skipped, frames })
}
