//! `plan.json`: a plan as a file, written and read back by one set of types.
//!
//! Numbers that are not finite are written as `null`. Files of older builds have no `version` and may lack later keys.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use stillpoint_patient::Grid;
use stillpoint_patient::case::Prescription;
use thiserror::Error;

use crate::arc::{ArcBeam, ArcPoint, ArcSpec};
use crate::check::{Bounds, CheckValues, Checked};
use crate::dose::{ArcLimits, BeamAngles, Collimator, EngineName, farthest_mm};
use crate::evaluation::{FallOff, StructureDose};
use crate::protocol::{Judged, Served};
use crate::recipe::{MethodName, StartFluence};
use crate::recompute::BeamFluence;

/// Newest version of the file, which this build reads and writes: that of plans of arcs. A build that knows none refuses it.
pub const PLAN_FILE_VERSION: u32 = 3;
/// Version of plans with couch angles. A build that knows none refuses it, and does not take its beams for others.
const COUCH_VERSION: u32 = 2;
/// Version of plans without couch angles.
const COPLANAR_VERSION: u32 = 1;

/// What every plan file says to people.
pub const WARNING: &str = "Research only. No plan made by stillpoint may treat a patient.";

/// A plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFile {
    /// Version of the build that wrote the file.
    #[serde(default)]
    pub stillpoint: String,
    /// What every plan file says to people.
    #[serde(default)]
    pub warning: String,
    /// The case.
    pub case: PlanFileCase,
    /// Prescriptions of the case.
    #[serde(default)]
    pub prescription: Vec<Prescription>,
    /// Fractions of the case.
    pub fractions: Option<u32>,
    /// Isocentre, mm in the patient frame.
    #[serde(default)]
    pub isocentre_mm: [f64; 3],
    /// The machine.
    pub machine: PlanFileMachine,
    /// The grids and bixels of the dose.
    pub dose: PlanFileDose,
    /// Objectives as they were solved: doses in gray, over the points that count for the structure.
    #[serde(default)]
    #[serde(rename = "wanted")]
    pub requested: Vec<PlanFileObjectives>,
    /// The objectives with what the planned fluence gives.
    #[serde(default)]
    pub objectives: Vec<Value>,
    /// What couch angles changed, where beams were searched with them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub couch: Option<PlanFileCouch>,
    /// How the beams were chosen.
    pub method: MethodName,
    /// Whether another program found the weights: then nothing was optimised here.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub given_weights: bool,
    /// The case of the plan with whose fluence the solve began, where there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<PlanFileCase>,
    /// Seed of the random methods.
    #[serde(default)]
    pub seed: u64,
    /// The objective of the planned fluence.
    pub objective: f64,
    /// What uneven fluence adds to it; the rest is the sum of the costs of the objectives.
    #[serde(default)]
    pub modulation: f64,
    /// The robust game, where it was played.
    #[serde(default)]
    pub robust_game: Option<PlanFileGame>,
    /// How much above the optimum of these beams the objective is at most.
    #[serde(default)]
    pub excess_at_most: Option<f64>,
    /// Residual of the conditions of Karush, Kuhn and Tucker.
    #[serde(default)]
    pub kkt: Option<f64>,
    /// Steps of Newton's method.
    #[serde(default)]
    pub newton_steps: usize,
    /// The beams with their fluence.
    pub beams: Vec<PlanFileBeam>,
    /// Figures of the planned fluence.
    #[serde(flatten)]
    pub figures: PlanFileFigures,
    /// The segments, where there are some.
    pub leaves: Option<PlanFileLeaves>,
    /// The arcs of a plan of arcs, which has no `beams`: `objective` and figures are of their dose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arcs: Option<PlanFileArcs>,
    /// Which objective serves each limit of the protocol.
    #[serde(default)]
    pub served: Vec<PlanFileServed>,
    /// The check of what is delivered; files of older builds have none.
    #[serde(default)]
    pub check: Option<PlanFileCheck>,
    /// Figures of the other set-ups.
    #[serde(default)]
    pub setups: Vec<PlanFileSetup>,
    /// Figures of the dose that came with the case.
    #[serde(default)]
    pub reference: Option<Vec<StructureDose>>,
    /// Every search that was run.
    #[serde(default)]
    pub searches: Vec<PlanFileSearch>,
    /// Version of the file; 0 for files of builds that wrote none.
    #[serde(default)]
    pub version: u32,
}

