//! Planning on a pool of workers: the same plan, computed elsewhere.

use std::path::{Path, PathBuf};

use stillpoint_plan::dose::{BeamAngles, DoseCache, DoseEngine};
use stillpoint_plan::recipe::{MOST_LEAVES, PlanRun};
use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Pool, PoolDoses};

use crate::exit::Failure;
use crate::pool::print_shares;

/// Leaves beyond which a set of beams is chosen with too little knowledge: docs/results/beams.md.
const BEST_LEAVES: usize = 8;

/// A pool, and the doses that it computed.
pub struct Pooled {
    /// The pool.
    pub pool: Pool<ChildCourier>,
    made: PoolDoses,
    /// Where the calls go, if they are recorded.
    record: Option<PathBuf>,
}

impl Pooled {
    /// Of this pool, with the folder of doses. Its calls go into a file if one is given. The file is made here: a plan that took an hour is not lost
    /// because it cannot be written.
    pub fn new(mut pool: Pool<ChildCourier>, doses: &Path, record: Option<&Path>) -> Result<Self, Failure> {
        let made = PoolDoses::in_folder(doses).map_err(Failure::failed)?;
        if let Some(file) = record {
            write(file, "")?;
            pool.start_record();
        }
        Ok(Self { pool, made, record: record.map(Path::to_owned) })
    }

    /// Writes the calls into their file, if there is one.
    pub fn write_record(&mut self) -> Result<(), Failure> {
        let (Some(file), Some(record)) = (&self.record, self.pool.take_record()) else { return Ok(()) };
        write(file, &record.to_text())
    }

    /// Computes the doses that the folder lacks, and gives the cache that has them. `on_dose` is called for each. Where the pool
    /// cannot be used, the doses stay missing, and this process computes them.
    pub fn fill(
        &mut self,
        engines: &[DoseEngine],
        angles: &[BeamAngles],
        on_dose: impl FnMut(),
    ) -> DoseCache {
        if let Err(reason) = self.made.fill(&mut self.pool, engines, angles, on_dose) {
            errln!("pool: this process computes the doses that are missing: {reason}");
        }
        self.made.cache().clone()
    }

    /// Whether answers of a worker that was shut out are part of what was computed: then it must be computed again, without
    /// their doses.
    pub fn is_in_doubt(&mut self) -> bool {
        let tainted = self.pool.take_tainted();
        self.made.remove(&tainted);
        !tainted.is_empty()
    }

    /// Puts the doses of workers into the folder. Only what is in no doubt may be.
    pub fn adopt_doses(&mut self) -> Result<(), Failure> {
        self.made.adopt().map_err(Failure::failed)
    }

    /// Tells on standard error what happened to workers.
    pub fn print_news(&mut self) {
        for text in self.pool.take_news() {
            errln!("pool: {text}");
        }
    }

    /// Prints the shares of the workers, and whether the searches could use all of them.
    pub fn print_notes(&self, runs: &[PlanRun]) {
        print_shares(&self.pool);
        let slots: usize = self.pool.workers().values().map(|worker| worker.hello.slots as usize).sum();
        let leaves = runs.iter().map(|run| run.leaves.get()).max().unwrap_or(1);
        if slots > leaves && runs.iter().any(|run| run.name.looks_ahead()) {
            outln!(
                "pool: the search had at most {leaves} leaves under way for {slots} slots of workers; `--leaves {}` uses \
                 more of them, but more than {BEST_LEAVES} find worse beams with as many solves",
                slots.min(MOST_LEAVES)
            );
        }
    }
}

fn write(record: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(record, text).map_err(|e| {
        Failure::failed(format!("--pool-record {}: the calls cannot be written there: {e}", record.display()))
    })
}
