//! Runs on the discrete-event schedule: simulated, or in lock-step.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use stillpoint_pipeline::files::Snapshot;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::live::RunReport;
use stillpoint_pipeline::run_source::RunSource;
use stillpoint_pipeline::sample_store::OwnedSample;
use stillpoint_pipeline::schedule::Observer;
use stillpoint_pipeline::session::identity;
use stillpoint_pipeline::simulated::{self, SimulatedOptions};
use stillpoint_recorder::Compression;
use stillpoint_report::hold::{Held, Hold};
use stillpoint_samples::{Entry, Pieces};

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

/// Runs a checked pipeline for `length` ns of session time, which starts at 0. The run ends earlier when all its sources
/// have finished or `stop` is set. Gives the report, and the states of the valves and far ends, if the graph has any.
pub fn simulate(
    checked: &Checked,
    sets: &[String],
    place: Place,
    length: u64,
    session: Option<(&Path, Compression)>,
    stop: Arc<AtomicBool>,
) -> Result<(RunReport, Held), Failure> {
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
    let mut valves = Valves { graph: &checked.graph, hold: Hold::of_valves(&checked.graph) };
    let report =
        simulated::simulate(&checked.graph, &source, options, &mut valves).map_err(Failure::failed)?;
    Ok((report, valves.hold.held()))
}

/// Observes the valves and their far ends.
struct Valves<'a> {
    graph: &'a Graph,
    hold: Hold,
}

impl Observer for Valves<'_> {
    fn on_activation(
        &mut self,
        operator: usize,
        _: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), String> {
        for (port, sample) in outputs {
            let topic = &self.graph.operators[operator].outputs[*port].topic;
            if self.hold.topics().any(|watched| watched == topic)
                && let Ok(pieces) = Pieces::split(sample.kind, &sample.bytes)
            {
                self.hold.take(topic, pieces);
            }
        }
        Ok(())
    }
}
