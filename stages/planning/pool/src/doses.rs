//! The doses of beams over the pool: what the cache lacks is computed by workers.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use stillpoint_plan::dose::{BeamAngles, BeamFile, CacheError, DoseCache, DoseEngine};

use crate::{Call, CallError, Courier, Hash, Home, Pool};

/// Doses that a pool computed for a cache. Only this process uses them until they are in no doubt ([`Self::adopt`]): a worker that
/// lies, and is not found because this process is killed before, leaves nothing in the folder.
pub struct PoolDoses {
    cache: DoseCache,
    /// The file of each call.
    made: BTreeMap<Hash, PathBuf>,
}

impl PoolDoses {
    /// For the cache in a folder.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn in_folder(folder: &Path) -> Result<Self, CacheError> {
        Ok(Self { cache: DoseCache::with_pending(folder)?, made: BTreeMap::new() })
    }

    /// The cache, with the doses of the pool.
    pub fn cache(&self) -> &DoseCache {
        &self.cache
    }

    /// Makes the doses part of the cache: all comparisons have been made, and none of these is in doubt.
    ///
    /// # Errors
    /// A file cannot be moved.
    pub fn adopt(&mut self) -> Result<(), CacheError> {
        self.made.clear();
        self.cache.adopt()
    }

    /// Computes what the cache lacks of these engines and angles. `on_dose` is called for each.
    ///
    /// # Errors
    /// A dose cannot be computed or written.
    pub fn fill<C: Courier>(
        &mut self,
        pool: &mut Pool<C>,
        engines: &[DoseEngine],
        angles: &[impl Into<BeamAngles> + Copy],
        mut on_dose: impl FnMut(),
    ) -> Result<(), CallError> {
        let cache = &self.cache;
        for engine in engines {
            let mut missing = cache.missing(engine, angles);
            while !missing.is_empty() {
                let bytes = engine.to_bytes().map_err(CallError::of)?;
                let name = Hash::of(&bytes);
                let calls: Vec<Call> = missing.iter().map(|angles| Call::dose(name, *angles)).collect();
                let home = Dosing { engine, name, bytes: &bytes, angles: &missing };
                pool.call_each(&calls, &home, |call, answer| {
                    match cache.put(engine, missing[call], answer) {
                        // What is no dose of this engine stays missing: this process computes it when it loads the doses.
                        Ok(()) | Err(CacheError::Read { .. }) => {
                            on_dose();
                            Ok(())
                        }
                        Err(e) => Err(CallError::of(e)),
                    }
                })?;
                let files = missing.iter().map(|angles| cache.file(engine, *angles));
                self.made.extend(calls.iter().map(|call| pool.key(call)).zip(files));
                let tainted = pool.take_tainted();
                remove(&mut self.made, &tainted);
                // Those in doubt are computed again; one worker fewer is asked each time.
                missing = if tainted.is_empty() { Vec::new() } else { cache.missing(engine, angles) };
            }
        }
        Ok(())
    }

    /// Removes doses that are in doubt.
    pub fn remove(&mut self, tainted: &BTreeSet<Hash>) {
        remove(&mut self.made, tainted);
    }
}

fn remove(made: &mut BTreeMap<Hash, PathBuf>, tainted: &BTreeSet<Hash>) {
    for file in tainted.iter().filter_map(|key| made.remove(key)) {
        // A file that cannot be removed is reported by whoever needs the folder next.
        let _ = std::fs::remove_file(file);
    }
}

struct Dosing<'a> {
    engine: &'a DoseEngine,
    name: Hash,
    bytes: &'a [u8],
    angles: &'a [BeamAngles],
}

impl Home for Dosing<'_> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        (*hash == self.name).then_some(self.bytes)
    }

    fn check(&self, call: usize, answer: &[u8]) -> Result<(), CallError> {
        // The rest is checked when it is put into the cache.
        BeamFile::check_bytes(answer, self.angles[call]).map_err(CallError::of)
    }

    fn compute(&self, call: usize) -> Result<Vec<u8>, CallError> {
        self.engine.beam_file(self.angles[call]).map_err(CallError::of)
    }
}
