//! Plans a patient from Rust: five beams by exchange for a case file, or for the phantom of a pelvis.
//!
//! `cargo run --release -p stillpoint-tests --example plan_a_case -- patient.case`

use std::error::Error;
use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::path::PathBuf;

use stillpoint_patient::case::{Case, phantom, read};
use stillpoint_plan::evaluation::{OnGrid, StructureDose};
use stillpoint_plan::recipe::{MethodName, PlanRequest, Planned, SetupSpec, plan};
use stillpoint_plan::recompute::{Recompute, WeightedBeam};

pub fn main() -> Result<(), Box<dyn Error>> {
    let case = match std::env::args_os().nth(1) {
        Some(path) => read(&PathBuf::from(path))?,
        None => phantom(0)?,
    };
    // No plan depends on the number of threads, so all cores may be used.
    let threads = std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    let request = PlanRequest { threads, ..PlanRequest::of_method(MethodName::Exchange) };
    let planned = planned(case, SetupSpec::shipped()?, &request)?;
    let mut out = io::stdout().lock();
    writeln!(out, "beams at {:?} degrees, cost {:.3}", planned.angles_deg(), planned.best().cost)?;
    for figures in doses(&planned, threads)? {
        let StructureDose { name, d95_gy, mean_gy, d003cc_gy, .. } = figures;
        writeln!(out, "{name:20} D95 {d95_gy:5.1} Gy, mean {mean_gy:5.1} Gy, D0.03cc {d003cc_gy:5.1} Gy")?;
    }
    Ok(())
}

/// The plan, which is known to be near the optimum of its beams.
pub fn planned(case: Case, spec: SetupSpec, request: &PlanRequest) -> Result<Planned, Box<dyn Error>> {
    let planned = plan(case, spec, request)?;
    // The certificate bounds how much cheaper any other fluence of these beams can be.
    let excess = planned.best().plan.certificate.relative_excess();
    if excess > 1e-3 {
        return Err(format!("the fluence may cost {:.2} % more than the optimum", 100.0 * excess).into());
    }
    Ok(planned)
}

/// The figures of each structure. The optimiser sees the dose at its own points alone, where it is always in the plan's
/// favour: so the dose is recomputed on a finer grid.
pub fn doses(planned: &Planned, threads: NonZeroUsize) -> Result<Vec<StructureDose>, Box<dyn Error>> {
    let (setup, best) = (&planned.setup, planned.best());
    let params = setup.engine().params();
    let recompute = Recompute::new(&setup.case, setup.spec.machine.clone(), params, setup.points_mm())?;
    let of_beam = |beam: &u16| WeightedBeam {
        angles: setup.directions.angles(*beam),
        weights: best.weights_of(*beam).unwrap_or_default(),
        bixels_mm: None,
    };
    let beams: Vec<WeightedBeam<'_>> = best.beams.beams().iter().map(of_beam).collect();
    let planned_position_mm = [0.0; 3];
    let gray = recompute.dose(&beams, planned_position_mm, threads)?;
    Ok(OnGrid::new(&setup.case, recompute.grid()).evaluate(&gray).figures(&[]))
}
