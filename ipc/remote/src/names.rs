//! Keys of publications.

use std::fmt::Write;

use stillpoint_transport::Channel;

/// A text as one chunk of a key: other characters than letters, digits, `_`, `-` and `.` are written by number.
pub fn chunk(text: &str) -> String {
    let mut chunk = String::with_capacity(text.len());
    for byte in text.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'_' | b'-' | b'.' => chunk.push(byte as char),
            // Writing to a text cannot fail.
            other => drop(write!(chunk, "%{other:02x}")),
        }
    }
    if chunk.is_empty() { "-".to_owned() } else { chunk }
}

/// The key of a channel's samples: `PREFIX/PIPELINE/NAME/FRAME/TYPE/HASH`.
pub fn samples(prefix: &str, pipeline: &str, name: &str, channel: &Channel) -> String {
    let frame = channel.frame.as_deref().map_or_else(|| "-".to_owned(), chunk);
    let (kind, hash) = (chunk(channel.kind.name), channel.kind.hash);
    format!("{}/{}/{}/{frame}/{kind}/{hash:016x}", chunk(prefix), chunk(pipeline), chunk(name))
}

/// The key of a host's beats.
pub fn beats(prefix: &str, host: &str) -> String {
    format!("{}/beat/{}", chunk(prefix), chunk(host))
}

/// The key of all beats.
pub fn all_beats(prefix: &str) -> String {
    format!("{}/beat/*", chunk(prefix))
}

/// The key of a host's acknowledgements of bulk samples.
pub fn acknowledgements(prefix: &str, host: &str) -> String {
    format!("{}/taken/{}", chunk(prefix), chunk(host))
}

/// The key of all acknowledgements.
pub fn all_acknowledgements(prefix: &str) -> String {
    format!("{}/taken/*", chunk(prefix))
}

/// The key of what programs of the planning pool send to all: workers their greetings, and those who ask their demand.
pub fn pool_greetings(prefix: &str) -> String {
    format!("{}/pool/1/all/*", chunk(prefix))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_one_chunk_of_a_key() {
        assert_eq!(chunk("head_pose.planned"), "head_pose.planned");
        assert_eq!(chunk("a/b*?#$@ä"), "a%2fb%2a%3f%23%24%40%c3%a4");
        assert_eq!(chunk(""), "-");
    }
}
