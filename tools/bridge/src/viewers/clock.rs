//! The time of a session that viewers play, pause and seek.

use std::time::Duration;

use foxglove::websocket::{PlaybackCommand, PlaybackControlRequest, PlaybackState, PlaybackStatus};
use stillpoint_viewer::Asked;

/// The slowest and the fastest playback, as a factor.
const SPEED: (f32, f32) = (0.01, 50.0);

/// The time of a session. It plays from its begin as soon as somebody looks.
#[derive(Debug)]
pub struct Clock {
    first: u64,
    last: u64,
    now: u64,
    status: PlaybackStatus,
    speed: f32,
    /// The state at `now` is to be shown as a whole.
    is_chosen: bool,
    /// What was asked for is not shown yet.
    is_asked: bool,
    /// Viewers do not know the state.
    is_changed: bool,
}

impl Clock {
    /// At the begin of a session from `first` to `last`, ns.
    pub fn new((first, last): (u64, u64)) -> Self {
        Self {
            first,
            last: last.max(first),
            now: first,
            status: PlaybackStatus::Playing,
            speed: 1.0,
            is_chosen: true,
            is_asked: false,
            is_changed: true,
        }
    }

    /// The time, ns.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Someone looks who has seen nothing yet.
    pub fn repeat_now(&mut self) {
        self.is_chosen = true;
        self.is_changed = true;
    }

    /// Does what a viewer asks for.
    pub fn control(&mut self, request: &PlaybackControlRequest) -> PlaybackState {
        let asked = request.playback_speed;
        if asked.is_finite() && asked > 0.0 {
            self.speed = asked.clamp(SPEED.0, SPEED.1);
        }
        let plays = request.playback_command == PlaybackCommand::Play;
        // From the end, it plays from the begin again.
        let from_start = (plays && self.now == self.last).then_some(self.first);
        if let Some(time) = request.seek_time.or(from_start) {
            self.now = time.clamp(self.first, self.last);
            self.is_chosen = true;
        }
        self.status = match plays {
            true => PlaybackStatus::Playing,
            false => PlaybackStatus::Paused,
        };
        let did_seek = request.seek_time.is_some() || from_start.is_some();
        PlaybackState { did_seek, request_id: Some(request.request_id.clone()), ..self.state() }
    }

    /// What is to be shown after a time has passed; nothing before the last answer, or if nothing changes.
    pub fn tick(&mut self, passed: Duration) -> Option<Asked> {
        if self.is_asked {
            return None;
        }
        if self.is_chosen {
            self.is_chosen = false;
            self.is_asked = true;
            return Some(Asked::Play { from: self.now, to: self.now, is_seek: true });
        }
        if self.status != PlaybackStatus::Playing {
            return None;
        }
        let from = self.now;
        self.now = from.saturating_add((passed.as_nanos() as f64 * f64::from(self.speed)) as u64);
        if self.now >= self.last {
            self.now = self.last;
            self.status = PlaybackStatus::Ended;
            self.is_changed = true;
        }
        self.is_asked = true;
        Some(Asked::Play { from, to: self.now, is_seek: false })
    }

    /// What was asked for is shown.
    pub fn played(&mut self) {
        self.is_asked = false;
    }

    /// The state, if viewers do not know it.
    pub fn changed(&mut self) -> Option<PlaybackState> {
        std::mem::take(&mut self.is_changed).then(|| self.state())
    }

    fn state(&self) -> PlaybackState {
        PlaybackState {
            status: self.status,
            current_time: self.now,
            playback_speed: self.speed,
            did_seek: false,
            request_id: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: Duration = Duration::from_nanos(10);

    fn request(command: PlaybackCommand, speed: f32, seek: Option<u64>) -> PlaybackControlRequest {
        PlaybackControlRequest {
            playback_command: command,
            playback_speed: speed,
            seek_time: seek,
            request_id: "r".into(),
        }
    }

    fn play(from: u64, to: u64, is_seek: bool) -> Option<Asked> {
        Some(Asked::Play { from, to, is_seek })
    }

    #[test]
    fn it_shows_the_begin_then_plays_and_waits_for_each_answer() {
        let mut clock = Clock::new((100, 125));
        assert_eq!(clock.tick(TICK), play(100, 100, true));
        assert_eq!(clock.tick(TICK), None);
        clock.played();
        assert_eq!(clock.tick(TICK), play(100, 110, false));
        clock.played();
        assert_eq!(clock.tick(2 * TICK), play(110, 125, false));
        clock.played();
        assert_eq!(clock.changed().map(|s| (s.status, s.current_time)), Some((PlaybackStatus::Ended, 125)));
        assert_eq!((clock.tick(TICK), clock.changed()), (None, None));
        // Play at the end begins anew.
        let state = clock.control(&request(PlaybackCommand::Play, 2.0, None));
        assert_eq!((state.status, state.current_time, state.did_seek), (PlaybackStatus::Playing, 100, true));
        assert_eq!(clock.tick(TICK), play(100, 100, true));
        clock.played();
        assert_eq!(clock.tick(TICK), play(100, 120, false));
    }

    #[test]
    fn a_seek_shows_the_state_there_and_a_pause_holds_it() {
        let mut clock = Clock::new((100, 200));
        let state = clock.control(&request(PlaybackCommand::Pause, f32::NAN, Some(150)));
        assert_eq!((state.status, state.current_time, state.did_seek), (PlaybackStatus::Paused, 150, true));
        assert_eq!((state.playback_speed, state.request_id.as_deref()), (1.0, Some("r")));
        assert_eq!(clock.tick(TICK), play(150, 150, true));
        clock.played();
        assert_eq!(clock.tick(TICK), None);
        // Another viewer comes, and sees the same.
        clock.repeat_now();
        assert_eq!(clock.tick(TICK), play(150, 150, true));
        // A time outside of the session is its nearest end.
        assert_eq!(clock.control(&request(PlaybackCommand::Pause, 1.0, Some(7))).current_time, 100);
        assert_eq!(clock.control(&request(PlaybackCommand::Pause, 1.0, Some(700))).current_time, 200);
    }
}
