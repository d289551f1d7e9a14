//! Samples as bytes, as they lie in shared memory.

use stillpoint_samples::{AlignedBytes, HEADER_SIZE, Header, Sample};
use zerocopy::IntoBytes;

/// The bytes of a sample.
pub fn bytes_of<S: Sample>(head: &Header, body: &S::Body, elements: &[S::Element]) -> AlignedBytes {
    let mut meta = [head.as_bytes(), body.as_bytes()].concat();
    if meta.len() > HEADER_SIZE {
        // A body ends in the count.
        let end = meta.len();
        meta[end - 4..].copy_from_slice(&head.count.to_le_bytes());
    }
    AlignedBytes::copy_of(&[&meta, elements.as_bytes()].concat())
}
