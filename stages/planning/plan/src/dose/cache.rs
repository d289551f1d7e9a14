//! Doses kept on disk, so that the same beam is computed once.

use super::angles::BeamAngles;
use super::engine::DoseEngine;
use super::error::DoseError;
use super::file::{self, BeamFile, BeamFileError, Key};
use super::machine::{MachineFile, PencilsOf};
use super::name::EngineName;
use super::pending::Pending;
use crate::threads::on_threads;
use sha2::{Digest, Sha256};
use std::io::ErrorKind;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// A folder of doses by beam. A file's name is the hash of all that its dose depends on.
#[derive(Clone, Debug)]
pub struct DoseCache {
    folder: PathBuf,
    /// Where doses go that others computed.
    pending: Option<Arc<Pending>>,
}

/// A beam from the cache.
#[derive(Debug)]
pub struct CachedBeam {
    /// The beam's dose.
    pub beam: BeamFile,
    /// How it came there.
    pub origin: Origin,
}

/// How a beam came to be in the cache.
#[derive(Debug)]
pub enum Origin {
    /// It was there.
    Found,
    /// It was computed.
    Computed,
    /// A file was there that could not be used; the dose was computed again. Worth a word to the user.
    Replaced(BeamFileError),
}

/// Why the cache gives no dose.
#[derive(Debug, Error)]
pub enum CacheError {
    /// The dose cannot be computed.
    #[error(transparent)]
    Dose(#[from] DoseError),
    /// The folder or a file cannot be written.
    #[error("the dose cache cannot write {}: {source}; give another folder, or make room", path.display())]
    Write {
        /// Which file or folder.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// What was just written cannot be read.
    #[error("the dose cache cannot use {}, which it has just written: {source}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// The underlying error.
        source: BeamFileError,
    },
    /// What was just computed in memory cannot be used.
    #[error("a dose that was just computed cannot be used: {0}")]
    Memory(BeamFileError),
}

impl DoseCache {
    /// The cache in a folder, which is made if it is not there.
    pub fn in_folder(folder: &Path) -> Result<Self, CacheError> {
        match std::fs::create_dir_all(folder) {
            Ok(()) => Ok(Self { folder: folder.to_owned(), pending: None }),
            Err(source) => Err(CacheError::Write { path: folder.to_owned(), source }),
        }
    }

    /// The cache in a folder, where doses that others compute are apart ([`Self::put`]): only this cache finds them, until
    /// [`Self::adopt`]. They are removed with the last clone of the cache, and if the process is killed, they never count.
    pub fn with_pending(folder: &Path) -> Result<Self, CacheError> {
        let cache = Self::in_folder(folder)?;
        match Pending::within(folder) {
            Ok(pending) => Ok(Self { pending: Some(Arc::new(pending)), ..cache }),
            Err(source) => Err(CacheError::Write { path: cache.folder, source }),
        }
    }

    /// Makes the doses that others computed part of the folder: they are in no doubt any more.
    ///
    /// # Errors
    /// A file cannot be moved.
    pub fn adopt(&self) -> Result<(), CacheError> {
        let Some(pending) = &self.pending else { return Ok(()) };
        pending
            .adopt(&self.folder)
            .map_err(|source| CacheError::Write { path: pending.folder().to_owned(), source })
    }

    /// The dose of one beam: from the folder, or computed and put there.
    pub fn beam(&self, engine: &DoseEngine, angles: impl Into<BeamAngles>) -> Result<CachedBeam, CacheError> {
        self.beam_of(engine, &engine_key(engine), angles.into())
    }

    /// The doses of several beams, those that are not there computed on several threads.
    pub fn beams(
        &self,
        engine: &DoseEngine,
        angles: &[impl Into<BeamAngles> + Copy + Sync],
        threads: NonZeroUsize,
    ) -> Result<Vec<CachedBeam>, CacheError> {
        self.beams_with(engine, angles, threads, || ())
    }

