//! The dose of a plan, its figures, and how far it is from that of another program.

use std::num::NonZeroUsize;

use serde_json::{Value, json};
use stillpoint_dicom::GivenDose;
use stillpoint_patient::case::{Case, Role, Structure};
use stillpoint_plan::dose::{BixelSpec, DoseParams, EngineName, Machine};
use stillpoint_plan::evaluation::{Evaluation, OnGrid, StructureDose, brought_to};
use stillpoint_plan::gamma::{Gamma, Tolerance, gamma};
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::recompute::{BeamFluence, Recompute};

use super::treatment::Treatment;
use crate::columns::{Columns, Side};
use crate::exit::Failure;

/// Parts of the largest dose of the other program: the difference that gamma tolerates, the least dose that it counts, and the
/// least with which the factor is taken.
const TOLERATED: f64 = 0.03;
const COUNTED: f64 = 0.1;
const SCALED: f64 = 0.5;
const DISTANCE_MM: f64 = 3.0;

/// All of it.
pub struct Outcome<'a> {
    case: &'a Case,
    treatment: &'a Treatment,
    engine: EngineName,
    spacing_mm: [f64; 2],
    dose: Evaluation<'a>,
    other: Option<Other<'a>>,
}

/// The dose of another program.
struct Other<'a> {
    dose: Evaluation<'a>,
    /// Where it counts.
    gamma: Option<Gamma>,
    /// What it has to be multiplied by to be nearest to this program's, in least squares, where it is high.
    factor: Option<f64>,
}

impl<'a> Outcome<'a> {
    /// Computes the dose of all fractions. `spacing_mm` is that of bixels and of the grid.
    pub fn new(
        case: &'a Case,
        machine: Machine,
        treatment: &'a Treatment,
        given: Option<&GivenDose>,
        engine: EngineName,
        spacing_mm: [f64; 2],
        threads: NonZeroUsize,
    ) -> Result<Self, Failure> {
        let [bixel_mm, grid_mm] = spacing_mm;
        let params = DoseParams {
            bixels: BixelSpec::of_width(bixel_mm),
            engine,
            ..DoseParams::over(case.grid(), grid_mm)
        };
        let recompute = Recompute::with_spacing(case, machine, &params, grid_mm).map_err(Failure::failed)?;
        let grid = *recompute.grid();
        let mut gray = vec![0.0; grid.len()];
        for (isocentre_mm, beams) in &treatment.parts {
            // The isocentre of the plan in that of the case: the patient is moved the other way.
            let own = case.isocentre_mm();
            let shift_mm = std::array::from_fn(|axis| own[axis] - isocentre_mm[axis]);
            let dose = recompute.dose(&BeamFluence::weighted(beams), shift_mm, threads);
            let dose = dose.map_err(Failure::failed)?;
            gray.iter_mut().zip(&dose).for_each(|(sum, dose): (&mut f32, _)| *sum += dose);
        }
        let on_grid = OnGrid::new(case, &grid);
        let other = given.map(|given| {
            let fractions = if given.sum == "FRACTION" { treatment.plan.fractions as f32 } else { 1.0 };
            let other: Vec<f32> = given.gray.iter().map(|gray| fractions * gray).collect();
            let largest = f64::from(other.iter().copied().fold(0.0, f32::max));
            let tolerance = Tolerance {
                dose_gy: TOLERATED * largest,
                distance_mm: DISTANCE_MM,
                least_gy: COUNTED * largest,
            };
            let brought = brought_to(&grid, &given.grid, &other);
            Other {
                gamma: gamma((&given.grid, &other), (&grid, &gray), &tolerance).filter(|_| largest > 0.0),
                factor: factor(&gray, &brought, SCALED * largest),
                dose: on_grid.evaluate(&brought),
            }
        });
        Ok(Self { case, treatment, engine, spacing_mm, dose: on_grid.evaluate(&gray), other })
    }

