//! Runs on the discrete-event schedule: simulated, or in lock-step.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use stillpoint_pipeline::files::Snapshot;
use stillpoint_pipeline::live::RunReport;
use stillpoint_pipeline::run_source::RunSource;
use stillpoint_pipeline::session::identity;
use stillpoint_pipeline::simulated::{self, SimulatedOptions};
use stillpoint_recorder::Compression;

use crate::exit::Failure;
use crate::pipeline_file::Checked;
use crate::program::launch;

/// Where activations happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// In this thread.
    Local,
    /// In a thread per operator.
    Threads,
    /// In the processes of the pipeline.
    Processes,
}

/// Runs a checked pipeline for `length` ns of session time, which starts at 0, or until all that feeds it has finished, or
/// until `stop` is set.
pub fn simulate(
    checked: &Checked,
    sets: &[String],
    place: Place,
    length: u64,
    session: Option<(&Path, Compression)>,
    stop: Arc<AtomicBool>,
) -> Result<RunReport, Failure> {
    let source = RunSource {
        text: checked.source.text.clone(),
        file: checked.source.file.display().to_string(),
        sets: sets.to_vec(),
        files: Snapshot::of(&checked.graph, &checked.source.files).map_err(Failure::failed)?,
    };
    let place = match place {
        Place::Local => simulated::Place::Local,
        Place::Threads => simulated::Place::Threads,
        Place::Processes => simulated::Place::Processes(launch()?),
    };
    let session = session.map(|(folder, compression)| (folder.to_path_buf(), compression));
    let options = SimulatedOptions { place, length, session, identity: identity(), stop };
    simulated::simulate(&checked.graph, &source, options).map_err(Failure::failed)
}
