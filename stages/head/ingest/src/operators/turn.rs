//! One frame of a recording per tick.

use stillpoint_operator::Choice;

/// What comes after the last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
pub enum AtEnd {
    /// No frame: a tick later the operator has finished, and the run ends when all its sources have finished.
    Stop,
    /// The first frame.
    Repeat,
}

/// Whether the next frame is of the same round through the recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Round {
    /// It is.
    Same,
    /// The recording begins again with it.
    Next,
}

/// The next frame of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    frames: usize,
    next: usize,
    at_end: AtEnd,
}

impl Turn {
    /// The turns of a recording of `frames` frames, from the first.
    pub fn new(frames: usize, at_end: AtEnd) -> Self {
        Self { frames, next: 0, at_end }
    }

    /// The frame that comes next, `None` after the end, and its round.
    pub fn peek(&self) -> (Option<usize>, Round) {
        let begins = self.next >= self.frames && self.at_end == AtEnd::Repeat;
        let (next, round) = if begins { (0, Round::Next) } else { (self.next, Round::Same) };
        ((next < self.frames).then_some(next), round)
    }

    /// The frame of this tick; `None` after the end.
    pub fn take(&mut self) -> Option<usize> {
        let frame = self.peek().0?;
        self.next = frame + 1;
        Some(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_stops_or_begins_again() {
        let turns = |at_end| {
            let mut turn = Turn::new(2, at_end);
            [(); 5].map(|()| turn.take())
        };
        assert_eq!(turns(AtEnd::Stop), [Some(0), Some(1), None, None, None]);
        assert_eq!(turns(AtEnd::Repeat), [Some(0), Some(1), Some(0), Some(1), Some(0)]);
        assert_eq!(Turn::new(0, AtEnd::Repeat).take(), None);
    }
}
