//! Planning: cases, set-ups, doses of beams, the objective at any fluence, and plans.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use serde_json::json;
use stillpoint_patient::case::{Case, lung, neck, phantom, read};
use stillpoint_plan::dose::{CachedBeam, EngineName, Machine};
use stillpoint_plan::evaluation::OnGrid;
use stillpoint_plan::fluence::{Options, PlanProblem, solve_plan};
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::recipe::{PlanDoses, PlanEngine, PlanRequest, PlanSetup, PriorName, SetupSpec};
use stillpoint_plan::recompute::{Recompute, WeightedBeam};
use stillpoint_plan::threads::on_threads;
use stillpoint_plan::{ByRows as CompressedRows, Setups};

use crate::error::raise;
use crate::interrupt::interruptible;

/// Rows of a dose matrix, and the volume that each stands for.
type RowsAndVolumes<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>);

/// Steps of a histogram.
const STEPS: usize = 200;

/// A patient.
#[pyclass(frozen, name = "NativeCase", module = "stillpoint_rt._native")]
pub struct NativeCase {
    case: Case,
}

#[pymethods]
impl NativeCase {
    /// Reads a case file.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let case = py.detach(|| read(&path)).map_err(raise)?;
        Ok(Self { case })
    }

    /// The synthetic patient of a seed: `pelvis`, `neck` or `lung`.
    #[staticmethod]
    fn phantom(py: Python<'_>, seed: u64, site: &str) -> PyResult<Self> {
        let case = match site {
            "pelvis" => py.detach(|| phantom(seed)),
            "neck" => py.detach(|| neck(seed)),
            "lung" => py.detach(|| lung(seed)),
            other => return Err(raise(format!("invalid site: {other} (allowed: pelvis, neck, lung)"))),
        };
        Ok(Self { case: case.map_err(raise)? })
    }

    /// Name, grid, structures and prescription, as JSON.
    fn about(&self) -> String {
        let case = &self.case;
        let structure = |s: &stillpoint_patient::case::Structure| json!({ "name": s.name, "role": s.role.word(), "volume_cm3": case.volume_cm3(s) });
        let prescription: Vec<_> = case
            .prescription()
            .iter()
            .map(|p| json!({ "structure": p.structure, "dose_gy": p.dose_gy }))
            .collect();
        let grid = case.grid();
        json!({
            "name": case.name(), "provenance": case.provenance(), "fractions": case.fractions(),
            "counts": grid.counts, "spacing_mm": grid.spacing_mm, "origin_mm": grid.origin_mm,
            "isocentre_mm": case.isocentre_mm(), "prescription": prescription,
            "structures": case.structures().iter().map(structure).collect::<Vec<_>>(),
        })
        .to_string()
    }

    /// Hounsfield units of the image; x runs fastest.
    fn hu<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i16>> {
        self.case.hu().to_vec().into_pyarray(py)
    }

    /// Whether each voxel of the image is in a structure; x runs fastest.
    fn mask<'py>(&self, py: Python<'py>, structure: &str) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let names = || self.case.structures().iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ");
        let found = self.case.structure(structure);
        let found = found
            .ok_or_else(|| raise(format!("the case has no structure `{structure}`; it has {}", names())))?;
        let mut inside = vec![false; self.case.grid().len()];
        found.mask.indices().for_each(|voxel| inside[voxel] = true);
        Ok(inside.into_pyarray(py))
    }
}

/// A case made ready for plans.
#[pyclass(frozen, name = "NativeSetup", module = "stillpoint_rt._native")]
pub struct NativeSetup {
    setup: Arc<PlanSetup>,
    threads: NonZeroUsize,
}

/// Gantry angles, the weights of all bixels, the cost, and the sets of angles that were solved with their costs.
type Planned<'py> = (Vec<f64>, Bound<'py, PyArray1<f64>>, f64, Vec<(Vec<f64>, f64)>);

