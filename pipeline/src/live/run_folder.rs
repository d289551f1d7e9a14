//! Where a run is found by others (`echo`, `send`), and how what a dead run left is swept.
//!
//! Each run has a folder `<temp>/stillpoint-<uid>/<id>` with `lock` (held by the supervisor while it lives), `run.json`
//! and the root folder of its domain.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};

use crate::files::Snapshot;

/// Start of the name of a folder that is being made.
const MAKING: &str = ".";

/// The folder of a run that is going on.
pub struct RunFolder {
    path: PathBuf,
    _lock: File,
    prefix: String,
}

/// What others need to join a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunCard {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Process number of the supervisor.
    pub pid: u32,
    /// Text of the pipeline.
    pub source: String,
    /// Name of its file.
    pub file: String,
    /// `--set` overrides.
    pub sets: Vec<String>,
    /// The files that params name, as they were when the run began.
    pub files: Snapshot,
    /// Root folder of the domain.
    pub root: PathBuf,
    /// Prefix of the domain.
    pub prefix: String,
}

/// The folder of all runs of this user.
pub fn runs_folder() -> PathBuf {
    let user = rustix::process::getuid().as_raw();
    // Short: the paths of sockets below it may have 108 bytes.
    std::env::var_os("STILLPOINT_RUNS")
        .map_or_else(|| std::env::temp_dir().join(format!("stillpoint-{user}")), PathBuf::from)
}

impl RunFolder {
    /// Makes the folder of a new run.
    pub fn create() -> Result<Self, String> {
        let runs = runs_folder();
        let say = |path: &Path, e: std::io::Error| format!("{}: {e}", path.display());
        std::fs::DirBuilder::new().recursive(true).mode(0o700).create(&runs).map_err(|e| say(&runs, e))?;
        let start = crate::clock::realtime();
        for attempt in 0..100u64 {
            let id = format!(
                "{:08x}",
                (start / 1000 + attempt * 7919 + u64::from(std::process::id()) * 104_729) as u32
            );
            // Made and locked under a name that nobody sweeps, and then given its own: a run is never seen without its
            // lock.
            let (making, path) = (runs.join(format!("{MAKING}{id}")), runs.join(&id));
            if path.exists() || std::fs::DirBuilder::new().mode(0o700).create(&making).is_err() {
                continue;
            }
            let lock_path = making.join("lock");
            let lock = OpenOptions::new()
                .create(true)
                .truncate(false)
                .write(true)
                .mode(0o600)
                .open(&lock_path)
                .map_err(|e| say(&lock_path, e))?;
            flock(&lock, FlockOperation::NonBlockingLockExclusive)
                .map_err(|e| format!("{}: {e}", lock_path.display()))?;
            // A folder of that name is never empty, so this fails where there is one.
            if std::fs::rename(&making, &path).is_err() {
                let _ = std::fs::remove_dir_all(&making);
                continue;
            }
            return Ok(Self { path, _lock: lock, prefix: format!("sp_{id}_") });
        }
        Err(format!("{}: no free name for a run; remove what is old there", runs.display()))
    }

    /// Prefix of the run's domain.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Root folder of the run's domain.
    pub fn root(&self) -> PathBuf {
        self.path.join("d")
    }

    /// Folder of the files that params name.
    pub fn files(&self) -> PathBuf {
        self.path.join("f")
    }

    /// Writes what others need to join.
    pub fn publish(&self, card: &RunCard) -> Result<(), String> {
        let text = serde_json::to_vec_pretty(card).map_err(|e| e.to_string())?;
        let (draft, done) = (self.path.join("run.json.new"), self.path.join("run.json"));
        std::fs::write(&draft, text)
            .and_then(|()| std::fs::rename(&draft, &done))
            .map_err(|e| format!("{}: {e}", done.display()))
    }
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        stillpoint_shm::sweep(&self.root(), &self.prefix);
        let _ = std::fs::remove_dir_all(&self.path);
    }
}

/// Sweeps what dead runs of this user left. Says which were swept.
pub fn sweep_dead() -> Vec<String> {
    let mut swept = Vec::new();
    for (path, id) in folders() {
        let Ok(lock) = OpenOptions::new().write(true).open(path.join("lock")) else { continue };
        // Whoever holds the lock lives. A folder that is just being made has no lock yet, and is left alone.
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok() {
            stillpoint_shm::sweep(&path.join("d"), &format!("sp_{id}_"));
            let _ = std::fs::remove_dir_all(&path);
            swept.push(id);
        }
    }
    swept
}

/// Whether the run with this folder is going on: its supervisor holds the lock.
pub fn is_going_on(run: &Path) -> bool {
    let lock = OpenOptions::new().write(true).open(run.join("lock"));
    lock.is_ok_and(|l| flock(&l, FlockOperation::NonBlockingLockShared).is_err())
}

/// The cards of all runs that are going on, oldest process first.
pub fn going_on() -> Vec<RunCard> {
    let mut cards: Vec<RunCard> = folders()
        .into_iter()
        .filter(|(path, _)| is_going_on(path))
        .filter_map(|(path, _)| serde_json::from_slice(&std::fs::read(path.join("run.json")).ok()?).ok())
        .collect();
    cards.sort_by_key(|c| c.pid);
    cards
}

fn folders() -> Vec<(PathBuf, String)> {
    let Ok(entries) = std::fs::read_dir(runs_folder()) else { return Vec::new() };
    let mut found: Vec<_> =
        entries.flatten().map(|e| (e.path(), e.file_name().to_string_lossy().into_owned())).collect();
    found.retain(|(_, name)| !name.starts_with(MAKING));
    found.sort();
    found
}
