//! The folder of a run, by which other programs (`echo`, `send`) find it, and the sweep of what dead runs left.
//!
//! Each run has a folder `<temp>/stillpoint-<uid>/<id>` with `lock` (held by the supervisor while it lives), `children`
//! (held by all its other processes together), `run.json`, `changes.json` and the root folder of its domain.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};

use crate::clock::SessionClock;
use crate::files::Snapshot;
use crate::settings::TakenChange;

/// Start of the name of a folder that is being made.
const MAKING: &str = ".";

/// In the folder of a run: the changes of parameters that its operators took.
const CHANGES: &str = "changes.json";
/// In the folder of a run: held by its supervisor.
const LOCK: &str = "lock";
/// In the folder of a run: held by its other processes together. They may outlive the supervisor.
const CHILDREN: &str = "children";
/// Bytes that the path of the folder of all runs may have. A socket's may have 107; below the folder stand the run's name,
/// its root, the prefix, a number of up to 31 digits, and `.event`.
const LONGEST: usize = 46;

/// Why the folder of a run cannot be made or used.
#[derive(Debug, thiserror::Error)]
pub enum RunFolderError {
    /// The name of the folder of all runs is no folder.
    #[error("{}: runs are stored there, but it is not a folder; remove it", place.display())]
    NoFolder {
        /// The folder of all runs.
        place: PathBuf,
    },
    /// Another user owns the folder of all runs.
    #[error(
        "{}: runs are stored there, but it belongs to user {owner}, not to you (user {user}); remove it, or name \
         another folder in STILLPOINT_RUNS", place.display()
    )]
    Owner {
        /// The folder of all runs.
        place: PathBuf,
        /// Its owner.
        owner: u32,
        /// The user of this process.
        user: u32,
    },
    /// Other users may read or write the folder of all runs.
    #[error(
        "{0}: runs are stored there, but other users have rights in it (mode {mode:o}); run `chmod 700 {0}`", place.display()
    )]
    Rights {
        /// The folder of all runs.
        place: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// The path is too long for the sockets below it.
    #[error(
        "{}: runs are stored there, and the paths of their sockets would be too long: it has {length} bytes, of at \
         most {LONGEST}; name a folder with a shorter path in STILLPOINT_RUNS", place.display()
    )]
    TooLong {
        /// The folder of all runs.
        place: PathBuf,
        /// Bytes of its path.
        length: usize,
    },
    /// The folder cannot be written.
    #[error("{}: {reason}; name a folder that you can write in STILLPOINT_RUNS", place.display())]
    Write {
        /// The folder.
        place: PathBuf,
        /// What the system says.
        reason: std::io::Error,
    },
    /// No name for the run is free.
    #[error("{}: no free name for a run; remove what is old there", place.display())]
    NoName {
        /// The folder of all runs.
        place: PathBuf,
    },
    /// A file of the run cannot be read, written or locked.
    #[error("{}: {reason}", place.display())]
    File {
        /// The file.
        place: PathBuf,
        /// What the system says.
        reason: std::io::Error,
    },
    /// The run is over.
    #[error("{}: {reason}; the run is over, and was swept", place.display())]
    Swept {
        /// The file that its processes hold.
        place: PathBuf,
        /// What the system says.
        reason: std::io::Error,
    },
}

/// The folder of a run that is going on.
pub struct RunFolder {
    path: PathBuf,
    _lock: File,
    prefix: String,
}

/// All that another program needs to join a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunCard {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Process number of the supervisor.
    pub pid: u32,
    /// The session's clock.
    pub clock: SessionClock,
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
    /// The session that is recorded, from the root of the file system; `None`: none.
    pub session: Option<PathBuf>,
}

/// The folder of all runs of this user, by name.
fn runs_folder() -> PathBuf {
    let user = rustix::process::getuid().as_raw();
    std::env::var_os("STILLPOINT_RUNS")
        .map_or_else(|| std::env::temp_dir().join(format!("stillpoint-{user}")), PathBuf::from)
}

/// Refuses a folder of runs that another user could read or write: its files name other files to read, and a sweep removes
/// its contents.
fn check_owner(runs: &Path, folder: &std::fs::Metadata) -> Result<(), RunFolderError> {
    let (place, user) = (runs.to_path_buf(), rustix::process::getuid().as_raw());
    // What is checked is the name itself: a link leads wherever its owner likes.
    if !folder.is_dir() {
        return Err(RunFolderError::NoFolder { place });
    }
    if folder.uid() != user {
        return Err(RunFolderError::Owner { place, owner: folder.uid(), user });
    }
    let mode = folder.mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(RunFolderError::Rights { place, mode });
    }
    Ok(())
}

