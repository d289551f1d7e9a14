//! Depth doses and profiles of the Monte Carlo program; `data/monte_carlo/README.md` says how they were made.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::phantom::{Phantom, Setting};

/// The spectrum of the reference.
pub const SPECTRUM: &str = "varian-6mv of Ali and Rogers (2012)";

/// Dose on and across the axis, 1e-3 MeV/g for each photon/cm2 on the isocentre plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Half of the side of the square over which the depth dose is a mean, mm.
    pub half_mm: f64,
    /// By depth, a voxel apart.
    pub axis: Vec<f64>,
    /// One standard deviation of each.
    pub axis_sigma: Vec<f64>,
    /// Across the axis, by rising depth.
    pub profiles: Vec<Profile>,
}

/// Dose across the axis, a voxel apart from the axis outwards.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Depth from the skin, mm.
    pub depth_mm: f64,
    /// Dose.
    pub dose: Vec<f64>,
    /// One standard deviation of each.
    pub sigma: Vec<f64>,
}

/// A file of `data/monte_carlo`.
#[derive(Deserialize)]
struct File {
    axis_square_half_cm: f64,
    axis: Vec<f64>,
    axis_sigma: Vec<f64>,
    lateral: BTreeMap<String, Lateral>,
}

#[derive(Deserialize)]
struct Lateral {
    dose: Vec<f64>,
    sigma: Vec<f64>,
}

/// The reference of a setting; `None` where there is none.
///
/// # Errors
/// A file that comes with stillpoint is damaged.
pub fn reference(setting: Setting) -> Result<Option<Reference>, serde_json::Error> {
    let Some(text) = text(setting) else { return Ok(None) };
    let file: File = serde_json::from_str(text)?;
    let mut profiles = Vec::with_capacity(file.lateral.len());
    for (depth_cm, Lateral { dose, sigma }) in file.lateral {
        let depth_cm: f64 = serde_json::from_str(&depth_cm)?;
        profiles.push(Profile { depth_mm: 10.0 * depth_cm, dose, sigma });
    }
    profiles.sort_by(|a, b| a.depth_mm.total_cmp(&b.depth_mm));
    let half_mm = 10.0 * file.axis_square_half_cm;
    Ok(Some(Reference { half_mm, axis: file.axis, axis_sigma: file.axis_sigma, profiles }))
}

fn text(Setting { phantom, field_cm }: Setting) -> Option<&'static str> {
    Some(match (phantom, field_cm) {
        (Phantom::Water, 1) => include_str!("../../data/monte_carlo/a_1.json"),
        (Phantom::Water, 2) => include_str!("../../data/monte_carlo/a_2.json"),
        (Phantom::Water, 5) => include_str!("../../data/monte_carlo/a_5.json"),
        (Phantom::Lung, 1) => include_str!("../../data/monte_carlo/b_1.json"),
        (Phantom::Lung, 2) => include_str!("../../data/monte_carlo/b_2.json"),
        (Phantom::Lung, 5) => include_str!("../../data/monte_carlo/b_5.json"),
        (Phantom::Bone, 2) => include_str!("../../data/monte_carlo/c_2.json"),
        (Phantom::Bone, 5) => include_str!("../../data/monte_carlo/c_5.json"),
        (Phantom::Air, 1) => include_str!("../../data/monte_carlo/d_1.json"),
        (Phantom::Air, 2) => include_str!("../../data/monte_carlo/d_2.json"),
        (Phantom::Air, 5) => include_str!("../../data/monte_carlo/d_5.json"),
        (Phantom::Tumour, 1) => include_str!("../../data/monte_carlo/e_1.json"),
        (Phantom::Tumour, 2) => include_str!("../../data/monte_carlo/e_2.json"),
        (Phantom::Tumour, 5) => include_str!("../../data/monte_carlo/e_5.json"),
        _ => return None,
    })
}