#[pymethods]
impl NativeSetup {
    /// Makes a case ready. `objectives` is a table as JSON, followed by the one that comes with stillpoint where `shipped`;
    /// `threads` changes no result.
    #[new]
    #[pyo3(signature = (case, grid_mm, bixel_mm, objectives, shipped, angles, machine, engine, threads))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        case: &NativeCase,
        grid_mm: f64,
        bixel_mm: f64,
        objectives: Option<&str>,
        shipped: bool,
        angles: u16,
        machine: Option<PathBuf>,
        engine: &str,
        threads: usize,
    ) -> PyResult<Self> {
        let own = objectives.map(ObjectiveTable::parse).transpose().map_err(raise)?.unwrap_or_default();
        let usual = SetupSpec::shipped().map_err(raise)?;
        let machine = match machine {
            Some(path) => {
                let text =
                    std::fs::read_to_string(&path).map_err(|e| raise(format!("{}: {e}", path.display())))?;
                Machine::from_json(&text).map_err(|e| raise(format!("{}: {e}", path.display())))?
            }
            None => usual.machine.clone(),
        };
        // The doses are in the caller's hands, so one method makes all of them.
        let engine = match engine.parse::<EngineName>().map_err(raise)? {
            EngineName::Pencil => PlanEngine::Pencil,
            EngineName::Superposition => PlanEngine::Superposition,
        };
        let spec = SetupSpec {
            engine,
            objectives: if shipped { own.before(usual.objectives.clone()) } else { own },
            ring: SetupSpec::ring_of(angles).map_err(raise)?,
            grid_mm,
            bixel_mm,
            machine,
            ..usual
        };
        let case = case.case.clone();
        let setup = py.detach(|| PlanSetup::new(case, spec)).map_err(raise)?;
        let threads = NonZeroUsize::new(threads).unwrap_or(NonZeroUsize::MIN);
        Ok(Self { setup: Arc::new(setup), threads })
    }

    /// Points, notes and objectives, as JSON.
    fn about(&self) -> PyResult<String> {
        let setup = &self.setup;
        let mut structures = Vec::new();
        for structure in &setup.objective_set.structures {
            let objectives: Result<Vec<_>, _> =
                structure.objectives.iter().map(serde_json::to_value).collect();
            structures.push(json!({
                "structure": structure.name, "rows": structure.voxels.len(), "objectives": objectives.map_err(raise)?,
            }));
        }
        let mut notes = setup.objective_set.notes.clone();
        if setup.engine_name() == EngineName::Pencil {
            let beams: Vec<u16> = (0..setup.directions.ring().count()).collect();
            notes.extend(setup.low_density_of(&beams).map_err(raise)?.caution());
        }
        let about = json!({
            "rows": setup.engine().rows(), "points_mm": setup.points_mm(), "prescribed_gy": setup.prescribed_gy(),
            "notes": notes, "structures": structures,
        });
        Ok(about.to_string())
    }

    /// Rows of dose matrices that are points of a structure with objectives, and the volume that each stands for.
    fn rows_of<'py>(&self, py: Python<'py>, structure: &str) -> PyResult<RowsAndVolumes<'py>> {
        let all = &self.setup.objective_set.structures;
        let found = all.iter().find(|s| s.name == structure).ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|s| s.name.as_str()).collect();
            raise(format!(
                "no objectives for a structure `{structure}`; there are some for {}",
                names.join(", ")
            ))
        })?;
        let volumes = match found.volumes.is_empty() {
            true => vec![1.0; found.voxels.len()],
            false => found.volumes.clone(),
        };
        Ok((found.voxels.clone().into_pyarray(py), volumes.into_pyarray(py)))
    }

    /// The doses of beams at these gantry angles, degrees.
    fn beams(&self, py: Python<'_>, angles_deg: Vec<f64>) -> PyResult<NativeBeams> {
        if angles_deg.is_empty() {
            return Err(raise("no gantry angle is given: give at least one, degrees"));
        }
        let (setup, threads) = (self.setup.clone(), self.threads);
        py.detach(|| {
            let of = |deg: &f64| CachedBeam::computed(setup.engine(), *deg);
            let beams = on_threads(&angles_deg, threads, of).map_err(raise)?;
            let matrices: Vec<Setups<'_>> =
                beams.iter().map(|b| Setups::from(b.beam.dose()).placed(b.beam.bixels_mm())).collect();
            let problem = setup.goals.problem(&matrices).map_err(raise)?.on_threads(threads);
            drop(matrices);
            Ok(NativeBeams { setup: setup.clone(), beams, problem, threads })
        })
    }

    /// A plan of a shipped search over the angles of the ring.
    #[pyo3(signature = (method, beams, budget, seed, priors))]
    fn plan<'py>(
        &self,
        py: Python<'py>,
        method: &str,
        beams: usize,
        budget: Option<usize>,
        seed: u64,
        priors: Vec<String>,
    ) -> PyResult<Planned<'py>> {
        let request = PlanRequest { beams, ..PlanRequest::of_method(method.parse().map_err(raise)?) };
        let priors: Result<Vec<PriorName>, _> = priors.iter().map(|name| name.parse()).collect();
        let priors = priors.map_err(raise)?;
        let request = PlanRequest {
            budget: budget.unwrap_or(request.budget),
            priors: if priors.is_empty() { request.priors.clone() } else { priors },
            seed,
            threads: self.threads,
            ..request
        };
        let setup = &self.setup;
        let search = request.check(&setup.case, setup.directions.clone()).map_err(raise)?;
        let run = interruptible(py, |_| {
            let doses = PlanDoses::compute(setup, &search.needed_beams(), search.threads).map_err(raise)?;
            let run = search.run(search.evaluator(setup, &doses, None)).map_err(raise)?;
            search.settle(setup, doses, run).map(|(_, run)| run).map_err(raise)
        })??;
        let best = &run.choice.best;
        let history =
            run.history.iter().map(|step| (setup.angles_deg(step.beams.beams()), step.cost)).collect();
        let weights = best.plan.weights.clone().into_pyarray(py);
        Ok((setup.angles_deg(best.beams.beams()), weights, best.cost, history))
    }
}

