//! Radii, stretches and volumes of an inflated shell: the wall keeps its volume (2.22)-(2.23), (2.26).

use core::f64::consts::PI;

use super::Shell;

/// The invariants `I1` and `I2` of the stretches `lambda^-2, lambda, lambda` (2.18), (2.27). `I3` is 1.
pub fn invariants(stretch: f64) -> (f64, f64) {
    let square = stretch * stretch;
    (1.0 / (square * square) + 2.0 * square, square * square + 2.0 / square)
}

impl Shell {
    /// Stretch of the outer surface, `lambda_o^3 = 1 + (lambda_i^3 - 1) (R_i / R_o)^3`.
    pub fn outer_stretch(&self, inner_stretch: f64) -> f64 {
        libm::cbrt(1.0 + (inner_stretch * inner_stretch * inner_stretch - 1.0) * self.hollow)
    }

    /// Radius of the cavity, m.
    pub fn cavity_radius(&self, inner_stretch: f64) -> f64 {
        inner_stretch * self.inner
    }

    /// Radius of the outer surface, m.
    pub fn surface_radius(&self, inner_stretch: f64) -> f64 {
        self.outer_stretch(inner_stretch) * self.outer
    }

    /// Volume of the cavity, m^3.
    pub fn cavity_volume(&self, inner_stretch: f64) -> f64 {
        let radius = self.cavity_radius(inner_stretch);
        4.0 / 3.0 * PI * radius * radius * radius
    }

    /// Volume of the wall, m^3: the same at every stretch.
    pub fn wall_volume(&self) -> f64 {
        let (inner, outer) = (self.inner, self.outer);
        4.0 / 3.0 * PI * (outer * outer * outer - inner * inner * inner)
    }

    /// Where the wall that is at radius `r` (m) of the inflated shell lies at rest, m: `R^3 = r^3 - r_i^3 + R_i^3`.
    pub fn radius_at_rest(&self, inner_stretch: f64, r: f64) -> f64 {
        let cavity = self.cavity_radius(inner_stretch);
        libm::cbrt(r * r * r - cavity * cavity * cavity + self.inner * self.inner * self.inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_wall_keeps_its_volume(stretch in 0.2..8.0f64, ratio in 1.001..2.0f64) {
            let shell = Shell::new(1e5, 1e4, 0.05, 0.05 * ratio).unwrap();
            let surface = shell.surface_radius(stretch);
            let full = 4.0 / 3.0 * PI * surface * surface * surface;
            let wall = full - shell.cavity_volume(stretch);
            prop_assert!((wall - shell.wall_volume()).abs() < 1e-12 * full, "{wall}");
        }

        #[test]
        fn the_invariants_are_three_at_rest_and_more_elsewhere(stretch in 0.1..10.0f64) {
            prop_assert_eq!(invariants(1.0), (3.0, 3.0));
            let (i1, i2) = invariants(stretch);
            prop_assert!(i1 >= 3.0 - 1e-12 && i2 >= 3.0 - 1e-12, "{i1} {i2}");
        }
    }
}
