//! Depth doses and profiles of a machine on the phantoms.

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;

use super::comparison::MonteCarloError;
use super::phantom::{DEPTHS, Phantom, Setting, VOXEL_MM};
use super::reference::Reference;
use crate::dose::{Anatomy, BixelSpec, DoseEngine, DoseError, DoseParams, EngineName, Machine, MachineFile};

/// Half of the phantom's width, voxels.
const HALF: usize = 48;
/// From the source to the isocentre, as in the reference, mm.
const SAD_MM: f64 = 1000.0;
/// From the skin to the isocentre, mm.
const SKIN_MM: f64 = 100.0;
/// Hounsfield units of a phantom for each density: its table reads tenths of a thousandth.
const HU_PER_DENSITY: f64 = 1e4;
/// Full width of the edge of the reference's fields, mm: sharp. The samples of pencil beams are 0.5 mm apart and do not
/// resolve a sharper edge than the first.
const PENUMBRA_MM: [f64; 2] = [1.5, 0.1];

/// Dose on the axis and at the places of the reference's profiles, in its unit and order.
#[derive(Clone, Debug, PartialEq)]
pub struct Computed {
    /// By depth.
    pub axis: Vec<f64>,
    /// By profile, from the axis outwards.
    pub profiles: Vec<Vec<f64>>,
}

/// The doses of a machine at the places of a reference.
///
/// # Errors
/// The machine has another distance from the source to the isocentre than the reference, or no point kernels.
pub fn computed(
    machine: &Machine,
    setting: Setting,
    engine: EngineName,
    reference: &Reference,
) -> Result<Computed, MonteCarloError> {
    let found = machine.file().sad_mm;
    if (found - SAD_MM).abs() > 0.5 {
        return Err(MonteCarloError::Distance { found, expected: SAD_MM });
    }
    let kernels = machine.file().superposition.as_ref().ok_or(DoseError::NoKernels)?;
    let scale = 1e3 / kernels.gray_per_mev_g;
    let engine = ready(setting, engine, machine)?;
    let grid = engine.params().grid;
    let half = (reference.half_mm / VOXEL_MM).round() as usize;
    let strip = HALF - half..HALF + half;
    let depth = |depth_mm: f64| (depth_mm / VOXEL_MM) as usize;
    let reach = reference.profiles.iter().map(|profile| profile.dose.len()).max().unwrap_or(0);
    let is_read = |voxel: &usize| {
        let [x, y, z] = grid.voxel(*voxel);
        let is_lateral = (HALF - reach.min(HALF)..HALF + reach).contains(&x)
            && reference.profiles.iter().any(|profile| depth(profile.depth_mm) == y);
        strip.contains(&z) && (strip.contains(&x) || is_lateral)
    };
    let rows: Vec<u32> = (0..grid.len()).filter(is_read).map(|voxel| voxel as u32).collect();
    let dose = engine.within(&rows).weighted_bixels(0.0, &[[0.0; 2]], &[1.0])?;
    let mean = |xs: &[usize], y: usize| {
        let places = xs.iter().flat_map(|x| strip.clone().map(move |z| [*x, y, z]));
        let sum: f64 = places.map(|place| f64::from(dose[grid.index(place)])).sum();
        scale * sum / (xs.len() * strip.len()) as f64
    };
    let across: Vec<usize> = strip.clone().collect();
    let mut profiles = Vec::with_capacity(reference.profiles.len());
    for profile in &reference.profiles {
        let y = depth(profile.depth_mm);
        profiles.push((0..profile.dose.len()).map(|i| mean(&[HALF + i, HALF - 1 - i], y)).collect());
    }
    Ok(Computed { axis: (0..DEPTHS).map(|y| mean(&across, y)).collect(), profiles })
}

/// A phantom: x across, y along the beam from the skin at 900 mm, z.
fn ready(
    Setting { phantom, field_cm }: Setting,
    name: EngineName,
    machine: &Machine,
) -> Result<DoseEngine, MonteCarloError> {
    let side = 0.5 - HALF as f64;
    let grid = Grid {
        counts: [2 * HALF, DEPTHS, 2 * HALF],
        spacing_mm: [VOXEL_MM; 3],
        origin_mm: [side * VOXEL_MM, 0.5 * VOXEL_MM - SKIN_MM, side * VOXEL_MM],
    };
    let all = Mask::from_fn(grid.len(), |_| true);
    let target =
        Mask::from_fn(grid.len(), |voxel| grid.centre_mm(grid.voxel(voxel)).iter().all(|mm| mm.abs() < 4.0));
    let hu = hounsfield(phantom, &grid);
    let anatomy = Anatomy { grid, hu: &hu, external: &all, target: &target, isocentre_mm: [0.0; 3] };
    let params = DoseParams {
        grid,
        bixels: BixelSpec::of_width(10.0 * f64::from(field_cm)),
        engine: name,
        ..DoseParams::over(&grid, VOXEL_MM)
    };
    Ok(DoseEngine::new(&anatomy, sharp(machine, name)?, params)?)
}

fn hounsfield(phantom: Phantom, grid: &Grid) -> Vec<i16> {
    let of = |voxel: usize| {
        let [x, y, z] = grid.centre_mm(grid.voxel(voxel));
        (HU_PER_DENSITY * phantom.density(y + SKIN_MM, [x, z])).round() as i16
    };
    (0..grid.len()).map(of).collect()
}

/// The machine with the sharp field edges of the reference, and the densities of the phantoms.
fn sharp(machine: &Machine, name: EngineName) -> Result<Machine, MonteCarloError> {
    let [pencil, superposition] = PENUMBRA_MM;
    let file = MachineFile {
        penumbra_fwhm_at_iso_mm: if name == EngineName::Pencil { pencil } else { superposition },
        hu_to_density: vec![[0.0, 0.0], [3.0 * HU_PER_DENSITY, 3.0]],
        ..machine.file().clone()
    };
    Ok(Machine::new(file)?)
}
