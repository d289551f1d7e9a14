//! Whether a pipeline gives the same samples each time that it is run.

use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use stillpoint_operator::Registry;
use stillpoint_pipeline::program::Program;
use stillpoint_recorder::Session;
use stillpoint_report::compare::{self, Choice, Comparison};

use crate::exit::Failure;
use crate::pipeline_file::PipelineFile;
use crate::recorded::with_topics;

/// Characters of what a run that failed printed, of which the end is shown.
const SHOWN: usize = 2_000;

/// Runs a pipeline twice in simulated time, each time in a process of its own, and compares all samples. What depends on the
/// clock, on memory addresses or on numbers that no seed gives differs between the runs.
///
/// # Errors
/// A run fails, or a session cannot be read.
pub fn of_two_runs(
    pipeline: &PipelineFile,
    length: &str,
    registry: &Registry,
) -> Result<Comparison, Failure> {
    let folder = Folder::new()?;
    let [first, second] = [folder.run("first", pipeline, length)?, folder.run("second", pipeline, length)?];
    let open = |path: &PathBuf| with_topics(Session::open_any(path), path);
    let sessions = [&open(&first)?, &open(&second)?];
    compare::of_sessions(sessions, Choice::Sequence, registry).map_err(Failure::failed)
}

/// A folder of sessions that is removed with this value.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Result<Self, Failure> {
        let path = std::env::temp_dir().join(format!("stillpoint-two-runs-{}", std::process::id()));
        // Sessions can show a patient.
        std::fs::DirBuilder::new()
            .mode(0o700)
            .create(&path)
            .map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
        Ok(Self(path))
    }

    /// Runs the pipeline. Gives the folder of the session.
    fn run(&self, name: &str, pipeline: &PipelineFile, length: &str) -> Result<PathBuf, Failure> {
        let sessions = self.0.join(name);
        let Program { executable, lead, environment, .. } = Program::here().map_err(Failure::failed)?;
        let mut command = Command::new(executable);
        command.args(lead).envs(environment).arg("run").args(&pipeline.file).args([
            "--clock",
            "simulated",
            "--for",
            length,
            "--record",
        ]);
        command.arg(&sessions).args(pipeline.sets.iter().flat_map(|set| ["--set", set.as_str()]));
        let ran = command.stdin(Stdio::null()).output().map_err(Failure::failed)?;
        let failed = |why: String| Failure::failed(format!("the {name} run: {why}"));
        if !ran.status.success() {
            let printed =
                [ran.stdout, ran.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
            let cut = printed.char_indices().rev().nth(SHOWN).map_or(0, |(at, _)| at);
            return Err(failed(format!("{}\n{}", ran.status, &printed[cut..])));
        }
        only_folder(&sessions).ok_or_else(|| failed("it left no session".to_owned()))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left lies in the folder of temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn only_folder(path: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(path).ok()?.flatten();
    entries.map(|entry| entry.path()).find(|path| path.is_dir())
}
