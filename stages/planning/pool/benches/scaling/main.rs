//! How a search for beams on the pool scales with the number of workers, in simulated time.
//!
//! `cargo bench -p stillpoint-pool --bench scaling -- CASE [KEY=NUMBER]...`, with the keys of [`Asked`]. The search,
//! the client and its messages are real. Each call is computed once, and its CPU time is the time that every simulated
//! worker takes for it. The CPU time of the client counts, too. Workers and network are those of `simulated`.
//!
//! The efficiency is the CPU time of all different calls, divided by the number of workers and by the time until the
//! plan is there.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod oracle;
mod simulated;

use std::cell::RefCell;
use std::num::NonZeroUsize;
use std::path::Path;
use std::rc::Rc;

use stillpoint_patient::case::read;
use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, RingDoses, SearchOptions, choose};
use stillpoint_plan::dose::{BixelSpec, DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::Goals;
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::sampling::Sampling;
use stillpoint_pool::{ClientSettings, Courier, Pool, PoolDoses, PoolSetup, PoolSolver, answer};

use oracle::{Oracle, build};
use simulated::{Network, Simulated};

const WORKERS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
const RING: (u16, u16) = (90, 5);

/// What is asked for.
struct Asked {
    /// Beams of a plan.
    beams: usize,
    /// Sets that are solved.
    budget: usize,
    /// Sets that the tree search solves together.
    leaves: usize,
    /// Width of a bixel, mm.
    bixel: f64,
    /// Bandwidth of each host's link, Mbit/s.
    mbit: f64,
    /// Time of a message from one host to another, us.
    delay: f64,
}

fn main() {
    let mut asked = Asked { beams: 9, budget: 128, leaves: 64, bixel: 10.0, mbit: 1000.0, delay: 500.0 };
    let mut case = None;
    for argument in std::env::args().skip(1).filter(|argument| argument != "--bench") {
        match argument.split_once('=') {
            Some((key, value)) => asked.set(key, value.parse().unwrap()),
            None => case = Some(argument),
        }
    }
    // CI builds and starts all benches without arguments.
    let Some(case) = case else { return println!("scaling: give a case file") };
    let setup = Setup::new(Path::new(&case), &asked);
    let oracle = Rc::new(RefCell::new(Oracle::new()));
    let network = Network { bits_per_s: asked.mbit * 1e6, delay: (asked.delay * 1e3) as u64 };
    println!("| workers | time, s | speed-up | efficiency | client, CPU s | sent by the client, MB |");
    println!("| --- | --- | --- | --- | --- | --- |");
    let mut first = None;
    for workers in WORKERS {
        let courier = Simulated::new(&oracle, network, workers);
        let mut pool = Pool::new(courier, ClientSettings::new(build()));
        let plan = setup.plan(&mut pool, &asked);
        assert!(
            first.get_or_insert_with(|| plan.clone()) == &plan,
            "the plan depends on the number of workers"
        );
        let time_s = pool.courier().now() as f64 * 1e-9;
        let work_s = oracle.borrow().seconds();
        println!(
            "| {workers} | {time_s:.1} | {:.1} | {:.2} | {:.1} | {:.0} |",
            work_s / time_s,
            work_s / time_s / workers as f64,
            pool.courier().client_s(),
            pool.courier().sent_mb(),
        );
        eprintln!("{:?}", pool.tally());
    }
    oracle.borrow().report();
}

impl Asked {
    fn set(&mut self, key: &str, value: f64) {
        match key {
            "beams" => self.beams = value as usize,
            "budget" => self.budget = value as usize,
            "leaves" => self.leaves = value as usize,
            "bixel" => self.bixel = value,
            "mbit" => self.mbit = value,
            "delay" => self.delay = value,
            other => panic!("{other}: the keys are beams, budget, leaves, bixel, mbit and delay"),
        }
    }
}

/// What the plan is made on, as `stillpoint plan` makes it.
struct Setup {
    engine: DoseEngine,
    goals: Goals,
    ring: Ring,
}

impl Setup {
    fn new(case: &Path, asked: &Asked) -> Self {
        let case = read(case).unwrap();
        let sampling = Sampling::new(&case, 5.0, asked.bixel).unwrap();
        let over = DoseParams::over(case.grid(), 5.0);
        let params = DoseParams { grid: *sampling.grid(), bixels: BixelSpec::of_width(asked.bixel), ..over };
        let engine = DoseEngine::of_case(&case, Machine::shipped().unwrap(), params).unwrap();
        let goals = ObjectiveTable::shipped().unwrap().for_points(&case, &sampling).unwrap();
        let goals = goals.goals(1).unwrap();
        Self { engine: sampling.engine(&engine), goals, ring: Ring::new(RING.0, RING.1).unwrap() }
    }

    /// Doses and search on the pool, in a folder without doses: every solve, and the best plan.
    fn plan(&self, pool: &mut Pool<Simulated>, asked: &Asked) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let cache = DoseCache::in_folder(folder.path()).unwrap();
        let engines = std::slice::from_ref(&self.engine);
        let beams: Vec<u16> = (0..self.ring.count()).collect();
        let angles: Vec<f64> = beams.iter().map(|beam| self.ring.angle_deg(*beam)).collect();
        PoolDoses::default().fill(pool, &cache, engines, &angles, || ()).unwrap();
        let doses = RingDoses::load(&cache, engines, self.ring, &beams, NonZeroUsize::MIN, || ()).unwrap();
        let setup = PoolSetup::new(&doses, &self.goals, self.ring.count());
        let mut solver = PoolSolver::new(pool, &setup);
        let budget = Budget { solves: asked.budget };
        let evaluator = Evaluator::new(&doses, &self.goals, self.ring, asked.beams, budget);
        let mut evaluator = evaluator.with_solver(&mut solver);
        // Without a number of leaves: exchange, one after the other.
        let leaves = NonZeroUsize::new(asked.leaves);
        evaluator = evaluator.with_leaves(leaves.unwrap_or(NonZeroUsize::MIN));
        let method = match leaves {
            None => Method::Exchange(Vec::new()),
            Some(_) => Method::Search(SearchOptions::default()),
        };
        let choice = choose(&method, &mut evaluator, None, 0).unwrap();
        let mut bytes = format!("{:?}", evaluator.history()).into_bytes();
        bytes.extend(answer::of_plan(&choice.best.plan));
        eprintln!("{} solves, {} prices, best {}", evaluator.solves(), evaluator.prices(), choice.best.cost);
        bytes
    }
}
