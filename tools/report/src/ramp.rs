//! What a settled filter of constant velocity does to white noise and to a ramp, from the gains that it had.
//!
//! With constant gains it is the alpha-beta filter: `x <- x + v dt + k nu`, `v <- v + l nu`, alpha = k, beta = l dt.

/// The ramp that the lag is stated for.
pub const RAMP_MM_PER_S: f64 = 10.0;

/// Intervals, s, of sensors that a ramp of six seconds says something of.
const SHORTEST: f64 = 1e-4;
const LONGEST: f64 = 0.5;

/// A settled filter of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settled {
    /// Gain of the position.
    pub position: f64,
    /// Gain of the rate, 1/s.
    pub rate: f64,
    /// Time between measurements, s.
    pub interval: f64,
}

impl Settled {
    /// Whether these are gains of a filter that settles.
    pub fn is_stable(&self) -> bool {
        let (alpha, beta) = (self.position, self.rate * self.interval);
        alpha > 0.0 && beta > 0.0 && alpha.is_finite() && 2.0 * alpha + beta < 4.0
    }

    /// Variance of the output over that of white noise at the input (Kalata, IEEE Trans. AES 20 (1984) 174).
    pub fn noise_ratio(&self) -> Option<f64> {
        let (alpha, beta) = (self.position, self.rate * self.interval);
        self.is_stable().then(|| {
            (2.0 * alpha * alpha + beta * (2.0 - 3.0 * alpha)) / (alpha * (4.0 - beta - 2.0 * alpha))
        })
    }

    /// Mean lag, mm, behind a ramp of 10 mm/s from rest, over its first, second and sixth second.
    pub fn lag_mm(&self) -> Option<[f64; 3]> {
        if !self.is_stable() || !(SHORTEST..=LONGEST).contains(&self.interval) {
            return None;
        }
        let (mut x, mut v, mut sums) = (0.0, 0.0, [(0.0, 0.0); 6]);
        let steps = (6.0 / self.interval) as usize;
        for step in 1..=steps {
            let t = step as f64 * self.interval;
            let truth = RAMP_MM_PER_S * t;
            let predicted = x + v * self.interval;
            let innovation = truth - predicted;
            x = predicted + self.position * innovation;
            v += self.rate * innovation;
            if let Some((sum, count)) = sums.get_mut(t as usize) {
                *sum += truth - x;
                *count += 1.0;
            }
        }
        let lags = [sums[0], sums[1], sums[5]].map(|(sum, count)| sum / f64::max(count, 1.0));
        Some(lags)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix1, Vector1};
    use stillpoint_estimate::{Kalman, KalmanParams, Measurement, Outcome, ProcessNoise};

    /// The gains of the filter of Fig 4.3: a sensor of 3 mm at 30 Hz, 107 mm/s2.
    fn settled() -> Settled {
        let mut filter = Kalman::<1>::new(KalmanParams {
            process: ProcessNoise::per_step(106.6),
            open_sd: Vector1::new(1.0),
            initial_velocity_sd: Vector1::new(50.0),
            gate: f64::INFINITY,
            horizon: u64::MAX,
        })
        .unwrap();
        let mut gains = [0.0; 2];
        for k in 1..1000 {
            let z = Measurement { position: Vector1::new(0.0), covariance: Matrix1::new(9.0) };
            if let Outcome::Updated(i) = filter.step(k * 33_333_333, Some(&z)).unwrap() {
                gains = [i.position_gain.x, i.velocity_gain.x];
            }
        }
        Settled { position: gains[0], rate: gains[1], interval: 33_333_333e-9 }
    }

    #[test]
    fn the_filter_of_the_source_has_the_reduction_and_the_lag_that_are_known_of_it() {
        // docs/science/equations.md: 80.87 % by simulation, and 0.241, -0.005, 0.000 mm.
        let settled = settled();
        let reduction = 1.0 - settled.noise_ratio().unwrap();
        assert!((reduction - 0.8081).abs() < 0.002, "{reduction}");
        let lag = settled.lag_mm().unwrap();
        assert!((lag[0] - 0.241).abs() < 0.02 && lag[1].abs() < 0.01 && lag[2].abs() < 1e-3, "{lag:?}");
    }

    #[test]
    fn the_ratio_of_noise_is_the_sum_of_the_squares_of_the_answer_to_an_impulse() {
        let s = Settled { position: 0.3, rate: 0.8, interval: 0.05 };
        let (mut x, mut v, mut sum) = (0.0, 0.0, 0.0);
        for step in 0..5000 {
            let z = if step == 0 { 1.0 } else { 0.0 };
            let predicted = x + v * s.interval;
            x = predicted + s.position * (z - predicted);
            v += s.rate * (z - predicted);
            sum += x * x;
        }
        assert!((s.noise_ratio().unwrap() - sum).abs() < 1e-9);
    }

    #[test]
    fn gains_that_do_not_settle_have_no_figures() {
        for (position, rate) in [(0.0, 0.0), (2.5, 1.0), (f64::NAN, 1.0)] {
            let s = Settled { position, rate, interval: 0.1 };
            assert_eq!((s.noise_ratio(), s.lag_mm()), (None, None));
        }
    }
}
