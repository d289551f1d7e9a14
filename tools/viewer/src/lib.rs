//! What `stillpoint view` hands to `stillpoint-bridge`, which serves it to viewers such as Foxglove, and what viewers ask for.
//!
//! The two programs are joined by pipes. What is shown goes one way, as a head in JSON with bytes behind it; what is asked
//! goes the other way, a line of JSON each. So the server of viewers knows no operators and no sessions, and `stillpoint`
//! has no runtime of a network.
//!
//! ```
//! use stillpoint_viewer::{Shown, read, write};
//! let image = Shown::Image { time: 7, frame: "camera".into(), width: 1, height: 1 };
//! let mut pipe = Vec::new();
//! write(&mut pipe, &image, &[1, 2, 3])?;
//! assert_eq!(read(&mut &pipe[..])?, Some((image, vec![1, 2, 3])));
//! # Ok::<(), stillpoint_viewer::PipeError>(())
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

use std::collections::BTreeSet;
use std::io::{ErrorKind, Read, Write};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Bytes of the longest head and of the longest body.
const LONGEST: [usize; 2] = [16 << 20, 256 << 20];

/// A position in m and an orientation (w, x, y, z).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Position, m.
    pub position: [f64; 3],
    /// Orientation: w, x, y, z.
    pub orientation: [f64; 4],
}

/// How grave a line of a log is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// Something failed.
    Error,
    /// Something is not as it should be.
    Warn,
    /// Something happened.
    Info,
}

/// Something that is shown. Times are session time, ns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shown {
    /// What begins: sent once, before all else.
    Begin {
        /// Name of the pipeline.
        name: String,
        /// Port on this machine; 0 takes any that is free.
        port: u16,
        /// First and last time of a session; none of a run.
        range: Option<(u64, u64)>,
    },
    /// An image; its bytes are red, green, blue for each pixel.
    Image {
        /// Time of the acquisition.
        time: u64,
        /// Frame of the camera.
        frame: String,
        /// Pixels of a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Points of a face; its bytes are x, y, z of each point as `f32`, little-endian, m.
    Points {
        /// Time of the acquisition.
        time: u64,
        /// Frame of the points.
        frame: String,
    },
    /// A pose.
    Pose {
        /// The topic.
        topic: Topic,
        /// Its time.
        time: u64,
        /// The frame in which it is stated.
        frame: String,
        /// The pose.
        place: Place,
    },
    /// Where a frame is.
    Frame {
        /// Its time.
        time: u64,
        /// The frame in which it is stated.
        parent: String,
        /// The frame.
        child: String,
        /// Its origin and axes.
        place: Place,
    },
    /// Numbers and words, as JSON.
    Values {
        /// The topic.
        topic: Topic,
        /// Their time.
        time: u64,
        /// An object.
        values: Value,
    },
    /// A line of the log.
    Line {
        /// Its time.
        time: u64,
        /// Its level.
        level: Level,
        /// The operator or process that it is about.
        name: String,
        /// What is stated.
        message: String,
    },
    /// All that was asked for by [`Asked::Play`] was sent.
    Played,
}

/// A topic that a viewer may subscribe to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Topic {
    /// Images with the outline of the face.
    Image,
    /// The points of the face.
    Face,
    /// Where the head is.
    Estimate,
    /// Where it is to be.
    Target,
    /// Frames.
    Tf,
    /// Estimate, target, beam, valves and tracker as numbers and words.
    Held,
    /// The figures of `top`.
    State,
    /// The log.
    Log,
}

impl Topic {
    /// All topics.
    pub const ALL: [Self; 8] =
        [Self::Image, Self::Face, Self::Estimate, Self::Target, Self::Tf, Self::Held, Self::State, Self::Log];

    /// Its name in viewers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Image => "/image",
            Self::Face => "/face",
            Self::Estimate => "/estimate",
            Self::Target => "/target",
            Self::Tf => "/tf",
            Self::Held => "/held",
            Self::State => "/state",
            Self::Log => "/log",
        }
    }

    /// Name and JSON schema of a topic of [`Shown::Values`]; that of any object for the others.
    pub fn schema(self) -> (&'static str, Value) {
        match self {
            Self::Held => ("stillpoint.Held", held()),
            _ => ("stillpoint.State", json!({ "type": "object" })),
        }
    }

    /// The topic of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }
}

/// The schema of the values of [`Topic::Held`]: positions in m, angles in rad.
fn held() -> Value {
    let (number, word) = (json!({ "type": "number" }), json!({ "type": "string" }));
    let words = json!({ "type": "array", "items": word });
    let pose = json!({ "type": "object", "properties": {
        "x": number, "y": number, "z": number, "pitch": number, "roll": number, "yaw": number,
    } });
    json!({ "type": "object", "properties": {
        "estimate": pose, "target": pose,
        "beam": { "type": "boolean" }, "beam_reasons": words,
        "valves": word, "valves_reasons": words, "valves_fault": words,
        "tracker": word, "proof": word, "unproven": word, "confidence": number,
    } })
}

