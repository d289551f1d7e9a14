//! The true poses of the last frames, by acquisition time.

use stillpoint_samples::PoseElement;

/// Frames that are kept: more than can be on their way through the stages before a filter.
const RETAINED: usize = 16;

/// A ring of true poses.
#[derive(Default)]
pub struct Truths {
    ring: [Option<(u64, PoseElement)>; RETAINED],
    next: usize,
}

impl Truths {
    /// Keeps the true pose of a frame, in place of the oldest.
    pub fn keep(&mut self, origin: u64, truth: PoseElement) {
        self.ring[self.next] = Some((origin, truth));
        self.next = (self.next + 1) % RETAINED;
    }

    /// The true pose of the frame acquired at `origin`, ns.
    pub fn at(&self, origin: u64) -> Option<&PoseElement> {
        self.ring.iter().flatten().find(|(t, _)| *t == origin).map(|(_, truth)| truth)
    }
}
