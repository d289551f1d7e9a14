//! `stillpoint run`

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use stillpoint_http::{Metrics, MetricsError};
use stillpoint_operator::Registry;
use stillpoint_pipeline::config::{Machine, quantity};
use stillpoint_pipeline::files::Snapshot;
use stillpoint_pipeline::live::{RunOptions, RunReport, Supervisor};
use stillpoint_pipeline::session::identity;
use stillpoint_pipeline::session_recorder::{create_folder, remove_folder};
use stillpoint_recorder::Session;

use crate::compress::Compress;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::pipeline_file::{Checked, PipelineFile};
use crate::program::launch;
use crate::rerun::add_metadata;
use crate::signals::{stop_flag, stop_flag_of_this_process};
use crate::simulate::{Place, simulate};
use crate::status_line::StatusLine;
use crate::summary::{Observed, Summary};

/// Length of a run of the default pipeline.
const DEFAULT_LENGTH: &str = "20 s";

/// Length of a simulated run that its sources end, ns of session time: the longest time that a pipeline can state.
const UNBOUNDED: u64 = 366 * 86_400 * 1_000_000_000;

/// Run a pipeline and record it.
#[derive(Args, Default)]
pub struct Run {
    #[command(flatten)]
    pipeline: PipelineFile,
    /// Maximum length of the run in session time, such as `10s`. Without it, a run ends when all its sources have
    /// finished (for example, when every file has been read) or on Ctrl-C; the default pipeline ends after 20 s.
    #[arg(long = "for", value_name = "TIME", allow_hyphen_values = true)]
    length: Option<String>,
    /// Run live only the operators that the pipeline places on this host; links and the bridge connect them to the programs
    /// of the other hosts. Operators without a host are on `main`. Without FILE, the embedded pipeline in two programs is used.
    #[arg(long, value_name = "NAME")]
    host: Option<String>,
    /// Which clock decides when activations happen; the default is `live`.
    #[arg(long, value_enum)]
    clock: Option<Clock>,
    /// Run the simulated schedule in threads or processes, one activation at a time.
    #[arg(long, value_enum, value_name = "PLACEMENT", num_args = 0..=1, default_missing_value = "processes")]
    lock_step: Option<LockStep>,
    /// Folder in which the session folder is created.
    #[arg(long, value_name = "FOLDER", default_value = "sessions")]
    record: PathBuf,
    /// Do not record a session.
    #[arg(long, conflicts_with = "record")]
    no_record: bool,
    /// Compression of the recording.
    #[arg(long, value_enum, default_value_t)]
    compression: Compress,
    /// Serve the figures of a live run as Prometheus text at this address, such as `127.0.0.1:9464`; port 0 takes any.
    #[arg(long, value_name = "ADDRESS")]
    metrics: Option<SocketAddr>,
    /// Print the tables of operators and edges at the end, too. Without it they are printed where something went wrong.
    #[arg(long)]
    verbose: bool,
    /// Exit with 1 where an operator that should answer never did: no frame with a face, a law that was idle to the end, a
    /// sensor that fusion left out.
    #[arg(long)]
    strict: bool,
    /// Print the report as JSON. If the pipeline has faults, print them as `check --json` does.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Clock {
    /// The clock of the machine and the arrival of samples; operators run in processes.
    Live,
    /// Discrete events in this process, as fast as possible.
    Simulated,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LockStep {
    /// A thread per operator.
    Threads,
    /// The processes that the pipeline file names.
    Processes,
}

impl Run {
    /// A live run of the operators that the pipeline places on a host.
    pub fn part(
        pipeline: PipelineFile,
        host: &str,
        length: Option<String>,
        record: PathBuf,
        no_record: bool,
        json: bool,
    ) -> Self {
        Self { pipeline, length, host: Some(host.to_owned()), record, no_record, json, ..Self::default() }
    }

    /// A run of a pipeline that another command evaluates: it records into `folder`, and prints nothing at its end.
    pub fn recording(folder: PathBuf, clock: Clock, json: bool) -> Self {
        Self { record: folder, clock: Some(clock), json, ..Self::default() }
    }

    /// Runs a checked pipeline for `length` ns of session time. Gives the session and the report.
    pub fn record_checked(
        &self,
        registry: &Registry,
        checked: &Checked,
        length: u64,
    ) -> Result<(PathBuf, RunReport), Failure> {
        let session = next_session(&self.session_folder(), checked)?;
        let report = if self.is_live() {
            self.live(registry, checked, Some(length), Some(&session))?.0
        } else {
            let stop = stop_flag_of_this_process()?;
            let recorded = Some((session.as_path(), self.compression.into()));
            simulate(checked, Place::Local, length, recorded, stop, !self.json)?.0
        };
        Ok((session, report))
    }

