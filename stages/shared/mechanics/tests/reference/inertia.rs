//! What the wall's mass adds while it moves (SCIENCE A8, in place of the inertial part of (3.7a) and (C.6)).
//!
//! At 10 mm/s it is below 1 Pa: the plants leave it out.

use stillpoint_mechanics::shell::Shell;

/// How a shell's cavity moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swelling {
    /// Radius of the cavity, m.
    pub radius: f64,
    /// Its rate, m/s.
    pub rate: f64,
    /// The rate's rate, m/s^2.
    pub acceleration: f64,
}

/// Pressure inside over that outside that moves a free shell so, Pa. `density` is the wall's, kg/m^3.
pub fn moving_pressure(shell: &Shell, swelling: &Swelling, density: f64) -> f64 {
    let Swelling { radius: r, rate, acceleration } = *swelling;
    let inner_stretch = r / shell.inner_radius();
    let surface = shell.surface_radius(inner_stretch);
    let fourth = |x: f64| x * x * x * x;
    let shift = (2.0 * r * rate * rate + r * r * acceleration) * (1.0 / r - 1.0 / surface);
    let squeeze = 0.5 * rate * rate * (1.0 - fourth(r / surface));
    shell.pressure(inner_stretch) + density * (shift - squeeze)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_walls_mass_adds_less_than_a_pascal_at_the_rigs_speeds() {
        let shell = Shell::rig();
        let swelling = Swelling { radius: 0.06, rate: 0.01, acceleration: 0.0 };
        let added = moving_pressure(&shell, &swelling, 1100.0) - shell.pressure(1.2);
        assert!(added.abs() < 1.0, "{added}");
    }

    /// The work of the added pressure is the wall's kinetic energy.
    #[test]
    fn what_the_added_pressure_does_moves_the_wall() {
        use core::f64::consts::PI;
        let (shell, density) = (Shell::rig(), 1100.0);
        // r = 55 mm + 5 mm sin^2(10 t): from rest, and a quarter period later at full speed.
        let at = |t: f64| {
            let sine = libm::sin(10.0 * t);
            Swelling {
                radius: 0.055 + 0.005 * sine * sine,
                rate: 0.05 * libm::sin(20.0 * t),
                acceleration: libm::cos(20.0 * t),
            }
        };
        let (end, parts) = (core::f64::consts::FRAC_PI_4 / 10.0, 4000);
        let work: f64 = (0..parts)
            .map(|i| {
                let s = at(end * (f64::from(i) + 0.5) / f64::from(parts));
                let added =
                    moving_pressure(&shell, &s, density) - shell.pressure(s.radius / shell.inner_radius());
                added * 4.0 * PI * s.radius * s.radius * s.rate * end / f64::from(parts)
            })
            .sum();
        // Kinetic energy of an incompressible wall: 2 pi rho (r_i^2 r_i')^2 (1/r_i - 1/r_o).
        let s = at(end);
        let flow = s.radius * s.radius * s.rate;
        let surface = shell.surface_radius(s.radius / shell.inner_radius());
        let energy = 2.0 * PI * density * flow * flow * (1.0 / s.radius - 1.0 / surface);
        assert!((work - energy).abs() < 1e-5 * energy, "{work} {energy}");
    }
}
