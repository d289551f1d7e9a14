//! A small patient of water, his doses, and a search for his beams.

use std::num::NonZeroUsize;

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;
use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, RingDoses, SearchOptions, choose};
use stillpoint_plan::dose::{Anatomy, BixelSpec, DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::{Goals, MeanDose, Objective, Overdose, StructureObjectives, Underdose};
use stillpoint_pool::{Courier, Pool, PoolDoses, PoolSetup, PoolSolver, answer};

const SIDE: usize = 16;
const ANGLES: u16 = 18;

pub struct Water {
    pub engine: DoseEngine,
    pub goals: Goals,
}

pub fn ring() -> Ring {
    Ring::new(ANGLES, 2).unwrap()
}

pub fn angles() -> Vec<f64> {
    (0..ANGLES).map(|beam| ring().angle_deg(beam)).collect()
}

impl Water {
    pub fn new() -> Self {
        let grid = Grid { counts: [SIDE; 3], spacing_mm: [10.0; 3], origin_mm: [-75.0; 3] };
        let within = |voxel: usize, middle: [f64; 3], mm: f64| {
            let at = grid.voxel(voxel).map(|i| -75.0 + 10.0 * i as f64);
            (0..3).map(|axis| (at[axis] - middle[axis]).powi(2)).sum::<f64>() <= mm * mm
        };
        let hu = vec![0; grid.len()];
        let anatomy = Anatomy {
            grid,
            hu: &hu,
            external: &Mask::from_fn(grid.len(), |voxel| within(voxel, [0.0; 3], 74.0)),
            target: &Mask::from_fn(grid.len(), |voxel| within(voxel, [5.0, 0.0, 0.0], 20.0)),
            isocentre_mm: [0.0; 3],
        };
        let params = DoseParams { grid, bixels: BixelSpec::of_width(15.0), ..DoseParams::over(&grid, 10.0) };
        let engine = DoseEngine::new(&anatomy, Machine::shipped().unwrap(), params).unwrap();
        let structure = |name: &str, middle, mm, objectives| StructureObjectives {
            name: name.into(),
            voxels: (0..grid.len() as u32).filter(|v| within(*v as usize, middle, mm)).collect(),
            volumes: Vec::new(),
            to_target_mm: Vec::new(),
            objectives,
        };
        let target = vec![
            Objective::Underdose(Underdose { dose: 60.0, weight: 200.0 }),
            Objective::Overdose(Overdose { dose: 63.0, weight: 100.0 }),
        ];
        let organ = vec![
            Objective::Overdose(Overdose { dose: 10.0, weight: 40.0 }),
            Objective::MeanDose(MeanDose { dose: 8.0, weight: 5.0 }),
        ];
        let requested = vec![
            structure("target", [5.0, 0.0, 0.0], 20.0, target),
            structure("organ", [5.0, 40.0, 0.0], 16.0, organ),
            structure(
                "body",
                [0.0; 3],
                74.0,
                vec![Objective::Overdose(Overdose { dose: 20.0, weight: 10.0 })],
            ),
        ];
        Self { engine, goals: Goals::new(requested, grid.len()).unwrap() }
    }
}

/// All that a search gives, as bytes: each solve with its cost and the prices until then, and the best plan.
pub fn plan_bytes(
    water: &Water,
    doses: &RingDoses,
    solver: Option<&mut dyn stillpoint_plan::beams::Solver>,
    leaves: usize,
) -> Vec<u8> {
    let evaluator = Evaluator::new(doses, &water.goals, ring(), 3, Budget { solves: 24 });
    let evaluator = evaluator.with_leaves(NonZeroUsize::new(leaves).unwrap());
    let mut evaluator = match solver {
        Some(solver) => evaluator.with_solver(solver),
        None => evaluator,
    };
    let method = match leaves {
        1 => Method::Exchange(Vec::new()),
        _ => Method::Search(SearchOptions::default()),
    };
    let choice = choose(&method, &mut evaluator, None, 3).unwrap();
    let history: Vec<String> = evaluator.history().iter().map(|progress| format!("{progress:?}")).collect();
    let mut bytes = history.join("\n").into_bytes();
    bytes.extend(format!("{:?}", choice.best.beams).into_bytes());
    bytes.extend(answer::of_plan(&choice.best.plan));
    bytes
}

/// Doses and plan of this process alone, with the bytes of all dose files.
pub fn alone(water: &Water) -> (Vec<u8>, Vec<Vec<u8>>) {
    alone_with(water, 1)
}

/// The same with so many leaves under way: by exchange with one, by search with more.
pub fn alone_with(water: &Water, leaves: usize) -> (Vec<u8>, Vec<Vec<u8>>) {
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let doses = load(water, &cache);
    (plan_bytes(water, &doses, None, leaves), files(&doses))
}

/// The same over a pool, again as long as answers are in doubt.
pub fn pooled<C: Courier>(water: &Water, pool: &mut Pool<C>) -> (Vec<u8>, Vec<Vec<u8>>) {
    pooled_with(water, pool, 1)
}

/// The same with so many leaves under way.
pub fn pooled_with<C: Courier>(water: &Water, pool: &mut Pool<C>, leaves: usize) -> (Vec<u8>, Vec<Vec<u8>>) {
    let folder = tempfile::tempdir().unwrap();
    let engines = [water.engine.clone()];
    let mut made = PoolDoses::in_folder(folder.path()).unwrap();
    loop {
        made.fill(pool, &engines, &angles(), || ()).unwrap();
        let doses = load(water, made.cache());
        let setup = PoolSetup::new(&doses, &water.goals, ANGLES, NonZeroUsize::MIN);
        let bytes = {
            let mut solver = PoolSolver::new(pool, &setup);
            let bytes = plan_bytes(water, &doses, Some(&mut solver), leaves);
            assert_eq!(solver.broken(), None);
            bytes
        };
        let tainted = pool.take_tainted();
        if tainted.is_empty() {
            return (bytes, files(&doses));
        }
        made.remove(&tainted);
    }
}

fn load(water: &Water, cache: &DoseCache) -> RingDoses {
    let beams: Vec<u16> = (0..ANGLES).collect();
    RingDoses::load(cache, std::slice::from_ref(&water.engine), ring(), &beams, NonZeroUsize::MIN, || ())
        .unwrap()
}

fn files(doses: &RingDoses) -> Vec<Vec<u8>> {
    (0..ANGLES)
        .flat_map(|beam| doses.files(beam).map(|file| file.bytes().to_vec()).collect::<Vec<_>>())
        .collect()
}
