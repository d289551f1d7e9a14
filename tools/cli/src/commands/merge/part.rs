//! The session of one host, and the clocks of other hosts as it measured them.

use std::path::{Path, PathBuf};

use stillpoint_operator::Registry;
use stillpoint_operator::outside::ClockOffset;
use stillpoint_pipeline::config;
use stillpoint_pipeline::graph::{Graph, Wire};
use stillpoint_pipeline::session::{PIPELINE, SETS};
use stillpoint_pipeline::session_files::SessionFiles;
use stillpoint_recorder::{Recorded, Session};
use stillpoint_report::pipeline_of;
use stillpoint_samples::{Diagnostics, Pieces, Sample};

use super::wrong;
use crate::exit::Failure;

/// Setting by which a run is that of one host.
const HOST: &str = "host=";

/// The session of a host.
pub struct MergedPart {
    /// Folder or file.
    pub path: PathBuf,
    /// What is in it.
    pub session: Session,
    /// The host that recorded it.
    pub host: String,
    /// The pipeline as text.
    pub pipeline: String,
    /// Settings beside the host.
    pub sets: Vec<String>,
    /// Times of the first and the last sample, ns, by the clock of this session; `None` without a sample.
    pub span: Option<[u64; 2]>,
    /// Clocks of other hosts against that of this session, by host, in the order of measurement.
    pub measured: Vec<(String, ClockOffset)>,
}

impl MergedPart {
    /// Opens the session.
    pub fn open(path: &Path, registry: &Registry) -> Result<Self, Failure> {
        let name = path.display();
        let session = Session::open_any(path).map_err(Failure::failed)?;
        let (graph, files) = pipeline_of(&session, registry).map_err(|e| {
            let failure = Failure::from(e);
            Failure { text: format!("{name}: {}", failure.text), ..failure }
        })?;
        let Some(part) = graph.part else {
            return Err(wrong(format!(
                "{name}: this session was not recorded by one of several hosts (`stillpoint run --host NAME`), so \
                 there is nothing to join it with"
            )));
        };
        let attached = |name: &str| session.attachments().get(name).map(|retained| retained.bytes.clone());
        let pipeline = String::from_utf8(attached(PIPELINE).unwrap_or_default()).unwrap_or_default();
        let sets: Vec<String> =
            serde_json::from_slice(&attached(SETS).unwrap_or_default()).unwrap_or_default();
        let sets: Vec<String> = sets.into_iter().filter(|set| !set.starts_with(HOST)).collect();
        let whole = whole(&pipeline, &sets, registry, &files)
            .map_err(|e| wrong(format!("{name}: the pipeline of all hosts does not fit this build:\n{e}")))?;
        let measured = measured(&session, &whole, &part.host)
            .map_err(|e| wrong(format!("{name}: a measurement of a clock cannot be read: {e}")))?;
        let span = span(&session).map_err(|e| wrong(format!("{name}: {e}")))?;
        Ok(Self { path: path.to_owned(), session, host: part.host, pipeline, sets, span, measured })
    }
}

fn span(session: &Session) -> Result<Option<[u64; 2]>, String> {
    let mut span: Option<[u64; 2]> = None;
    for sample in session.samples() {
        let at = sample.map_err(|e| e.to_string())?.log_time;
        let [first, last] = span.unwrap_or([at; 2]);
        span = Some([first.min(at), last.max(at)]);
    }
    Ok(span)
}

/// The graph of all hosts.
fn whole(
    pipeline: &str,
    sets: &[String],
    registry: &Registry,
    files: &SessionFiles,
) -> Result<Graph, config::Faults> {
    config::check(pipeline, PIPELINE, sets, registry, files)
}

/// The clocks of the hosts from which this host took samples.
fn measured(session: &Session, whole: &Graph, host: &str) -> Result<Vec<(String, ClockOffset)>, String> {
    let host_of = |operator: usize| &whole.processes[whole.operators[operator].process].host;
    let mut found = Vec::new();
    for (number, far) in whole.operators.iter().enumerate() {
        if !matches!(far.far_end, Some(Wire::Host(_))) || host_of(number) != host {
            continue;
        }
        let Some(edge) = far.inputs.iter().find_map(|input| input.edge) else { continue };
        let topic = format!("{}.diagnostics", far.name);
        for sample in session.samples_where(|t| t.name == topic) {
            let sample = sample.map_err(|e| e.to_string())?;
            found.extend(clock_of(&sample)?.map(|clock| (host_of(edge.operator).clone(), clock)));
        }
    }
    Ok(found)
}

/// The clock in a sample of diagnostics.
fn clock_of(sample: &Recorded) -> Result<Option<ClockOffset>, String> {
    let pieces = Pieces::split(Diagnostics::KIND, &sample.sample).map_err(|e| e.to_string())?;
    let view = pieces.view::<Diagnostics>().map_err(|e| e.to_string())?;
    let number = |name: &str| view.elements.iter().find(|m| m.name() == name).map(|m| m.value);
    let (Some(offset), Some(uncertainty)) = (number("clock_offset_s"), number("clock_uncertainty_s")) else {
        return Ok(None);
    };
    let nanoseconds = |seconds: f64| {
        let ns = seconds * 1e9;
        (ns.is_finite() && ns.abs() < 9e18).then(|| ns.round() as i64)
    };
    match (nanoseconds(offset), nanoseconds(uncertainty).filter(|ns| *ns >= 0)) {
        (Some(offset), Some(uncertainty)) => Ok(Some(ClockOffset { offset, uncertainty })),
        _ => Err(format!("the offset {offset} s with the uncertainty {uncertainty} s is none")),
    }
}