/// The doses of some beams, and the objective of their fluence.
#[pyclass(frozen, name = "NativeBeams", module = "stillpoint_rt._native")]
pub struct NativeBeams {
    setup: Arc<PlanSetup>,
    beams: Vec<CachedBeam>,
    problem: PlanProblem,
    threads: NonZeroUsize,
}

/// Row starts, columns and values of a matrix by rows.
type ByRows<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i32>>, Bound<'py, PyArray1<f32>>);

#[pymethods]
impl NativeBeams {
    /// The dose matrix by rows: points of the set-up by bixels of all beams, gray per unit weight.
    fn dose<'py>(&self, py: Python<'py>) -> ByRows<'py> {
        let CompressedRows { starts, columns, values } = py.detach(|| self.by_rows());
        (starts.into_pyarray(py), columns.into_pyarray(py), values.into_pyarray(py))
    }

    /// For each bixel the number of its beam, and x and z of its centre on the isocentre plane, mm, one after the other.
    fn bixels<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>) {
        let (mut beams, mut places) = (Vec::new(), Vec::new());
        for (number, beam) in self.beams.iter().enumerate() {
            for [x, z] in beam.beam.bixels_mm() {
                beams.push(number as u32);
                places.extend([*x, *z]);
            }
        }
        (beams.into_pyarray(py), places.into_pyarray(py))
    }

    /// The objective at weights, and its slope in each.
    fn value<'py>(
        &self,
        py: Python<'py>,
        weights: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        let weights = weights.to_vec()?;
        let found = py.detach(|| self.problem.value(&weights)).map_err(raise)?;
        Ok((found.cost, found.slope.into_pyarray(py)))
    }

    /// The weights that the shipped solver finds, and the part of the objective by which a better plan could be below it.
    fn solve<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyArray1<f64>>, f64)> {
        let plan =
            interruptible(py, |_| solve_plan(&self.problem, None, Options::default()))?.map_err(raise)?;
        Ok((plan.weights.into_pyarray(py), plan.certificate.relative_excess()))
    }

    /// What weights give, of a dose that is computed again on a finer grid: figures and histograms as JSON, and the dose,
    /// gray; x runs fastest.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        weights: PyReadonlyArray1<'py, f64>,
        volumes_at_gy: Vec<f64>,
        grid_mm: Option<f64>,
    ) -> PyResult<(String, Bound<'py, PyArray1<f32>>)> {
        let weights = weights.to_vec()?;
        let (json, gray) = py.detach(|| self.evaluated(&weights, &volumes_at_gy, grid_mm))?;
        Ok((json, gray.into_pyarray(py)))
    }
}

impl NativeBeams {
    fn by_rows(&self) -> CompressedRows {
        let matrices: Vec<Setups<'_>> = self.beams.iter().map(|b| Setups::from(b.beam.dose())).collect();
        CompressedRows::of(&matrices)
    }

    fn evaluated(
        &self,
        weights: &[f64],
        volumes_at_gy: &[f64],
        grid_mm: Option<f64>,
    ) -> PyResult<(String, Vec<f32>)> {
        let setup = &self.setup;
        let (found, expected) = (weights.len(), self.problem.bixels());
        if found != expected {
            return Err(raise(format!("{found} weights are given for {expected} bixels: give one for each")));
        }
        let (machine, params) = (setup.spec.machine.clone(), setup.engine().params());
        let recompute = match grid_mm {
            None => Recompute::new(&setup.case, machine, params, setup.points_mm()),
            Some(spacing_mm) => Recompute::with_spacing(&setup.case, machine, params, spacing_mm),
        };
        let recompute = recompute.map_err(raise)?;
        let mut weighted = Vec::new();
        let mut rest = weights;
        for beam in &self.beams {
            let (own, behind) = rest.split_at(beam.beam.bixels_mm().len());
            weighted.push(WeightedBeam { angles: beam.beam.angles(), weights: own, bixels_mm: None });
            rest = behind;
        }
        let gray = recompute.dose(&weighted, [0.0; 3], self.threads).map_err(raise)?;
        let grid = recompute.grid();
        let given = OnGrid::new(&setup.case, grid).evaluate(&gray);
        let most = gray.iter().copied().fold(0.0, f32::max);
        let histograms: Vec<_> = given
            .histograms
            .iter()
            .map(|(structure, dvh)| json!({ "structure": structure.name, "curve": dvh.curve(f64::from(most), STEPS) }))
            .collect();
        let json = json!({
            "figures": given.figures(volumes_at_gy), "fall_off": given.fall_off, "histograms": histograms,
            "counts": grid.counts, "spacing_mm": grid.spacing_mm, "origin_mm": grid.origin_mm,
        });
        Ok((json.to_string(), gray))
    }
}