/// What viewers ask for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Asked {
    /// They are served at this port.
    Listening(u16),
    /// The topics to which any viewer subscribes from now on.
    Topics(BTreeSet<Topic>),
    /// Of a session: what lies after `from`, up to `to`; after a seek, the state at `to`. [`Shown::Played`] answers it.
    Play {
        /// Time, ns.
        from: u64,
        /// Time, ns.
        to: u64,
        /// Whether the time was chosen and did not pass.
        is_seek: bool,
    },
}

/// Why nothing can be handed over.
#[derive(Debug, thiserror::Error)]
pub enum PipeError {
    /// The pipe.
    #[error("the pipe to the server of viewers: {0}")]
    Io(#[from] std::io::Error),
    /// The message is none: the programs are of different builds.
    #[error("invalid message between the programs: {0}; build both from one source")]
    Message(#[from] serde_json::Error),
    /// A message that is too long.
    #[error("invalid length of a message between the programs: {0} bytes (allowed: up to {1})")]
    Length(usize, usize),
}

/// Writes something that is shown, with its bytes.
///
/// # Errors
/// The other program is gone, or the message is too long.
pub fn write(out: &mut impl Write, shown: &Shown, bytes: &[u8]) -> Result<(), PipeError> {
    let head = serde_json::to_vec(shown)?;
    let mut message = Vec::with_capacity(8 + head.len() + bytes.len());
    for (part, most) in [&head[..], bytes].into_iter().zip(LONGEST) {
        let length = u32::try_from(part.len()).ok().filter(|length| *length as usize <= most);
        let length = length.ok_or(PipeError::Length(part.len(), most))?;
        message.extend_from_slice(&length.to_le_bytes());
    }
    message.extend_from_slice(&head);
    message.extend_from_slice(bytes);
    out.write_all(&message)?;
    Ok(out.flush()?)
}

/// Reads what [`write()`] wrote; `None` at the end.
///
/// # Errors
/// The pipe breaks off within a message, or the message is none.
pub fn read(from: &mut impl Read) -> Result<Option<(Shown, Vec<u8>)>, PipeError> {
    let mut lengths = [0; 8];
    match from.read_exact(&mut lengths) {
        Err(e) if e.kind() == ErrorKind::UnexpectedEof => return Ok(None),
        other => other?,
    }
    let [a, b, c, d, e, f, g, h] = lengths;
    let mut parts = [Vec::new(), Vec::new()];
    for ((part, length), most) in parts.iter_mut().zip([[a, b, c, d], [e, f, g, h]]).zip(LONGEST) {
        let length = u32::from_le_bytes(length) as usize;
        if length > most {
            return Err(PipeError::Length(length, most));
        }
        part.resize(length, 0);
        from.read_exact(part)?;
    }
    let [head, bytes] = parts;
    Ok(Some((serde_json::from_slice(&head)?, bytes)))
}

/// Writes what is asked, as a line.
///
/// # Errors
/// The other program is gone.
pub fn ask(out: &mut impl Write, asked: &Asked) -> Result<(), PipeError> {
    let mut line = serde_json::to_vec(asked)?;
    line.push(b'\n');
    out.write_all(&line)?;
    Ok(out.flush()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_that_is_cut_or_too_long_is_an_error_and_an_end_between_messages_is_none() {
        let mut pipe = Vec::new();
        write(&mut pipe, &Shown::Played, &[]).unwrap();
        assert_eq!(read(&mut &pipe[..]).unwrap(), Some((Shown::Played, Vec::new())));
        assert!(matches!(read(&mut &pipe[..pipe.len() - 1]), Err(PipeError::Io(_))));
        assert_eq!(read(&mut &pipe[..0]).unwrap(), None);
        pipe[3] = 0xff;
        assert!(matches!(read(&mut &pipe[..]), Err(PipeError::Length(..))));
    }

    #[test]
    fn what_is_asked_is_a_line() {
        for asked in [
            Asked::Listening(8765),
            Asked::Topics(BTreeSet::from(Topic::ALL)),
            Asked::Play { from: 1, to: 2, is_seek: true },
        ] {
            let mut line = Vec::new();
            ask(&mut line, &asked).unwrap();
            assert_eq!(line.iter().filter(|b| **b == b'\n').count(), 1);
            assert_eq!(serde_json::from_slice::<Asked>(&line).unwrap(), asked);
        }
        assert!(Topic::ALL.iter().all(|topic| Topic::named(topic.name()) == Some(*topic)));
    }
}
