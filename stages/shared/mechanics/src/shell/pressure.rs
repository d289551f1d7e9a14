//! The pressure that a stretch takes, in closed form (SCIENCE A5, in place of (2.40)).
//!
//! `P = g(lambda_i) - g(lambda_o)` with `g(l) = C1 (-2/l - 1/(2 l^4)) + C2 (2 l - 1/l^2)`.

use super::Shell;
use crate::root;

/// Stretches between which limit points and roots are sought.
pub const LEAST_STRETCH: f64 = 1e-3;
/// See [`LEAST_STRETCH`].
pub const GREATEST_STRETCH: f64 = 60.0;

/// A stretch at which the pressure is stationary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitPoint {
    pub inner_stretch: f64,
    /// Pressure, Pa.
    pub pressure: f64,
}

impl Shell {
    /// `g(lambda)`, the primitive of (2.40)'s integrand over the stretch.
    pub(crate) fn primitive(&self, stretch: f64) -> f64 {
        let inverse = 1.0 / stretch;
        let square = inverse * inverse;
        self.c1 * (-2.0 * inverse - 0.5 * square * square) + self.c2 * (2.0 * stretch - square)
    }

    /// `h = dg/d lambda`.
    fn primitive_slope(&self, stretch: f64) -> f64 {
        let inverse = 1.0 / stretch;
        let square = inverse * inverse;
        let cube = square * inverse;
        2.0 * self.c1 * (square + square * cube) + 2.0 * self.c2 * (1.0 + cube)
    }

    /// Pressure inside over that outside at an inner stretch above 0, Pa.
    pub fn pressure(&self, inner_stretch: f64) -> f64 {
        self.primitive(inner_stretch) - self.primitive(self.outer_stretch(inner_stretch))
    }

    /// `dP / d lambda_i`, Pa.
    pub fn pressure_slope(&self, inner_stretch: f64) -> f64 {
        self.pressure_with_slope(inner_stretch).1
    }

    /// Pressure and its slope, from one cube root.
    pub(crate) fn pressure_with_slope(&self, inner_stretch: f64) -> (f64, f64) {
        let outer = self.outer_stretch(inner_stretch);
        let ratio = inner_stretch / outer;
        let pressure = self.primitive(inner_stretch) - self.primitive(outer);
        let slope =
            self.primitive_slope(inner_stretch) - self.primitive_slope(outer) * ratio * ratio * self.hollow;
        (pressure, slope)
    }

    /// The stretches from 1 to [`GREATEST_STRETCH`] at which the pressure is stationary, in rising order:
    /// none, a maximum, or a maximum and a minimum (SCIENCE A7).
    ///
    /// Two that are closer together than 0.2 % of the stretch are not told apart: between them the pressure hardly
    /// changes.
    pub fn limit_points(&self) -> Vec<LimitPoint> {
        const PARTS: u32 = 2000;
        let growth = libm::log(GREATEST_STRETCH) / f64::from(PARTS);
        let stretch = |i: u32| libm::exp(growth * f64::from(i));
        let mut found = Vec::new();
        let (mut low, mut low_slope) = (1.0, self.pressure_slope(1.0));
        for i in 1..=PARTS {
            let high = stretch(i);
            let high_slope = self.pressure_slope(high);
            if (low_slope < 0.0) != (high_slope < 0.0) {
                let inner_stretch = root::bisect(|l| self.pressure_slope(l), low, high);
                found.push(LimitPoint { inner_stretch, pressure: self.pressure(inner_stretch) });
            }
            (low, low_slope) = (high, high_slope);
        }
        found
    }

    /// The pressure below which a thin sphere of this wall may buckle, Pa, negative: `-2 E (t/R)^2 / sqrt(3 (1 -
    /// nu^2))` with `nu = 1/2`. The model is not valid below it.
    pub fn buckling_pressure(&self) -> f64 {
        let thinness = (self.outer - self.inner) / (0.5 * (self.outer + self.inner));
        -2.0 * self.young() * thinness * thinness / libm::sqrt(3.0 * (1.0 - 0.25))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_slope_is_the_pressures_derivative(
            stretch in 0.5..4.0f64,
            ratio in 1.01..2.0f64,
            share in 0.0..2.0f64,
        ) {
            let shell = Shell::new(1e5, 1e5 * share, 0.05, 0.05 * ratio).unwrap();
            let h = 1e-6;
            let difference = (shell.pressure(stretch + h) - shell.pressure(stretch - h)) / (2.0 * h);
            let slope = shell.pressure_slope(stretch);
            prop_assert!((difference - slope).abs() < 1e-4 * slope.abs() + 1.0, "{difference} {slope}");
        }

        #[test]
        fn a_shell_at_rest_has_no_pressure_and_an_inflated_one_has_some(
            stretch in 1.0001..20.0f64,
            share in 0.0..2.0f64,
        ) {
            let shell = Shell::new(1e5, 1e5 * share, 0.05, 0.053).unwrap();
            prop_assert_eq!(shell.pressure(1.0), 0.0);
            prop_assert!(shell.pressure(stretch) > 0.0);
        }
    }

    #[test]
    fn the_rigs_shell_has_no_limit_point() {
        assert_eq!(Shell::rig().limit_points(), []);
    }

    #[test]
    fn a_thin_wall_of_one_modulus_has_its_limit_near_the_thin_walls_value() {
        let points = Shell::new(1e5, 0.0, 0.05, 0.05005).unwrap().limit_points();
        let [point] = points.as_slice() else { panic!("{points:?}") };
        assert!((point.inner_stretch - libm::pow(7.0, 1.0 / 6.0)).abs() < 1e-3, "{point:?}");
    }

    #[test]
    fn a_maximum_and_a_minimum_where_the_second_modulus_is_small() {
        let points = Shell::new(1e5, 1e4, 0.05, 0.053).unwrap().limit_points();
        let [top, dip] = points.as_slice() else { panic!("{points:?}") };
        assert!((top.inner_stretch - 1.507).abs() < 1e-3 && (top.pressure - 8680.0).abs() < 10.0, "{top:?}");
        assert!((dip.inner_stretch - 3.232).abs() < 1e-3 && (dip.pressure - 7360.0).abs() < 10.0, "{dip:?}");
    }
}
