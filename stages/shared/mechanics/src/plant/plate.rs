//! A bladder pressed between two flat plates: an energy-consistent clip of the free sphere (SCIENCE C4).
//!
//! The sphere of chapter 2 is cut by both plates. `dV/d gap` is the contact area, and the air's work at constant gap
//! is the wall's energy: so the contact is conservative. It holds for clips below half the radius.

use core::f64::consts::PI;

use crate::root;
use crate::shell::Shell;
use crate::shell::air::Air;
use crate::shell::pressure::{GREATEST_STRETCH, LEAST_STRETCH};
use crate::shell::rubber::Wall;

/// Gaps below this are taken as this one: the model's pressure has no bound as the gap closes.
const LEAST_GAP: f64 = 2e-3;

/// A bladder between its plates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pressed {
    /// Inner stretch of the sphere that is clipped.
    pub inner_stretch: f64,
    /// Outer radius of that sphere, m.
    pub radius: f64,
    /// How much of the radius each plate cuts off, m; 0 where the plates do not touch.
    pub clip: f64,
    /// Gauge pressure of the air, Pa.
    pub pressure: f64,
    /// Volume of the air, m^3.
    pub volume: f64,
    /// Area of each contact, m^2.
    pub area: f64,
}

impl Pressed {
    /// Force on each plate, N. A bladder cannot pull: never negative.
    pub fn force(&self) -> f64 {
        self.pressure.max(0.0) * self.area
    }

    /// The clip is below half the radius and the pressure above where a thin shell may buckle: what the model covers.
    pub fn is_modelled(&self, shell: &Shell) -> bool {
        self.clip < 0.5 * self.radius && self.pressure > shell.buckling_pressure()
    }
}

/// Derivatives of a pressed bladder's numbers.
struct Slopes {
    pressure_by_stretch: f64,
    pressure_by_gap: f64,
    volume_by_stretch: f64,
    area_by_stretch: f64,
    area_by_gap: f64,
}

impl Shell {
    /// A bladder of an inner stretch above 0 between plates `gap` m apart.
    pub fn pressed(&self, inner_stretch: f64, gap: f64) -> Pressed {
        self.pressed_with_slopes(inner_stretch, gap).0
    }

    /// The bladder that holds `mass` kg of air between plates `gap` m apart: the root of
    /// `(P_atm + P) V = m R_s T` over the stretch, of which the left side grows.
    ///
    /// Total over the numbers: a mass beyond the stretches from 0.001 to 60 is replaced by the nearest mass inside, and
    /// a NaN gives NaN. `Pressed::is_modelled` says whether the result is inside the model.
    pub fn pressed_with(&self, mass: f64, air: &Air, gap: f64) -> Pressed {
        self.creeping_with(mass, air, gap, &Wall::ELASTIC)
    }

    /// [`pressed_with`](Self::pressed_with) with a wall that creeps.
    pub fn creeping_with(&self, mass: f64, air: &Air, gap: f64, wall: &Wall) -> Pressed {
        if mass.is_nan() || gap.is_nan() {
            return self.pressed(f64::NAN, f64::NAN);
        }
        let target = mass * air.specific_energy();
        let excess = |stretch: f64| {
            let (p, slopes) = self.creeping_with_slopes(stretch, gap, wall);
            let absolute = air.atmosphere + p.pressure;
            if absolute <= 0.0 || p.volume <= 0.0 {
                // Without either there is no air; both grow with the stretch.
                return (-target.max(f64::MIN_POSITIVE), f64::NAN);
            }
            let slope = slopes.pressure_by_stretch * p.volume + absolute * slopes.volume_by_stretch;
            (absolute * p.volume - target, slope)
        };
        let stretch = root::newton(excess, LEAST_STRETCH, GREATEST_STRETCH, 1.1);
        self.creeping_with_slopes(stretch, gap, wall).0
    }

    /// The bladder that pushes its plates, `gap` m apart, with a force of at least 0 N; `None` where no stretch up to 60
    /// does. Of a shell without limit point: with one, the force may not grow with the stretch.
    pub fn pressed_under(&self, force: f64, gap: f64) -> Option<Pressed> {
        let reach = 0.5 * gap.max(LEAST_GAP) / self.outer;
        // Where the free shell just touches both plates; a shell below rest does not push.
        let touching = libm::cbrt(1.0 + (reach * reach * reach - 1.0) / self.hollow).max(1.0);
        let excess = |stretch: f64| {
            let (p, s) = self.pressed_with_slopes(stretch, gap);
            (p.pressure * p.area - force, s.pressure_by_stretch * p.area + p.pressure * s.area_by_stretch)
        };
        let possible = force >= 0.0 && touching <= GREATEST_STRETCH && excess(GREATEST_STRETCH).0 >= 0.0;
        let found = || root::newton(excess, touching, GREATEST_STRETCH, 1.02 * touching);
        possible.then(|| self.pressed(found(), gap))
    }

