//! Creep and hysteresis of the rubber: quasi-linear viscoelasticity (Fung, *Biomechanics*, 1981, chapter 7).
//!
//! The elastic pressure `P(lambda)` of a free shell is carried at once by the network and by elements that relax:
//!
//! ```text
//! P_wall = P + c sum_k (P - z_k),   z_k' = (P - z_k) / tau_k
//! ```
//!
//! with one element for each decade of time. After a step the surplus falls by about `c P` in each decade. Rubber near
//! room temperature relaxes so (Gent, Rubber Chem. Technol. 36 (1963) 697), by a few per cent in a decade. At rest
//! `z_k = P`: the elastic shell is what the wall relaxes to. A cycle loses energy at every rate, which is the
//! hysteresis.

use super::Shell;

/// Relaxation times, s: from a breath's start to a treatment.
const TIMES: [f64; 5] = [0.1, 1.0, 10.0, 100.0, 1000.0];

/// How the pressure of a wall follows from that of the elastic one: `gain P - relaxed`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// `1 + c` times the number of elements.
    pub(crate) gain: f64,
    /// `c sum z_k`, Pa.
    pub(crate) relaxed: f64,
}

impl Wall {
    pub const ELASTIC: Self = Self { gain: 1.0, relaxed: 0.0 };
}

/// The elements of one bladder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relaxation {
    /// `z_k`, Pa.
    followed: [f64; TIMES.len()],
}

impl Relaxation {
    /// Of a shell that has had this inner stretch for long.
    pub fn at_rest(shell: &Shell, inner_stretch: f64) -> Self {
        Self { followed: [shell.pressure(inner_stretch); TIMES.len()] }
    }

    /// The wall with creep of `creep` in each decade.
    pub fn wall(&self, creep: f64) -> Wall {
        Wall { gain: 1.0 + creep * TIMES.len() as f64, relaxed: creep * self.followed.iter().sum::<f64>() }
    }

    /// `h` seconds at this inner stretch.
    pub fn advance(&mut self, shell: &Shell, inner_stretch: f64, h: f64) {
        let pressure = shell.pressure(inner_stretch);
        for (followed, time) in self.followed.iter_mut().zip(TIMES) {
            *followed -= (pressure - *followed) * libm::expm1(-h / time);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pressure of the wall over the elastic pressure.
    fn surplus(shell: &Shell, relaxation: &Relaxation, stretch: f64, creep: f64) -> f64 {
        let wall = relaxation.wall(creep);
        (wall.gain * shell.pressure(stretch) - wall.relaxed) / shell.pressure(stretch) - 1.0
    }

    #[test]
    fn after_a_step_the_pressure_falls_by_the_creep_in_each_decade() {
        let shell = Shell::rig();
        let step = shell.pressure(1.3) - shell.pressure(1.1);
        let part = step / shell.pressure(1.3);
        let mut relaxation = Relaxation::at_rest(&shell, 1.1);
        let mut after = Vec::new();
        for millisecond in 1..=100_000 {
            relaxation.advance(&shell, 1.3, 1e-3);
            if [1_000, 10_000, 100_000].contains(&millisecond) {
                after.push(surplus(&shell, &relaxation, 1.3, 0.03));
            }
        }
        for pair in after.windows(2) {
            let fall = (pair[0] - pair[1]) / part;
            assert!((fall - 0.03).abs() < 0.004, "{fall}: {after:?}");
        }
    }

    #[test]
    fn a_wall_at_rest_is_the_elastic_one_and_without_creep_always_is() {
        let shell = Shell::rig();
        let mut relaxation = Relaxation::at_rest(&shell, 1.2);
        assert!(surplus(&shell, &relaxation, 1.2, 0.05).abs() < 1e-12);
        relaxation.advance(&shell, 1.5, 0.3);
        assert_eq!(relaxation.wall(0.0), Wall::ELASTIC);
    }

    #[test]
    fn a_cycle_of_stretch_loses_energy_at_every_rate() {
        let shell = Shell::rig();
        for period in [0.5, 4.0, 40.0] {
            let mut relaxation = Relaxation::at_rest(&shell, 1.2);
            let (mut lost, mut turned) = (0.0, 0.0);
            let steps = 4_000;
            let at =
                |k: i32| 1.2 + 0.05 * libm::sin(core::f64::consts::TAU * f64::from(k) / f64::from(steps));
            // The second cycle: the first one starts from rest.
            for k in 0..2 * steps {
                relaxation.advance(&shell, at(k), period / f64::from(steps));
                let volume = shell.cavity_volume(at(k + 1)) - shell.cavity_volume(at(k));
                let middle = 0.5 * (at(k) + at(k + 1));
                let wall = relaxation.wall(0.03);
                if k >= steps {
                    lost += (wall.gain * shell.pressure(middle) - wall.relaxed) * volume;
                    turned += 0.5 * (shell.pressure(1.25) - shell.pressure(1.15)) * volume.abs() * 0.5;
                }
            }
            let part = lost / turned;
            assert!((0.02..0.2).contains(&part), "{period} s: {part}");
        }
    }
}
