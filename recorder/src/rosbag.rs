//! `metadata.yaml`: what rosbag2 wants to know of a folder of MCAP files. A session with it is a bag.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::Path;

use crate::folder::create_private;
use crate::part::SessionPart;
use crate::session::Session;

/// Name of the file in the folder of a session.
pub const METADATA_FILE: &str = "metadata.yaml";
/// Version of its format: that of ROS 2 Humble, which later releases read.
const VERSION: u32 = 5;

/// Text of the `metadata.yaml` of a session.
#[must_use]
pub fn metadata_yaml(session: &Session) -> String {
    let mut topics: BTreeMap<(&str, &str), u64> = BTreeMap::new();
    for (part, (channel, count)) in session.parts.iter().flat_map(|p| p.counts.iter().map(move |c| (p, c))) {
        if let Some(c) = part.channels.get(channel) {
            *topics.entry((&c.channel.topic, &c.schema_name)).or_default() += count;
        }
    }
    let first = session.parts.iter().filter_map(|p| Some(p.times?[0])).min().unwrap_or(0);
    let last = session.parts.iter().filter_map(|p| Some(p.times?[1])).max().unwrap_or(first);
    let mut text = format!(
        "rosbag2_bagfile_information:\n  version: {VERSION}\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {}\n  \
         starting_time:\n    nanoseconds_since_epoch: {first}\n  message_count: {}\n  topics_with_message_count:\n",
        last - first,
        topics.values().sum::<u64>()
    );
    for ((topic, kind), count) in topics {
        // Writing to a text never fails.
        let _ = write!(
            text,
            "    - topic_metadata:\n        name: {}\n        type: {}\n        serialization_format: cdr\n        \
             offered_qos_profiles: \"\"\n      message_count: {count}\n",
            quoted(topic),
            quoted(kind)
        );
    }
    text.push_str("  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n");
    for part in &session.parts {
        let _ = writeln!(text, "    - {}", quoted(&name(part)));
    }
    text.push_str("  files:\n");
    for part in &session.parts {
        let [begin, end] = part.times.unwrap_or([first, first]);
        let _ = write!(
            text,
            "    - path: {}\n      starting_time:\n        nanoseconds_since_epoch: {begin}\n      duration:\n        \
             nanoseconds: {}\n      message_count: {}\n",
            quoted(&name(part)),
            end - begin,
            part.counts.values().sum::<u64>()
        );
    }
    text
}

/// Writes the `metadata.yaml` of a session into its folder, mode 0600, in the place of one that is there. A session that is
/// one file has none.
///
/// # Errors
/// What the operating system answers.
pub fn write_metadata(folder: &Path, session: &Session) -> io::Result<()> {
    if !folder.is_dir() {
        return Ok(());
    }
    let (path, new) = (folder.join(METADATA_FILE), folder.join("metadata.yaml.new"));
    match std::fs::remove_file(&new) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(e),
        _ => {}
    }
    let written = create_private(&new).and_then(|mut file| file.write_all(metadata_yaml(session).as_bytes()));
    written.and_then(|()| std::fs::rename(&new, path)).inspect_err(|_| {
        let _ = std::fs::remove_file(&new);
    })
}

fn name(part: &SessionPart) -> String {
    part.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// A text between single quotes, as YAML has them.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "''").replace(['\n', '\r'], " "))
}
