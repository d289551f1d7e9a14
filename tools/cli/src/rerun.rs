//! A session that runs again with a changed pipeline, and its comparison with the recording. `replay --set` prints the
//! result; programs read it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Instant;

use serde_json::{Value, json};
use stillpoint_operator::Registry;
use stillpoint_operator::files::{DiskFiles, Files, FilesError};
use stillpoint_pipeline::config::{self, Composed};
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Observer, ObserverError};
use stillpoint_pipeline::session::PIPELINE;
use stillpoint_pipeline::session_files::SessionFiles;
use stillpoint_pipeline::what_if::{Checked, Options, StepTimes, WhatIf, WhatIfError, what_if};
use stillpoint_recorder::{Compression, METADATA_FILE, Session, write_metadata};
use stillpoint_report::compare::{self, Choice, Comparison};
use stillpoint_report::{SessionPipeline, SessionPipelineError, recorded_pipeline};
use stillpoint_samples::Entry;

use crate::exit::{Exit, Failure};
use crate::pipeline_file::{PipelineFile, Refused};

/// An observer that keeps nothing.
pub struct Nobody;

impl Observer for Nobody {
    fn on_activation(
        &mut self,
        _: usize,
        _: &Entry,
        _: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        Ok(())
    }
}

/// What is changed, and how the session runs again.
#[derive(Clone, Debug, Default)]
pub struct Rerun {
    /// Changes, each `operator.param=value`.
    pub sets: Vec<String>,
    /// File of the changed pipeline, in place of the one that the session keeps.
    pub with: Option<PathBuf>,
    /// Operators that run again though they are not changed.
    pub rerun: Vec<String>,
    /// Operators that are taken from the recording though a change reaches them.
    pub hold: Vec<String>,
    /// The times that steps take.
    pub step_times: StepTimes,
    /// How samples are paired.
    pub align: Choice,
    /// Folder of the session that is written. `None`: a folder that is removed afterwards.
    pub record: Option<PathBuf>,
    /// Compression of that session.
    pub compression: Compression,
}

/// The result of a [`Rerun`].
pub struct Computed {
    /// The run.
    pub done: WhatIf,
    /// The recording against the run.
    pub comparison: Comparison,
    /// Operators of the recorded pipeline.
    pub operators: usize,
    /// Time that the run took, s.
    pub wall_seconds: f64,
}

/// The reasons why a session does not run again.
pub enum RerunError {
    /// The changed pipeline is refused.
    Refused(Refused),
    /// Another reason.
    Failed(Failure),
}

impl From<Failure> for RerunError {
    fn from(failure: Failure) -> Self {
        Self::Failed(failure)
    }
}

impl From<SessionPipelineError> for RerunError {
    fn from(error: SessionPipelineError) -> Self {
        Self::Failed(error.into())
    }
}

impl From<RerunError> for Failure {
    fn from(error: RerunError) -> Self {
        match error {
            RerunError::Refused(refused) => Self::wrong(refused),
            RerunError::Failed(failure) => failure,
        }
    }
}

/// The files of the session, and where it has none of a name, those on disk.
struct Layered {
    session: SessionFiles,
    disk: DiskFiles,
}

impl Files for Layered {
    fn read(&self, name: &str) -> Result<Vec<u8>, FilesError> {
        if self.session.list(name).is_ok() { self.session.read(name) } else { self.disk.read(name) }
    }

    fn shared_mode(&self, name: &str) -> Option<u32> {
        if self.session.list(name).is_ok() { None } else { self.disk.shared_mode(name) }
    }

    fn list(&self, name: &str) -> Result<Vec<String>, FilesError> {
        self.session.list(name).or_else(|_| self.disk.list(name))
    }
}

/// The folder of the session that is written; one that nobody asked for is removed.
enum Folder {
    Asked(PathBuf),
    Scratch(PathBuf),
}

impl Folder {
    fn new(asked: Option<&Path>) -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        match asked {
            Some(folder) => Self::Asked(folder.to_owned()),
            None => {
                let number = NEXT.fetch_add(1, Ordering::Relaxed);
                let name = format!("stillpoint-what-if-{}-{number}", std::process::id());
                Self::Scratch(std::env::temp_dir().join(name))
            }
        }
    }

    fn path(&self) -> &Path {
        match self {
            Self::Asked(path) | Self::Scratch(path) => path,
        }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if let Self::Scratch(path) = self {
            stillpoint_pipeline::session_recorder::remove_folder(path);
        }
    }
}

impl Rerun {
    /// Refuses a changed pipeline that has faults, without a run.
    ///
    /// # Errors
    /// The changed pipeline has faults, or the session has none that can be read.
    pub fn check(&self, session: &Session, registry: &Registry) -> Result<(), RerunError> {
        let before = recorded_pipeline(session, registry)?;
        self.changed(&before, registry).map(|_| ())
    }

