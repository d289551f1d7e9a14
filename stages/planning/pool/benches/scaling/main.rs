//! How a search for beams on the pool scales with the number of workers, in simulated time.
//!
//! `cargo bench -p stillpoint-pool --bench scaling -- CASE [KEY=NUMBER]... [record=FILE]`, with the keys of [`Asked`]. The
//! search, the client and one worker run in this thread, and their times are CPU times of it: other programs do not change
//! them. From the calls that they record, the simulation of `stillpoint bench pool` computes the times of other numbers of
//! workers. A plan by exchange has `leaves=0`.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod inside;

use std::num::NonZeroUsize;
use std::path::Path;

use stillpoint_patient::case::read;
use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, RingDoses, SearchOptions, choose};
use stillpoint_plan::dose::{BixelSpec, DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::Goals;
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::sampling::Sampling;
use stillpoint_pool::{ClientSettings, Network, Pool, PoolDoses, PoolSetup, PoolSolver, Simulation};

use inside::{Inside, build};

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
    /// File for the calls.
    record: Option<String>,
}

fn main() {
    let mut asked =
        Asked { beams: 9, budget: 128, leaves: 64, bixel: 10.0, mbit: 1000.0, delay: 500.0, record: None };
    let mut case = None;
    for argument in std::env::args().skip(1).filter(|argument| argument != "--bench") {
        match argument.split_once('=') {
            Some(("record", file)) => asked.record = Some(file.to_owned()),
            Some((key, value)) => asked.set(key, value.parse().unwrap()),
            None => case = Some(argument),
        }
    }
    // CI builds and starts all benches without arguments.
    let Some(case) = case else { return println!("scaling: give a case file") };
    let setup = Setup::new(Path::new(&case), &asked);
    let mut pool = Pool::new(Inside::new(), ClientSettings { checked: 0.0, ..ClientSettings::new(build()) });
    pool.start_record();
    setup.plan(&mut pool, &asked);
    let record = pool.take_record().unwrap();
    if let Some(file) = &asked.record {
        std::fs::write(file, record.to_text()).unwrap();
    }
    let network = Network { bits_per_s: asked.mbit * 1e6, delay: (asked.delay * 1e3) as u64 };
    println!("{} calls, {:.1} CPU s of computation", record.calls.len(), record.work_s());
    println!("| workers | time, s | efficiency | sent by the client, MB |\n| --- | --- | --- | --- |");
    for workers in WORKERS {
        let outcome = Simulation { workers, network }.run(&[&record]).unwrap();
        let (time_s, efficiency, sent_mb) =
            (outcome.seconds, outcome.efficiency(), outcome.sent as f64 * 1e-6);
        println!("| {workers} | {time_s:.1} | {efficiency:.2} | {sent_mb:.0} |");
    }
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

    /// Doses and search on the pool, in a folder without doses: the best plan.
    fn plan(&self, pool: &mut Pool<Inside>, asked: &Asked) {
        let folder = tempfile::tempdir().unwrap();
        let mut made = PoolDoses::in_folder(folder.path()).unwrap();
        let engines = std::slice::from_ref(&self.engine);
        let beams: Vec<u16> = (0..self.ring.count()).collect();
        let angles: Vec<f64> = beams.iter().map(|beam| self.ring.angle_deg(*beam)).collect();
        made.fill(pool, engines, &angles, || ()).unwrap();
        let doses =
            RingDoses::load(made.cache(), engines, self.ring, &beams, NonZeroUsize::MIN, || ()).unwrap();
        let setup = PoolSetup::new(&doses, &self.goals, self.ring.count(), NonZeroUsize::MIN);
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
        eprintln!("{} solves, {} prices, best {}", evaluator.solves(), evaluator.prices(), choice.best.cost);
    }
}
