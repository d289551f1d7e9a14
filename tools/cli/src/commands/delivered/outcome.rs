//! The doses of a session and their figures.

use std::num::NonZeroUsize;

use serde_json::{Value, json};
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, Structure};
use stillpoint_plan::delivery::{BeamTime, Bin, BinWidth, MotionAt, bins, mean_dose, shifted_cloud};
use stillpoint_plan::evaluation::{Evaluation, OnGrid, StructureDose};
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::recompute::BeamFluence;

use super::plan_file::DeliveredPlan;
use super::recorded::Recorded;
use super::reference::Reference;
use crate::commands::plan::bar;
use crate::exit::Failure;

/// Most bins of which doses are computed.
const MOST_BINS: usize = 2000;
/// A voxel with at least this part of the highest prescription counts where doses are compared.
const COMPARED: f64 = 0.5;

/// What is told of the interplay of beams and motion.
pub const INTERPLAY: &str = "the planned meterset is spread evenly over beam-on time, so every beam meets every motion: a \
session does not say which beam or segment meets which motion, and the interplay of both is not in these doses";

/// A dose to the patient.
pub struct Dose<'a> {
    /// Its name in tables.
    pub name: &'static str,
    /// What it gives the structures.
    given: Evaluation<'a>,
    /// By structure.
    pub figures: Vec<StructureDose>,
}

/// Motion over a time.
pub struct MotionTime {
    /// Time with a motion, s.
    pub seconds: f64,
    /// Bins.
    pub bins: Vec<Bin>,
    /// Mean of each of the six numbers, mm and degrees.
    pub mean: [f64; 6],
    /// Standard deviation.
    pub deviation: [f64; 6],
    /// Largest magnitude.
    pub largest: [f64; 6],
}

/// All of it.
pub struct Outcome<'a> {
    /// The case.
    pub case: &'a Case,
    grid: Grid,
    /// With the beam on.
    pub on: MotionTime,
    /// All time after arming.
    pub armed: MotionTime,
    /// Planned, delivered, without gating, and the planned dose shifted as a cloud over the delivered motion.
    pub doses: [Dose<'a>; 4],
    /// Difference of the delivered dose from that cloud, where it counts: root mean square and the largest, Gy.
    pub from_cloud_gy: [f64; 2],
    /// Width of the bins.
    pub width: BinWidth,
}

impl<'a> Outcome<'a> {
    /// Computes the doses.
    pub fn new(
        case: &'a Case,
        plan: &DeliveredPlan,
        recorded: &Recorded,
        width: BinWidth,
        threads: NonZeroUsize,
        quiet: bool,
    ) -> Result<Self, Failure> {
        let on = MotionTime::new(&recorded.motions, &recorded.on, width);
        let armed = MotionTime::new(&recorded.motions, &recorded.armed, width);
        let all = on.bins.len() + armed.bins.len();
        if all > MOST_BINS {
            return Err(Failure::wrong(format!(
                "the motion is in {all} bins, more than {MOST_BINS}; choose wider ones with --bin and --bin-angle"
            )));
        }
        let beams = BeamFluence::weighted(&plan.beams);
        let bar = bar(all as u64, "dose of bins", quiet);
        let over = |bins: &[Bin]| {
            mean_dose(&plan.recompute, &beams, case.isocentre_mm(), bins, threads, || bar.inc(1))
        };
        let planned = plan.recompute.dose(&beams, [0.0; 3], threads).map_err(Failure::failed)?;
        let delivered = over(&on.bins).map_err(Failure::failed)?;
        let ungated = over(&armed.bins).map_err(Failure::failed)?;
        bar.finish_and_clear();
        let cloud = shifted_cloud(plan.recompute.grid(), &planned, &on.bins);
        let on_grid = OnGrid::new(case, plan.recompute.grid());
        let prescribed = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let from_cloud_gy = difference(&delivered, &cloud, &planned, COMPARED * prescribed);
        let dose = |name, gray: Vec<f32>| {
            let given = on_grid.evaluate(&gray);
            Dose { name, figures: given.figures(&[]), given }
        };
        let doses = [
            dose("planned", planned),
            dose("delivered", delivered),
            dose("without gating", ungated),
            dose("shifted cloud", cloud),
        ];
        Ok(Self { case, doses, grid: *on_grid.grid(), on, armed, from_cloud_gy, width })
    }

