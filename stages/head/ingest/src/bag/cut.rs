//! A recording with the messages that are read, and no others.

use std::collections::BTreeSet;
use std::io::Cursor;

use mcap::records::MessageHeader;

use super::files::Bag;
use super::select::{At, Selection};
use super::walk::{Walk, WalkError};

/// Why a recording is not cut.
#[derive(Debug, thiserror::Error)]
pub enum CutError {
    /// A file is not read.
    #[error(transparent)]
    Walk(#[from] WalkError),
    /// A file is not written.
    #[error("{name}: it cannot be cut to what is read: {error}")]
    Write {
        /// The file.
        name: String,
        /// What the library says.
        error: mcap::McapError,
    },
}

/// The files of a recording, each with the messages of it that the selections read. Messages that are skipped keep their
/// place and lose their bytes, so that the same parameters read the same messages of it.
///
/// # Errors
/// A file that cannot be read or written.
pub fn cut(bag: &Bag, selections: &[Selection]) -> Result<Vec<(String, Vec<u8>)>, CutError> {
    let frames = || selections.iter().flat_map(|s| &s.frames);
    let read: BTreeSet<At> = frames().map(|f| f.at).chain(frames().filter_map(|f| f.camera)).collect();
    let skipped: BTreeSet<At> = selections.iter().flat_map(|s| &s.skipped).copied().collect();
    let mut files = Vec::new();
    for (number, (name, bytes)) in bag.files.iter().enumerate() {
        let fault = |error: mcap::McapError| CutError::Write { name: name.clone(), error };
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("stillpoint-ingest/", env!("CARGO_PKG_VERSION")))
            .compression_threads(0)
            .compression(Some(mcap::Compression::Lz4));
        let mut writer = options.create(Cursor::new(Vec::new())).map_err(fault)?;
        for (message, place) in Walk::new(name, bytes).zip(0..) {
            let message = message?;
            let at = (number, place);
            let is_read = read.contains(&at);
            if !is_read && !skipped.contains(&at) {
                continue;
            }
            let channel = &message.channel;
            let schema = match &channel.schema {
                Some(s) => writer.add_schema(&s.name, &s.encoding, &s.data).map_err(fault)?,
                None => 0,
            };
            let encoding = &channel.message_encoding;
            let channel_id =
                writer.add_channel(schema, &channel.topic, encoding, &channel.metadata).map_err(fault)?;
            let header = MessageHeader { channel_id, ..message.header };
            let data: &[u8] = if is_read { &message.data } else { &[] };
            writer.write_to_known_channel(&header, data).map_err(fault)?;
        }
        writer.finish().map_err(fault)?;
        files.push((name.clone(), writer.into_inner().into_inner()));
    }
    Ok(files)
}