/// The case of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileCase {
    /// Name.
    pub name: String,
    /// Content hash.
    pub hash: String,
    /// Where the case is from.
    #[serde(default)]
    pub provenance: String,
}

/// The machine of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileMachine {
    /// Nominal energy, MV.
    pub energy_mv: f64,
    /// Where the machine file is from.
    pub provenance: String,
}

/// A grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileGrid {
    /// Voxels along x, y, z.
    #[serde(default)]
    pub counts: [usize; 3],
    /// Spacing along x, y, z, mm.
    pub spacing_mm: [f64; 3],
    /// Centre of the first voxel, mm.
    #[serde(default)]
    pub origin_mm: [f64; 3],
}

/// The points that were optimised.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFilePoints {
    /// The lattice on which they are.
    pub lattice: PlanFileGrid,
    /// Points with objectives.
    pub points: usize,
}

/// The grids and bixels of the dose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileDose {
    /// The grid of the figures.
    pub grid: PlanFileGrid,
    /// The points that were optimised.
    #[serde(default)]
    pub optimised: Option<PlanFilePoints>,
    /// Width of a bixel, mm.
    pub bixel_mm: f64,
    /// Distance from the axis of a bixel beyond which it gives no dose, mm.
    pub cutoff_mm: f64,
    /// The method by which dose was computed; files of older builds have pencil beams.
    #[serde(default)]
    pub engine: EngineName,
    /// The method by which dose was computed for the search, where it is another: the objectives of `searches` are by it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub searched_by: Option<EngineName>,
    /// Lung and air on the rays of the bixels that have weight; files of older builds have none.
    #[serde(default)]
    pub low_density: Option<PlanFileLowDensity>,
}

/// Lung and air on the rays of bixels, from the skin to the far side of the target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileLowDensity {
    /// Bixels with weight.
    pub bixels: usize,
    /// Those whose ray crosses at least 10 mm of lung or air.
    pub crossing: usize,
    /// The most that a ray crosses, mm.
    pub longest_mm: f64,
    /// What a person should know of doses by pencil beams there, or by pencil beams of this machine anywhere.
    #[serde(default)]
    pub caution: Option<String>,
}

/// The objectives of a structure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileObjectives {
    /// The structure, or a part of it.
    pub structure: String,
    /// Its points.
    pub voxels: usize,
    /// Its objectives: each a map from the shape to its parameters.
    pub objectives: Vec<Value>,
}

/// What the robust game found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileGame {
    /// The objective in the worst set-up.
    pub worst_objective: f64,
    /// Number of the worst set-up error; `None` for the planned set-up.
    pub worst_setup: Option<usize>,
    /// The objective under each set-up error.
    pub objectives_of_setups: Vec<f64>,
}

/// A beam with its fluence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileBeam {
    /// IEC 61217, degrees.
    pub gantry_deg: f64,
    /// Couch angle (patient support), IEC 61217, degrees; files of older builds have none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub couch_deg: f64,
    /// Sum of the weights.
    #[serde(default)]
    pub weight: f64,
    /// Centre on the isocentre plane (x, z, mm) and weight of each bixel.
    pub bixels_x_z_mm_weight: Vec<[f64; 3]>,
}

/// What a dose gives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileFigures {
    /// By structure.
    #[serde(default)]
    pub structures: Vec<StructureDose>,
    /// By structure; files of older builds have none.
    #[serde(default)]
    pub histograms: Vec<Histogram>,
    /// How the dose falls off.
    pub fall_off: Option<FallOff>,
    /// The limits.
    pub protocol: Option<PlanFileProtocol>,
}

/// A cumulative histogram.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// The structure.
    pub structure: String,
    /// From one volume to the next, gray; the first volume gets 0 Gy.
    pub step_gy: f64,
    /// Percent of the structure that get at least each dose.
    pub volumes_percent: Vec<f64>,
}

/// A protocol with which a plan was compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileProtocol {
    /// Its name.
    pub name: String,
    /// Its limits.
    pub limits: Vec<Judged>,
}

/// A limit with the objective that serves it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileServed {
    /// The structure, or `plan`.
    pub structure: String,
    /// The limit.
    pub limit: String,
    /// The objective in words; nothing where none serves the limit.
    pub by: Option<String>,
    /// Whether the objective was derived from the limit.
    pub derived: bool,
}

impl From<&Served> for PlanFileServed {
    fn from(served: &Served) -> Self {
        Self {
            structure: served.structure.clone(),
            limit: served.limit.clone(),
            by: served.by.as_ref().map(|(name, objective)| format!("{name}: {}", objective.aim())),
            derived: served.is_derived,
        }
    }
}

