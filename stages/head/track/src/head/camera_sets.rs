//! Which cameras the newest frames are of.

use stillpoint_samples::SensorHealth;

/// Frames that are remembered: the cameras of a frame arrive before its face, and perhaps those of a later one.
const FRAMES: usize = 8;

/// The cameras of the newest frames, a bit each in the order in which the health of the frame lists them.
#[derive(Clone, Copy, Debug, Default)]
pub struct CameraSets {
    /// Acquisition of a frame, ns, and its cameras.
    frames: [(u64, u32); FRAMES],
    next: usize,
}

impl CameraSets {
    /// Notes the cameras of the frame that was acquired at `time`, ns.
    pub fn note(&mut self, time: u64, cameras: &[SensorHealth]) {
        let bit = |(place, camera): (usize, &SensorHealth)| u32::from(camera.is_used()) << place;
        self.frames[self.next] = (time, cameras.iter().take(32).enumerate().map(bit).sum());
        self.next = (self.next + 1) % FRAMES;
    }

    /// The cameras of the frame that was acquired at `time`, ns: those of the newest frame up to it. 0 where none is known.
    pub fn of(&self, time: u64) -> u32 {
        let known = self.frames.iter().filter(|(at, _)| *at <= time);
        known.max_by_key(|(at, _)| *at).map_or(0, |(_, cameras)| *cameras)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_the_cameras_that_were_noted_for_it_though_a_later_frame_is_known() {
        let camera = |reason| SensorHealth {
            age: 0.0,
            since: 0.0,
            distance: f64::NAN,
            used: 0,
            left_out: 0,
            name: [0; 16],
            reason: SensorHealth::field(reason),
        };
        let mut sets = CameraSets::default();
        assert_eq!(sets.of(5), 0);
        sets.note(10, &[camera("used"), camera("used")]);
        sets.note(20, &[camera("blocked"), camera("used")]);
        assert_eq!((sets.of(9), sets.of(10), sets.of(20), sets.of(30)), (0, 3, 2, 2));
        for time in 3..20 {
            sets.note(10 * time, &[camera("used"), camera("late")]);
        }
        assert_eq!((sets.of(190), sets.of(20)), (1, 0), "what is too long ago is forgotten");
    }
}
