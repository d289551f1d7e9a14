//! Cauchy stress through the wall of an inflated shell (SCIENCE A4, A6, in place of (2.31)-(2.34)).
//!
//! The rigs and the controllers do not use this module yet: the reference vectors and its own tests do.

use super::Shell;

/// Stress at one radius of the wall, Pa; tension is positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stress {
    pub radial: f64,
    /// Along both directions of the surface.
    pub hoop: f64,
    /// The undetermined pressure of the incompressible wall, `p` in `sigma = C1 B - C2 B^-1 - p I`.
    pub pressure: f64,
}

impl Shell {
    /// Stress where the inflated wall's radius is `r` (m), with `outside` Pa (gauge) around the shell.
    pub fn stress(&self, inner_stretch: f64, r: f64, outside: f64) -> Stress {
        let stretch = r / self.radius_at_rest(inner_stretch, r);
        let square = stretch * stretch;
        let fourth = square * square;
        let at_surface = self.primitive(self.outer_stretch(inner_stretch));
        let radial = at_surface - self.primitive(stretch) - outside;
        Stress {
            radial,
            hoop: radial + self.c1 * (square - 1.0 / fourth) + self.c2 * (fourth - 1.0 / square),
            pressure: self.c1 / fourth - self.c2 * fourth - radial,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_wall_is_in_equilibrium(stretch in 0.6..3.0f64, part in 0.05..0.95f64, outside in -1e3..1e3f64) {
            let shell = Shell::rig();
            let (inner, outer) = (shell.cavity_radius(stretch), shell.surface_radius(stretch));
            let r = inner + part * (outer - inner);
            let h = 1e-7;
            let radial = |r| shell.stress(stretch, r, outside).radial;
            let slope = (radial(r + h) - radial(r - h)) / (2.0 * h);
            let Stress { radial, hoop, .. } = shell.stress(stretch, r, outside);
            let pull = 2.0 / r * (hoop - radial);
            prop_assert!((slope - pull).abs() < 1e-4 * pull.abs() + 1e2, "{slope} {pull}");
        }

        #[test]
        fn the_walls_faces_carry_the_pressures_on_them(stretch in 0.6..3.0f64, outside in -1e3..1e3f64) {
            let shell = Shell::rig();
            let inside = shell.stress(stretch, shell.cavity_radius(stretch), outside).radial;
            let surface = shell.stress(stretch, shell.surface_radius(stretch), outside).radial;
            prop_assert!((inside + shell.pressure(stretch) + outside).abs() < 1e-6, "{inside}");
            prop_assert!((surface + outside).abs() < 1e-6, "{surface}");
        }

        #[test]
        fn the_components_agree_with_the_law_of_the_material(stretch in 0.6..3.0f64) {
            let shell = Shell::rig();
            let r = shell.cavity_radius(stretch);
            let Stress { radial, hoop, pressure } = shell.stress(stretch, r, 0.0);
            let (b_r, b_t) = (stretch.powi(-4), stretch.powi(2));
            prop_assert!((radial - (-pressure + shell.c1 * b_r - shell.c2 / b_r)).abs() < 1e-5 * hoop.abs() + 1e-6);
            prop_assert!((hoop - (-pressure + shell.c1 * b_t - shell.c2 / b_t)).abs() < 1e-5 * hoop.abs() + 1e-6);
        }
    }
}
