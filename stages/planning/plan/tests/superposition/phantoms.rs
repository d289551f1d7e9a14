//! Superposition against profiles of a Monte Carlo program.

use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;
use stillpoint_plan::dose::{Anatomy, BixelSpec, DoseEngine, DoseParams, EngineName, Machine, MachineFile};

/// Half of the phantom's width, voxels.
const HALF: usize = 48;
pub const DEPTHS: usize = 120;
pub const VOXEL_MM: f64 = 2.5;

/// A file of `monte_carlo`.
#[derive(Deserialize)]
pub struct Reference {
    unit: String,
    axis_square_half_cm: f64,
    pub axis: Vec<f64>,
    pub axis_sigma: Vec<f64>,
    pub lateral: BTreeMap<String, Lateral>,
}

#[derive(Deserialize)]
pub struct Lateral {
    pub dose: Vec<f64>,
    pub sigma: Vec<f64>,
}

pub fn reference(phantom: char, field_cm: u32) -> Reference {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join(format!("tests/superposition/monte_carlo/{phantom}_{field_cm}.json"));
    let reference: Reference = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert!(reference.unit.starts_with("1e-3 MeV/g per photon/cm2"), "{}", reference.unit);
    reference
}

/// Density of a phantom at a depth and a distance beside the axis, mm.
fn density(phantom: char, depth_mm: f64, [x, z]: [f64; 2]) -> f64 {
    let is_in = |low: f64, high: f64| (low..high).contains(&depth_mm);
    let is_central = x.abs() < 10.0 && z.abs() < 10.0;
    match phantom {
        'b' if is_in(30.0, 130.0) => 0.25,
        'c' if is_in(50.0, 70.0) => 1.6,
        'd' if is_in(20.0, 40.0) && is_central => 0.0012,
        'e' if is_in(90.0, 110.0) && is_central => 1.0,
        'e' if is_in(30.0, 230.0) => 0.25,
        _ => 1.0,
    }
}

/// The shipped machine with sharp field edges, whose density is read from tenths of a thousandth.
fn machine(name: EngineName) -> MachineFile {
    MachineFile {
        // The samples of pencil beams, 0.5 mm apart, do not resolve a sharper edge.
        penumbra_fwhm_at_iso_mm: if name == EngineName::Pencil { 1.5 } else { 0.1 },
        hu_to_density: vec![[0.0, 0.0], [30000.0, 3.0]],
        ..Machine::shipped().unwrap().file().clone()
    }
}

/// A phantom: x across, y along the beam from the skin at 900 mm, z.
fn engine(phantom: char, field_cm: u32, name: EngineName, machine: MachineFile) -> DoseEngine {
    let side = 0.5 - HALF as f64;
    let grid = Grid {
        counts: [2 * HALF, DEPTHS, 2 * HALF],
        spacing_mm: [VOXEL_MM; 3],
        origin_mm: [side * VOXEL_MM, 0.5 * VOXEL_MM - 100.0, side * VOXEL_MM],
    };
    let hu: Vec<i16> = (0..grid.len())
        .map(|voxel| {
            let [x, y, z] = grid.centre_mm(grid.voxel(voxel));
            (1e4 * density(phantom, y + 100.0, [x, z])).round() as i16
        })
        .collect();
    let all = Mask::from_fn(grid.len(), |_| true);
    let target =
        Mask::from_fn(grid.len(), |voxel| grid.centre_mm(grid.voxel(voxel)).iter().all(|mm| mm.abs() < 4.0));
    let anatomy = Anatomy { grid, hu: &hu, external: &all, target: &target, isocentre_mm: [0.0; 3] };
    let params = DoseParams {
        grid,
        bixels: BixelSpec::of_width(10.0 * f64::from(field_cm)),
        engine: name,
        ..DoseParams::over(&grid, VOXEL_MM)
    };
    DoseEngine::new(&anatomy, Machine::new(machine).unwrap(), params).unwrap()
}

/// Dose along the axis, and at the places of the lateral profiles, in the unit of the references.
pub struct Computed {
    pub axis: Vec<f64>,
    pub lateral: BTreeMap<String, Vec<f64>>,
}

pub fn computed(phantom: char, field_cm: u32, name: EngineName, reference: &Reference) -> Computed {
    let machine = machine(name);
    let scale = 1e3 / machine.superposition.as_ref().unwrap().gray_per_mev_g;
    let engine = engine(phantom, field_cm, name, machine);
    let half = (10.0 * reference.axis_square_half_cm / VOXEL_MM).round() as usize;
    let strip = HALF - half..HALF + half;
    let grid = engine.params().grid;
    let depths: BTreeMap<&str, usize> = reference
        .lateral
        .keys()
        .map(|key| (key.as_str(), (key.parse::<f64>().unwrap() * 10.0 / VOXEL_MM) as usize))
        .collect();
    let reach = reference.lateral.values().map(|lateral| lateral.dose.len()).max().unwrap();
    let rows: Vec<u32> = (0..grid.len())
        .filter(|voxel| {
            let [x, y, z] = grid.voxel(*voxel);
            let is_lateral =
                depths.values().any(|depth| *depth == y) && (HALF - reach..HALF + reach).contains(&x);
            strip.contains(&z) && (strip.contains(&x) || is_lateral)
        })
        .map(|voxel| voxel as u32)
        .collect();
    let dose = engine.within(&rows).weighted_bixels(0.0, &[[0.0; 2]], &[1.0]).unwrap();
    let mean = |xs: &[usize], y: usize| {
        let places = xs.iter().flat_map(|x| strip.clone().map(move |z| [*x, y, z]));
        let sum: f64 = places.map(|place| f64::from(dose[grid.index(place)])).sum();
        scale * sum / (xs.len() * strip.len()) as f64
    };
    let across: Vec<usize> = strip.clone().collect();
    Computed {
        axis: (0..DEPTHS).map(|y| mean(&across, y)).collect(),
        lateral: reference
            .lateral
            .iter()
            .map(|(key, lateral)| {
                let at = |i: usize| mean(&[HALF + i, HALF - 1 - i], depths[key.as_str()]);
                (key.clone(), (0..lateral.dose.len()).map(at).collect())
            })
            .collect(),
    }
}
