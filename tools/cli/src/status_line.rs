//! What the command observes of a live run: the status on a terminal, and what the valves do.

use std::io::IsTerminal;

use stillpoint_http::Metrics;
use stillpoint_operator::Registry;
use stillpoint_pipeline::live::Fault;
use stillpoint_pipeline::live::status::OperatorFigures;

use crate::attach::{Attached, Which};
use crate::exit::Failure;
use crate::held::{HeldTaps, Read};
use crate::journals::JournalTaps;
use crate::metrics;
use crate::summary::Observed;
use stillpoint_report::contracts;
use stillpoint_report::hold::Held;
use stillpoint_samples::Entry;

/// Journal entries of a run without a session that are kept for its contracts; later ones are not judged.
const MOST_ENTRIES: usize = 2_000_000;

/// The live status, on a terminal: how the head is held, and rates, latencies and losses of all operators. Without a
/// terminal it only observes what the end of the run states.
pub struct StatusLine<'a> {
    registry: &'a Registry,
    terminal: bool,
    /// Lines on the screen.
    shown: usize,
    taps: Option<Taps>,
    /// Where the figures are served, with the name of the pipeline.
    metrics: Option<(Metrics, String)>,
}

/// What is read, and the run that it belongs to. Dropped in this order.
struct Taps {
    held: HeldTaps,
    /// The journals of a run with contracts that nothing records, with their entries.
    journals: Option<(JournalTaps, Vec<Vec<Entry>>)>,
    _attached: Attached,
}

impl Taps {
    /// Opens all topics for a terminal; else those that the session does not keep.
    fn open(registry: &Registry, for_terminal: bool) -> Result<Self, Failure> {
        let attached = Which { run: Some(std::process::id().to_string()) }.attach(registry)?;
        let read = if for_terminal { Read::All } else { Read::NotRetained };
        let journals = if attached.session.is_none() && contracts::is_any(&attached.graph) {
            let entries = vec![Vec::new(); attached.graph.operators.len()];
            Some((JournalTaps::open(&attached, |_| true)?, entries))
        } else {
            None
        };
        Ok(Self { held: HeldTaps::open(&attached, read)?, journals, _attached: attached })
    }

    fn look(&mut self) -> Held {
        if let Some((journals, entries)) = &mut self.journals {
            let mut count: usize = entries.iter().map(Vec::len).sum();
            // A journal that cannot be read is judged as far as it was.
            let _ = journals.look(&mut |operator, entry| {
                if count < MOST_ENTRIES {
                    entries[operator].push(entry);
                    count += 1;
                }
            });
        }
        self.held.look()
    }
}

impl<'a> StatusLine<'a> {
    /// The status of a run on standard error, if that is a terminal and the status is `requested`.
    pub fn new(registry: &'a Registry, requested: bool) -> Self {
        let terminal = requested && std::io::stderr().is_terminal();
        Self { registry, terminal, shown: 0, taps: None, metrics: None }
    }

    /// The same, with figures for others.
    pub fn with_metrics(self, metrics: Metrics, pipeline: &str) -> Self {
        Self { metrics: Some((metrics, pipeline.to_owned())), ..self }
    }

    /// Clears the status for good, and gives what was observed up to the end; nothing if the run could not be observed.
    pub fn close(mut self) -> Observed {
        self.clear();
        let Some(mut taps) = self.taps.take() else { return Observed::default() };
        let held = Some(taps.look());
        Observed { held, answers: taps.held.answers, entries: taps.journals.map(|(_, entries)| entries) }
    }

    /// Erases the status.
    fn clear(&mut self) {
        for line in 0..self.shown {
            err!("{}\r\x1b[2K", if line > 0 { "\x1b[1A" } else { "" });
        }
        self.shown = 0;
    }
}

impl stillpoint_pipeline::live::Run for StatusLine<'_> {
    fn started(&mut self, _: &[(String, u32)]) {
        // The run continues without taps.
        self.taps = Taps::open(self.registry, self.terminal || self.metrics.is_some()).ok();
    }

    fn goes_on(&mut self, seconds: f64, operators: &[OperatorFigures]) {
        let held = self.taps.as_mut().map(Taps::look);
        if let Some((served, pipeline)) = &self.metrics {
            served.update(metrics::figures(pipeline, seconds, operators, held.as_ref()));
        }
        if !self.terminal {
            return;
        }
        let mut parts = vec![format!("{seconds:.1} s, latencies since the acquisition")];
        parts.extend(held.map(|held| held.now()).unwrap_or_default());
        let figures = operators.iter().filter(|o| o.activations > 0).map(figures).collect::<Vec<_>>();
        // A terminal that does not know how wide it is says 0.
        let columns = rustix::termios::tcgetwinsize(std::io::stderr()).map_or(0, |w| usize::from(w.ws_col));
        let width = if columns == 0 { 80 } else { columns.max(20) };
        let lines = [wrapped(&parts, width - 1), wrapped(&figures, width - 1)].concat();
        self.clear();
        err!("{}", lines.join("\n"));
        self.shown = lines.len();
    }

    fn noted(&mut self, what: &str) {
        self.clear();
        errln!("stillpoint: {what}");
    }

    fn failed(&mut self, fault: &Fault) {
        self.clear();
        errln!("stillpoint: {}: {}", fault.operator, fault.reason);
    }
}

/// The rate of an operator, the age of its outputs, and its losses.
fn figures(o: &OperatorFigures) -> String {
    let mut part = format!("{} {:.0} Hz", o.operator, o.rate_hz);
    // The latency since the acquisition: of the whole chain up to this operator, not of this step alone.
    if o.age_ms[0].is_finite() {
        part += &format!(" {:.1} ms", o.age_ms[0]);
    }
    for (count, what) in [(o.lost, "lost"), (o.missed, "missed"), (o.errors + o.panics, "failed")] {
        if count > 0 {
            part += &format!(" {what} {count}");
        }
    }
    part
}

/// Joins parts to lines of at most `width` characters; a longer part is cut.
fn wrapped(parts: &[String], width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for part in parts {
        let part: String = part.chars().take(width).collect();
        match lines.last_mut() {
            Some(line) if line.chars().count() + 2 + part.chars().count() <= width => {
                *line += "  ";
                *line += &part;
            }
            _ => lines.push(part),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_operator_has_its_rate_its_latency_and_what_it_lost() {
        let mut face = OperatorFigures {
            operator: "face".into(),
            activations: 100,
            rate_hz: 10.0,
            errors: 1,
            panics: 1,
            incarnations: 2,
            sent: 98,
            sent_by_output: vec![98],
            lost: 3,
            ticks: 0,
            missed: 0,
            step_ms: [12.0, 20.0],
            age_ms: [35.24, 50.0],
        };
        assert_eq!(figures(&face), "face 10 Hz 35.2 ms lost 3 failed 2");
        // Nothing was sent yet.
        face.age_ms = [f64::NAN; 2];
        assert_eq!(figures(&face), "face 10 Hz lost 3 failed 2");
    }

    #[test]
    fn parts_fill_lines_and_none_is_longer_than_the_screen_is_wide() {
        let parts: Vec<String> =
            ["filter 10 Hz", "law", "a part that is too long for it"].map(Into::into).into();
        assert_eq!(wrapped(&parts, 17), ["filter 10 Hz  law", "a part that is to"]);
        assert_eq!(wrapped(&parts, 200), [parts.join("  ")]);
        assert!(wrapped(&[], 10).is_empty());
    }
}
