//! What goes over a link.

use stillpoint_samples::SampleKind;

/// The type of the samples on a link: if the two ends differ, no sample passes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Type of the samples.
    pub kind: &'static SampleKind,
    /// Frame of the samples.
    pub frame: Option<String>,
    /// The most elements of a sample.
    pub capacity: usize,
}

impl Channel {
    /// Bytes of the longest sample: header, body and elements.
    pub fn longest(&self) -> usize {
        self.kind.meta_size().saturating_add(self.capacity.saturating_mul(self.kind.element_size))
    }

    /// Type, layout and frame in one text without spaces in its parts. Two ends with the same text understand each
    /// other.
    pub fn name(&self) -> String {
        format!("{} {}", self.kind.type_name(), self.frame.as_deref().unwrap_or("-"))
    }
}
