//! The dose of a spectrum at the places of a curve.

use super::curve::{Across, Curve, Kind, Setup};
use super::spectrum::Spectra;
use crate::dose::Superposition;
use crate::dose::superposition::water::{NODE_MM, Response, TankField, responses};

/// A machine as the fit sees it.
pub(super) struct Tank<'a> {
    section: &'a Superposition,
    spectra: &'a Spectra<'a>,
    sad_mm: f64,
    /// TERMA of one photon of each energy, by depth: primary and scatter, MeV/g for a fluence of 1/cm2.
    terma: Vec<Vec<[f64; 2]>>,
}

/// What profiles determine: width of the penumbra, mm, and fluence over the distance from the axis.
pub(super) struct Beam<'a> {
    pub penumbra_mm: f64,
    pub fluence: &'a dyn Fn(f64) -> f64,
}

/// Depths of the table, mm of water: the deepest place and the farthest kernel.
const DEEPEST_MM: f64 = 2000.0;

impl<'a> Tank<'a> {
    pub fn new(section: &'a Superposition, spectra: &'a Spectra<'a>, sad_mm: f64) -> Self {
        let terma = (0..=(DEEPEST_MM / NODE_MM) as usize).map(|node| {
            let depth_mm = node as f64 * NODE_MM;
            let of = |(i, mu): (usize, &f64)| {
                // 1/mm at 1 g/cm3 is 10 cm2/g.
                let terma = section.energy_mev[i] * 10.0 * mu * libm::exp(-mu * depth_mm);
                [terma * section.charged_share[i], terma * (1.0 - section.charged_share[i])]
            };
            section.attenuation_per_mm.iter().enumerate().map(of).collect()
        });
        Self { section, spectra, sad_mm, terma: terma.collect() }
    }

    pub fn sad_mm(&self) -> f64 {
        self.sad_mm
    }

    /// The responses at places `[x, depth, z]`, mm.
    pub fn responses(&self, setup: Setup, beam: &Beam<'_>, places: &[[f64; 3]]) -> Vec<Response> {
        let field = TankField {
            sides_mm: setup.field_mm,
            ssd_mm: setup.ssd_mm,
            sad_mm: self.sad_mm,
            penumbra_mm: beam.penumbra_mm,
            fluence: beam.fluence,
        };
        responses(self.section, &field, places)
    }

    /// Doses of a spectrum, MeV/g for each photon/cm2 on the isocentre plane.
    pub fn doses(&self, responses: &[Response], photons: &[f64]) -> Vec<f64> {
        let nodes = responses.iter().map(|response| response.scatter.len()).max().unwrap_or(0);
        let sum = |node: &Vec<[f64; 2]>| {
            node.iter().zip(photons).fold([0.0, 0.0], |[p, s], ([a, b], n)| [p + a * n, s + b * n])
        };
        let terma: Vec<[f64; 2]> = self.terma.iter().take(nodes).map(sum).collect();
        let depths = &self.section.primary.depths_mm;
        let ends = [depths[0], depths[depths.len() - 1]].map(|depth| self.spectra.position(photons, depth));
        let of = |response: &Response| {
            // The machine that is written has kernels at these two ends, and none beyond.
            let position = self.spectra.position(photons, response.depth_mm);
            let position = position.max(ends[0].min(ends[1])).min(ends[0].max(ends[1]));
            let mut dose = 0.0;
            for (node, [primary, scatter]) in terma.iter().enumerate().take(response.scatter.len()) {
                let [first, last] = [response.primary[0][node], response.primary[1][node]];
                dose += primary * (first + position * (last - first)) + scatter * response.scatter[node];
            }
            dose
        };
        responses.iter().map(of).collect()
    }

    /// Doses of a spectrum at places of a field.
    pub fn doses_at(&self, setup: Setup, beam: &Beam<'_>, places: &[[f64; 3]], photons: &[f64]) -> Vec<f64> {
        self.doses(&self.responses(setup, beam, places), photons)
    }
}

/// The places of a curve that is moved so that its middle is on the axis.
pub(super) fn places(curve: &Curve, shift_mm: f64) -> Vec<[f64; 3]> {
    curve.points.iter().map(|point| place(curve.kind, point.at_mm - shift_mm)).collect()
}

/// A place of a curve, as x, depth and z of the beam.
pub(super) fn place(kind: Kind, at_mm: f64) -> [f64; 3] {
    match kind {
        Kind::DepthDose => [0.0, at_mm, 0.0],
        Kind::Profile { across: Across::X, depth_mm } => [at_mm, depth_mm, 0.0],
        Kind::Profile { across: Across::Y, depth_mm } => [0.0, depth_mm, at_mm],
    }
}
