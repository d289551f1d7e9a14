//! Dormand and Prince's embedded Runge-Kutta pair of orders 5 and 4 (J. Comput. Appl. Math. 6 (1980) 19).
//!
//! [`step`] advances by a fixed step, as a control law or a simulated plant does; [`integrate`] chooses its steps.
//! Both keep all they need on the stack: a loop of control may not allocate. (The crate `ode_solvers` stands on
//! another version of nalgebra and allocates in each step, so it does not serve here.)
//!
//! ```
//! use nalgebra::Vector1;
//! use stillpoint_mechanics::dormand_prince::{Tolerance, integrate};
//! let decay = |_: f64, y: &Vector1<f64>| -y;
//! let y = integrate(decay, 0.0, Vector1::new(1.0), 2.0, Tolerance::default()).unwrap();
//! assert!((y.x - (-2.0_f64).exp()).abs() < 1e-9);
//! ```

use nalgebra::SVector;

/// When each stage is evaluated, as a part of the step.
const NODES: [f64; 7] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];

/// Weights of the earlier stages in each stage. The last row is the result of order 5.
const STAGES: [&[f64]; 7] = [
    &[],
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
    &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
    &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];

/// Weights of all stages in the difference of the results of orders 5 and 4.
const ERROR: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0];

/// What one step gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntegrationStep<const N: usize> {
    /// The state after the step, of order 5.
    pub state: SVector<f64, N>,
    /// The slope after the step: the first slope of the next one.
    pub slope: SVector<f64, N>,
    /// The result of order 5 less that of order 4.
    pub error: SVector<f64, N>,
}

/// One step from the slope at its beginning, `slope = f(t, y)`.
fn from_slope<const N: usize>(
    f: &mut impl FnMut(f64, &SVector<f64, N>) -> SVector<f64, N>,
    t: f64,
    y: &SVector<f64, N>,
    slope: SVector<f64, N>,
    h: f64,
) -> IntegrationStep<N> {
    let mut slopes = [SVector::<f64, N>::zeros(); 7];
    slopes[0] = slope;
    let mut state = *y;
    for stage in 1..7 {
        state = *y;
        for (weight, slope) in STAGES[stage].iter().zip(&slopes) {
            state.axpy(h * weight, slope, 1.0);
        }
        slopes[stage] = f(t + h * NODES[stage], &state);
    }
    let mut error = SVector::<f64, N>::zeros();
    for (weight, slope) in ERROR.iter().zip(&slopes) {
        error.axpy(h * weight, slope, 1.0);
    }
    IntegrationStep { state, slope: slopes[6], error }
}

/// Advances `y' = f(t, y)` from `t` by `h`: local error of order `h^6`, no allocation.
pub fn step<const N: usize>(
    mut f: impl FnMut(f64, &SVector<f64, N>) -> SVector<f64, N>,
    t: f64,
    y: &SVector<f64, N>,
    h: f64,
) -> IntegrationStep<N> {
    let slope = f(t, y);
    from_slope(&mut f, t, y, slope, h)
}

/// How exact each adaptive step is: its error stays below `absolute + relative |y|`, root mean square over the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Part of each component.
    pub relative: f64,
    /// In the components' own units.
    pub absolute: f64,
    /// Largest number of steps.
    pub steps: u32,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self { relative: 1e-9, absolute: 1e-12, steps: 1_000_000 }
    }
}

/// Why an integration ended early.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum IntegrateError {
    /// Times or tolerances that are not usable.
    #[error(
        "cannot integrate from {from} to {to} with tolerances {relative} and {absolute}; give finite times and \
             tolerances of which none is negative and one is positive"
    )]
    Input {
        /// Where it was to begin.
        from: f64,
        /// Where it was to end.
        to: f64,
        relative: f64,
        absolute: f64,
    },
    /// The state or its slope stopped being finite.
    #[error("the state is not finite after t = {at}")]
    NotFinite {
        /// The last time with a finite state.
        at: f64,
    },
    /// Steps shrank to zero, or there were too many.
    #[error(
        "no progress at t = {at} after {steps} steps; the equations may be too stiff for an explicit method"
    )]
    Stuck {
        /// How far it came.
        at: f64,
        steps: u32,
    },
}

/// Advances `y' = f(t, y)` from `from` to `to` (in either direction) by steps of the size that the tolerance allows.
///
/// # Errors
/// [`IntegrateError`] for input that is not finite, a state that leaves the finite numbers, and equations too stiff.
pub fn integrate<const N: usize>(
    mut f: impl FnMut(f64, &SVector<f64, N>) -> SVector<f64, N>,
    from: f64,
    start: SVector<f64, N>,
    to: f64,
    tolerance: Tolerance,
) -> Result<SVector<f64, N>, IntegrateError> {
    let Tolerance { relative, absolute, steps } = tolerance;
    let sound = relative >= 0.0 && absolute >= 0.0 && relative + absolute > 0.0;
    if !(from.is_finite() && to.is_finite() && sound && (relative + absolute).is_finite()) {
        return Err(IntegrateError::Input { from, to, relative, absolute });
    }
    let (mut t, mut y) = (from, start);
    if t == to {
        return Ok(y);
    }
    let mut slope = f(t, &y);
    let mut h = first_step(&y, &slope, to - from, &tolerance);
    for _ in 0..steps {
        let last = (to - t).abs() <= h.abs() * (1.0 + 1e-12);
        let taken = if last { to - t } else { h };
        if t + taken == t {
            return Err(IntegrateError::Stuck { at: t, steps });
        }
        let next = from_slope(&mut f, t, &y, slope, taken);
        let error = scaled(&next.error, &y, &next.state, &tolerance);
        if error <= 1.0 {
            t += taken;
            (y, slope) = (next.state, next.slope);
            if last {
                return Ok(y);
            }
        } else if !error.is_finite() && taken.abs() < 1e-12 * (to - from).abs() {
            return Err(IntegrateError::NotFinite { at: t });
        }
        // The error grows with the fifth power of the step; a state that is not finite asks for a much shorter one.
        let factor =
            if error.is_finite() { (0.9 * libm::pow(error.max(1e-10), -0.2)).clamp(0.2, 5.0) } else { 0.1 };
        h = taken * factor;
    }
    Err(IntegrateError::Stuck { at: t, steps })
}

