//! Least squares of a few tones over a window of positions (SCIENCE Y4).
//!
//! ```text
//! q_i(t) = a_i + b_i t + c_i t^2 + sum_j D_ij y_m,j + sum_k (s_ik sin w_k t + c_ik cos w_k t)
//! ```
//!
//! with q the position that the orders do not explain, and y_m the reference model: where the effect of the bladders is not
//! the nominal one, a part of the model's way stays in q. Younger samples weigh more.

use nalgebra::{SMatrix, SVector};

pub const CHANNELS: usize = 6;
pub const TONES: usize = 2;
/// Samples that a window holds.
pub const SAMPLES: usize = 200;
/// Numbers of the trend: constant, slope, curvature.
const TREND: usize = 3;
const MOST: usize = TREND + CHANNELS + 2 * TONES;
/// Age at which the weight of a sample is a quarter, s.
const HALF_WEIGHT: f64 = 8.0;
/// Ridge of the trend and of the other coefficients, in scales^2.
const RIDGE: [f64; 2] = [1e-9, 1e-4];

/// A position at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// s.
    pub time: f64,
    /// q of each channel, in scales.
    pub value: [f64; CHANNELS],
    /// y_m of each channel, in scales.
    pub model: [f64; CHANNELS],
}

/// The last positions, oldest first, with the newest time at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    channels: usize,
    positions: Box<[Position; SAMPLES]>,
    count: usize,
    next: usize,
}

/// A tone in each channel: the factors of sine and cosine, counted from the newest time of the window.
pub type Phasors = [[f64; 2]; CHANNELS];

/// What tones explain of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Weighted sum of the squares that are left, of all channels.
    pub left: f64,
    pub phasors: [Phasors; TONES],
    /// Slope of the trend at the newest time, scales per second.
    pub drift: [f64; CHANNELS],
}

impl Window {
    /// An empty window of this many channels, at most [`CHANNELS`].
    #[must_use]
    pub fn new(channels: usize) -> Self {
        let channels = channels.min(CHANNELS);
        Self { channels, positions: Box::new([Position::default(); SAMPLES]), count: 0, next: 0 }
    }

    pub fn clear(&mut self) {
        (self.count, self.next) = (0, 0);
    }

    /// Takes a position. Times must grow.
    pub fn push(&mut self, position: Position) {
        self.positions[self.next] = position;
        self.next = (self.next + 1) % SAMPLES;
        self.count = (self.count + 1).min(SAMPLES);
    }

    #[must_use]
    pub fn newest(&self) -> Option<&Position> {
        (self.count > 0).then(|| &self.positions[(self.next + SAMPLES - 1) % SAMPLES])
    }

