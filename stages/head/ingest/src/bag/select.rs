//! Which messages of a recording are read.

use std::collections::BTreeMap;

use stillpoint_cdr::Reader;

use super::files::Bag;
use super::topics::{Named, Reading, TopicError, check, is_named};

/// Where a message is: numbers of its file and of its place in the file.
pub type At = (usize, u64);

/// What of a recording is wanted.
#[derive(Clone, Debug)]
pub struct Selected<'a> {
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
    pub frames: Vec<SelectedMessage>,
}

/// A message that is read.
#[derive(Clone, Copy, Debug)]
pub struct SelectedMessage {
    /// The message.
    pub at: At,
    /// Time at which it was recorded, ns.
    pub log_time: u64,
    /// The `CameraInfo` of an image: that with its stamp and frame; else the last of its frame that was recorded until
    /// then, or the first.
    pub camera: Option<At>,
}

/// A `CameraInfo` of a recording, by what it says about itself.
struct Info {
    log_time: u64,
    at: At,
    /// Its stamp, where it has one, and its frame. A damaged one has neither.
    stamp: Option<u64>,
    frame: String,
}

/// Finds the messages that are wanted. A recorder may write messages of one topic out of order.
///
/// # Errors
/// A topic that is missing or of another type, a damaged file, or nothing left to read.
pub fn select(bag: &Bag, selected: &Selected<'_>) -> Result<Selection, TopicError> {
    let Named { reading, camera_info } = check(bag, selected.topic, selected.camera_info)?;
    let (mut all, mut infos) = (Vec::new(), Vec::new());
    for message in bag.messages() {
        let (at, message) = message?;
        let log_time = message.header.log_time;
        let (stamp, frame) = header_of(&message.data);
        if is_named(&message.channel, selected.topic) {
            all.push((log_time, at, stamp, frame));
        } else if camera_info.as_ref().is_some_and(|topic| message.channel.topic == *topic) {
            infos.push(Info { log_time, at, stamp, frame });
        }
    }
    all.sort();
    infos.sort_by_key(|info| (info.log_time, info.at));
    let mut by_stamp = BTreeMap::<u64, Vec<&Info>>::new();
    for info in &infos {
        if let Some(stamp) = info.stamp {
            by_stamp.entry(stamp).or_default().push(info);
        }
    }
    let mut by_frame = BTreeMap::<&str, Vec<&Info>>::new();
    for (.., frame) in &all {
        by_frame.entry(frame).or_insert_with(|| {
            let own: Vec<&Info> = infos.iter().filter(|info| is_of_frame(info, frame)).collect();
            if own.is_empty() { infos.iter().collect() } else { own }
        });
    }
    let most = selected.frames.unwrap_or(usize::MAX);
    let read = all.iter().skip(selected.skip).take(most);
    let frames: Vec<SelectedMessage> = read
        .map(|(log_time, at, stamp, frame)| {
            let equal = stamp.and_then(|stamp| by_stamp.get(&stamp)).map_or(&[][..], Vec::as_slice);
            let own = equal.iter().find(|info| is_of_frame(info, frame)).copied();
            let of_frame = by_frame.get(frame.as_str()).map_or(&[][..], Vec::as_slice);
            let camera = own.or_else(|| by_time(of_frame, *log_time)).map(|info| info.at);
            SelectedMessage { at: *at, log_time: *log_time, camera }
        })
        .collect();
    if frames.is_empty() {
        return Err(TopicError::Skipped { messages: all.len(), topic: selected.topic.to_owned() });
    }
    let skipped = all.iter().take(selected.skip).map(|(_, at, ..)| *at).collect();
    Ok(Selection { reading, skipped, frames })
}

/// The last info that was recorded until a time, or the first.
fn by_time<'i>(infos: &[&'i Info], time: u64) -> Option<&'i Info> {
    let before = infos.partition_point(|info| info.log_time <= time);
    infos.get(before.saturating_sub(1)).copied()
}

fn is_of_frame(info: &Info, frame: &str) -> bool {
    info.frame.is_empty() || frame.is_empty() || info.frame == frame
}

/// Stamp and frame of a message; a damaged one has neither.
fn header_of(message: &[u8]) -> (Option<u64>, String) {
    let header = Reader::in_either_order(message).and_then(|mut r| r.foreign_header());
    header.map_or((None, String::new()), |(stamp, frame)| (stamp, frame.to_owned()))
}
