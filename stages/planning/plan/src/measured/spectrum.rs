//! The spectra that a fit may find: the start's photons times a smooth positive factor over the energy.
//!
//! `photons(E) = start(E) exp(sum over k of p_k h_k(ln E))`, with hat functions `h_k` on knots that are even in `ln E`. So
//! photons are never negative, and few numbers describe what depth doses can tell.

use crate::dose::Superposition;

/// Numbers of a spectrum.
pub(super) const KNOTS: usize = 5;
/// Positions of the mean energy between those of the two kernels (0 and 1) that the kernels serve.
pub(super) const SERVED: [f64; 2] = [-0.6, 1.6];

/// The photons of the start, made ready.
pub(super) struct Spectra<'a> {
    section: &'a Superposition,
    /// By energy: the lower knot and the part of the upper one.
    places: Vec<(usize, f64)>,
    /// Mean energies of the start at the depths of its primary kernels, MeV.
    pub ends: [f64; 2],
}

impl<'a> Spectra<'a> {
    pub fn new(section: &'a Superposition) -> Self {
        let energies = &section.energy_mev;
        let (first, last) = (libm::log(energies[0]), libm::log(energies[energies.len() - 1]));
        let span = (last - first).max(1e-9);
        let place = |energy: &f64| {
            let place = (libm::log(*energy) - first) / span * (KNOTS - 1) as f64;
            let low = (place as usize).min(KNOTS - 2);
            (low, place - low as f64)
        };
        let depths = &section.primary.depths_mm;
        let ends =
            [depths[0], depths[depths.len() - 1]].map(|depth| mean_energy(section, &section.photons, depth));
        Self { section, places: energies.iter().map(place).collect(), ends }
    }

    /// Photons of each energy; their sum is 1.
    pub fn photons(&self, numbers: &[f64]) -> Vec<f64> {
        let factor =
            |(low, part): &(usize, f64)| libm::exp(numbers[*low] * (1.0 - part) + numbers[low + 1] * part);
        let photons: Vec<f64> = self
            .places
            .iter()
            .zip(&self.section.photons)
            .map(|(place, start)| start * factor(place))
            .collect();
        let sum: f64 = photons.iter().sum();
        photons.into_iter().map(|part| part / sum).collect()
    }

    /// Where the mean energy at a depth is between those of the two kernels of the start.
    pub fn position(&self, photons: &[f64], depth_mm: f64) -> f64 {
        let [first, last] = self.ends;
        let span = last - first;
        if span > 0.0 { (mean_energy(self.section, photons, depth_mm) - first) / span } else { 0.0 }
    }

    /// The section with these photons. Its primary kernels are those of the start, moved along their difference to the mean
    /// energies of the new spectrum.
    pub fn section(&self, photons: Vec<f64>, provenance: &str) -> Superposition {
        let mut section = self.section.clone();
        let depths = section.primary.depths_mm.clone();
        let last = depths.len() - 1;
        let [first_kernel, last_kernel] =
            [&self.section.primary.energy[0], &self.section.primary.energy[last]];
        for (place, depth) in depths.iter().enumerate() {
            let position = self.position(&photons, *depth);
            for (ring, shells) in section.primary.energy[place].iter_mut().enumerate() {
                for (shell, energy) in shells.iter_mut().enumerate() {
                    let (a, b) = (first_kernel[ring][shell], last_kernel[ring][shell]);
                    *energy = short((a + position * (b - a)).max(0.0));
                }
            }
        }
        section.photons = photons.into_iter().map(short).collect();
        section.provenance = format!("{provenance} From: {}", self.section.provenance);
        section
    }
}

/// Mean energy of the photons at a depth in water, MeV.
pub(super) fn mean_energy(section: &Superposition, photons: &[f64], depth_mm: f64) -> f64 {
    let (mut energy, mut sum) = (0.0, 0.0);
    for (i, mu) in section.attenuation_per_mm.iter().enumerate() {
        let left = photons[i] * libm::exp(-mu * depth_mm);
        energy += left * section.energy_mev[i];
        sum += left;
    }
    energy / sum
}

/// The number to six digits, which keeps the file small.
fn short(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}
