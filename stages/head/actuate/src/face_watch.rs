//! Whether a face that moves explains why there is no fresh pose.
//!
//! A smile is no reason to let go of a head that lies still: while the tracker reports that the face moves, the valves
//! hold, and the last sound pose counts. It counts for a bounded time. After that a missing pose is missing.

use stillpoint_samples::PoseStatus;

/// While a face moves, the valves hold for at most so long, ns. Then the head may have moved: a pose is followed, and a
/// pose that is missing is missing.
const HOLD: u64 = 5_000_000_000;

/// A face that moves, as the tracker reports it.
#[derive(Clone, Copy, Debug)]
pub struct FaceWatch {
    /// A report counts for so long, ns.
    lasts: u64,
    episode: Option<Episode>,
}

/// From the first report that the face moves to the next pose of a face at rest.
#[derive(Clone, Copy, Debug)]
struct Episode {
    since: u64,
    /// When it was last reported that the face moves, ns.
    last: u64,
    /// Whether the newest report says so.
    is_now: bool,
    /// Whether a face at rest has had a pose since.
    is_over: bool,
}

impl FaceWatch {
    /// Without a report. A report counts for as long as a pose is fresh: `lasts`, ns.
    #[must_use]
    pub fn new(lasts: u64) -> Self {
        Self { lasts, episode: None }
    }

    /// Takes the status of a frame that is known at `now`, ns. An episode begins only while a pose `is_fresh`.
    pub fn see(&mut self, status: Option<PoseStatus>, is_fresh: bool, now: u64) {
        let moves = matches!(status, Some(PoseStatus::FaceMoves | PoseStatus::FaceUnsure));
        let rests = matches!(status, Some(PoseStatus::Captured | PoseStatus::Tracked | PoseStatus::Found));
        let running = self.episode.filter(|episode| !episode.is_over);
        self.episode = match (running, moves) {
            (Some(episode), true) => Some(Episode { last: now, is_now: true, ..episode }),
            (None, true) if is_fresh => Some(Episode { since: now, last: now, is_now: true, is_over: false }),
            (None, true) => None,
            // The pose of a face at rest is known a moment after its report.
            (_, false) => self.episode.map(|episode| Episode {
                is_now: false,
                is_over: episode.is_over || rests,
                ..episode
            }),
        };
    }

    /// Whether it explains that no pose is fresh at `now`, ns.
    #[must_use]
    pub fn excuses(&self, now: u64) -> bool {
        self.episode.is_some_and(|episode| {
            now.saturating_sub(episode.since) < HOLD && now.saturating_sub(episode.last) <= self.lasts
        })
    }

    /// Whether the face moves at `now`, ns, so that the valves hold.
    #[must_use]
    pub fn moves(&self, now: u64) -> bool {
        self.excuses(now) && self.episode.is_some_and(|episode| episode.is_now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STALE: u64 = 300;
    const MS: u64 = 1_000_000;

    /// A watch that saw these statuses, one each 100 ms from 1 s on, and the time of the last, ms.
    fn after(statuses: &[PoseStatus]) -> (FaceWatch, u64) {
        let mut watch = FaceWatch::new(STALE * MS);
        let mut now = 900;
        for status in statuses {
            now += 100;
            watch.see(Some(*status), true, now * MS);
        }
        (watch, now)
    }

    #[test]
    fn a_face_without_a_pose_is_an_excuse_for_five_seconds_and_no_longer() {
        let (watch, now) = after(&[PoseStatus::FaceUnsure; 49]);
        assert!(watch.excuses(now * MS) && watch.moves(now * MS));
        let (watch, now) = after(&[PoseStatus::FaceUnsure; 60]);
        assert!(!watch.excuses(now * MS) && !watch.moves(now * MS));
    }

    #[test]
    fn a_camera_that_stops_during_a_smile_is_missed_as_ever() {
        let (watch, now) = after(&[PoseStatus::FaceUnsure; 5]);
        assert!(watch.excuses((now + STALE) * MS) && !watch.excuses((now + STALE + 1) * MS));
    }

    #[test]
    fn other_causes_do_not_begin_an_episode_and_do_not_prolong_it() {
        for other in [PoseStatus::NoFace, PoseStatus::Lost, PoseStatus::Doubted, PoseStatus::TooFewPoints] {
            let (watch, now) = after(&[other; 3]);
            assert!(!watch.excuses(now * MS));
            let (watch, now) = after(&[PoseStatus::FaceUnsure, other, other, other, other]);
            assert!(!watch.excuses(now * MS));
            // A face that comes and goes without a pose between is one episode.
            let (watch, now) = after(&[PoseStatus::FaceUnsure, other].repeat(30));
            assert!(!watch.excuses(now * MS));
        }
    }

    #[test]
    fn a_pose_of_a_face_at_rest_begins_anew() {
        let (watch, now) = after(&[vec![PoseStatus::FaceMoves; 40], vec![PoseStatus::Tracked]].concat());
        assert!(!watch.moves(now * MS) && watch.excuses(now * MS));
        let smiles =
            [vec![PoseStatus::FaceMoves; 40], vec![PoseStatus::Tracked], vec![PoseStatus::FaceMoves; 40]];
        let (watch, now) = after(&smiles.concat());
        assert!(watch.moves(now * MS));
    }

    #[test]
    fn no_episode_begins_while_the_pose_is_missing() {
        let mut watch = FaceWatch::new(STALE * MS);
        watch.see(Some(PoseStatus::FaceUnsure), false, 1_000 * MS);
        assert!(!watch.excuses(1_000 * MS) && !watch.moves(1_000 * MS));
    }
}
