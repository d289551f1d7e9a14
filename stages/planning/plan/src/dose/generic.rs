//! The machine that comes with the project: a generic 6 MV beam, made of formulas.
//!
//! It is no machine's measurement. Its dose in water has three parts, each a depth dose
//! `beta / (beta - m) * (exp(-m d) - exp(-beta d))` times a share of the whole and the pencil kernel
//! `exp(-r / lambda) / (2 pi lambda r)`, the radial form of Ahnesjo, Saxner and Trepp, Med. Phys. 19 (1992) 263:
//!
//! | part | beta, 1/mm | share | lambda, mm |
//! | --- | --- | --- | --- |
//! | primary: electrons that photons of the source set free | 0.28 | 1 | 2.5 |
//! | scatter from nearby | 0.04 | 0.05 | 8 |
//! | scatter from afar | 0.006 | 0.5 | 50 |
//!
//! with `m` = 0.0051 per mm. The numbers are chosen so that fields in water lie where 6 MV beams are published to lie:
//! `tests/dose/water.rs` holds depth of maximum, depth dose, tissue-phantom ratio and output factors. `lambda` is the
//! distance at 100 mm depth, seen on the isocentre plane, so it grows as the skin comes nearer to the source. One unit of
//! weight on all of a 100 mm field gives 1 Gy at the isocentre, 100 mm deep in water with the skin at 900 mm.

use super::collimator::Collimator;
use super::machine::{COMPONENTS, MachineFile, PencilsOf};

const M_PER_MM: f64 = 0.0051;
const BETAS_PER_MM: [f64; COMPONENTS] = [0.28, 0.04, 0.006];
const SHARES: [f64; COMPONENTS] = [1.0, 0.05, 0.5];
const LAMBDAS_MM: [f64; COMPONENTS] = [2.5, 8.0, 50.0];
const SAD_MM: f64 = 1000.0;
/// Depth at which the lambdas are given, and at which dose is 1 Gy per unit weight.
const REFERENCE_DEPTH_MM: f64 = 100.0;
/// Dose of the reference field before it is brought to 1 Gy per unit weight; `water.rs` holds the outcome.
const REFERENCE_DOSE: f64 = 0.76065;
/// Side of the cell of the kernels' first value, at their pole: the distance of samples in `kernel.rs`.
const CELL_MM: f64 = 0.5;

impl MachineFile {
    /// What the project's machine file holds beside the section `superposition`; [`Machine::shipped`] reads that file.
    ///
    /// [`Machine::shipped`]: super::Machine::shipped
    pub fn generic_6mv() -> Self {
        let kernel_pos_mm = positions_mm();
        let ssd_mm: Vec<f64> = (0..=20).map(|step| 500.0 + 25.0 * f64::from(step)).collect();
        let kernels = |component: usize| {
            let at = |&ssd: &f64| {
                let lambda = LAMBDAS_MM[component] * SAD_MM / (ssd + REFERENCE_DEPTH_MM);
                kernel(&kernel_pos_mm, lambda, SHARES[component] / REFERENCE_DOSE)
            };
            ssd_mm.iter().map(at).collect()
        };
        Self {
            provenance: "generic 6 MV photons of stillpoint, made of formulas; licence as the project's"
                .to_owned(),
            energy_mv: 6.0,
            sad_mm: SAD_MM,
            scd_mm: 500.0,
            m_per_mm: M_PER_MM,
            betas_per_mm: BETAS_PER_MM.to_vec(),
            penumbra_fwhm_at_iso_mm: 5.0,
            // The horns of a flattened beam: 5 % at 150 mm.
            primary_fluence_r_mm_value: (0..=20)
                .map(|step| 10.0 * f64::from(step))
                .map(|r| [r, short(1.0 + 0.05 * r * r / (150.0 * 150.0))])
                .collect(),
            kernels_per_mm2: (0..COMPONENTS).map(kernels).collect(),
            kernel_pos_mm,
            ssd_mm,
            // Thomas, Br. J. Radiol. 72 (1999) 781: 1 + HU/1000 up to 100, then 1.052 + 0.00048 HU.
            hu_to_density: vec![[-1000.0, 0.0], [100.0, 1.1], [3000.0, 2.492]],
            collimator: Some(Collimator::generic()),
            superposition: None,
            free_angles: None,
            arc: None,
            pencils_of: PencilsOf::Machine,
        }
    }
}

/// Every half millimetre near the pole, then ever wider.
fn positions_mm() -> Vec<f64> {
    let mut positions = vec![0.0];
    for (end, step) in [(12.0, 0.5), (40.0, 2.0), (180.0, 5.0)] {
        while positions.last().is_some_and(|&last| last < end) {
            positions.push(positions[positions.len() - 1] + step);
        }
    }
    positions
}

/// `share * exp(-r / lambda) / (2 pi lambda r)`, with a value at its pole such that the sum over cells is the integral.
fn kernel(positions_mm: &[f64], lambda_mm: f64, share: f64) -> Vec<f64> {
    let at = |r: f64| share * libm::exp(-r / lambda_mm) / (core::f64::consts::TAU * lambda_mm * r);
    let mut values: Vec<f64> =
        positions_mm.iter().map(|&r| if r > 0.0 { short(at(r)) } else { 0.0 }).collect();
    let end = positions_mm[positions_mm.len() - 1];
    let cells = (end / CELL_MM) as i64;
    // The four quarters around the pole are alike.
    let mut quarter = 0.0;
    for x in 1..=cells {
        for z in 0..=cells {
            let r = CELL_MM * libm::hypot(x as f64, z as f64);
            quarter += super::kernel::at_distance(positions_mm, &values, r);
        }
    }
    let integral = share * (1.0 - libm::exp(-end / lambda_mm));
    values[0] = short(integral / (CELL_MM * CELL_MM) - 4.0 * quarter);
    values
}

/// The number to seven digits, which keeps the file small.
fn short(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}