impl RunFolder {
    /// Makes the folder of a new run.
    pub fn create() -> Result<Self, RunFolderError> {
        let runs = runs_folder();
        let length = runs.as_os_str().len();
        if length > LONGEST {
            return Err(RunFolderError::TooLong { place: runs, length });
        }
        let say =
            |path: &Path, reason: std::io::Error| RunFolderError::Write { place: path.to_path_buf(), reason };
        std::fs::DirBuilder::new().recursive(true).mode(0o700).create(&runs).map_err(|e| say(&runs, e))?;
        check_owner(&runs, &runs.symlink_metadata().map_err(|e| say(&runs, e))?)?;
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
            let lock = open_lock(&making.join(LOCK)).map_err(|e| say(&making, e))?;
            open_lock(&making.join(CHILDREN)).map_err(|e| say(&making, e))?;
            flock(&lock, FlockOperation::NonBlockingLockExclusive)
                .map_err(|e| file_error(&making, e.into()))?;
            // A folder of that name is never empty, so this fails where there is one.
            if std::fs::rename(&making, &path).is_err() {
                let _ = std::fs::remove_dir_all(&making);
                continue;
            }
            return Ok(Self { path, _lock: lock, prefix: prefix_of(&id) });
        }
        Err(RunFolderError::NoName { place: runs })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
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

    /// Writes the card of the run.
    pub fn publish(&self, card: &RunCard) -> Result<(), RunFolderError> {
        let (draft, done) = (self.path.join("run.json.new"), self.path.join("run.json"));
        serde_json::to_vec_pretty(card)
            .map_err(std::io::Error::from)
            .and_then(|text| std::fs::write(&draft, text))
            .and_then(|()| std::fs::rename(&draft, &done))
            .map_err(|e| file_error(&done, e))
    }

    /// Notes the changes of parameters that operators took, for those who join later. A change that cannot be noted holds
    /// nevertheless.
    pub fn note_changes(&self, changes: &BTreeMap<&str, &Vec<TakenChange>>) {
        let (draft, done) = (self.path.join("changes.json.new"), self.path.join(CHANGES));
        let written = serde_json::to_vec(changes).map(|text| std::fs::write(&draft, text));
        if let Ok(Ok(())) = written {
            let _ = std::fs::rename(&draft, &done);
        }
    }
}

/// The changes of parameters that the operators of the run in this folder took, by name of the operator, the oldest first.
pub fn changes(folder: &Path) -> BTreeMap<String, Vec<TakenChange>> {
    let text = std::fs::read(folder.join(CHANGES)).unwrap_or_default();
    serde_json::from_slice(&text).unwrap_or_default()
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        stillpoint_shm::sweep(&self.root(), &self.prefix);
        let _ = std::fs::remove_dir_all(&self.path);
    }
}

fn file_error(place: &Path, reason: std::io::Error) -> RunFolderError {
    RunFolderError::File { place: place.to_path_buf(), reason }
}

fn open_lock(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().create(true).truncate(false).write(true).mode(0o600).open(path)
}

/// Keeps the folder of the run whose domain has this root from being swept while the file is open.
pub fn hold(root: &Path) -> Result<File, RunFolderError> {
    let path = root.with_file_name(CHILDREN);
    let held = OpenOptions::new().write(true).open(&path).and_then(|file| {
        flock(&file, FlockOperation::LockShared)?;
        // Who sweeps a run holds this until its name is gone.
        path.symlink_metadata().map(|_| file)
    });
    held.map_err(|reason| RunFolderError::Swept { place: path, reason })
}

/// Sweeps the runs of this user of which no process lives any more. Gives their names.
pub fn sweep_dead() -> Result<Vec<String>, RunFolderError> {
    let mut swept = Vec::new();
    for (path, id) in folders()? {
        // A folder that is just being made has no lock yet, and is left alone.
        let (Ok(Some(_supervisor)), Ok(_children)) = (take(&path.join(LOCK)), take(&path.join(CHILDREN)))
        else {
            continue;
        };
        stillpoint_shm::sweep(&path.join("d"), &prefix_of(&id));
        let _ = std::fs::remove_dir_all(&path);
        swept.push(id);
    }
    Ok(swept)
}

