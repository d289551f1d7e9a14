//! Spectrum and kernels as the machine file writes them.

use serde::{Deserialize, Serialize};

use crate::dose::machine::{MachineError, in_range, rising, size};

/// What a superposition knows of a machine: its spectrum, and how the energy of first interactions spreads in water.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Superposition {
    /// Where the numbers come from and under which licence they may be passed on.
    pub provenance: String,
    /// Gray per unit weight and MeV/g: dose of a field of 100 mm at the isocentre, 100 mm deep in water, is 1 Gy.
    pub gray_per_mev_g: f64,
    /// Photon energies, rising, MeV.
    pub energy_mev: Vec<f64>,
    /// Photons of each energy; their sum is 1.
    pub photons: Vec<f64>,
    /// Attenuation in water at each energy, 1/mm.
    pub attenuation_per_mm: Vec<f64>,
    /// Part of the energy of first interactions that charged particles carry, at each energy.
    pub charged_share: Vec<f64>,
    /// Energy that charged particles carry, for the spectra at two depths.
    pub primary: PointKernels,
    /// Energy that scattered photons carry, for one spectrum.
    pub scatter: PointKernels,
}

/// Point kernels in water, by rings of directions around the beam and shells of distance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointKernels {
    /// Edges of the rings, from 0 to 180 degrees.
    pub edges_deg: Vec<f64>,
    /// Cones in each ring.
    pub cones: Vec<usize>,
    /// Width of a shell, mm.
    pub shell_mm: f64,
    /// Depths in water whose spectra the kernels belong to, mm.
    pub depths_mm: Vec<f64>,
    /// Part of the energy at each depth, in each ring and shell.
    pub energy: Vec<Vec<Vec<f64>>>,
}

/// Energies that a spectrum may have.
const ENERGIES: std::ops::RangeInclusive<usize> = 1..=1000;
/// Farthest that a kernel may reach, mm.
const FARTHEST_MM: f64 = 1000.0;

impl Superposition {
    pub(in crate::dose) fn check(&self) -> Result<(), MachineError> {
        let scale = 1e-6..=1e9;
        in_range("superposition.gray_per_mev_g", self.gray_per_mev_g, scale, "from 0.000001 to 1000000000")?;
        size("superposition.energy_mev", self.energy_mev.len(), ENERGIES)?;
        rising("superposition.energy_mev", &self.energy_mev)?;
        let energies = self.energy_mev.len();
        let tables = [
            ("superposition.photons", &self.photons, 0.0..=1.0, "from 0 to 1"),
            (
                "superposition.attenuation_per_mm",
                &self.attenuation_per_mm,
                1e-5..=1.0,
                "from 0.00001 to 1 per mm",
            ),
            ("superposition.charged_share", &self.charged_share, 0.0..=1.0, "from 0 to 1"),
        ];
        for (field, table, range, must) in tables {
            size(field, table.len(), energies..=energies)?;
            table.iter().try_for_each(|value| in_range(field, *value, range.clone(), must))?;
        }
        for &energy in &self.energy_mev {
            in_range("superposition.energy_mev", energy, 0.01..=100.0, "from 0.01 to 100 MeV")?;
        }
        let photons: f64 = self.photons.iter().sum();
        in_range("superposition.photons", photons, 0.99..=1.01, "numbers whose sum is 1")?;
        self.primary.check(["superposition.primary", "superposition.primary.energy"], 2)?;
        self.scatter.check(["superposition.scatter", "superposition.scatter.energy"], 1)
    }
}

impl PointKernels {
    /// Distance that the shells reach, mm.
    pub(super) fn shells_mm(&self) -> f64 {
        self.shell_mm * self.energy[0][0].len() as f64
    }

    fn check(&self, [of, energy]: [&'static str; 2], depths: usize) -> Result<(), MachineError> {
        rising(of, &self.edges_deg)?;
        size(of, self.edges_deg.len(), 2..=100)?;
        let (first, last) = (self.edges_deg[0], self.edges_deg[self.edges_deg.len() - 1]);
        in_range(of, first, 0.0..=0.0, "edges of rings that begin at 0 degrees")?;
        in_range(of, last, 180.0..=180.0, "edges of rings that end at 180 degrees")?;
        let rings = self.edges_deg.len() - 1;
        size(of, self.cones.len(), rings..=rings)?;
        for &cones in &self.cones {
            in_range(of, cones as f64, 1.0..=100.0, "1 to 100 cones in a ring")?;
        }
        in_range(of, self.shell_mm, 0.1..=50.0, "shells from 0.1 to 50 mm wide")?;
        rising(of, &self.depths_mm)?;
        size(of, self.depths_mm.len(), depths..=depths)?;
        size(energy, self.energy.len(), depths..=depths)?;
        for of_depth in &self.energy {
            size(energy, of_depth.len(), rings..=rings)?;
            let shells = of_depth[0].len();
            size(energy, shells, 1..=1000)?;
            in_range(energy, shells as f64 * self.shell_mm, 1.0..=FARTHEST_MM, "shells out to 1 to 1000 mm")?;
            for ring in of_depth {
                size(energy, ring.len(), shells..=shells)?;
                ring.iter().try_for_each(|part| in_range(energy, *part, 0.0..=1.0, "from 0 to 1"))?;
            }
            let sum: f64 = of_depth.iter().flatten().sum();
            in_range(energy, sum, 0.1..=1.01, "parts whose sum is from 0.1 to 1.01")?;
        }
        Ok(())
    }
}
