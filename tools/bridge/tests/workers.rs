//! The time of a search for nine beams with no worker, one and two, in processes of their own on loopback.

use std::num::NonZeroUsize;
use std::process::Stdio;
use std::time::Instant;

use stillpoint_patient::case::neck;
use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, RingDoses, SearchOptions, Solver, choose};
use stillpoint_plan::dose::{BixelSpec, DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::Goals;
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::sampling::Sampling;
use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Build, ClientSettings, Pool, PoolDoses, PoolSetup, PoolSolver, answer};

use crate::bench::{two_ports, wait_for};
use crate::pool::{Ends, program};

const BEAMS: usize = 9;
/// Bixels of a coarse plan, so that a plan takes a minute, mm.
const BIXEL_MM: f64 = 15.0;
const GRID_MM: f64 = 5.0;
const SOLVES: usize = 96;
/// Leaves under way.
const LEAVES: NonZeroUsize = NonZeroUsize::new(32).unwrap();

struct Setup {
    engine: DoseEngine,
    goals: Goals,
    ring: Ring,
}

impl Setup {
    fn new() -> Self {
        let case = neck(0).unwrap();
        let sampling = Sampling::new(&case, GRID_MM, BIXEL_MM).unwrap();
        let over = DoseParams::over(case.grid(), GRID_MM);
        let params = DoseParams { grid: *sampling.grid(), bixels: BixelSpec::of_width(BIXEL_MM), ..over };
        let engine = DoseEngine::of_case(&case, Machine::shipped().unwrap(), params).unwrap();
        let goals = ObjectiveTable::shipped().unwrap().for_points(&case, &sampling).unwrap();
        let goals = goals.goals(1).unwrap();
        Self { engine: sampling.engine(&engine), goals, ring: Ring::new(90, 5).unwrap() }
    }

    /// All doses and a search, with the time that each took, s, and the plan's bytes.
    fn plan(&self, pool: Option<&mut Pool<ChildCourier>>) -> ([f64; 2], Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let engines = std::slice::from_ref(&self.engine);
        let beams: Vec<u16> = (0..self.ring.count()).collect();
        let load =
            |cache| RingDoses::load(cache, engines, self.ring, &beams, NonZeroUsize::MIN, || ()).unwrap();
        let begun = Instant::now();
        let Some(pool) = pool else {
            let doses = load(&DoseCache::in_folder(folder.path()).unwrap());
            let dosed = begun.elapsed().as_secs_f64();
            let plan = self.search(&doses, None);
            return ([dosed, begun.elapsed().as_secs_f64() - dosed], plan);
        };
        let angles: Vec<f64> = beams.iter().map(|beam| self.ring.angle_deg(*beam)).collect();
        let mut made = PoolDoses::in_folder(folder.path()).unwrap();
        made.fill(pool, engines, &angles, || ()).unwrap();
        let doses = load(made.cache());
        let dosed = begun.elapsed().as_secs_f64();
        let setup = PoolSetup::new(&doses, &self.goals, self.ring.count(), NonZeroUsize::MIN);
        let mut solver = PoolSolver::new(pool, &setup);
        let plan = self.search(&doses, Some(&mut solver));
        assert_eq!(solver.broken(), None);
        ([dosed, begun.elapsed().as_secs_f64() - dosed], plan)
    }

    fn search(&self, doses: &RingDoses, solver: Option<&mut dyn Solver>) -> Vec<u8> {
        let budget = Budget { solves: SOLVES };
        let evaluator = Evaluator::new(doses, &self.goals, self.ring, BEAMS, budget);
        let evaluator = match solver {
            Some(solver) => evaluator.with_solver(solver),
            None => evaluator,
        };
        let mut evaluator = evaluator.with_leaves(LEAVES);
        let method = Method::Search(SearchOptions::default());
        answer::of_plan(&choose(&method, &mut evaluator, None, 0).unwrap().best.plan)
    }
}

/// A plan with so many workers, whose caches are empty.
fn with(workers: usize, setup: &Setup) -> ([f64; 2], Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let endpoint = format!("tcp/127.0.0.1:{}", two_ports());
    let start = |number: usize| {
        let reach = if number == 0 { "--listen" } else { "--connect" };
        let (name, cache) = (format!("w{number}"), folder.path().join(number.to_string()));
        let arguments =
            ["worker", reach, &endpoint, "--slots", "1", "--name", &name, "--cache", cache.to_str().unwrap()];
        Ends(program(&arguments).stdout(Stdio::null()).spawn().unwrap())
    };
    let _workers: Vec<Ends> = (0..workers).map(start).collect();
    let courier = ChildCourier::start(program(&["plan-client", "--connect", &endpoint])).unwrap();
    let mut pool = Pool::new(courier, ClientSettings::new(Build::here().unwrap()));
    // Time begins when all workers have answered.
    let mut spare = PoolDoses::in_folder(&folder.path().join("spare")).unwrap();
    let mut round = 0;
    wait_for("all workers", || {
        round += 1;
        let angles: Vec<f64> = (0..4).map(|i| f64::from(round) * 0.01 + f64::from(i) * 0.001).collect();
        let engines = std::slice::from_ref(&setup.engine);
        spare.fill(&mut pool, engines, &angles, || ()).unwrap();
        (pool.workers().values().filter(|worker| worker.answered > 0).count() == workers).then_some(())
    });
    setup.plan(Some(&mut pool))
}

#[test]
#[ignore = "a measurement of four minutes: .ci/soak runs it"]
fn time_of_a_plan_with_no_worker_one_and_two() {
    let setup = Setup::new();
    let mut expected = None;
    for workers in 0..=2 {
        let ([doses, search], plan) = if workers == 0 { setup.plan(None) } else { with(workers, &setup) };
        eprintln!("{workers} workers: doses {doses:.2} s, search {search:.2} s, all {:.2} s", doses + search);
        assert!(*expected.get_or_insert_with(|| plan.clone()) == plan, "the plan depends on the workers");
    }
}