    /// Runs the session again and compares it with the recording. `stop` ends the run early, which is a failure.
    ///
    /// # Errors
    /// The changed pipeline has faults, an option names an operator that is not there, or a session cannot be read or
    /// written.
    pub fn compute(
        &self,
        session: &Session,
        registry: &Registry,
        stop: Arc<AtomicBool>,
    ) -> Result<Computed, RerunError> {
        let before = recorded_pipeline(session, registry)?;
        let after = self.changed(&before, registry)?;
        let SessionPipeline { graph, files, text, sets, variables, included } = before;
        let before = Checked { graph, files: Arc::new(files), text, sets, variables, included };
        let folder = Folder::new(self.record.as_deref());
        let options = Options {
            rerun: self.rerun.clone(),
            hold: self.hold.clone(),
            step_times: self.step_times,
            folder: folder.path().to_owned(),
            compression: self.compression,
            stop,
        };
        let begun = Instant::now();
        let done = what_if(session, &before, after, &options, &mut Nobody).map_err(failed)?;
        let wall_seconds = begun.elapsed().as_secs_f64();
        if done.report.ended_early.as_deref() == Some("stopped") {
            return Err(Failure::failed("stopped before the end of the session: nothing was compared").into());
        }
        let computed = Session::open(folder.path()).map_err(Failure::failed)?;
        if self.record.is_some() {
            add_metadata(folder.path(), &computed);
        }
        let comparison =
            compare::of_sessions([session, &computed], self.align, registry).map_err(Failure::failed)?;
        Ok(Computed { done, comparison, operators: before.graph.operators.len(), wall_seconds })
    }

    /// The changed pipeline.
    fn changed(&self, before: &SessionPipeline, registry: &Registry) -> Result<Checked, RerunError> {
        let faults = |faults| RerunError::Refused(Refused::Faults(faults));
        match &self.with {
            None => {
                let sets = [before.sets.clone(), self.sets.clone()].concat();
                let (text, files) = (before.text.clone(), before.files.clone());
                let graph = config::check(&text, PIPELINE, &sets, registry, &files).map_err(faults)?;
                let (variables, included) = (before.variables.clone(), before.included.clone());
                Ok(Checked { graph, text, sets, variables, included, files: Arc::new(files) })
            }
            Some(file) => {
                let given = PipelineFile { file: Some(file.clone()), ..PipelineFile::default() };
                let source = given.read().map_err(RerunError::Refused)?;
                let files = Layered { session: before.files.clone(), disk: source.files };
                let name = file.display().to_string();
                let Composed { graph, text, sets, variables, included } =
                    config::compose_to_rerun(&source.text, &name, &self.sets, registry, &files)
                        .map_err(faults)?;
                Ok(Checked { graph, text, sets, variables, included, files: Arc::new(files) })
            }
        }
    }
}

impl Computed {
    /// How the command ends.
    pub fn exit(&self) -> Exit {
        let done = &self.done;
        match () {
            () if done.report.ended_early.is_some() => Exit::Failed,
            () if done.replayed.differences > 0 => Exit::Differs,
            () if !done.open().is_empty() => Exit::Open,
            () => Exit::Done,
        }
    }

    /// All of it as JSON: of the session at `path`, written as the session `record`.
    pub fn to_json(&self, path: &Path, record: Option<&Path>) -> Value {
        let Self { done, comparison, wall_seconds, .. } = self;
        json!({
            "session": path,
            "recorded": record,
            "changes": done.changes,
            "computed": done.reach.decided,
            "held": done.reach.held,
            "closed_loop": done.reach.rigs,
            "measured_steps": done.measured,
            "open": done.open(),
            "differences_of_recording": done.replayed.differences,
            "faults": done.report.faults,
            "ended_early": done.report.ended_early,
            "seconds": done.report.seconds,
            "wall_seconds": wall_seconds,
            "identical_all": comparison.is_identical(),
            "comparison": comparison,
        })
    }
}

/// Makes the folder of a session a bag of rosbag2.
pub fn add_metadata(folder: &Path, session: &Session) {
    if let Err(e) = write_metadata(folder, session) {
        let place = folder.join(METADATA_FILE);
        errln!("{}: {e}. The session is whole, but rosbag2 does not open it", place.display());
    }
}

fn failed(error: WhatIfError) -> Failure {
    match error {
        WhatIfError::Operator { .. } | WhatIfError::HeldAndChanged(_) => Failure::wrong(error),
        _ => Failure::failed(error),
    }
}