/// The check of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileCheck {
    /// What a plan may be.
    pub bounds: Bounds,
    /// What this one is.
    pub values: CheckValues,
    /// What is beyond a bound, in words; nothing where the plan passes.
    pub faults: Vec<String>,
    /// Why a person takes a plan that the check refuses.
    pub accepted: Option<String>,
}

impl PlanFileCheck {
    /// Of what a check found, and the reason to take the plan all the same.
    pub fn new(checked: &Checked, accepted: Option<&str>) -> Self {
        Self {
            bounds: checked.bounds,
            values: checked.values,
            faults: checked.faults.iter().map(ToString::to_string).collect(),
            accepted: accepted.map(str::to_owned),
        }
    }
}

/// What couch angles changed, by the doses of the search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileCouch {
    /// Largest couch angle to both sides that was allowed, degrees.
    pub most_deg: f64,
    /// The objective of the best beams without couch angles.
    pub coplanar_objective: f64,
    /// Their gantry angles, degrees.
    pub coplanar_angles_deg: Vec<f64>,
    /// The objective with couch angles.
    pub objective: f64,
    /// Directions among which the search chose.
    pub candidates: usize,
    /// Of these, the directions whose doses were needed.
    pub doses: usize,
    /// Structures whose mean dose is higher than without couch angles by at least 0.5 Gy.
    pub higher: Vec<PlanFileHigher>,
}

/// A structure that gets more than without couch angles. Means are of the points that count for it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileHigher {
    /// Its name.
    pub structure: String,
    /// Mean dose without couch angles, gray.
    pub coplanar_gy: f64,
    /// Mean dose with couch angles, gray.
    pub mean_gy: f64,
}

/// The segments of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileLeaves {
    /// The leaves.
    pub collimator: Collimator,
    /// Levels into which fluences were divided.
    #[serde(default)]
    pub levels: u32,
    /// The objective of the segments.
    pub objective: f64,
    /// Its rise above that of the fluence, as a part of it.
    pub loss: f64,
    /// The same behind leaves that let nothing through.
    #[serde(default)]
    pub loss_without_transmission: Option<f64>,
    /// The same before segments were added.
    #[serde(default)]
    pub loss_before_segments_were_added: Option<f64>,
    /// Segments that were added by their price.
    #[serde(default)]
    pub added_segments: usize,
    /// Number of segments.
    pub segments: usize,
    /// Monitor units in one fraction.
    pub monitor_units: f64,
    /// The beams that have segments.
    pub beams: Vec<PlanFileLeafBeam>,
    /// Figures of the dose of the segments.
    #[serde(flatten)]
    pub figures: PlanFileFigures,
}

/// The segments of a beam.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileLeafBeam {
    /// IEC 61217, degrees.
    pub gantry_deg: f64,
    /// Couch angle (patient support), IEC 61217, degrees; files of older builds have none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub couch_deg: f64,
    /// Monitor units in one fraction.
    #[serde(default)]
    pub monitor_units: f64,
    /// The smallest rectangle around the jaws of all segments, along x and z, mm.
    pub field_x_z_mm: [[f64; 2]; 2],
    /// The segments.
    pub segments: Vec<PlanFileSegment>,
}

/// A segment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileSegment {
    /// Monitor units in one fraction.
    pub monitor_units: f64,
    /// The jaws along x and z, mm, where they follow each segment; those of the beam where they do not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field_x_z_mm: Option<[[f64; 2]; 2]>,
    /// Number and tips (mm) of each pair of leaves that is open.
    pub open_pair_from_to_mm: Vec<(usize, f64, f64)>,
}

/// The arcs of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileArcs {
    /// The leaves.
    pub collimator: Collimator,
    /// How fast gantry, leaves and dose may be.
    pub limits: ArcLimits,
    /// Monitor units in one fraction.
    pub monitor_units: f64,
    /// Seconds with the beam on, from the first control point of each arc to its last, in one fraction.
    pub seconds: f64,
    /// Largest distance between the angles of the dose, degrees.
    pub angles_deg: f64,
    /// Width of the bixels of the dose, mm.
    pub bixel_mm: f64,
    /// How far the doses of half as many angles are from this one, over the points: root of the mean square, gray.
    pub spacing_rms_gy: f64,
    /// The largest of these distances, gray.
    pub spacing_largest_gy: f64,
    /// The objective of the search for leaves, at its own points: of the start, and after each round.
    pub objectives: Vec<f64>,
    /// Points of the search.
    pub points: usize,
    /// The arcs.
    pub arcs: Vec<PlanFileArc>,
}

