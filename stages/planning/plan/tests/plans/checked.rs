//! The plan check on a head and neck, where bixels at the edge of the patient once carried the plan.

use std::num::NonZeroUsize;

use stillpoint_patient::case::neck;
use stillpoint_plan::check::{Checked, Fault};
use stillpoint_plan::dose::{FreeRange, Machine, MachineFile};
use stillpoint_plan::evaluation::OnGrid;
use stillpoint_plan::evaluation::StructureDose;
use stillpoint_plan::recipe::{Delivery, PlanEngine, PlanRequest, Planned, SetupSpec, plan};
use stillpoint_plan::recompute::{BeamFluence, Recompute};

const THREADS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(1);

fn planned() -> Planned {
    let request =
        PlanRequest { threads: THREADS, ..PlanRequest::of_angles(vec![0.0, 72.0, 144.0, 216.0, 288.0]) };
    let spec = SetupSpec { engine: PlanEngine::Pencil, ..SetupSpec::shipped().unwrap() };
    plan(neck(0).unwrap(), spec, &request).unwrap()
}

fn fluences(planned: &Planned) -> Vec<BeamFluence> {
    let best = planned.best();
    let fluence = |beam: &u16| BeamFluence {
        angles: planned.setup.directions.angles(*beam),
        bixels_mm: planned.doses.solved.bixels_mm(*beam).to_vec(),
        weights: best.weights_of(*beam).unwrap().to_vec(),
    };
    best.beams.beams().iter().map(fluence).collect()
}

fn targets(planned: &Planned, fluences: &[BeamFluence]) -> Vec<StructureDose> {
    let setup = &planned.setup;
    let (machine, params) = (setup.spec.machine.clone(), setup.engine().params());
    let recompute = Recompute::with_spacing(&setup.case, machine, params, 4.0).unwrap();
    let gray = recompute.dose(&BeamFluence::weighted(fluences), [0.0; 3], THREADS).unwrap();
    let mut figures = OnGrid::new(&setup.case, recompute.grid()).evaluate(&gray).figures(&[]);
    figures.retain(|f| f.covered.is_some());
    figures
}

#[test]
fn no_bixel_carries_a_neck_its_targets_are_covered_and_a_spoilt_fluence_is_refused() {
    let planned = planned();
    let good = fluences(&planned);
    let check = |fluences: &[BeamFluence], monitor_units: Option<f64>| -> Checked {
        let delivery = Delivery { planned: fluences, delivered: fluences, monitor_units, moved_mm: [0.0; 3] };
        planned.setup.check(&delivery, THREADS).unwrap()
    };
    let Checked { values, faults, .. } = check(&good, None);
    assert_eq!(faults, []);
    assert!(values.medians < 10.0 && values.outside < 0.05 && values.mu_per_cgy.is_none(), "{values:?}");
    for target in targets(&planned, &good) {
        assert!(target.covered.unwrap() > 0.9, "{}: {:?}", target.name, target.covered);
    }
    // A bixel of 174 medians, as one beside the patient had when kernels ignored the air.
    let mut spoilt = good.clone();
    let mut lit: Vec<f64> = spoilt[0].weights.iter().copied().filter(|weight| *weight > 0.0).collect();
    lit.sort_by(f64::total_cmp);
    spoilt[0].weights[0] = 174.0 * lit[lit.len() / 2];
    let found = check(&spoilt, Some(1e5));
    assert!((found.values.medians - 174.0).abs() < 5.0, "{:?}", found.values);
    assert!(
        found.faults.iter().any(|fault| matches!(fault, Fault::Peak { angles, .. } if *angles == 0.0.into()))
    );
    assert!(found.faults.iter().any(|fault| matches!(fault, Fault::Units { .. })));
    // Fluence that comes in when the patient moves: the same weight just beside him.
    let mut neighbour = good.clone();
    let edge = neighbour[0].bixels_mm.iter().map(|[x, _]| *x).fold(0.0, f64::max);
    let weight: f64 = neighbour[0].weights.iter().sum();
    neighbour[0].bixels_mm.push([edge + 60.0, 0.0]);
    neighbour[0].weights.push(weight);
    let found = check(&neighbour, None);
    assert!(found.values.outside > 0.1, "{:?}", found.values);
    assert!(matches!(found.faults[0], Fault::Outside { .. }), "{:?}", found.faults);
    // On a machine whose couch is in the way from below, one beam is closed.
    let mut planned = planned;
    let free = FreeRange { couch_deg: [-5.0, 5.0], gantry_deg: [200.0, 100.0] };
    let file = MachineFile { free_angles: Some(vec![free]), ..planned.setup.spec.machine.file().clone() };
    planned.setup.spec.machine = Machine::new(file).unwrap();
    let delivery = Delivery { planned: &good, delivered: &good, monitor_units: None, moved_mm: [0.0; 3] };
    let found = planned.setup.check(&delivery, THREADS).unwrap();
    assert_eq!(found.faults, [Fault::Closed { angles: vec![144.0.into()] }]);
}