    /// The force with which a bladder pushes its plates at a gauge pressure above 0 Pa, limited to the force that clips
    /// half of its radius. `None` if the bladder does not reach the plates, or if no stretch up to 60 has that
    /// pressure.
    pub fn greatest_push(&self, pressure: f64, gap: f64) -> Option<f64> {
        let excess = |stretch: f64| {
            let (p, s) = self.pressed_with_slopes(stretch, gap);
            (p.pressure - pressure, s.pressure_by_stretch)
        };
        if excess(GREATEST_STRETCH).0.is_nan() || excess(GREATEST_STRETCH).0 < 0.0 || pressure <= 0.0 {
            return None;
        }
        // A clip of half the radius is a radius of the whole gap.
        let full = gap / self.outer;
        let half_clipped = libm::cbrt(1.0 + (full * full * full - 1.0) / self.hollow);
        let stretch = root::newton(excess, 1.0, GREATEST_STRETCH, 1.1).min(half_clipped.max(1.0));
        let pressed = self.pressed(stretch, gap);
        (pressed.clip > 0.0).then(|| pressed.force())
    }

    /// How the force on the plates changes with the gap while the air stays inside, N/m: never positive while it
    /// pushes, 0 where it does not touch.
    pub fn pressed_stiffness(&self, pressed: &Pressed, air: &Air, gap: f64) -> f64 {
        let (p, s) = self.pressed_with_slopes(pressed.inner_stretch, gap);
        if p.clip == 0.0 || p.pressure <= 0.0 {
            return 0.0;
        }
        let absolute = air.atmosphere + p.pressure;
        // The stretch follows the gap so that the air's pressure times volume stays.
        let by_stretch = s.pressure_by_stretch * p.volume + absolute * s.volume_by_stretch;
        let by_gap = s.pressure_by_gap * p.volume + absolute * p.area;
        let stretch_by_gap = -by_gap / by_stretch;
        (s.pressure_by_gap + s.pressure_by_stretch * stretch_by_gap) * p.area
            + p.pressure * (s.area_by_gap + s.area_by_stretch * stretch_by_gap)
    }

    fn pressed_with_slopes(&self, inner_stretch: f64, gap: f64) -> (Pressed, Slopes) {
        self.creeping_with_slopes(inner_stretch, gap, &Wall::ELASTIC)
    }