/// An arc.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileArc {
    /// Which way it goes, as on the command line.
    pub arc: String,
    /// Monitor units in one fraction.
    pub monitor_units: f64,
    /// Seconds with the beam on.
    pub seconds: f64,
    /// The jaws along x and z, mm.
    pub field_x_z_mm: [[f64; 2]; 2],
    /// Number of the first pair of leaves whose tips are written; pairs before and behind those stand behind the lower jaw.
    pub first_pair: usize,
    /// Its control points.
    pub control_points: Vec<PlanFileControlPoint>,
}

/// A control point of an arc.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileControlPoint {
    /// IEC 61217, degrees.
    pub gantry_deg: f64,
    /// Monitor units given up to here in one fraction.
    pub monitor_units: f64,
    /// Tips of the pairs in the jaws, mm.
    pub tips_mm: Vec<[f64; 2]>,
}

impl PlanFileArcs {
    /// Seconds of one fraction: with the beam on, and the gantry between arcs, which does not turn through 180 degrees.
    pub fn seconds_in_all(&self) -> f64 {
        let arcs: Vec<ArcSpec> = self.arcs.iter().filter_map(|arc| arc.arc.parse().ok()).collect();
        let turned: f64 = arcs.windows(2).map(|pair| pair[0].degrees_to(&pair[1])).sum();
        self.seconds + turned / self.limits.gantry_deg_per_s
    }
}

impl PlanFileLeaves {
    /// Seconds of one fraction: monitor units at the highest dose rate, leaves and jaws (as fast as leaves) between segments, and the
    /// gantry between beams, which does not turn through 180 degrees. Nothing for the beam to go on and off, nor for a couch that turns.
    pub fn seconds(&self, limits: &ArcLimits) -> f64 {
        let mut seconds = 60.0 * self.monitor_units / limits.mu_per_min;
        for beam in &self.beams {
            let over = self.collimator.over_travel_mm;
            let closed = beam.field_x_z_mm[0][0].clamp(-over, over);
            let tips = |segment: &PlanFileSegment| {
                let mut tips = vec![[closed; 2]; self.collimator.pairs()];
                for (pair, from, to) in &segment.open_pair_from_to_mm {
                    if let Some(tips) = tips.get_mut(*pair) {
                        *tips = [*from, *to];
                    }
                }
                tips.extend(segment.field_x_z_mm.unwrap_or(beam.field_x_z_mm));
                tips
            };
            for pair in beam.segments.windows(2) {
                seconds += farthest_mm(&tips(&pair[0]), &tips(&pair[1])) / limits.leaf_mm_per_s;
            }
        }
        let mut angles: Vec<f64> =
            self.beams.iter().map(|beam| (beam.gantry_deg - 180.0).rem_euclid(360.0)).collect();
        angles.sort_by(f64::total_cmp);
        let turned: f64 = angles.windows(2).map(|pair| pair[1] - pair[0]).sum();
        seconds + turned / limits.gantry_deg_per_s
    }
}

impl PlanFileArc {
    /// Of an arc on a machine with these leaves and limits.
    pub fn new(beam: &ArcBeam, collimator: &Collimator, limits: &ArcLimits) -> Self {
        let [_, [low, high]] = beam.field_mm;
        let is_in_jaws = |pair: &usize| {
            let [from, to] = collimator.pair_mm(*pair);
            from < high && to > low
        };
        let pairs: Vec<usize> = (0..collimator.pairs()).filter(is_in_jaws).collect();
        let point = |point: &ArcPoint| PlanFileControlPoint {
            gantry_deg: point.gantry_deg.rem_euclid(360.0),
            monitor_units: point.units,
            tips_mm: pairs.iter().map(|pair| point.tips_mm[*pair]).collect(),
        };
        Self {
            arc: beam.spec.to_string(),
            monitor_units: beam.units(),
            seconds: beam.seconds(limits),
            field_x_z_mm: beam.field_mm,
            first_pair: pairs.first().copied().unwrap_or_default(),
            control_points: beam.points.iter().map(point).collect(),
        }
    }
}

/// Figures of a set-up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileSetup {
    /// Displacement of the patient along his axes, mm.
    pub patient_moved_mm: [f64; 3],
    /// Figures of the structures that are followed.
    pub structures: Vec<StructureDose>,
}