    /// The case.
    pub fn case(&self) -> &'a Case {
        self.case
    }

    /// Histograms of the structures, and those of the other program's dose.
    pub fn histograms(&self) -> [&[(&'a Structure, Dvh)]; 2] {
        [&self.dose.histograms, self.other.as_ref().map_or(&[], |other| &other.dose.histograms)]
    }

    /// As it is written to recalculated.json.
    pub fn reported(&self) -> Value {
        let plan = &self.treatment.plan;
        let beam = |beam: &stillpoint_dicom::TreatmentBeam| {
            let mut reported = json!({
                "name": beam.name,
                "gantry_deg": [beam.points.first().map(|p| p.gantry_deg), beam.points.last().map(|p| p.gantry_deg)],
                "control_points": beam.points.len(),
                "monitor_units": beam.monitor_units,
            });
            if beam.points.iter().any(|point| point.couch_deg != 0.0) {
                let ends = [beam.points.first(), beam.points.last()];
                reported["couch_deg"] = json!(ends.map(|point| point.map(|p| p.couch_deg)));
            }
            reported
        };
        let other = self.other.as_ref().map(|other| {
            json!({
                "structures": other.dose.figures(&[]),
                "factor": other.factor,
                "gamma": other.gamma.map(|g| json!({ "passed": g.passed, "mean": g.mean, "voxels": g.voxels })),
            })
        });
        json!({
            "stillpoint": env!("CARGO_PKG_VERSION"),
            "warning": "Research only. No dose computed by stillpoint may be used to treat a patient.",
            "case": self.case.name(),
            "plan": plan.label,
            "fractions": plan.fractions,
            "left_out": plan.left_out,
            "engine": self.engine.word(),
            "bixel_mm": self.spacing_mm[0],
            "grid_mm": self.spacing_mm[1],
            "directions": self.treatment.parts.iter().map(|(_, beams)| beams.len()).sum::<usize>(),
            "beams": plan.beams.iter().map(beam).collect::<Vec<_>>(),
            "structures": self.dose.figures(&[]),
            "other": other,
        })
    }

    /// Prints it for people.
    pub fn print(&self) {
        let plan = &self.treatment.plan;
        outln!(
            "{}: plan {:?}, {} beams, {} fractions, {:.1} monitor units a fraction; dose by {}",
            self.case.name(),
            plan.label,
            plan.beams.len(),
            plan.fractions,
            self.treatment.monitor_units(),
            self.engine.about()
        );
        plan.left_out.iter().for_each(|sentence| outln!("left out: {sentence}"));
        outln!("\ndose of all fractions, Gy:\n");
        let mut heads = vec![(Side::Left, "structure"), (Side::Left, ""), (Side::Right, "recalculated")];
        heads.extend(self.other.as_ref().map(|_| (Side::Right, "as given")));
        let mut rows = Columns::new(heads);
        let figures = self.dose.figures(&[]);
        let others = self.other.as_ref().map(|other| other.dose.figures(&[]));
        for (place, structure) in figures.iter().enumerate().filter(|(_, s)| s.role != Role::External) {
            type Read = fn(&StructureDose) -> f64;
            let of_target: &[(&str, Read)] =
                &[("D98", |f| f.d98_gy), ("D50", |f| f.d50_gy), ("D0.03", |f| f.d003cc_gy)];
            let of_organ: &[(&str, Read)] = &[("mean", |f| f.mean_gy), ("D0.03", |f| f.d003cc_gy)];
            let shown = if structure.role == Role::Target { of_target } else { of_organ };
            for (line, (what, read)) in shown.iter().enumerate() {
                let name = if line == 0 { structure.name.clone() } else { String::new() };
                let mut row = vec![name, (*what).to_owned(), format!("{:.2}", read(structure))];
                row.extend(others.as_ref().map(|others| format!("{:.2}", read(&others[place]))));
                rows.row(row);
            }
        }
        out!("{rows}");
        let Some(other) = &self.other else { return };
        match other.gamma {
            Some(found) => outln!(
                "\ngamma at 3 % of the largest dose and 3 mm, from 10 % of it on: {:.1} % of {} voxels pass, mean {:.2}",
                100.0 * found.passed,
                found.voxels,
                found.mean
            ),
            None => outln!("\nthe dose as given is zero everywhere: it is not compared"),
        }
        if let Some(factor) = other.factor {
            outln!(
                "the dose as given is nearest to this one when it is multiplied by {factor:.3}; monitor units are those of the machine file"
            );
        }
    }
}

/// The factor of `other` that brings it nearest to `own`, in least squares over voxels with at least `least` gray.
fn factor(own: &[f32], other: &[f32], least: f64) -> Option<f64> {
    let (mut product, mut square) = (0.0, 0.0);
    for (own, other) in own.iter().zip(other).filter(|(_, other)| f64::from(**other) >= least) {
        product += f64::from(*own) * f64::from(*other);
        square += f64::from(*other) * f64::from(*other);
    }
    (square > 0.0).then(|| product / square)
}
