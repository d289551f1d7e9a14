//! How old the newest measurement behind a pose is, and whether it is one.

use stillpoint_samples::{Standing, TrackElement};

/// Watches the tracks of a pose.
///
/// A filter with a timer sends predictions with the time of the prediction, so the origin of such a track does not show
/// the age of the newest measurement. The count of its measurements does.
#[derive(Clone, Debug)]
pub struct PoseWatch {
    /// Number of identical measurements in a row after which the camera counts as frozen.
    frozen_after: u64,
    /// Count of measurements and incarnation, and when the newest was acquired, ns.
    newest: Option<((u64, u32), u64)>,
    last: Option<TrackElement>,
    finite: bool,
}

impl PoseWatch {
    /// A watch without samples.
    #[must_use]
    pub fn new(frozen_after: u64) -> Self {
        Self { frozen_after, newest: None, last: None, finite: true }
    }

    /// Sees a track of this origin, ns, of a producer's incarnation, at `now`, ns.
    pub fn see(&mut self, track: &TrackElement, origin: u64, incarnation: u32, now: u64) {
        self.last = Some(*track);
        let has_estimate = track.standing() != Standing::None;
        self.finite = !has_estimate || is_finite(track);
        let count = (track.accepted, incarnation);
        let is_new = self.newest.is_none_or(|(newest, _)| newest != count);
        if has_estimate && self.finite && is_new && track.repeated < self.frozen_after {
            // A clock that is ahead must not make a pose fresh for longer.
            self.newest = Some((count, origin.min(now)));
        }
    }

    /// The newest track, where it has an estimate of finite numbers.
    #[must_use]
    pub fn track(&self) -> Option<&TrackElement> {
        self.last.as_ref().filter(|t| self.finite && t.standing() != Standing::None)
    }

    /// Whether the newest track has numbers that are none.
    #[must_use]
    pub fn is_broken(&self) -> bool {
        !self.finite
    }

    /// Whether the newest track repeats one measurement too often.
    #[must_use]
    pub fn is_frozen(&self) -> bool {
        self.last.is_some_and(|track| track.repeated >= self.frozen_after)
    }

    /// Age of the newest measurement at `now`, ns; `None` before the first.
    #[must_use]
    pub fn age(&self, now: u64) -> Option<u64> {
        self.newest.map(|(_, origin)| now.saturating_sub(origin))
    }
}

/// Whether all numbers of the channels that a track has are finite.
fn is_finite(track: &TrackElement) -> bool {
    let has = |place: usize| track.channels >> place & 1 == 1;
    let lengths = (0..3).filter(|i| has(*i)).all(|i| track.position[i].is_finite());
    let turns = !(3..6).any(has) || track.orientation.iter().all(|q| q.is_finite());
    lengths && turns && track.channels != 0
}