    /// Executes the subcommand.
    pub fn execute(mut self, registry: &Registry) -> Ended {
        if self.clock == Some(Clock::Live) && self.lock_step.is_some() {
            return Err(Failure::wrong(
                "--lock-step uses the simulated schedule: remove --clock live or --lock-step",
            ));
        }
        if self.metrics.is_some() && !self.is_live() {
            return Err(Failure::wrong(
                "--metrics serves the figures of a live run: remove it, or --clock simulated and --lock-step",
            ));
        }
        if let Some(host) = &self.host {
            if !self.is_live() {
                return Err(Failure::wrong(
                    "--host runs live only: remove --host to run the whole pipeline simulated or in lock-step",
                ));
            }
            self.pipeline.in_parts = true;
            // Every process that reads the pipeline of this run sees this part only.
            self.pipeline.sets.push(format!("host={host}"));
        }
        // A run in one process claims no cores.
        let in_processes = self.is_live() || self.lock_step == Some(LockStep::Processes);
        let machine = match (self.is_live(), in_processes) {
            (true, _) => Machine::here(),
            (false, true) => Machine::here().in_session_time(),
            (false, false) => Machine::any(),
        };
        let checked = match self.pipeline.check(registry, &machine) {
            Ok(checked) => checked,
            Err(refused) => return refused.end(self.json),
        };
        let length = match (&self.length, &self.pipeline.file) {
            (Some(text), _) => Some(time(text)?),
            (None, None) if self.host.is_none() => Some(time(DEFAULT_LENGTH)?),
            (None, None) => None,
            (None, Some(_)) => None,
        };
        let session =
            if self.no_record { None } else { Some(next_session(&self.session_folder(), &checked)?) };
        let is_live = self.is_live();
        let (report, observed) = if !is_live {
            let length = match length {
                None if checked.graph.ends_by_itself() => UNBOUNDED,
                None => {
                    return Err(Failure::wrong(
                        "not every source of this pipeline finishes by itself, so a simulated run needs a maximum length, \
                         such as `--for 10s`",
                    ));
                }
                Some(length) => length,
            };
            let place = match self.lock_step {
                None => Place::Local,
                Some(LockStep::Threads) => Place::Threads,
                Some(LockStep::Processes) => Place::Processes,
            };
            let stop = stop_flag_of_this_process()?;
            let retained = session.as_deref().map(|folder| (folder, self.compression.into()));
            simulate(&checked, place, length, retained, stop, !self.json)?
        } else {
            self.live(registry, &checked, length, session.as_deref())?
        };
        let opened = session.as_deref().map(Session::open);
        if let (Some(folder), Some(Ok(opened))) = (&session, &opened) {
            add_metadata(folder, opened);
        }
        let session = session.as_deref();
        let graph = &checked.graph;
        let remarks = Snapshot::of(graph, &checked.source.files).map(|files| files.remarks().clone());
        let summary = Summary::new(&report, graph, registry, is_live, session, opened.as_ref(), observed)
            .with_remarks(&remarks.unwrap_or_default());
        let good = report.balanced
            && (report.ended_early.is_none() || report.ended_early.as_deref() == Some("stopped"))
            && report.recording_failed.is_none()
            && summary.is_complete()
            && !summary.breaks_contract()
            && !(self.strict && summary.is_unanswered());
        if self.json {
            print_json(&summary.to_json()?)?;
        } else {
            summary.print(self.verbose);
        }
        Ok(if good { Exit::Done } else { Exit::Failed })
    }

    fn is_live(&self) -> bool {
        self.clock != Some(Clock::Simulated) && self.lock_step.is_none()
    }

    /// `Default` leaves the folder empty; the command line fills it in.
    fn session_folder(&self) -> PathBuf {
        if self.record.as_os_str().is_empty() { PathBuf::from("sessions") } else { self.record.clone() }
    }

    fn live(
        &self,
        registry: &Registry,
        checked: &Checked,
        length: Option<u64>,
        session: Option<&Path>,
    ) -> Result<(RunReport, Observed), Failure> {
        let stop = stop_flag()?;
        if let Some(session) = session {
            create_folder(session).map_err(Failure::failed)?;
        }
        let options = RunOptions {
            source: checked.source.text.clone(),
            file: checked.source.file.display().to_string(),
            sets: checked.source.sets.clone(),
            variables: checked.source.variables.clone(),
            included: checked.source.included.clone(),
            files: checked.source.files.clone(),
            duration: length,
            session: session.map(Path::to_path_buf),
            compression: self.compression.into(),
            launch: launch()?,
            identity: identity(),
        };
        let mut line = StatusLine::new(registry, !self.json);
        if let Some(address) = self.metrics {
            let (metrics, bound) = Metrics::serve(address).map_err(|e| match e {
                MetricsError::Address { .. } => Failure::wrong(e),
                MetricsError::Thread(_) => Failure::failed(e),
            })?;
            errln!("stillpoint: metrics at http://{bound}/metrics");
            line = line.with_metrics(metrics, &checked.graph.name);
        }
        let supervisor = Supervisor::start(checked.graph.clone(), options, &stop, &mut line)
            .inspect_err(|_| session.into_iter().for_each(remove_folder))
            .map_err(Failure::failed)?;
        let report = supervisor.watch(&stop, &mut line);
        let observed = line.close();
        if let Some(session) = session {
            // A part that a dead recorder left cut is repaired before any program opens it.
            match stillpoint_recorder::recover_session(session) {
                Ok(parts) => {
                    for (part, mended) in parts {
                        errln!("stillpoint: {} was cut off and has been repaired: {mended}", part.display());
                    }
                }
                // The report comes first: the session can be repaired later.
                Err(e) => errln!("stillpoint: the session cannot be repaired now: {e}"),
            }
        }
        Ok((report, observed))
    }
}

/// A time with its unit, ns.
fn time(text: &str) -> Result<u64, Failure> {
    quantity::nanoseconds(text)
        .map_err(|e| Failure::wrong(format!("--for {text}: {}; {}", e.message, e.help)))
}

/// The folder of the next session: the pipeline's name with the next free number.
fn next_session(folder: &Path, checked: &Checked) -> Result<PathBuf, Failure> {
    std::fs::create_dir_all(folder).map_err(|e| {
        let place = folder.display();
        Failure::failed(format!("{place}: {e}; choose another folder with --record, or use --no-record"))
    })?;
    let name = &checked.graph.name;
    (1..1_000_000u32).map(|n| folder.join(format!("{name}-{n:04}"))).find(|path| !path.exists()).ok_or_else(
        || {
            Failure::failed(format!(
                "{}: every session number is taken; choose another folder with --record",
                folder.display()
            ))
        },
    )
}
