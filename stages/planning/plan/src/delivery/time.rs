//! How long the beam was on at each recorded motion.

/// The rigid motion of a patient from the planned set-up, at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionAt {
    /// Time of the measurement, ns.
    pub time_ns: u64,
    /// Where the isocentre of the patient is, from the planned place, along the axes of the patient frame, mm.
    pub shift_mm: [f64; 3],
    /// The turn about it: axis times angle, rad.
    pub turn_rad: [f64; 3],
}

/// A stretch of time, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// Its first moment.
    pub from_ns: u64,
    /// Its end.
    pub to_ns: u64,
}

impl Stretch {
    /// Its length, ns.
    pub fn length_ns(&self) -> u64 {
        self.to_ns.saturating_sub(self.from_ns)
    }

    fn shared_ns(&self, other: &Self) -> u64 {
        let shared = Self { from_ns: self.from_ns.max(other.from_ns), to_ns: self.to_ns.min(other.to_ns) };
        shared.length_ns()
    }
}

/// Beam-on time by motion.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamTime {
    /// Of each motion, in their order, ns.
    pub of_motion_ns: Vec<u64>,
    /// Beam-on time without a motion, ns.
    pub unknown_ns: u64,
}

/// Gives each motion the time that is nearest to it, at most `hold_ns` before and behind, as far as it lies in a stretch.
/// Motions and stretches rise in time; stretches do not overlap.
pub fn beam_time(motions: &[MotionAt], beam: &[Stretch], hold_ns: u64) -> BeamTime {
    let mut of_motion_ns = vec![0; motions.len()];
    let mut first = 0;
    for (place, motion) in motions.iter().enumerate() {
        let time = motion.time_ns;
        let half = |other: Option<&MotionAt>| {
            other.map_or(hold_ns, |other| (other.time_ns.abs_diff(time) / 2).min(hold_ns))
        };
        let before = half(place.checked_sub(1).and_then(|i| motions.get(i)));
        let behind = half(motions.get(place + 1));
        let own = Stretch { from_ns: time.saturating_sub(before), to_ns: time.saturating_add(behind) };
        while beam.get(first).is_some_and(|stretch| stretch.to_ns <= own.from_ns) {
            first += 1;
        }
        let met = beam[first..].iter().take_while(|stretch| stretch.from_ns < own.to_ns);
        of_motion_ns[place] = met.map(|stretch| stretch.shared_ns(&own)).sum();
    }
    let all: u64 = beam.iter().map(Stretch::length_ns).sum();
    let known: u64 = of_motion_ns.iter().sum();
    BeamTime { of_motion_ns, unknown_ns: all.saturating_sub(known) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time_ns: u64) -> MotionAt {
        MotionAt { time_ns, shift_mm: [0.0; 3], turn_rad: [0.0; 3] }
    }

    fn stretch(from_ns: u64, to_ns: u64) -> Stretch {
        Stretch { from_ns, to_ns }
    }

    #[test]
    fn each_motion_has_the_time_that_is_nearest_to_it() {
        let motions = [at(100), at(200), at(400)];
        let found = beam_time(&motions, &[stretch(120, 250), stretch(350, 1000)], 1000);
        // 100 stands until 150, 200 until 300.
        assert_eq!(found, BeamTime { of_motion_ns: vec![30, 100, 650], unknown_ns: 0 });
    }

    #[test]
    fn a_motion_stands_no_longer_than_the_hold_and_the_rest_is_told() {
        let motions = [at(100), at(1100)];
        let found = beam_time(&motions, &[stretch(0, 2000)], 150);
        assert_eq!(found, BeamTime { of_motion_ns: vec![250, 300], unknown_ns: 2000 - 550 });
        assert_eq!(beam_time(&motions, &[], 150), BeamTime { of_motion_ns: vec![0, 0], unknown_ns: 0 });
        assert_eq!(beam_time(&[], &[stretch(3, 9)], 150).unknown_ns, 6);
    }
}
