//! TERMA over the depth in water: the energy that photons of the source lose per mass, for a fluence of one photon/cm2.
//!
//! `sum over E of p(E) E mu(E)/rho exp(-mu(E) d)`, so the spectrum hardens with depth without further assumptions. The part
//! that charged particles carry is the primary, the rest the scatter.

use super::section::Superposition;

/// Distance between depths, mm.
const STEP_MM: f64 = 1.0;
/// Deepest, mm of water.
const DEEPEST_MM: f64 = 1500.0;

/// TERMA by depth in water.
#[derive(Clone, Debug)]
pub(super) struct Terma {
    /// Primary and scatter, MeV/g, at each depth.
    parts: Vec<[f32; 2]>,
    /// Where the mean energy lies between those of the two kernels' spectra, from 0 to 1, at each depth.
    hardening: Vec<f32>,
}

impl Terma {
    pub fn new(section: &Superposition) -> Self {
        let steps = (DEEPEST_MM / STEP_MM) as usize + 2;
        let ends: Vec<f64> = section.primary.depths_mm.iter().map(|d| mean_energy(section, *d)).collect();
        let span = ends[ends.len() - 1] - ends[0];
        let hardening = |depth_mm: f64| match span > 0.0 {
            true => ((mean_energy(section, depth_mm) - ends[0]) / span).clamp(0.0, 1.0),
            false => 0.0,
        };
        let depths = || (0..steps).map(|step| step as f64 * STEP_MM);
        Self {
            parts: depths().map(|d| parts(section, d).map(|part| part as f32)).collect(),
            hardening: depths().map(|d| hardening(d) as f32).collect(),
        }
    }

    /// Primary and scatter at a depth, MeV/g.
    pub fn at(&self, depth_mm: f64) -> [f32; 2] {
        let (low, part) = between(depth_mm);
        let [a, b] = [self.parts[low], self.parts[low + 1]];
        [0, 1].map(|i| a[i] + part * (b[i] - a[i]))
    }

    /// Where the mean energy lies between those of the two kernels' spectra.
    pub fn hardening(&self, depth_mm: f64) -> f32 {
        let (low, part) = between(depth_mm);
        self.hardening[low] + part * (self.hardening[low + 1] - self.hardening[low])
    }
}

fn between(depth_mm: f64) -> (usize, f32) {
    let place = (depth_mm / STEP_MM).clamp(0.0, DEEPEST_MM / STEP_MM);
    (place as usize, (place - place.floor()) as f32)
}

fn parts(section: &Superposition, depth_mm: f64) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for (i, &mu) in section.attenuation_per_mm.iter().enumerate() {
        // 1/mm at 1 g/cm3 is 10 cm2/g.
        let terma = section.photons[i] * section.energy_mev[i] * 10.0 * mu * libm::exp(-mu * depth_mm);
        sums[0] += terma * section.charged_share[i];
        sums[1] += terma * (1.0 - section.charged_share[i]);
    }
    sums
}

/// Mean energy of the photons at a depth, MeV.
fn mean_energy(section: &Superposition, depth_mm: f64) -> f64 {
    let (mut energy, mut photons) = (0.0, 0.0);
    for (i, &mu) in section.attenuation_per_mm.iter().enumerate() {
        let left = section.photons[i] * libm::exp(-mu * depth_mm);
        energy += left * section.energy_mev[i];
        photons += left;
    }
    energy / photons
}
