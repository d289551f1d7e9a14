//! What must be alike so that two processes give the same bytes: sources, processor, and the results of a sample
//! computation.

use std::num::NonZeroUsize;
use std::sync::Arc;

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;
use stillpoint_plan::beams::{SOLVE_TOLERANCE, price_beams, solve_beams};
use stillpoint_plan::dose::{Anatomy, DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::{Goals, Objective, Overdose, StructureObjectives, Underdose};
use stillpoint_plan::{Rows, Setups};

use crate::{Hash, answer};

/// A build on a processor. Only workers whose build is the same are asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Build(Arc<str>);

/// Why a build is not known: the sample computation fails.
#[derive(Debug, thiserror::Error)]
#[error("the sample computation of this build fails: {0}")]
pub struct BuildError(Fault);

/// What a step of the sample computation answers.
type Fault = Box<dyn std::error::Error + Send + Sync>;

/// The longest text of a build.
pub const LONGEST: usize = 1024;

impl Build {
    /// This build on this processor.
    ///
    /// # Errors
    /// The sample computation fails, which is a fault of the build.
    pub fn here() -> Result<Self, BuildError> {
        let probe = probe().map_err(BuildError)?;
        Ok(Self::of(&format!(
            "stillpoint {}, sources {}, processor {} {} with {}, caches {}, sample {probe:.16}",
            env!("CARGO_PKG_VERSION"),
            env!("STILLPOINT_POOL_SOURCES"),
            std::env::consts::ARCH,
            std::env::consts::OS,
            features(),
            caches(),
        )))
    }

    /// The build of this text.
    pub fn of(text: &str) -> Self {
        Self(text.into())
    }

    /// Its text.
    pub fn text(&self) -> &str {
        &self.0
    }
}

/// Instructions that matrix products choose by.
fn features() -> String {
    #[cfg(target_arch = "x86_64")]
    let found = [
        ("avx", std::arch::is_x86_feature_detected!("avx")),
        ("avx2", std::arch::is_x86_feature_detected!("avx2")),
        ("fma", std::arch::is_x86_feature_detected!("fma")),
        ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
        ("avx512bw", std::arch::is_x86_feature_detected!("avx512bw")),
        ("avx512vl", std::arch::is_x86_feature_detected!("avx512vl")),
        ("avx512dq", std::arch::is_x86_feature_detected!("avx512dq")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let found = [("the architecture's own", true)];
    let names: Vec<&str> = found.iter().filter(|(_, there)| *there).map(|(name, _)| *name).collect();
    if names.is_empty() { "none".to_owned() } else { names.join("+") }
}

/// Sizes of the caches, by which matrix products are cut into blocks; that changes the order of their sums.
fn caches() -> String {
    let of = |index: u32| {
        let folder = format!("/sys/devices/system/cpu/cpu0/cache/index{index}");
        let read = |name: &str| std::fs::read_to_string(format!("{folder}/{name}")).ok();
        let (size, ways) = (read("size")?, read("ways_of_associativity")?);
        Some(format!("{}/{}", size.trim(), ways.trim()))
    };
    let sizes: Vec<String> = (0..8).filter_map(of).collect();
    if sizes.is_empty() { "unknown".to_owned() } else { sizes.join(" ") }
}

/// Doses of three beams to a cube of water with a target, the best fluence of two, the price of the third.
fn probe() -> Result<Hash, Fault> {
    const SIDE: usize = 16;
    let grid = Grid { counts: [SIDE; 3], spacing_mm: [10.0; 3], origin_mm: [-75.0; 3] };
    let within = |voxel: usize, mm: f64| {
        let [x, y, z] = grid.voxel(voxel).map(|i| -75.0 + 10.0 * i as f64);
        x * x + y * y + z * z <= mm * mm
    };
    let hu = vec![0; grid.len()];
    let anatomy = Anatomy {
        grid,
        hu: &hu,
        external: &Mask::from_fn(grid.len(), |voxel| within(voxel, 74.0)),
        target: &Mask::from_fn(grid.len(), |voxel| within(voxel, 22.0)),
        isocentre_mm: [0.0; 3],
    };
    let machine = Machine::shipped()?;
    let engine = DoseEngine::new(&anatomy, machine, DoseParams::over(&grid, 10.0))?;
    let mut rows = Vec::new();
    for angle in [12.0, 100.0, 236.0] {
        let beam = engine.beam(angle)?;
        rows.push(Rows::from_columns(beam.dose.view())?);
    }
    let structure = |name: &str, mm: f64, objectives| StructureObjectives {
        name: name.to_owned(),
        voxels: (0..engine.rows() as u32).filter(|v| within_grid(&engine, *v, mm)).collect(),
        volumes: Vec::new(),
        to_target_mm: Vec::new(),
        objectives,
    };
    let target = vec![
        Objective::Underdose(Underdose { dose: 60.0, weight: 100.0 }),
        Objective::Overdose(Overdose { dose: 62.0, weight: 80.0 }),
    ];
    let requested = vec![
        structure("target", 22.0, target),
        structure("body", 70.0, vec![Objective::Overdose(Overdose { dose: 20.0, weight: 10.0 })]),
    ];
    let goals = Goals::new(requested, engine.rows())?;
    let beams: Vec<Setups<'_>> = rows.iter().map(|rows| rows.view().into()).collect();
    let plan = solve_beams(&goals, &beams[..2], None, SOLVE_TOLERANCE, NonZeroUsize::MIN)?;
    let prices = price_beams(&goals, Some(&plan), &beams[2..])?;
    let doses: Vec<u8> =
        rows.iter().flat_map(|rows| rows.view().value).flat_map(|v| v.to_le_bytes()).collect();
    Ok(Hash::of_parts(&[&doses, &answer::of_plan(&plan), &answer::of_prices(&prices)]))
}

fn within_grid(engine: &DoseEngine, voxel: u32, mm: f64) -> bool {
    let grid = engine.params().grid;
    let at = grid.voxel(voxel as usize);
    let square = |axis: usize| (grid.origin_mm[axis] + at[axis] as f64 * grid.spacing_mm[axis]).powi(2);
    square(0) + square(1) + square(2) <= mm * mm
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_has_the_same_text_each_time() {
        let here = Build::here().unwrap();
        assert_eq!(Build::here().unwrap(), here);
        assert!(here.text().len() < LONGEST, "{}", here.text());
    }
}