    /// The same; `on_beam` hears of each that is there.
    pub fn beams_with(
        &self,
        engine: &DoseEngine,
        angles: &[impl Into<BeamAngles> + Copy + Sync],
        threads: NonZeroUsize,
        on_beam: impl Fn() + Sync,
    ) -> Result<Vec<CachedBeam>, CacheError> {
        let key = engine_key(engine);
        on_threads(angles, threads, |&angles| {
            self.beam_of(engine, &key, angles.into()).inspect(|_| on_beam())
        })
    }

    /// Those of these angles whose doses the folder does not hold.
    pub fn missing(&self, engine: &DoseEngine, angles: &[impl Into<BeamAngles> + Copy]) -> Vec<BeamAngles> {
        let key = engine_key(engine);
        let angles = angles.iter().map(|angles| (*angles).into());
        let is_there = |angles: &BeamAngles| {
            let name = name(&beam_key(&key, *angles));
            self.folder.join(&name).exists() || self.others().join(&name).exists()
        };
        angles.filter(|angles| !is_there(angles)).collect()
    }

    /// Puts a dose that was computed elsewhere where such doses go: the bytes of [`DoseEngine::beam_file`].
    ///
    /// # Errors
    /// The file cannot be written, or it is not the dose of this engine and angle.
    pub fn put(
        &self,
        engine: &DoseEngine,
        angles: impl Into<BeamAngles>,
        bytes: &[u8],
    ) -> Result<(), CacheError> {
        let key = beam_key(&engine_key(engine), angles.into());
        let path = self.others().join(name(&key));
        stillpoint_map::publish_derived(&path, |file| std::io::Write::write_all(file, bytes))
            .map_err(|source| CacheError::Write { path: path.clone(), source })?;
        match BeamFile::open(&path, &key) {
            Ok(_) => Ok(()),
            Err(source) => {
                // A later look finds no file, or computes the dose again.
                let _ = std::fs::remove_file(&path);
                Err(CacheError::Read { path, source })
            }
        }
    }

    /// The file of a dose that was computed elsewhere, whether it is there or not. Who removes it has the dose computed again
    /// when it is needed.
    pub fn file(&self, engine: &DoseEngine, angles: impl Into<BeamAngles>) -> PathBuf {
        self.others().join(name(&beam_key(&engine_key(engine), angles.into())))
    }

    /// Where doses go that others computed.
    fn others(&self) -> &Path {
        self.pending.as_ref().map_or(&self.folder, |pending| pending.folder())
    }

    fn beam_of(
        &self,
        engine: &DoseEngine,
        engine_key: &Key,
        angles: BeamAngles,
    ) -> Result<CachedBeam, CacheError> {
        let key = beam_key(engine_key, angles);
        let path = self.folder.join(name(&key));
        let origin = match BeamFile::open(&path, &key) {
            Ok(beam) => return Ok(CachedBeam { beam, origin: Origin::Found }),
            Err(BeamFileError::File(fault)) if fault.kind() == ErrorKind::NotFound => Origin::Computed,
            Err(fault) => Origin::Replaced(fault),
        };
        if self.pending.is_some()
            && let Ok(beam) = BeamFile::open(&self.others().join(name(&key)), &key)
        {
            return Ok(CachedBeam { beam, origin: Origin::Found });
        }
        match file::write(&path, &key, &engine.beam_rows(angles)?) {
            Ok(()) => {}
            Err(source) => return Err(CacheError::Write { path, source }),
        }
        match BeamFile::open(&path, &key) {
            Ok(beam) => Ok(CachedBeam { beam, origin }),
            Err(source) => Err(CacheError::Read { path, source }),
        }
    }
}

/// Name of the file of a dose.
fn name(key: &Key) -> String {
    key.iter().map(|byte| format!("{byte:02x}")).collect::<String>() + ".dose"
}

impl CachedBeam {
    /// The dose of one beam, computed in memory.
    ///
    /// # Errors
    /// The dose cannot be computed.
    pub fn computed(engine: &DoseEngine, angles: impl Into<BeamAngles>) -> Result<Self, CacheError> {
        let angles = angles.into();
        let bytes = engine.beam_file(angles)?;
        let beam = engine.beam_of(angles, &bytes).map_err(CacheError::Memory)?;
        Ok(Self { beam, origin: Origin::Computed })
    }
}

impl DoseEngine {
    /// The dose of one beam as the file in which a [`DoseCache`] keeps it. The same engine and angle give the same bytes.
    ///
    /// # Errors
    /// The dose cannot be computed.
    pub fn beam_file(&self, angles: impl Into<BeamAngles>) -> Result<Vec<u8>, DoseError> {
        let angles = angles.into();
        let beam = self.beam_rows(angles)?;
        Ok(file::bytes(&beam_key(&engine_key(self), angles), &beam))
    }