/// A search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileSearch {
    /// The method.
    pub method: MethodName,
    /// Most solves.
    pub budget: usize,
    /// Leaves that the search had under way at most; 1 in files of builds that wrote none.
    #[serde(default = "one")]
    pub leaves: usize,
    /// Why the search ended.
    pub ended: String,
    /// The least cost.
    pub objective: f64,
    /// Gantry angles of the best set, degrees.
    pub angles_deg: Vec<f64>,
    /// Couch angles of the best set, degrees; none where all are 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub couches_deg: Vec<f64>,
    /// Solves.
    pub solves: usize,
    /// Beams priced.
    pub prices: usize,
    /// Every solve.
    pub history: Vec<PlanFileSolve>,
}

fn one() -> usize {
    1
}

fn is_zero(degrees: &f64) -> bool {
    *degrees == 0.0
}

impl PlanFileBeam {
    /// Where the beam comes from.
    pub fn angles(&self) -> BeamAngles {
        BeamAngles { gantry_deg: self.gantry_deg, couch_deg: self.couch_deg }
    }
}

impl PlanFileLeafBeam {
    /// Where the beam comes from.
    pub fn angles(&self) -> BeamAngles {
        BeamAngles { gantry_deg: self.gantry_deg, couch_deg: self.couch_deg }
    }
}

/// A solve.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFileSolve {
    /// Cost of the set.
    pub cost: Option<f64>,
    /// Least cost of a set of as many beams as the plan has, until then.
    pub best: Option<f64>,
    /// Beams priced until then.
    pub prices: usize,
    /// Gantry angles of the set, degrees.
    pub angles_deg: Vec<f64>,
    /// Couch angles of the set, degrees; none where all are 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub couches_deg: Vec<f64>,
}

/// The reasons why bytes are not a plan file.
#[derive(Debug, Error)]
pub enum PlanFileError {
    /// The bytes are something else.
    #[error("this is not a plan.json of `stillpoint plan`: {0}")]
    Json(#[from] serde_json::Error),
    /// The file is of a newer build.
    #[error(
        "unknown version of plan.json: {found} (allowed: up to {PLAN_FILE_VERSION}); read it with the build that wrote it"
    )]
    Version {
        /// Version of the file.
        found: u32,
    },
}

impl PlanFile {
    /// The plan in the bytes of a plan.json, of this or an older build.
    ///
    /// # Errors
    /// The bytes are not a plan file, or of a newer version.
    pub fn from_json(bytes: &[u8]) -> Result<Self, PlanFileError> {
        #[derive(Deserialize)]
        struct Version {
            #[serde(default)]
            version: u32,
        }
        // First, so that a file of another version is not blamed for its keys.
        let Version { version: found } = serde_json::from_slice(bytes)?;
        if found > PLAN_FILE_VERSION {
            return Err(PlanFileError::Version { found });
        }
        Ok(serde_json::from_slice(bytes)?)
    }

    /// The version that a plan of these static beams is written as.
    pub fn version_of(beams: &[PlanFileBeam]) -> u32 {
        let is_coplanar = beams.iter().all(|beam| beam.couch_deg == 0.0);
        if is_coplanar { COPLANAR_VERSION } else { COUCH_VERSION }
    }

    /// The text of the file.
    ///
    /// # Errors
    /// Never for the numbers of a plan.
    pub fn to_json(&self) -> Result<String, PlanFileError> {
        Ok(serde_json::to_string_pretty(self)?)
    }

    /// Seconds of one fraction on a machine with these limits: of segments without what [`PlanFileLeaves::seconds`] leaves out, of arcs with
    /// the beam on; nothing for a fluence that is not sequenced.
    pub fn seconds(&self, limits: &ArcLimits) -> Option<f64> {
        let of_segments = self.leaves.as_ref().map(|leaves| leaves.seconds(limits));
        of_segments.or_else(|| self.arcs.as_ref().map(PlanFileArcs::seconds_in_all))
    }

    /// Figures of the segments where there are some, of the planned fluence otherwise.
    pub fn shown(&self) -> &PlanFileFigures {
        self.leaves.as_ref().map_or(&self.figures, |leaves| &leaves.figures)
    }

    /// The limits of those figures.
    pub fn limits(&self) -> &[Judged] {
        self.shown().protocol.as_ref().map_or(&[], |protocol| &protocol.limits)
    }

    /// Where the beams come from.
    pub fn angles(&self) -> Vec<BeamAngles> {
        self.beams.iter().map(PlanFileBeam::angles).collect()
    }

