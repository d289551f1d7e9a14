//! `stillpoint replay --set`: a session with a changed pipeline.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use clap::{Args, ValueEnum};
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_operator::files::{DiskFiles, Files, FilesError};
use stillpoint_pipeline::config;
use stillpoint_pipeline::session_files::SessionFiles;
use stillpoint_pipeline::what_if::{Checked, Options, StepTimes, WhatIf, WhatIfError, what_if};
use stillpoint_recorder::{Compression, METADATA_FILE, Session, write_metadata};
use stillpoint_report::compare::{self, Choice};
use stillpoint_report::{SessionPipeline, recorded_pipeline};

use super::diff::{Align, write_page};
use super::replay::Nobody;
use crate::differences;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::pipeline_file::PipelineFile;
use crate::signals::stop_flag_of_this_process;

/// The changes with which a session runs again.
#[derive(Args, Default)]
pub struct WhatIfArgs {
    /// Change a parameter, the period (`law.every`), the kind (`law.use`) or an input (`law.inputs.state`) of an operator,
    /// and run the session again from the first change on.
    #[arg(long = "set", value_name = "OPERATOR.PARAM=VALUE", conflicts_with_all = ["only", "from"])]
    sets: Vec<String>,
    /// The changed pipeline, instead of the one that the session keeps; `--set` is applied to it. Files that it names are
    /// those of the session, and where the session has none of that name, those next to FILE.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["only", "from"])]
    with: Option<PathBuf>,
    /// Run this operator and all that is downstream of it again, though it is not changed.
    #[arg(long, value_name = "OPERATOR", conflicts_with_all = ["only", "from"])]
    rerun: Vec<String>,
    /// Take this operator from the recording, though a change reaches it.
    #[arg(long, value_name = "OPERATOR")]
    hold: Vec<String>,
    /// The times that steps take; the default is `measured`.
    #[arg(long, value_enum)]
    latencies: Option<Latencies>,
    /// How samples are paired for the table; the default is `auto`, as for `stillpoint diff`.
    #[arg(long, value_enum)]
    align: Option<Align>,
    /// Write a page with both runs in each chart.
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
}

/// The times that steps take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Latencies {
    /// Those that the session measured; the declared ones where it measured none.
    Measured,
    /// Those that the pipeline declares.
    Declared,
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

impl WhatIfArgs {
    /// Whether the session runs again with a change.
    pub fn is_asked(&self) -> bool {
        !self.sets.is_empty() || self.with.is_some() || !self.rerun.is_empty()
    }

    /// Refuses what only a change gives a meaning.
    pub fn check(&self) -> Result<(), Failure> {
        let alone = [
            ("--hold", !self.hold.is_empty()),
            ("--latencies", self.latencies.is_some()),
            ("--align", self.align.is_some()),
            ("--page", self.page.is_some()),
        ];
        match alone.into_iter().find(|(_, given)| *given && !self.is_asked()) {
            Some((name, _)) => {
                Err(Failure::wrong(format!("{name} needs a change: give --set, --with or --rerun")))
            }
            None => Ok(()),
        }
    }

    /// Runs the session again with the changes, and prints what is different.
    pub fn execute(
        &self,
        path: &Path,
        session: &Session,
        registry: &Registry,
        record: Option<&Path>,
        compression: Compression,
        is_json: bool,
    ) -> Ended {
        let before = recorded_pipeline(session, registry)?;
        let after = match self.changed(&before, registry)? {
            Ok(after) => after,
            Err(exit) => return Ok(exit),
        };
        let SessionPipeline { graph, files, text, sets } = before;
        let before = Checked { graph, files: Arc::new(files), text, sets };
        let folder = Folder::new(record);
        let options = Options {
            rerun: self.rerun.clone(),
            hold: self.hold.clone(),
            step_times: match self.latencies {
                Some(Latencies::Declared) => StepTimes::Declared,
                Some(Latencies::Measured) | None => StepTimes::Measured,
            },
            folder: folder.path().to_owned(),
            compression,
            stop: stop_flag_of_this_process()?,
        };
        let begun = std::time::Instant::now();
        let done = what_if(session, &before, after, &options, &mut Nobody).map_err(failed)?;
        let wall = begun.elapsed().as_secs_f64();
        if done.report.ended_early.as_deref() == Some("stopped") {
            return Err(Failure::failed("stopped before the end of the session: nothing was compared"));
        }
        let computed = Session::open(folder.path()).map_err(Failure::failed)?;
        if record.is_some() {
            add_metadata(folder.path(), &computed);
        }
        let choice = self.align.map_or(Choice::Auto, Choice::from);
        let found = compare::of_sessions([session, &computed], choice, registry).map_err(Failure::failed)?;
        let names = ["recorded", "changed"];
        if let Some(page) = &self.page {
            let changes: Vec<String> = done.changes.iter().map(ToString::to_string).collect();
            write_page(page, &found, names, &changes)?;
        }
        let exit = exit_of(&done);
        if is_json {
            let value = json!({
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
                "wall_seconds": wall,
                "identical_all": found.is_identical(),
                "comparison": found,
            });
            print_json(&value)?;
            return Ok(exit);
        }
        self.say(&done, before.graph.operators.len());
        differences::print(&found, names);
        if let Some(folder) = record {
            outln!("session: {}", folder.display());
        }
        let speed = done.report.seconds / wall.max(1e-9);
        outln!("{:.1} s of session in {wall:.2} s ({speed:.1}x real time)", done.report.seconds);
        Ok(exit)
    }