/// Root mean square of the error over the allowed error; 1 is just allowed.
fn scaled<const N: usize>(
    error: &SVector<f64, N>,
    before: &SVector<f64, N>,
    after: &SVector<f64, N>,
    tolerance: &Tolerance,
) -> f64 {
    let mut sum = 0.0;
    for i in 0..N {
        let allowed = tolerance.absolute + tolerance.relative * before[i].abs().max(after[i].abs());
        // Nothing is allowed where a component is zero and the tolerance relative: then its error must be zero.
        let part = if error[i] == 0.0 { 0.0 } else { error[i] / allowed };
        sum += part * part;
    }
    libm::sqrt(sum / N.max(1) as f64)
}

/// A hundredth of the time in which the state would change by its own size, at most the whole interval.
fn first_step<const N: usize>(
    y: &SVector<f64, N>,
    slope: &SVector<f64, N>,
    interval: f64,
    tolerance: &Tolerance,
) -> f64 {
    let size = scaled(y, y, y, tolerance);
    let speed = scaled(slope, y, y, tolerance);
    let guess = 0.01 * size / speed;
    let size = if guess.is_finite() && guess > 0.0 { guess } else { 1e-6 };
    size.min(interval.abs()).copysign(interval)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector1, Vector2};
    use proptest::prelude::*;

    fn oscillator(_: f64, y: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(y.y, -y.x)
    }

    fn fixed(h: f64, steps: u32) -> Vector2<f64> {
        let mut y = Vector2::new(1.0, 0.0);
        for i in 0..steps {
            y = step(oscillator, f64::from(i) * h, &y, h).state;
        }
        y
    }

    #[test]
    fn halving_the_step_divides_the_error_by_32() {
        let exact = Vector2::new(libm::cos(4.0), -libm::sin(4.0));
        let coarse = (fixed(0.1, 40) - exact).norm();
        let fine = (fixed(0.05, 80) - exact).norm();
        let ratio = coarse / fine;
        assert!((28.0..37.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn each_stages_weights_sum_to_its_node() {
        for (weights, node) in STAGES.iter().zip(NODES) {
            assert!((weights.iter().sum::<f64>() - node).abs() < 1e-14, "{weights:?}");
        }
        assert!(ERROR.iter().sum::<f64>().abs() < 1e-15);
    }

    #[test]
    fn polynomials_in_time_up_to_degree_four_are_exact() {
        let slope = |t: f64, _: &Vector1<f64>| Vector1::new(5.0 * t * t * t * t);
        let y = step(slope, 0.5, &Vector1::new(0.03125), 1.0).state;
        assert!((y.x - 1.5_f64.powi(5)).abs() < 1e-13, "{}", y.x);
    }

    #[test]
    fn time_runs_in_either_direction() {
        let tolerance = Tolerance::default();
        let there = integrate(oscillator, 0.0, Vector2::new(1.0, 0.3), 7.0, tolerance).unwrap();
        let back = integrate(oscillator, 7.0, there, 0.0, tolerance).unwrap();
        assert!((back - Vector2::new(1.0, 0.3)).norm() < 1e-7, "{back}");
    }

    #[test]
    fn a_state_that_runs_away_is_said_with_its_time() {
        let blow_up = |_: f64, y: &Vector1<f64>| Vector1::new(y.x * y.x);
        let error = integrate(blow_up, 0.0, Vector1::new(1.0), 2.0, Tolerance::default()).unwrap_err();
        let at = match error {
            IntegrateError::NotFinite { at } | IntegrateError::Stuck { at, .. } => at,
            IntegrateError::Input { .. } => f64::NAN,
        };
        assert!((0.99..1.01).contains(&at), "{error}");
    }

    #[test]
    fn times_and_tolerances_that_say_nothing_are_refused() {
        let start = Vector2::new(1.0, 0.0);
        for (to, relative) in [(f64::NAN, 1e-6), (f64::INFINITY, 1e-6), (1.0, f64::NAN), (1.0, -1.0)] {
            let tolerance = Tolerance { relative, absolute: 0.0, steps: 10 };
            let error = integrate(oscillator, 0.0, start, to, tolerance).unwrap_err();
            assert!(matches!(error, IntegrateError::Input { .. }), "{error}");
        }
    }

    proptest! {
        #[test]
        fn the_adaptive_steps_keep_their_tolerance(
            rate in -3.0..3.0f64,
            to in -3.0..3.0f64,
            exponent in 4..10i32,
        ) {
            let tolerance = Tolerance { relative: 10f64.powi(-exponent), absolute: 1e-12, steps: 100_000 };
            let y = integrate(|_, y: &Vector1<f64>| y * rate, 0.0, Vector1::new(1.0), to, tolerance).unwrap();
            let exact = libm::exp(rate * to);
            prop_assert!((y.x - exact).abs() <= 100.0 * tolerance.relative * exact.max(1.0), "{} {exact}", y.x);
        }
    }
}
