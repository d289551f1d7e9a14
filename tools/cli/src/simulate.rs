//! Runs on the discrete-event schedule: simulated, or in lock-step.

use std::io::IsTerminal;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use indicatif::{ProgressBar, ProgressStyle};
use stillpoint_pipeline::files::Snapshot;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::RunReport;
use stillpoint_pipeline::run_source::RunSource;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::{Observer, ObserverError};
use stillpoint_pipeline::session::identity;
use stillpoint_pipeline::simulated::{self, SimulatedOptions};
use stillpoint_recorder::Compression;
use stillpoint_report::hold::Hold;
use stillpoint_report::unanswered::Answers;
use stillpoint_samples::{Entry, Pieces};

use crate::exit::Failure;
use crate::pipeline_file::Checked;
use crate::program::launch;
use crate::summary::Observed;

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

/// Runs a checked pipeline for `length` ns of session time, which starts at 0. The run ends earlier when all its sources
/// have finished or `stop` is set. Gives the report, and what was observed.
pub fn simulate(
    checked: &Checked,
    place: Place,
    length: u64,
    session: Option<(&Path, Compression)>,
    stop: Arc<AtomicBool>,
    shows_progress: bool,
) -> Result<(RunReport, Observed), Failure> {
    let source = RunSource {
        text: checked.source.text.clone(),
        file: checked.source.file.display().to_string(),
        sets: checked.source.sets.clone(),
        variables: checked.source.variables.clone(),
        included: checked.source.included.clone(),
        files: Snapshot::of(&checked.graph, &checked.source.files).map_err(Failure::failed)?,
    };
    let place = match place {
        Place::Local => simulated::Place::Local,
        Place::Threads => simulated::Place::Threads,
        Place::Processes => simulated::Place::Processes(launch()?),
    };
    let session = session.map(|(folder, compression)| (folder.to_path_buf(), compression));
    let options = SimulatedOptions { place, length, session, identity: identity(), stop };
    let mut watch = Watch {
        graph: &checked.graph,
        hold: Hold::of(&checked.graph),
        answers: Answers::of(&checked.graph),
        progress: progress(length, shows_progress),
    };
    let report =
        simulated::simulate(&checked.graph, &source, options, &mut watch).map_err(Failure::failed)?;
    watch.progress.finish_and_clear();
    Ok((report, Observed { held: Some(watch.hold.held()), answers: watch.answers, entries: None }))
}

/// A bar of the session time on standard error; hidden where that is no terminal.
fn progress(length: u64, is_shown: bool) -> ProgressBar {
    if !is_shown || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(length);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {msg} in {elapsed}") {
        bar.set_style(style);
    }
    bar
}

/// Observes what the end of the run states.
struct Watch<'a> {
    graph: &'a Graph,
    hold: Hold,
    answers: Answers,
    progress: ProgressBar,
}

impl Observer for Watch<'_> {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        let stamp = entry.header.stamp;
        // A step of the bar is 10 ms of session time.
        if !self.progress.is_hidden() && stamp >= self.progress.position() + 10_000_000 {
            self.progress.set_position(stamp);
            self.progress.set_message(format!("{:.1} s", stamp as f64 * 1e-9));
        }
        for (port, sample) in outputs {
            let topic = &self.graph.operators[operator].outputs[*port].topic;
            if self.hold.topics().chain(self.answers.topics()).any(|watched| watched == topic)
                && let Ok(pieces) = Pieces::split(sample.kind, &sample.bytes)
            {
                self.hold.take(topic, pieces);
                self.answers.take(topic, pieces);
            }
        }
        Ok(())
    }
}
