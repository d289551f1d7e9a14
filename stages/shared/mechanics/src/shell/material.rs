//! The material of a shell: two moduli and two radii, checked.

/// Why a shell cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ShellError {
    /// A modulus that no rubber has.
    #[error("modulus {name} is {value} Pa; give a finite one, C1 above 0 and C2 at least 0")]
    Modulus {
        /// `C1` or `C2`.
        name: &'static str,
        value: f64,
    },
    /// Radii that enclose no wall.
    #[error("radii are {inner} m inside and {outer} m outside; give finite ones, 0 < inside < outside")]
    Radii {
        /// Inner radius at rest.
        inner: f64,
        /// Outer radius at rest.
        outer: f64,
    },
}

/// A spherical shell at rest. Its energy is `W = C1/2 (I1 - 3) + C2/2 (I2 - 3)` (2.24), so the shear modulus is
/// `C1 + C2`: both are twice what many handbooks print.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shell {
    pub(crate) c1: f64,
    pub(crate) c2: f64,
    pub(crate) inner: f64,
    pub(crate) outer: f64,
    /// `(R_i / R_o)^3`.
    pub(crate) hollow: f64,
}

impl Shell {
    /// A shell of moduli `c1`, `c2` (Pa) and radii at rest `inner`, `outer` (m).
    ///
    /// # Errors
    /// [`ShellError`] names what is not finite or out of range.
    pub fn new(c1: f64, c2: f64, inner: f64, outer: f64) -> Result<Self, ShellError> {
        if !(c1.is_finite() && c1 > 0.0) {
            return Err(ShellError::Modulus { name: "C1", value: c1 });
        }
        if !(c2.is_finite() && c2 >= 0.0) {
            return Err(ShellError::Modulus { name: "C2", value: c2 });
        }
        if !(outer.is_finite() && 0.0 < inner && inner < outer) {
            return Err(ShellError::Radii { inner, outer });
        }
        let ratio = inner / outer;
        Ok(Self { c1, c2, inner, outer, hollow: ratio * ratio * ratio })
    }

    /// The bladder of the rigs: 0.234 MPa of shear modulus, radii 50 and 53 mm, without a limit point (SCIENCE C4).
    pub fn rig() -> Self {
        let (inner, outer) = (0.050, 0.053);
        let ratio: f64 = inner / outer;
        Self { c1: 1.8e5, c2: 5.4e4, inner, outer, hollow: ratio * ratio * ratio }
    }

    /// Inner radius at rest, m.
    pub fn inner_radius(&self) -> f64 {
        self.inner
    }

    /// Outer radius at rest, m.
    pub fn outer_radius(&self) -> f64 {
        self.outer
    }

    /// Young's modulus at rest, Pa.
    pub fn young(&self) -> f64 {
        3.0 * (self.c1 + self.c2)
    }

    /// Energy per volume of wall where the hoop stretch is `stretch`, J/m^3 (2.24)-(2.27).
    pub fn energy_density(&self, stretch: f64) -> f64 {
        let (i1, i2) = super::kinematics::invariants(stretch);
        0.5 * self.c1 * (i1 - 3.0) + 0.5 * self.c2 * (i2 - 3.0)
    }

    /// Elastic energy of the wall at an inner stretch, J: the work that the air does on it from rest.
    ///
    /// `U = int P dV`, by Gauss's rule with eight points on 16 parts of the way, as P is smooth.
    pub fn energy(&self, inner_stretch: f64) -> f64 {
        const PARTS: u32 = 16;
        let part = (inner_stretch - 1.0) / f64::from(PARTS);
        let volume = 4.0 * core::f64::consts::PI * self.inner * self.inner * self.inner;
        let mut sum = 0.0;
        for i in 0..PARTS {
            let middle = 1.0 + (f64::from(i) + 0.5) * part;
            for (node, weight) in GAUSS {
                for stretch in [middle - 0.5 * part * node, middle + 0.5 * part * node] {
                    sum += weight * self.pressure(stretch) * stretch * stretch;
                }
            }
        }
        0.5 * part * volume * sum
    }
}

/// Nodes and weights of Gauss's rule with eight points on -1 to 1; each node stands for itself and its mirror image.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_that_cannot_be_is_refused_with_its_numbers() {
        for (c1, c2, inner, outer, statement) in [
            (0.0, 1.0, 0.05, 0.06, "modulus C1 is 0 Pa"),
            (f64::NAN, 1.0, 0.05, 0.06, "modulus C1 is NaN Pa"),
            (1.0, -2.0, 0.05, 0.06, "modulus C2 is -2 Pa"),
            (1.0, 1.0, 0.06, 0.06, "radii are 0.06 m inside and 0.06 m outside"),
            (1.0, 1.0, f64::NAN, 0.06, "radii are NaN m inside"),
            (1.0, 1.0, 0.05, f64::INFINITY, "inf m outside"),
        ] {
            let message = Shell::new(c1, c2, inner, outer).unwrap_err().to_string();
            assert!(message.contains(statement), "{message}");
        }
    }

    #[test]
    fn the_rigs_shell_is_a_sound_one() {
        assert_eq!(Shell::new(1.8e5, 5.4e4, 0.050, 0.053), Ok(Shell::rig()));
    }

    /// The energy by another route: its density summed over the wall in 20,000 layers of equal volume at rest.
    #[test]
    fn the_airs_work_is_the_energy_of_the_wall() {
        let shell = Shell::rig();
        for stretch in [0.9, 1.02, 1.3, 2.0] {
            let cube = |x: f64| x * x * x;
            let (inside, outside) = (cube(shell.inner), cube(shell.outer));
            let layers = 20_000;
            let volume = 4.0 / 3.0 * core::f64::consts::PI * (outside - inside) / f64::from(layers);
            let swell = inside * (cube(stretch) - 1.0);
            let sum: f64 = (0..layers)
                .map(|i| {
                    let at_rest = inside + (outside - inside) * (f64::from(i) + 0.5) / f64::from(layers);
                    volume * shell.energy_density(libm::cbrt((at_rest + swell) / at_rest))
                })
                .sum();
            let energy = shell.energy(stretch);
            assert!((energy - sum).abs() < 1e-7 * sum, "{stretch}: {energy} {sum}");
        }
    }
}
