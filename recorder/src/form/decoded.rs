//! A sample behind a message, its elements still in the message where they stand there as they are.

use std::borrow::Cow;

use stillpoint_samples::AlignedBytes;

/// A sample behind a message.
#[derive(Clone, Debug)]
pub(crate) struct Decoded<'a> {
    /// Header and body.
    pub meta: Cow<'a, [u8]>,
    /// The elements.
    pub payload: Cow<'a, [u8]>,
}

impl Decoded<'_> {
    /// Whether its bytes are these.
    pub fn is(&self, sample: &[u8]) -> bool {
        let split = sample.split_at_checked(self.meta.len());
        split.is_some_and(|(meta, payload)| *meta == *self.meta && *payload == *self.payload)
    }

    /// Its bytes one behind the other.
    pub fn to_bytes(&self) -> AlignedBytes {
        AlignedBytes::joined(&self.meta, &self.payload)
    }
}
