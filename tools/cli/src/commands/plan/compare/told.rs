//! What is read of the plan.json of a plan.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use stillpoint_patient::case::Prescription;
use stillpoint_plan::evaluation::{FallOff, StructureDose};
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::protocol::Judged;

use super::super::charts::percent_curve;
use crate::exit::Failure;

/// A cumulative histogram in plan.json.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// The structure.
    pub structure: String,
    /// From one volume to the next, gray; the first volume gets 0 Gy.
    pub step_gy: f64,
    /// Percent of the structure that get at least each dose.
    pub volumes_percent: Vec<f64>,
}

impl Histogram {
    /// Up to this dose, or until nothing is left.
    pub fn new(structure: &str, dvh: &Dvh, up_to_gy: f64) -> Self {
        let curve = percent_curve(dvh, up_to_gy);
        let volumes_percent = curve.iter().map(|(_, volume)| (1e4 * volume).round() / 1e4).collect();
        Self { structure: structure.to_owned(), step_gy: curve.get(1).map_or(0.0, |p| p.0), volumes_percent }
    }

    /// Doses with their volumes in percent.
    pub fn points(&self) -> Vec<(f64, f64)> {
        let numbered = self.volumes_percent.iter().enumerate();
        numbered.map(|(step, volume)| (self.step_gy * step as f64, *volume)).collect()
    }
}

/// The case of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OfCase {
    /// Its name.
    pub name: String,
    /// Its content hash.
    pub hash: String,
}

/// A plan, as its plan.json tells it.
#[derive(Debug)]
pub struct Told {
    /// The file.
    pub path: PathBuf,
    /// Its content.
    pub file: File,
}

/// plan.json, as far as plans are compared.
#[derive(Debug, Deserialize)]
pub struct File {
    case: OfCase,
    /// Prescriptions of the case.
    pub prescription: Vec<Prescription>,
    /// How the beams were chosen.
    pub method: String,
    /// The objective of the planned fluence.
    pub objective: f64,
    /// The objectives that were solved.
    pub wanted: Value,
    /// The beams.
    pub beams: Vec<Beam>,
    /// The grid of the dose.
    pub dose: Dose,
    /// The segments, if there are some.
    pub leaves: Option<Leaves>,
    #[serde(flatten)]
    figures: PlanFigures,
}

/// A beam.
#[derive(Debug, Deserialize)]
pub struct Beam {
    /// IEC 61217, degrees.
    pub gantry_deg: f64,
}

/// The dose of a plan.
#[derive(Debug, Deserialize)]
pub struct Dose {
    /// Its grid.
    pub grid: DoseGrid,
    /// Width of a bixel, mm.
    pub bixel_mm: f64,
}

/// The grid of a dose.
#[derive(Debug, Deserialize)]
pub struct DoseGrid {
    /// Along x, y, z.
    pub spacing_mm: [f64; 3],
}

/// The segments of a plan.
#[derive(Debug, Deserialize)]
pub struct Leaves {
    /// Their objective.
    pub objective: f64,
    /// Its rise above that of the fluence, as a part of it.
    pub loss: f64,
    /// Number of segments.
    pub segments: usize,
    /// Monitor units in one fraction.
    pub monitor_units: f64,
    #[serde(flatten)]
    figures: PlanFigures,
}

/// What a dose gives.
#[derive(Debug, Deserialize)]
pub struct PlanFigures {
    /// By structure.
    pub structures: Vec<StructureDose>,
    /// By structure; files of older builds have none.
    #[serde(default)]
    pub histograms: Vec<Histogram>,
    /// R50 and the like.
    pub fall_off: Option<FallOff>,
    /// The limits.
    pub protocol: Option<OfProtocol>,
}

/// A protocol beside a plan.
#[derive(Debug, Deserialize)]
pub struct OfProtocol {
    /// Its name.
    pub name: String,
    /// Its limits.
    pub limits: Vec<Judged>,
}

impl Told {
    /// Reads a plan.json, or that of a folder.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let path = if path.is_dir() { path.join("plan.json") } else { path.to_owned() };
        let fault = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", path.display()));
        let bytes = std::fs::read(&path).map_err(|e| fault(&e))?;
        let file: File = serde_json::from_slice(&bytes)
            .map_err(|e| fault(&format!("this is no plan.json of `stillpoint plan`: {e}")))?;
        let told = Self { file, path: path.clone() };
        if told.file.prescription.is_empty() {
            return Err(fault(
                &"the plan has no prescription; import its case with --prescribe and plan it again",
            ));
        }
        if told.shown().histograms.is_empty() {
            return Err(fault(
                &"the plan has no histograms; an older build wrote it, so plan the case again",
            ));
        }
        Ok(told)
    }

    /// Its case.
    pub fn case(&self) -> &OfCase {
        &self.file.case
    }

    /// Figures of the segments where there are some, of the planned fluence otherwise.
    pub fn shown(&self) -> &PlanFigures {
        self.file.leaves.as_ref().map_or(&self.file.figures, |leaves| &leaves.figures)
    }

    /// The limits of those figures.
    pub fn limits(&self) -> &[Judged] {
        self.shown().protocol.as_ref().map_or(&[], |protocol| &protocol.limits)
    }
}