/// Takes a lock, if it is there. `Err`: the process that holds it lives.
fn take(lock: &Path) -> Result<Option<File>, rustix::io::Errno> {
    let Ok(file) = OpenOptions::new().write(true).open(lock) else { return Ok(None) };
    flock(&file, FlockOperation::NonBlockingLockExclusive).map(|()| Some(file))
}

/// Whether the run with this folder is going on: its supervisor holds the lock.
pub fn is_going_on(run: &Path) -> bool {
    let lock = OpenOptions::new().write(true).open(run.join(LOCK));
    lock.is_ok_and(|l| flock(&l, FlockOperation::NonBlockingLockShared).is_err())
}

/// The cards of all runs that are going on, oldest process first.
pub fn going_on() -> Result<Vec<RunCard>, RunFolderError> {
    let mut cards: Vec<RunCard> = folders()?
        .into_iter()
        .filter(|(path, _)| is_going_on(path))
        .filter_map(|(path, _)| serde_json::from_slice(&std::fs::read(path.join("run.json")).ok()?).ok())
        .collect();
    cards.sort_by_key(|c| c.pid);
    Ok(cards)
}

/// What a run is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunState {
    /// Its processes are being started.
    Starting,
    /// It runs.
    Running,
    /// Its supervisor is stopped by a signal (SIGSTOP, or Ctrl-Z).
    Suspended,
    /// No supervisor lives; the next run removes what is left, as soon as no other process of the run lives.
    Dead,
}

/// A run of this user, as its folder shows it.
#[derive(Clone, Debug)]
pub struct FoundRun {
    /// Name of its folder.
    pub id: String,
    /// Its card; `None` before it has begun.
    pub card: Option<RunCard>,
    /// What it is at.
    pub state: RunState,
    /// Time since its folder was made.
    pub age: std::time::Duration,
}

/// All runs of this user whose folder is there, the oldest first.
pub fn all() -> Result<Vec<FoundRun>, RunFolderError> {
    let mut found = Vec::new();
    for (path, id) in folders()? {
        let card: Option<RunCard> =
            std::fs::read(path.join("run.json")).ok().and_then(|text| serde_json::from_slice(&text).ok());
        // The lock is written by nobody after it was made.
        let Ok(made) = path.join(LOCK).metadata().and_then(|lock| lock.modified()) else { continue };
        let state = match (&card, is_going_on(&path)) {
            (_, false) => RunState::Dead,
            (None, true) => RunState::Starting,
            (Some(card), true) if is_suspended(card.pid) => RunState::Suspended,
            (Some(_), true) => RunState::Running,
        };
        let age = made.elapsed().unwrap_or_default();
        found.push(FoundRun { id, card, state, age });
    }
    found.sort_by_key(|run| std::cmp::Reverse(run.age));
    Ok(found)
}

/// Whether a process is stopped by a signal.
fn is_suspended(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // The state stands behind the name in brackets, which may hold anything.
    stat.rsplit_once(") ").is_some_and(|(_, behind)| behind.starts_with(['T', 't']))
}

/// Prefix of the domain of the run of this name.
pub fn prefix_of(id: &str) -> String {
    format!("sp_{id}_")
}

/// Folders and names of the runs besides this one of which a process lives.
pub fn others_alive(but: &RunFolder) -> Result<Vec<(PathBuf, String)>, RunFolderError> {
    let lives = |path: &Path| is_going_on(path) || take(&path.join(CHILDREN)).is_err();
    Ok(folders()?.into_iter().filter(|(path, _)| *path != but.path && lives(path)).collect())
}

/// Folders of runs, with their names.
fn folders() -> Result<Vec<(PathBuf, String)>, RunFolderError> {
    let runs = runs_folder();
    let Ok(folder) = runs.symlink_metadata() else { return Ok(Vec::new()) };
    check_owner(&runs, &folder)?;
    let entries = std::fs::read_dir(&runs).map_err(|e| file_error(&runs, e))?;
    let mut found: Vec<_> =
        entries.flatten().map(|e| (e.path(), e.file_name().to_string_lossy().into_owned())).collect();
    found.retain(|(_, name)| !name.starts_with(MAKING));
    found.sort();
    Ok(found)
}
