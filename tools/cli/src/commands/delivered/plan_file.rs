//! The beams of a plan folder: its segments if it has some, else its fluence.

use std::path::{Path, PathBuf};

use stillpoint_actuate::couch;
use stillpoint_patient::case::{Case, content_hash};
use stillpoint_plan::dose::{BeamAngles, BixelSpec, DoseParams};
use stillpoint_plan::leaves::{LeafBeam, Segment};
use stillpoint_plan::plan_file::{PlanFile, PlanFileBeam, PlanFileLeafBeam, PlanFileLeaves, PlanFileSegment};
use stillpoint_plan::recompute::{BeamFluence, Recompute};

use crate::commands::plan::machine_of;
use crate::exit::Failure;

/// Farthest place of a field from the axis of its beam, mm.
const MOST_MM: f64 = 500.0;

/// A plan, ready for its dose.
pub struct DeliveredPlan {
    /// The beams.
    pub beams: Vec<BeamFluence>,
    /// Fractions of the plan.
    pub fractions: u32,
    /// Monitor units of each beam in one fraction; `None` for a plan without segments.
    units: Option<Vec<f64>>,
    /// Its file.
    path: PathBuf,
    /// The engine of its dose.
    pub recompute: Recompute,
}

impl DeliveredPlan {
    /// Reads the plan of a case from its folder or its plan.json.
    pub fn read(
        path: &Path,
        case: &Case,
        machine: Option<&Path>,
        grid_mm: Option<f64>,
    ) -> Result<Self, Failure> {
        let path = if path.is_dir() { path.join("plan.json") } else { path.to_owned() };
        let fault = |e: &dyn std::fmt::Display| Failure::failed(format!("{}: {e}", path.display()));
        let bytes = std::fs::read(&path).map_err(|e| fault(&e))?;
        let plan = PlanFile::from_json(&bytes).map_err(|e| fault(&e))?;
        let hash = content_hash(case).map_err(Failure::failed)?.to_string();
        if plan.case.hash != hash {
            return Err(fault(&format!(
                "this plan is of the case {} ({}), and --case is {} ({hash}); give the case of the plan",
                plan.case.name,
                plan.case.hash,
                case.name()
            )));
        }
        if plan.arcs.is_some() {
            return Err(fault(
                &"this plan is of arcs, and the dose to a moving patient is computed for static beams alone: give a plan of \
                  static beams",
            ));
        }
        let machine = machine_of(machine)?;
        let file = machine.file();
        if file.energy_mv != plan.machine.energy_mv || file.provenance != plan.machine.provenance {
            return Err(fault(&format!(
                "this plan is for the machine \"{}\"; give its machine file with --machine",
                plan.machine.provenance
            )));
        }
        let fractions = plan.fractions.unwrap_or(1);
        let grid_mm = grid_mm.unwrap_or(plan.dose.grid.spacing_mm[0]);
        let params = DoseParams {
            bixels: BixelSpec::of_width(plan.dose.bixel_mm),
            cutoff_mm: plan.dose.cutoff_mm,
            engine: plan.dose.engine,
            ..DoseParams::over(case.grid(), grid_mm)
        };
        let collimator = machine.file().collimator.clone();
        let recompute = Recompute::with_spacing(case, machine, &params, grid_mm).map_err(|e| fault(&e))?;
        let beams = match &plan.leaves {
            Some(leaves) if Some(&leaves.collimator) != collimator.as_ref() => {
                return Err(fault(
                    &"the leaves of this plan are not those of the machine; give its machine file with --machine",
                ));
            }
            Some(leaves) => fluences(leaves, plan.dose.bixel_mm, fractions).map_err(|e| fault(&e))?,
            None => plan.beams.iter().map(fluence).collect(),
        };
        let is_near = |bixel: &[f64; 2]| bixel.iter().all(|mm| mm.abs() <= MOST_MM);
        let is_sound = |beam: &BeamFluence| {
            beam.weights.iter().all(|w| w.is_finite() && *w >= 0.0) && beam.bixels_mm.iter().all(is_near)
        };
        if beams.is_empty() || !beams.iter().all(is_sound) {
            return Err(fault(&format!(
                "the plan has no beam, a weight that is negative, or a bixel more than {MOST_MM} mm from the axis"
            )));
        }
        let units = |leaves: PlanFileLeaves| leaves.beams.iter().map(|beam| beam.monitor_units).collect();
        Ok(Self { recompute, fractions, units: plan.leaves.map(units), beams, path })
    }