    /// Histograms of the first three doses.
    pub fn histograms(&self) -> [&[(&'a Structure, Dvh)]; 3] {
        [0, 1, 2].map(|i| &self.doses[i].given.histograms[..])
    }

    /// Everything, as it is written to delivered.json; nothing in it depends on a clock.
    pub fn reported(&self, plan: &DeliveredPlan, reference: &Reference, recorded: &Recorded) -> Value {
        let grid = &self.grid;
        let dose = |dose: &Dose<'_>| json!({ "name": dose.name, "structures": dose.figures });
        json!({
            "stillpoint": env!("CARGO_PKG_VERSION"),
            "warning": "Research only. No dose computed by stillpoint may be used to treat a patient.",
            "case": self.case.name(),
            "fractions": plan.fractions,
            "beams": plan.beams.iter().map(|beam| beam.angles.to_string()).collect::<Vec<_>>(),
            "couch_deg": reference.couch_deg,
            "doses_are_of": "all fractions, as if each had the motion of this session",
            "monitor_units_per_fraction": plan.monitor_units(),
            "interplay": INTERPLAY,
            "poses": reference.poses,
            "reference": {
                "tracker": reference.tracker,
                "surface": reference.surface,
                "is_the_case": reference.is_case,
                "isocentre_in_couch_m": <[f64; 3]>::from(reference.isocentre),
            },
            "beam": recorded.beam,
            "beam_on_without_pose_s": recorded.on.unknown_ns as f64 * 1e-9,
            "armed_since": recorded.armed_since,
            "armed_without_pose_s": recorded.armed.unknown_ns as f64 * 1e-9,
            "bin_mm": self.width.shift_mm,
            "bin_deg": self.width.turn_rad.to_degrees(),
            "grid": { "counts": grid.counts, "spacing_mm": grid.spacing_mm, "origin_mm": grid.origin_mm },
            "beam_on": self.on.reported(),
            "after_arming": self.armed.reported(),
            "doses": self.doses.iter().map(dose).collect::<Vec<_>>(),
            "delivered_minus_shifted_cloud_gy": { "rms": self.from_cloud_gy[0], "largest": self.from_cloud_gy[1] },
        })
    }
}

impl MotionTime {
    fn new(motions: &[MotionAt], time: &BeamTime, width: BinWidth) -> Self {
        let weights = &time.of_motion_ns;
        let numbers = |motion: &MotionAt| {
            let ([x, y, z], [a, b, c]) = (motion.shift_mm, motion.turn_rad.map(f64::to_degrees));
            [x, y, z, a, b, c]
        };
        let known: f64 = weights.iter().sum::<u64>() as f64;
        let weighted = || motions.iter().zip(weights).filter(|(_, w)| **w > 0);
        let [mut mean, mut squares, mut largest] = [[0.0; 6]; 3];
        for (motion, weight) in weighted() {
            for (i, number) in numbers(motion).into_iter().enumerate() {
                mean[i] += number * *weight as f64 / known;
                largest[i] = f64::max(largest[i], number.abs());
            }
        }
        for (motion, weight) in weighted() {
            for (i, number) in numbers(motion).into_iter().enumerate() {
                squares[i] += (number - mean[i]) * (number - mean[i]) * *weight as f64 / known;
            }
        }
        Self {
            seconds: known * 1e-9,
            bins: bins(motions, weights, width),
            mean,
            deviation: squares.map(f64::sqrt),
            largest,
        }
    }

    fn reported(&self) -> Value {
        let bin = |bin: &Bin| json!({ "share": bin.share, "shift_mm": bin.shift_mm, "turn_deg": bin.turn_rad.map(f64::to_degrees) });
        json!({
            "seconds": self.seconds,
            "mean_mm_deg": self.mean,
            "standard_deviation_mm_deg": self.deviation,
            "largest_mm_deg": self.largest,
            "bins": self.bins.iter().map(bin).collect::<Vec<_>>(),
        })
    }
}

/// Root mean square and largest difference of two doses where the planned one is at least `least` gray.
fn difference(a: &[f32], b: &[f32], planned: &[f32], least: f64) -> [f64; 2] {
    let (mut count, mut squares, mut largest) = (0, 0.0, 0.0_f64);
    for ((a, b), _) in a.iter().zip(b).zip(planned).filter(|(_, planned)| f64::from(**planned) >= least) {
        let off = f64::from(a - b);
        (count, squares, largest) = (count + 1, squares + off * off, largest.max(off.abs()));
    }
    [(squares / f64::from(count.max(1))).sqrt(), largest]
}