    /// The changed pipeline; or how the command ends, if it has faults.
    fn changed(
        &self,
        before: &SessionPipeline,
        registry: &Registry,
    ) -> Result<Result<Checked, Exit>, Failure> {
        let (text, name, sets, files): (_, _, _, Arc<dyn Files + Send + Sync>) = match &self.with {
            None => {
                let sets = [before.sets.clone(), self.sets.clone()].concat();
                let name = stillpoint_pipeline::session::PIPELINE.to_owned();
                (before.text.clone(), name, sets, Arc::new(before.files.clone()))
            }
            Some(file) => {
                let given = PipelineFile { file: Some(file.clone()), ..PipelineFile::default() };
                let source = match given.read() {
                    Ok(source) => source,
                    Err(refused) => return refused.end(false).map(Err),
                };
                let layered = Layered { session: before.files.clone(), disk: source.files };
                (source.text, file.display().to_string(), self.sets.clone(), Arc::new(layered))
            }
        };
        match config::check(&text, &name, &sets, registry, &*files) {
            Ok(graph) => Ok(Ok(Checked { graph, text, sets, files })),
            Err(faults) => {
                errln!("{faults}");
                Ok(Err(Exit::Wrong))
            }
        }
    }

    /// Says what was changed, and what was computed from it.
    fn say(&self, done: &WhatIf, operators: usize) {
        for change in &done.changes {
            outln!("change: {change}");
        }
        if done.changes.is_empty() && self.rerun.is_empty() {
            outln!("no change: the recording has these values");
        }
        let reach = &done.reach;
        if !reach.decided.is_empty() {
            let count = reach.decided.len();
            outln!("computed again: {} ({count} of {operators} operators)", reach.decided.join(", "));
            match reach.rigs.as_slice() {
                [] => outln!(
                    "open loop: the sensors are recorded, so the recorded patient does not react to the change"
                ),
                rigs => outln!(
                    "closed loop: the simulated patient ({}) runs again with its seed",
                    rigs.join(", ")
                ),
            }
        }
        if !reach.held.is_empty() {
            outln!("held, because what they say was recorded and does not react: {}", reach.held.join(", "));
        }
        match done.measured.len() {
            0 => outln!("step times: as declared"),
            n => outln!("step times: measured by the session for {n} operators, else as declared"),
        }
        for open in done.open() {
            outln!(
                "{}, incarnation {}, cannot be computed from activation {} on: {}",
                open.operator,
                open.incarnation,
                open.from_activation,
                open.reason
            );
        }
        if let Some(first) = &done.replayed.first_difference {
            outln!(
                "the recorded part does not replay: {} differences, the first: {first}",
                done.replayed.differences
            );
        }
        for fault in done.report.faults.iter().take(5) {
            outln!("{} failed: {}", fault.operator, fault.reason);
        }
        if let Some(reason) = &done.report.ended_early {
            outln!("ended early: {reason}");
        }
    }
}

/// Makes the folder of a session a bag of rosbag2.
pub fn add_metadata(folder: &Path, session: &Session) {
    if let Err(e) = write_metadata(folder, session) {
        let place = folder.join(METADATA_FILE);
        errln!("{}: {e}. The session is whole, but rosbag2 does not open it", place.display());
    }
}

fn exit_of(done: &WhatIf) -> Exit {
    match () {
        () if done.report.ended_early.is_some() => Exit::Failed,
        () if done.replayed.differences > 0 => Exit::Differs,
        () if !done.open().is_empty() => Exit::Open,
        () => Exit::Done,
    }
}

fn failed(error: WhatIfError) -> Failure {
    match error {
        WhatIfError::Operator { .. } | WhatIfError::HeldAndChanged(_) => Failure::wrong(error),
        _ => Failure::failed(error),
    }
}