    /// Leaves out all beams but these, which are named by their angles, such as `72@30,144@30`.
    pub fn choose(&mut self, angles: &str) -> Result<(), Failure> {
        let wrong = |why: &dyn std::fmt::Display| Failure::wrong(format!("--beams {angles}: {why}"));
        let mut chosen = Vec::new();
        for text in angles.split(',') {
            let named: BeamAngles = text.trim().parse().map_err(|e| wrong(&e))?;
            let found = self.beams.iter().position(|beam| is_same(beam.angles, named));
            let number = found.ok_or_else(|| {
                let all: Vec<String> = self.beams.iter().map(|beam| beam.angles.to_string()).collect();
                wrong(&format!("the plan has no beam at {named} (it has {})", all.join(", ")))
            })?;
            if chosen.contains(&number) {
                return Err(wrong(&format!("the beam at {named} is there twice")));
            }
            chosen.push(number);
        }
        chosen.sort_unstable();
        self.beams = chosen.iter().map(|number| self.beams[*number].clone()).collect();
        self.units = self.units.as_ref().map(|units| chosen.iter().map(|number| units[*number]).collect());
        Ok(())
    }

    /// Refuses beams at another couch angle than that of the session.
    pub fn check_couch(&self, couch_deg: f64) -> Result<(), Failure> {
        let is_turned =
            |beam: &&BeamFluence| !couch::is_same(beam.angles.couch_deg.to_radians(), couch_deg.to_radians());
        let Some(turned) = self.beams.iter().find(is_turned) else { return Ok(()) };
        Err(Failure::wrong(format!(
            "{}: the beam at gantry {} degrees is planned at the couch angle {} degrees, and the gate of the session states the \
             couch angle {couch_deg} degrees; choose the beams of this session with --beams",
            self.path.display(),
            turned.angles.gantry_deg,
            turned.angles.couch_deg
        )))
    }

    /// Monitor units of one fraction; `None` for a plan without segments.
    pub fn monitor_units(&self) -> Option<f64> {
        self.units.as_ref().map(|units| units.iter().sum())
    }
}

/// Whether a person who writes one angle means the other.
fn is_same(a: BeamAngles, b: BeamAngles) -> bool {
    let same = |a: f64, b: f64| couch::is_same(a.to_radians(), b.to_radians());
    same(a.gantry_deg, b.gantry_deg) && same(a.couch_deg, b.couch_deg)
}

fn fluence(beam: &PlanFileBeam) -> BeamFluence {
    let (bixels_mm, weights) = beam.bixels_x_z_mm_weight.iter().map(|[x, z, w]| ([*x, *z], *w)).unzip();
    BeamFluence { angles: beam.angles(), bixels_mm, weights }
}

/// Why the leaves of a plan cannot be those of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
enum LeavesFault {
    #[error("there is no leaf pair {0}")]
    Pair(usize),
    #[error("a field reaches more than {MOST_MM} mm from the axis")]
    Field,
}

/// What passes the leaves, in weights of all fractions.
fn fluences(leaves: &PlanFileLeaves, bixel_mm: f64, fractions: u32) -> Result<Vec<BeamFluence>, LeavesFault> {
    let weight_of_unit = f64::from(fractions) / leaves.collimator.mu_per_weight;
    let pairs = leaves.collimator.leaf_edges_mm.len().saturating_sub(1);
    let segment = |beam: &PlanFileLeafBeam, shape: &PlanFileSegment| {
        let over = leaves.collimator.over_travel_mm;
        let mut tips_mm = vec![[beam.field_x_z_mm[0][0].clamp(-over, over); 2]; pairs];
        for (pair, low, high) in &shape.open_pair_from_to_mm {
            let tips = tips_mm.get_mut(*pair).ok_or(LeavesFault::Pair(*pair))?;
            *tips = [*low, *high];
        }
        let field_mm = shape.field_x_z_mm.unwrap_or(beam.field_x_z_mm);
        Ok::<_, LeavesFault>(Segment { tips_mm, field_mm, weight: shape.monitor_units * weight_of_unit })
    };
    let fluence = |beam: &PlanFileLeafBeam| {
        let fields = beam.segments.iter().filter_map(|segment| segment.field_x_z_mm);
        if fields.chain([beam.field_x_z_mm]).flatten().flatten().any(|mm| mm.abs() > MOST_MM) {
            return Err(LeavesFault::Field);
        }
        let segments: Result<Vec<Segment>, LeavesFault> =
            beam.segments.iter().map(|shape| segment(beam, shape)).collect();
        let shaped = LeafBeam { field_mm: beam.field_x_z_mm, segments: segments? };
        let (bixels_mm, weights) = shaped.fluence(&leaves.collimator, bixel_mm);
        Ok(BeamFluence { angles: beam.angles(), bixels_mm, weights })
    };
    leaves.beams.iter().map(fluence).collect()
}
