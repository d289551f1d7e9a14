//! Reads a recorded session: what it holds, and the metrics of one topic of diagnostics over the run.
//!
//! `cargo run -p stillpoint-tests --example read_session -- sessions/head-3dof-0001 law.diagnostics`

use std::collections::BTreeMap;
use std::error::Error;
use std::io::{self, Write};
use std::path::Path;

use stillpoint_recorder::{Completeness, Session};
use stillpoint_samples::{Diagnostics, Pieces, Sample};

/// A metric over a session. Values that are not known (NaN) do not count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    pub count: u64,
    pub mean: f64,
    pub least: f64,
    pub largest: f64,
}

pub fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, topic] = arguments.as_slice() else { return Err("usage: read_session SESSION TOPIC".into()) };
    // A folder of parts or one MCAP file. A damaged session is an error with its place, never a shorter session.
    let session = Session::open(Path::new(path))?;
    let mut out = io::stdout().lock();
    for topic in session.topics() {
        writeln!(out, "{:30} {:8} samples of {}", topic.name, topic.samples, topic.type_name)?;
    }
    // What a session could not keep is listed in it: averages over a session with gaps may mislead.
    if let Completeness::Gaps(gaps) = session.completeness() {
        writeln!(out, "{} gaps; `stillpoint info {path}` lists them", gaps.len())?;
    }
    for (name, Summary { count, mean, least, largest }) in summary(&session, topic)? {
        writeln!(out, "{name:30} {count:8} values, mean {mean:.6}, from {least:.6} to {largest:.6}")?;
    }
    Ok(())
}

/// The metrics of a topic by name.
pub fn summary(session: &Session, topic: &str) -> Result<BTreeMap<String, Summary>, Box<dyn Error>> {
    session.topic_number(topic).ok_or_else(|| format!("the session has no topic `{topic}`"))?;
    let mut summaries = BTreeMap::new();
    // One chunk of the file is in memory at a time, so the session may be larger than the memory.
    for recorded in session.samples_where(|other| other.name == topic) {
        let recorded = recorded?;
        // The bytes are those that were in shared memory. The view checks them against the type and copies nothing; a topic
        // of another type is an error here.
        let view = Pieces::split(Diagnostics::KIND, &recorded.sample)?.view::<Diagnostics>()?;
        for metric in view.elements.iter().filter(|metric| metric.value.is_finite()) {
            let first = Summary { count: 0, mean: 0.0, least: f64::INFINITY, largest: f64::NEG_INFINITY };
            let s: &mut Summary = summaries.entry(metric.name().to_owned()).or_insert(first);
            s.count += 1;
            s.mean += (metric.value - s.mean) / s.count as f64;
            (s.least, s.largest) = (s.least.min(metric.value), s.largest.max(metric.value));
        }
    }
    Ok(summaries)
}
