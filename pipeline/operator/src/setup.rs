//! All that an operator gets when it is made.

use crate::error::SetupError;
use crate::files::Files;
use crate::frames::{Frames, Rigid};
use crate::outside::Outside;

/// All that an operator gets when it is made.
pub struct Setup<'a> {
    /// Name of the operator in the pipeline.
    pub operator: &'a str,
    /// Period of its timer, ns.
    pub every: Option<u64>,
    /// Whether each input is connected, in the order of the ports.
    pub connected: &'a [bool],
    /// Frame of each input, in the order of the ports.
    pub input_frames: &'a [Option<String>],
    /// Frame of each output, in the order of the ports.
    pub output_frames: &'a [Option<String>],
    /// The pipeline's frames.
    pub frames: &'a Frames,
    /// Bytes of the files that parameters name.
    pub files: &'a dyn Files,
    /// Messages from outside, for a source.
    pub outside: Outside,
}

impl Setup<'_> {
    /// Whether an input is connected.
    pub fn is_connected(&self, port: usize) -> bool {
        self.connected.get(port).copied().unwrap_or(false)
    }

    /// Bytes of a file that a parameter names; the same bytes live and in replay.
    pub fn file(&self, name: &str) -> Result<Vec<u8>, SetupError> {
        self.files.read(name).map_err(|e| SetupError(format!("{name}: {e}")))
    }

    /// The transform `to_from_from` between two frames, where both are known and joined.
    pub fn transform(&self, to: &str, from: &str) -> Option<Rigid> {
        self.frames.transform(to, from)
    }
}
