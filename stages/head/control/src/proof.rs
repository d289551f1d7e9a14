//! Whether the error becomes smaller when tones are answered.
//!
//! A valve that does nothing breaks the assumption that orders act, and then the orders that answer a tone enlarge it: a
//! bladder that cannot be emptied is only filled by them. So answers have to prove themselves, each coordinate for
//! itself. The error is measured before a tone is answered, and an answer that does not make it smaller is dropped for a
//! while.

/// Time constant of the mean, s. The error is measured for as long before a tone is answered.
const MEAN: f64 = 4.0;
/// Time in which an answer sets in, which does not count, and time for which it is given before it is judged, s.
const SETS_IN: f64 = 1.5;
const PROBATION: f64 = 8.0;
/// Squared error, in parts of that before the tones were answered, above which an answer is dropped.
const PROOF: f64 = 0.8;
/// Time for which a dropped answer is not given, s. It doubles each time.
const BARRED: f64 = 8.0;

/// The error of one coordinate, with and without an answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Proof {
    /// Mean of the squared error.
    power: f64,
    /// Time for which the error was measured without an answer, s.
    measured: f64,
    /// Squared error before there was an answer, and the time for which there has been one, s.
    before: f64,
    answered: f64,
    /// Until when no answer is given, s, and how often answers were dropped.
    until: f64,
    times: i32,
}

impl Proof {
    /// Whether an answer may be given from a time on.
    #[must_use]
    pub fn permits(&self, time: f64) -> bool {
        self.measured >= MEAN && time >= self.until
    }

    /// Squared error without an answer.
    #[must_use]
    pub fn before(&self) -> f64 {
        if self.answered > 0.0 { self.before } else { self.power }
    }

    /// Measures the error again.
    pub fn restart(&mut self) {
        *self = Self { until: self.until, times: self.times, ..Self::default() };
    }

    /// Takes the error of a sample, `dt` seconds after the last one. Returns whether the answer has to be dropped. Errors
    /// whose square is below `floor` are of no concern.
    pub fn fails(&mut self, time: f64, dt: f64, error: f64, is_answered: bool, floor: f64) -> bool {
        let taken = if is_answered { self.answered - SETS_IN } else { self.measured };
        // The first seconds have equal weights, and what was before an answer does not count for it.
        let part = if taken < 0.0 { 1.0 } else { (dt / (taken + dt).min(MEAN)).min(1.0) };
        self.power += part * (error * error - self.power);
        if !is_answered {
            (self.before, self.answered) = (self.power, 0.0);
            self.measured += dt;
            return false;
        }
        self.answered += dt;
        let fails = self.answered > PROBATION && self.power > (PROOF * self.before).max(floor);
        if fails {
            self.restart();
            self.until = time + BARRED * libm::ldexp(1.0, self.times.min(6));
            self.times += 1;
        }
        fails
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes an error at 10 Hz from one time to another; returns when the answer was dropped.
    fn over(
        proof: &mut Proof,
        from: u32,
        to: u32,
        is_answered: bool,
        of: impl Fn(f64) -> f64,
    ) -> Option<f64> {
        (from..to).map(|k| 0.1 * f64::from(k)).find(|t| proof.fails(*t, 0.1, of(*t), is_answered, 1e-4))
    }

    fn tone(part: f64) -> impl Fn(f64) -> f64 {
        move |t| part * libm::sin(1.57 * t)
    }

    #[test]
    fn an_answer_needs_a_measured_error_and_stays_as_long_as_it_helps() {
        let mut proof = Proof::default();
        assert_eq!(over(&mut proof, 0, 30, false, tone(1.0)), None);
        assert!(!proof.permits(3.0), "too short");
        assert_eq!(over(&mut proof, 30, 60, false, tone(1.0)), None);
        assert!(proof.permits(6.0) && (proof.before() - 0.5).abs() < 0.1, "{proof:?}");
        assert_eq!(over(&mut proof, 60, 400, true, tone(0.1)), None);
        // A valve fails.
        let dropped = over(&mut proof, 400, 800, true, tone(1.2)).unwrap();
        assert!((40.0..60.0).contains(&dropped) && !proof.permits(dropped + 7.9), "{dropped}");
    }

    #[test]
    fn an_answer_that_pushes_the_head_off_is_dropped() {
        let mut proof = Proof::default();
        over(&mut proof, 0, 60, false, tone(1.0));
        // No swing is left, but a bladder only fills.
        assert!(over(&mut proof, 60, 200, true, |_| 1.0).is_some());
    }

    #[test]
    fn an_answer_that_does_not_help_is_dropped_for_longer_and_longer() {
        let mut proof = Proof::default();
        let mut time = 0;
        for barred in [8.0, 16.0, 32.0] {
            assert_eq!(over(&mut proof, time, time + 60, false, tone(1.0)), None);
            let dropped = over(&mut proof, time + 60, time + 200, true, tone(1.0)).unwrap();
            assert!((dropped - 0.1 * f64::from(time + 60) - PROBATION).abs() < 0.2, "{dropped}");
            time = (10.0 * dropped) as u32 + 1;
            over(&mut proof, time, time + 60, false, tone(1.0));
            assert!(!proof.permits(dropped + barred - 0.1) && proof.permits(dropped + barred + 0.1));
            time += 60 + 10 * barred as u32;
        }
    }

    #[test]
    fn errors_below_the_floor_drop_no_answer() {
        let mut proof = Proof::default();
        over(&mut proof, 0, 60, false, |_| 0.005);
        assert_eq!(over(&mut proof, 60, 400, true, tone(0.005)), None);
    }
}