    /// The dose of one beam in such a file that was computed here or elsewhere. The bytes are checked and copied.
    ///
    /// # Errors
    /// The bytes are not the dose of this engine and angle.
    pub fn beam_of(&self, angles: impl Into<BeamAngles>, bytes: &[u8]) -> Result<BeamFile, BeamFileError> {
        let angles = angles.into();
        let beam = BeamFile::of_bytes(bytes, &beam_key(&engine_key(self), angles))?;
        if file::same_bits(beam.angles(), angles) { Ok(beam) } else { Err(BeamFileError::Place) }
    }
}

/// Raised with every change that gives other doses for the same inputs.
const METHOD: &[u8] = b"stillpoint pencil beam 2";
/// The same for doses by superposition.
const SUPERPOSITION: &[u8] = b"stillpoint superposition 1";

/// Hash of everything that an engine's doses depend on.
fn engine_key(engine: &DoseEngine) -> Key {
    engine.key.get(|| new_key(engine))
}

fn new_key(engine: &DoseEngine) -> Key {
    // Every field is named, so that a new one is thought of here.
    let DoseEngine {
        machine,
        params,
        isocentre_mm,
        position,
        density,
        voxels,
        target_mm,
        outline,
        image_spacing_mm,
        samples,
        shift_mm,
        key: _,
    } = engine;
    let mut hash = Sha256::new();
    let mut part = |bytes: &[u8]| {
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    let is_pencil = params.engine == EngineName::Pencil;
    part(if is_pencil { METHOD } else { SUPERPOSITION });
    // Debug output of numbers is exact: the shortest text that reads back as the same number.
    // Doses of bixels are those of the open field: they do not depend on the leaves, nor on how fast these are, nor on where the
    // couch has room, nor on where kernels come from.
    let mut open = MachineFile {
        collimator: None,
        free_angles: None,
        arc: None,
        pencils_of: PencilsOf::Machine,
        ..machine.file().clone()
    };
    if is_pencil {
        open.superposition = None;
    }
    let text = format!("{open:?} {params:?} {isocentre_mm:?} {image_spacing_mm:?} {shift_mm:?}");
    // Pencil beams keep the names that they had before there was another method.
    let text = text.replace(", pencils_of: Machine }", " }").replace(", arc: None }", " }");
    let text = text.replace(", free_angles: None }", " }");
    let text = text.replace(", superposition: None }", " }").replace(", engine: Pencil }", " }");
    part(text.as_bytes());
    // The doses of patients who lie head first and supine keep the names of their files.
    if !position.is_default() {
        part(position.term().as_bytes());
    }
    part(zerocopy::IntoBytes::as_bytes(density.as_slice()));
    part(zerocopy::IntoBytes::as_bytes(voxels.as_slice()));
    part(zerocopy::IntoBytes::as_bytes(target_mm.as_slice()));
    part(format!("{:?}", outline.grid).as_bytes());
    part(&outline.inside.to_bytes());
    // Doses to all voxels keep the names that they had before there were samples.
    if let Some(samples) = samples {
        part(zerocopy::IntoBytes::as_bytes(samples.as_slice()));
    }
    hash.finalize().into()
}

fn beam_key(engine_key: &Key, angles: BeamAngles) -> Key {
    let mut hash = Sha256::new();
    hash.update(engine_key);
    hash.update(angles.gantry_deg.to_bits().to_le_bytes());
    // The doses of beams without a couch angle keep the names that they had before there was one.
    if !angles.is_coplanar() {
        hash.update(angles.couch_deg.to_bits().to_le_bytes());
    }
    hash.finalize().into()
}
