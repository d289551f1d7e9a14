//! Planning on a pool of workers: the same plan, computed elsewhere.

use std::ffi::OsStr;
use std::path::Path;

use stillpoint_plan::dose::{DoseCache, DoseEngine};
use stillpoint_pool::pipe::ChildCourier;
use stillpoint_pool::{Build, ClientSettings, Pool, PoolDoses};

use crate::commands::bridge;
use crate::exit::Failure;

/// A pool, and the doses that it computed.
pub struct Pooled {
    /// The pool.
    pub pool: Pool<ChildCourier>,
    made: PoolDoses,
}

impl Pooled {
    /// The pool at this endpoint; a child process carries the messages, with the certificate that the
    /// arguments `tls` name.
    ///
    /// # Errors
    /// The child cannot be started.
    pub fn at(endpoint: &str, tls: &[&OsStr], patience_s: f64) -> Result<Self, Failure> {
        let mut command = bridge::command()?;
        command.args(["plan-client", "--connect", endpoint]).args(tls);
        let courier = ChildCourier::start(command)
            .map_err(|e| Failure::failed(format!("stillpoint-bridge cannot be started: {e}")))?;
        let mut settings = ClientSettings::new(Build::here().map_err(Failure::failed)?);
        settings.patience = (patience_s * 1e9) as u64;
        Ok(Self { pool: Pool::new(courier, settings), made: PoolDoses::default() })
    }

    /// Computes the doses that the folder lacks. `on_dose` is called for each. Where the pool cannot be used, the doses
    /// stay missing, and this process computes them.
    pub fn fill(
        &mut self,
        cache: &DoseCache,
        engines: &[DoseEngine],
        angles_deg: &[f64],
        on_dose: impl FnMut(),
    ) {
        if let Err(reason) = self.made.fill(&mut self.pool, cache, engines, angles_deg, on_dose) {
            errln!("pool: this process computes the doses that are missing: {reason}");
        }
    }

    /// Whether answers of a worker that was shut out are part of what was computed: then it must be computed again.
    /// Their doses are removed from the folder.
    ///
    /// # Errors
    /// The folder cannot be used.
    pub fn is_in_doubt(&mut self, folder: &Path, engines: &[DoseEngine]) -> Result<bool, Failure> {
        let tainted = self.pool.take_tainted();
        if tainted.is_empty() {
            return Ok(false);
        }
        let cache = DoseCache::in_folder(folder).map_err(Failure::failed)?;
        self.made.remove(&cache, engines, &tainted);
        Ok(true)
    }

    /// Tells on standard error what happened to workers.
    pub fn tell_news(&mut self) {
        for text in self.pool.take_news() {
            errln!("pool: {text}");
        }
    }

    /// Tells who computed.
    pub fn tell(&self) {
        let tally = self.pool.tally();
        outln!(
            "pool: {} calls by {} workers, {} by this process; {} answers compared, {} calls asked twice because they were late",
            tally.remote,
            self.pool.workers().values().filter(|worker| worker.answered > 0).count(),
            tally.local,
            tally.compared,
            tally.hedged
        );
    }
}