    /// Time from the oldest position to the newest, s.
    #[must_use]
    pub fn length(&self) -> f64 {
        let oldest = &self.positions[(self.next + SAMPLES - self.count) % SAMPLES];
        self.newest().map_or(0.0, |newest| newest.time - oldest.time)
    }

    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Fits tones of these angular frequencies, rad/s, at most [`TONES`]. `None` if the window is empty, or a number in
    /// it is not finite.
    #[must_use]
    pub fn fit(&self, tones: &[f64]) -> Option<Fit> {
        let newest = *self.newest()?;
        let tones = &tones[..tones.len().min(TONES)];
        let (n, first_tone) = (self.channels, TREND + self.channels);
        let used = first_tone + 2 * tones.len();
        let mut square = SMatrix::<f64, MOST, MOST>::identity();
        for i in 0..used {
            square[(i, i)] = RIDGE[usize::from(i >= TREND)];
        }
        let mut right = SMatrix::<f64, MOST, CHANNELS>::zeros();
        let mut whole = SVector::<f64, CHANNELS>::zeros();
        let mut x = [0.0; MOST];
        for position in self.positions.iter().take(self.count) {
            let since = position.time - newest.time;
            let age = since / HALF_WEIGHT;
            let weight = 1.0 / ((1.0 + age * age) * (1.0 + age * age));
            (x[0], x[1], x[2]) = (1.0, age, age * age);
            for (x, (model, now)) in
                x[TREND..].iter_mut().zip(position.model.iter().zip(&newest.model)).take(n)
            {
                *x = model - now;
            }
            for (k, tone) in tones.iter().enumerate() {
                let (sin, cos) = libm::sincos(tone * since);
                (x[first_tone + 2 * k], x[first_tone + 2 * k + 1]) = (sin, cos);
            }
            for i in 0..used {
                let weighted = weight * x[i];
                for j in 0..=i {
                    square[(i, j)] += weighted * x[j];
                }
                for c in 0..n {
                    right[(i, c)] += weighted * (position.value[c] - newest.value[c]);
                }
            }
            for c in 0..n {
                let value = position.value[c] - newest.value[c];
                whole[c] += weight * value * value;
            }
        }
        // Only the lower triangle is read.
        let solved = square.cholesky()?.solve(&right);
        let left: f64 = (0..n).map(|c| (whole[c] - right.column(c).dot(&solved.column(c))).max(0.0)).sum();
        let mut phasors = [[[0.0; 2]; CHANNELS]; TONES];
        for (k, phasor) in phasors.iter_mut().enumerate().take(tones.len()) {
            for (c, pair) in phasor.iter_mut().enumerate().take(n) {
                *pair = [solved[(first_tone + 2 * k, c)], solved[(first_tone + 2 * k + 1, c)]];
            }
        }
        let drift = core::array::from_fn(|c| if c < n { solved[(1, c)] / HALF_WEIGHT } else { 0.0 });
        (left.is_finite() && solved.iter().all(|v| v.is_finite())).then_some(Fit { left, phasors, drift })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A window of `seconds` at 10 Hz.
    fn window(seconds: f64, of: impl Fn(f64) -> Position) -> Window {
        let mut window = Window::new(2);
        for k in 0..=(seconds * 10.0) as u32 {
            window.push(of(0.1 * f64::from(k)));
        }
        window
    }

    fn position(time: f64, value: [f64; 2], model: [f64; 2]) -> Position {
        let six = |[a, b]: [f64; 2]| [a, b, 0.0, 0.0, 0.0, 0.0];
        Position { time, value: six(value), model: six(model) }
    }

    #[test]
    fn tones_are_found_under_a_trend_and_a_part_of_the_models_way() {
        let (slow, fast) = (0.63, 1.57);
        let window = window(30.0, |t| {
            let model = 1.0 - (-(t - 18.0).max(0.0) / 2.3).exp();
            let trend = 0.2 + 0.01 * t - 0.0004 * t * t;
            let value = [
                trend + 0.3 * model + 0.5 * (slow * t).sin(),
                -trend + 0.05 * (fast * t).cos() + 0.1 * (slow * t).sin(),
            ];
            position(t, value, [model, -0.5 * model])
        });
        assert!((window.length() - 19.9).abs() < 1e-9, "{}", window.length());
        let fit = window.fit(&[slow, fast]).unwrap();
        let without = window.fit(&[]).unwrap();
        assert!(fit.left < 1e-3 * without.left, "{} {}", fit.left, without.left);
        // Counted from the newest time, 30 s.
        let (sin, cos) = (30.0 * slow).sin_cos();
        let [s, c] = fit.phasors[0][0];
        assert!((s - 0.5 * cos).abs() < 5e-3 && (c - 0.5 * sin).abs() < 5e-3, "{s} {c}");
        assert!((fit.drift[0] - (0.01 - 0.0008 * 30.0)).abs() < 2e-3, "{:?}", fit.drift);
        let (sin, cos) = (30.0 * fast).sin_cos();
        let [s, c] = fit.phasors[1][1];
        assert!((s + 0.05 * sin).abs() < 2e-3 && (c - 0.05 * cos).abs() < 2e-3, "{s} {c}");
    }

    #[test]
    fn a_tone_that_is_not_there_explains_next_to_nothing_and_no_number_gives_no_fit() {
        let still = window(10.0, |t| position(t, [1.0 + 0.1 * t, 2.0], [0.0; 2]));
        assert!(still.fit(&[1.5]).unwrap().left < 1e-8);
        let broken = window(10.0, |t| position(t, [f64::NAN, 0.0], [0.0; 2]));
        assert_eq!(broken.fit(&[1.5]), None);
        assert_eq!(Window::new(3).fit(&[1.5]), None);
    }
}
