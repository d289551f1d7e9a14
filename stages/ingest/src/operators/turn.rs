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

    /// The frame of this tick; `None` after the end.
    pub fn take(&mut self) -> Option<usize> {
        if self.next >= self.frames && self.at_end == AtEnd::Repeat {
            self.next = 0;
        }
        let frame = self.next;
        if frame >= self.frames {
            return None;
        }
        self.next += 1;
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
