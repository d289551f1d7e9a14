//! The contract between the users of a topic.

use stillpoint_samples::{SampleKind, Shape};

/// What users of a topic agree on. The creator's limits hold for all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contract {
    /// Name of the topic, `operator.port`.
    pub topic: String,
    /// Sample type, layout hash and frame: who says otherwise is refused.
    pub type_name: String,
    /// Bytes of header and body.
    pub meta_size: usize,
    /// Bytes of an element.
    pub element_size: usize,
    /// Alignment of an element.
    pub element_align: usize,
    /// Whether a sample has many elements.
    pub shape: Shape,
    /// The most elements of a sample.
    pub capacity: usize,
    /// The deepest buffer that a subscriber may ask for.
    pub buffer: usize,
    /// The most samples that a subscriber holds at a time.
    pub borrowed: usize,
    /// The most subscribers, taps included.
    pub subscribers: usize,
    /// The most publishers: one that lives, and dead ones that are not cleaned up yet.
    pub publishers: usize,
    /// The most processes that use the topic at a time.
    pub nodes: usize,
    /// Samples that the publisher's memory holds, its history aside. The worst case over all subscribers would be far
    /// more.
    pub pool: usize,
    /// The newest samples that a publisher keeps for a subscriber that asks for them when it connects.
    pub history: usize,
}

impl Contract {
    /// The contract of `kind` in `frame`, with room for one consumer of depth 1 and taps.
    pub fn new(topic: &str, kind: &SampleKind, frame: Option<&str>, capacity: usize) -> Self {
        Self {
            topic: topic.to_string(),
            type_name: match frame {
                Some(frame) => format!("{} in {frame}", kind.type_name()),
                None => kind.type_name(),
            },
            meta_size: kind.meta_size(),
            element_size: kind.element_size,
            element_align: kind.element_align,
            shape: kind.shape,
            capacity: capacity.max(1),
            buffer: 1,
            borrowed: 2,
            subscribers: 8,
            publishers: 4,
            nodes: 64,
            pool: 8,
            history: 0,
        }
    }

    /// Bytes of shared memory that a publisher of this topic takes.
    pub fn pool_bytes(&self) -> usize {
        self.sample_bytes() * self.samples()
    }

    /// Bytes of shared memory that a sample takes at most.
    pub fn sample_bytes(&self) -> usize {
        // iceoryx2's own header precedes each sample.
        self.capacity * self.element_size + self.meta_size + 128
    }

    /// Samples that the publisher's memory holds. The newest are in buffers and in the history, and count once.
    pub(crate) fn samples(&self) -> usize {
        self.pool + self.history.saturating_sub(self.buffer)
    }

    /// The deepest buffer: a subscriber that asks for the history takes it at once.
    pub(crate) fn deepest(&self) -> usize {
        self.buffer.max(self.history)
    }
}
