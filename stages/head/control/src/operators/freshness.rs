//! How old the newest measurement behind a track is.

use stillpoint_samples::{Standing, TrackElement};

/// Watches a track for measurements.
///
/// A filter with a timer sends predictions with the time of the prediction, so the origin of such a sample does not
/// show the age of the newest measurement. The count of measurements does.
#[derive(Clone, Copy, Debug, Default)]
pub struct Freshness {
    /// Count of measurements, and the origin of the first track with that count, ns.
    newest: Option<(u64, u64)>,
}

impl Freshness {
    /// Sees a track of this origin, ns.
    pub fn see(&mut self, track: &TrackElement, origin: u64) {
        if track.standing() == Standing::None {
            return;
        }
        if self.newest.is_none_or(|(count, _)| count != track.accepted) {
            self.newest = Some((track.accepted, origin));
        }
    }

    /// Age of the newest measurement, ns; `None` before the first.
    pub fn age(&self, now: u64) -> Option<u64> {
        self.newest.map(|(_, origin)| now.saturating_sub(origin))
    }
}