    /// The fluence as it was planned, to start from.
    pub fn fluence(&self) -> StartFluence {
        let beam = |beam: &PlanFileBeam| BeamFluence {
            angles: beam.angles(),
            bixels_mm: beam.bixels_x_z_mm_weight.iter().map(|[x, z, _]| [*x, *z]).collect(),
            weights: beam.bixels_x_z_mm_weight.iter().map(|[.., weight]| *weight).collect(),
        };
        StartFluence { beams: self.beams.iter().map(beam).collect(), bixel_mm: self.dose.bixel_mm }
    }

    /// Gantry angles of the beams, degrees.
    pub fn angles_deg(&self) -> Vec<f64> {
        self.beams.iter().map(|beam| beam.gantry_deg).collect()
    }

    /// Couch angles of the beams, degrees.
    pub fn couches_deg(&self) -> Vec<f64> {
        self.beams.iter().map(|beam| beam.couch_deg).collect()
    }
}

impl From<&Grid> for PlanFileGrid {
    fn from(grid: &Grid) -> Self {
        Self { counts: grid.counts, spacing_mm: grid.spacing_mm, origin_mm: grid.origin_mm }
    }
}

impl Histogram {
    /// Of a curve of doses (gray, equally spaced from 0) with their volumes in percent.
    pub fn new(structure: &str, curve: &[(f64, f64)]) -> Self {
        let volumes_percent = curve.iter().map(|(_, volume)| (1e4 * volume).round() / 1e4).collect();
        Self { structure: structure.to_owned(), step_gy: curve.get(1).map_or(0.0, |p| p.0), volumes_percent }
    }

    /// Doses with their volumes in percent.
    pub fn points(&self) -> Vec<(f64, f64)> {
        let numbered = self.volumes_percent.iter().enumerate();
        numbered.map(|(step, volume)| (self.step_gy * step as f64, *volume)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_of_segments_is_that_of_units_leaves_and_gantry() {
        let segment = |monitor_units, from, to| PlanFileSegment {
            monitor_units,
            field_x_z_mm: None,
            open_pair_from_to_mm: vec![(40, from, to)],
        };
        let beam = |gantry_deg| PlanFileLeafBeam {
            gantry_deg,
            couch_deg: 0.0,
            monitor_units: 50.0,
            field_x_z_mm: [[-20.0, 30.0], [0.0, 5.0]],
            segments: vec![segment(30.0, -20.0, 30.0), segment(20.0, -20.0, 5.0)],
        };
        let leaves: PlanFileLeaves = serde_json::from_value(serde_json::json!({
            "collimator": Collimator::generic(), "objective": 1.0, "loss": 0.0, "segments": 4, "monitor_units": 100.0,
            "beams": [beam(170.0), beam(190.0)]
        }))
        .unwrap();
        // 10 s for 100 units, 1 s for 25 mm in each beam, and 340 degrees the long way round.
        let seconds = leaves.seconds(&ArcLimits::generic());
        assert!((seconds - 10.0 - 2.0 - 340.0 / 6.0).abs() < 1e-9, "{seconds}");
    }

    const OLDER: &str = r#"{
        "case": { "name": "a", "hash": "00" }, "fractions": null,
        "machine": { "energy_mv": 6, "provenance": "generic" },
        "dose": { "grid": { "spacing_mm": [2, 2, 2] }, "bixel_mm": 10, "cutoff_mm": 50 },
        "method": "two_player", "objective": 1.5, "beams": [], "leaves": null
    }"#;

    #[test]
    fn a_file_without_a_version_and_later_keys_is_read_and_written_back() {
        let file = PlanFile::from_json(OLDER.as_bytes()).unwrap();
        assert_eq!((file.version, file.method, file.shown().histograms.len()), (0, MethodName::TwoPlayer, 0));
        let repeated = PlanFile::from_json(file.to_json().unwrap().as_bytes()).unwrap();
        assert_eq!(repeated, file);
    }

    #[test]
    fn a_file_of_a_newer_version_is_refused_by_its_version() {
        let newer = br#"{ "version": 4, "beams_of_a_new_shape": [] }"#;
        let refused = PlanFile::from_json(newer).unwrap_err().to_string();
        assert!(refused.starts_with("unknown version of plan.json: 4 (allowed: up to 3)"), "{refused}");
        assert!(PlanFile::from_json(b"{}").unwrap_err().to_string().contains("missing field"));
    }
}