    fn creeping_with_slopes(&self, inner_stretch: f64, gap: f64, wall: &Wall) -> (Pressed, Slopes) {
        let half = 0.5 * gap.max(LEAST_GAP);
        let (elastic, elastic_slope) = self.pressure_with_slope(inner_stretch);
        let (free, free_slope) = (wall.gain * elastic - wall.relaxed, wall.gain * elastic_slope);
        let radius = self.surface_radius(inner_stretch);
        let cavity = self.cavity_radius(inner_stretch);
        // The wall keeps its volume: r_o^2 dr_o = r_i^2 dr_i.
        let radius_slope = self.inner * (cavity / radius) * (cavity / radius);
        let volume = 4.0 / 3.0 * PI * cavity * cavity * cavity;
        let volume_slope = 4.0 * PI * cavity * cavity * self.inner;
        let clip = (radius - half).max(0.0);
        if clip == 0.0 {
            let pressed = Pressed { inner_stretch, radius, clip, pressure: free, volume, area: 0.0 };
            let slopes = Slopes {
                pressure_by_stretch: free_slope,
                pressure_by_gap: 0.0,
                volume_by_stretch: volume_slope,
                area_by_stretch: 0.0,
                area_by_gap: 0.0,
            };
            return (pressed, slopes);
        }
        let pressed = Pressed {
            inner_stretch,
            radius,
            clip,
            pressure: free * radius / half,
            volume: volume - 2.0 / 3.0 * PI * clip * clip * (3.0 * radius - clip),
            area: PI * (radius * radius - half * half),
        };
        let slopes = Slopes {
            pressure_by_stretch: (free_slope * radius + free * radius_slope) / half,
            pressure_by_gap: -0.5 * pressed.pressure / half,
            volume_by_stretch: volume_slope * half / radius,
            area_by_stretch: 2.0 * PI * radius * radius_slope,
            area_by_gap: -PI * half,
        };
        (pressed, slopes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_volume_changes_with_the_gap_by_the_area(stretch in 0.9..1.6f64, gap in 0.05..0.2f64) {
            let shell = Shell::rig();
            let h = 1e-6;
            let volume = |gap| shell.pressed(stretch, gap).volume;
            let slope = (volume(gap + h) - volume(gap - h)) / (2.0 * h);
            prop_assert!((slope - shell.pressed(stretch, gap).area).abs() < 1e-7, "{slope}");
        }

        #[test]
        fn the_airs_work_at_constant_gap_is_the_walls_energy(stretch in 0.9..1.6f64, gap in 0.05..0.2f64) {
            let shell = Shell::rig();
            let h = 1e-5;
            let (less, more) = (shell.pressed(stretch - h, gap), shell.pressed(stretch + h, gap));
            let work = shell.pressed(stretch, gap).pressure * (more.volume - less.volume);
            let stored = shell.energy(stretch + h) - shell.energy(stretch - h);
            prop_assert!((work - stored).abs() < 1e-6 * stored.abs() + 1e-9, "{work} {stored}");
        }

        #[test]
        fn the_bladder_holds_the_air_that_was_put_in(stretch in 0.9..1.8f64, gap in 0.04..0.2f64) {
            let shell = Shell::rig();
            let pressed = shell.pressed(stretch, gap);
            prop_assume!(pressed.volume > 0.0);
            let mass = Air::ROOM.mass(pressed.pressure, pressed.volume);
            let found = shell.pressed_with(mass, &Air::ROOM, gap);
            prop_assert!((found.inner_stretch - stretch).abs() < 1e-10, "{found:?} {stretch}");
        }

        #[test]
        fn the_bladder_under_a_force_pushes_with_it(force in 0.0..300.0f64, gap in 0.06..0.14f64) {
            let pressed = Shell::rig().pressed_under(force, gap).unwrap();
            prop_assert!((pressed.force() - force).abs() < 1e-9 * force.max(1.0), "{pressed:?}");
        }

        #[test]
        fn the_stiffness_is_the_forces_slope_and_never_positive(
            mass in 6e-4..1.6e-3f64,
            gap in 0.06..0.13f64,
        ) {
            let (shell, air, h) = (Shell::rig(), Air::ROOM, 1e-6);
            let pressed = shell.pressed_with(mass, &air, gap);
            prop_assume!(pressed.clip > 1e-5 && pressed.pressure > 1.0);
            let force = |gap| shell.pressed_with(mass, &air, gap).force();
            let slope = (force(gap + h) - force(gap - h)) / (2.0 * h);
            let stiffness = shell.pressed_stiffness(&pressed, &air, gap);
            prop_assert!((slope - stiffness).abs() < 1e-4 * slope.abs() + 1e-2, "{slope} {stiffness}");
            prop_assert!(stiffness <= 0.0);
        }

        #[test]
        fn no_amount_of_air_and_no_gap_makes_a_number_that_is_none(
            mass in prop_oneof![-1.0..1.0f64, 0.0..1e-3f64, Just(0.0), Just(1e300)],
            gap in prop_oneof![-1.0..1.0f64, 0.0..0.2f64, Just(0.0), Just(1e300)],
        ) {
            let pressed = Shell::rig().pressed_with(mass, &Air::ROOM, gap);
            prop_assert!(pressed.force().is_finite() && pressed.force() >= 0.0, "{pressed:?}");
        }
    }

    #[test]
    fn a_force_that_is_none_has_no_bladder() {
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(Shell::rig().pressed_under(bad, 0.085), None);
        }
        assert_eq!(Shell::rig().pressed_under(1.0, f64::INFINITY), None);
    }

    #[test]
    fn plates_far_apart_leave_the_free_shell() {
        let shell = Shell::rig();
        let pressed = shell.pressed(1.2, 0.3);
        assert_eq!((pressed.clip, pressed.area, pressed.force()), (0.0, 0.0, 0.0));
        assert_eq!((pressed.pressure, pressed.volume), (shell.pressure(1.2), shell.cavity_volume(1.2)));
    }
}
