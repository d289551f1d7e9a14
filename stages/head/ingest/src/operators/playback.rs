//! When each message of a recording is sent, and with which time of acquisition.

use stillpoint_operator::Choice;

use super::turn::{AtEnd, Round, Turn};

/// The pace at which a recording is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum Pace {
    /// One message per tick; the tick is its time of acquisition.
    Ticks,
    /// Each message at the first tick at or after its own time, and its own time is that of its acquisition. The first
    /// message comes at the first tick.
    Recorded,
}

/// What is due at a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Due {
    /// Nothing yet.
    Wait,
    /// The message of this number, with its time of acquisition in session time, ns, where it is not the tick.
    SelectedMessage(usize, Option<u64>),
    /// There are no more.
    End,
}

/// The state of a recording that is played.
#[derive(Clone, Debug)]
pub struct Playback {
    /// Time of each message behind the first, ns; it never goes back.
    offsets: Vec<u64>,
    pace: Pace,
    turn: Turn,
    /// Session time of the first message of this round, ns.
    begin: Option<u64>,
}

impl Playback {
    /// A recording whose messages have these times, ns, in the order in which they are sent.
    pub fn new(times: &[u64], pace: Pace, at_end: AtEnd) -> Self {
        let first = times.first().copied().unwrap_or(0);
        let mut offsets: Vec<u64> = times.iter().map(|time| time.saturating_sub(first)).collect();
        for place in 1..offsets.len() {
            offsets[place] = offsets[place].max(offsets[place - 1]);
        }
        Self { turn: Turn::new(offsets.len(), at_end), offsets, pace, begin: None }
    }

    /// Mean distance of two messages, ns. `None`: there is one.
    pub fn period(&self) -> Option<u64> {
        let steps = self.offsets.len().checked_sub(1).filter(|steps| *steps > 0)?;
        Some(self.offsets.last()? / steps as u64)
    }

    /// What is due at a tick at `now`, session time in ns. One message at most: what is due at the same tick follows at
    /// the next ones, with its own time.
    pub fn at(&mut self, now: u64) -> Due {
        if self.pace == Pace::Ticks {
            return self.turn.take().map_or(Due::End, |frame| Due::SelectedMessage(frame, None));
        }
        let begin = *self.begin.get_or_insert(now);
        let (Some(next), round) = self.turn.peek() else { return Due::End };
        let begin = match round {
            Round::Same => begin,
            // A mean distance lies between the last message and the first.
            Round::Next => match self.period() {
                Some(period) => begin + self.offsets.last().copied().unwrap_or(0) + period,
                None => now,
            },
        };
        let time = begin + self.offsets[next];
        if now < time {
            return Due::Wait;
        }
        self.begin = Some(begin);
        self.turn.take().map_or(Due::End, |frame| Due::SelectedMessage(frame, Some(time)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_at_ticks_is_one_message_each() {
        let mut play = Playback::new(&[5, 9], Pace::Ticks, AtEnd::Stop);
        assert_eq!(
            [0, 7, 9].map(|t| play.at(t)),
            [Due::SelectedMessage(0, None), Due::SelectedMessage(1, None), Due::End]
        );
    }

    #[test]
    fn a_recording_at_its_pace_keeps_its_own_times_however_late_a_tick_is() {
        let mut play = Playback::new(&[1_000, 1_033, 1_067, 1_100], Pace::Recorded, AtEnd::Stop);
        assert_eq!(play.period(), Some(33));
        let due = [50, 60, 82, 83, 151, 151, 160].map(|t| play.at(t));
        let frame = |n, t| Due::SelectedMessage(n, Some(t));
        assert_eq!(
            due,
            [frame(0, 50), Due::Wait, Due::Wait, frame(1, 83), frame(2, 117), frame(3, 150), Due::End]
        );
    }

    #[test]
    fn a_repeated_recording_goes_on_a_mean_distance_behind_its_last_message() {
        let mut play = Playback::new(&[0, 10, 20], Pace::Recorded, AtEnd::Repeat);
        let sent: Vec<u64> = (0..=70)
            .filter_map(|t| match play.at(t) {
                Due::SelectedMessage(_, time) => time,
                _ => None,
            })
            .collect();
        assert_eq!(sent, [0, 10, 20, 30, 40, 50, 60, 70]);
        // One message: each tick is a round.
        let mut one = Playback::new(&[7], Pace::Recorded, AtEnd::Repeat);
        assert_eq!(
            [3, 4].map(|t| one.at(t)),
            [Due::SelectedMessage(0, Some(3)), Due::SelectedMessage(0, Some(4))]
        );
    }
}
