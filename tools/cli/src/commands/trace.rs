//! `stillpoint trace`

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_report::pipeline_of;
use stillpoint_report::trace::{Blame, Journals, Operator, PathFigures, Trace, as_run, laps, perfetto};

use super::hz::watched;
use crate::columns::{Columns, Side};
use crate::delays::{Delay, Delays};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::journals::JournalTaps;
use crate::laps::LapTaps;
use crate::private;
use crate::subject::{Of, Subject};

/// Measure how long samples take from a source to a sink, and which operator is to blame for the longest, from the
/// journals alone.
#[derive(Args)]
pub struct TracePaths {
    #[command(flatten)]
    of: Of,
    /// How long a running pipeline is watched.
    #[arg(long = "for", value_name = "TIME", default_value = "5s")]
    time: String,
    /// Only paths that begin with this topic.
    #[arg(long, value_name = "TOPIC")]
    from: Option<String>,
    /// Only paths that end with this topic or operator.
    #[arg(long, value_name = "TOPIC|OPERATOR")]
    to: Option<String>,
    /// Number of the path whose operators are shown; without it, the first that is listed.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=500))]
    path: Option<u16>,
    /// List every path. Without it, of the paths with one start and one end, that on which samples arrive first.
    #[arg(long)]
    all: bool,
    /// Also write the activations as a trace that Perfetto and Chrome open.
    #[arg(long, value_name = "FILE")]
    perfetto: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl TracePaths {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let subject = self.of.open(registry)?;
        match &subject {
            Subject::Session(_, session) => {
                // A pipeline that this build does not know leaves processes and links unknown.
                let graph = pipeline_of(session, registry).ok().map(|(graph, _)| as_run(&graph, session));
                let journals = Journals::of_session(session, graph.as_ref()).with_laps(laps(session));
                self.show(&subject, &journals, None)
            }
            Subject::Run(attached) => {
                let time = watched(&self.time)?;
                let mut entries = vec![Vec::new(); attached.graph.operators.len()];
                let taps = JournalTaps::open(attached, |_| true)?;
                let mut laps = LapTaps::open(attached)?;
                let before = Delays::now(attached.pid);
                let mut take = |operator: usize, entry| entries[operator].push(entry);
                taps.watch_with(attached, time, &mut take, &mut || laps.look())?;
                let delays = Delays::now(attached.pid).since(&before);
                let journals = Journals::of_run(&attached.graph, &entries).with_laps(laps.laps);
                self.show(&subject, &journals, Some(&delays))
            }
        }
    }

    fn show(&self, subject: &Subject, journals: &Journals<'_>, delays: Option<&[Delay]>) -> Ended {
        let fits = |asked: &Option<String>, name: &str| asked.as_ref().is_none_or(|asked| asked == name);
        let of_operator = |name: &str| name.split('.').next().unwrap_or_default().to_owned();
        let trace = Trace::of(journals, |from, to| {
            fits(&self.from, from) && (fits(&self.to, to) || fits(&self.to, &of_operator(to)))
        });
        if trace.paths.is_empty() {
            let asked = |name: &str, value: &Option<String>| {
                value.as_ref().map_or(String::new(), |v| format!(" {name} {v}"))
            };
            return Err(Failure::wrong(format!(
                "there is no path{}{}; without --from and --to, all paths are listed",
                asked("from", &self.from),
                asked("to", &self.to)
            )));
        }
        if let Some(file) = &self.perfetto {
            let text = serde_json::to_vec(&perfetto(journals)).map_err(Failure::failed)?;
            private::create(file).and_then(|mut out| out.write_all(&text)).map_err(|e| {
                Failure::failed(format!("{}: {e}; choose another file with --perfetto", file.display()))
            })?;
        }
        if self.json {
            print_json(&json!({
                "of": subject.of(), "paths": trace.paths, "more_paths": trace.more_paths, "processes": delays,
            }))?;
            return Ok(Exit::Done);
        }
        let with = trace.paths.iter().filter(|p| p.arrived > 0).count();
        let listed: Vec<usize> = if self.all { (0..with).collect() } else { trace.quickest() };
        if with == 0 {
            outln!("no sample came to the end of any of {} paths", trace.paths.len());
        } else {
            out!("{}", overview(&trace.paths, &listed));
            outln!();
        }
        let chosen = self.path.map_or_else(|| listed.first().map_or(1, |at| at + 1), usize::from);
        let Some(path) = trace.paths.get(chosen - 1) else {
            let count = trace.paths.len();
            return Err(Failure::wrong(format!(
                "invalid number of a path: {chosen} (allowed: 1 to {count})"
            )));
        };
        print_path(chosen, path);
        let of_path = |process: &str| {
            let is_at = |o: &&Operator| o.process == process && path.operators.contains(&o.stage.name);
            journals.operators.iter().any(|o| is_at(&o))
        };
        for delay in delays.unwrap_or_default().iter().filter(|d| of_path(&d.process)) {
            outln!("  {delay}");
        }
        if listed.len() < with {
            outln!("and {} more paths (--all lists them)", with - listed.len());
        }
        if with < trace.paths.len() {
            outln!("and {} paths on which no sample arrived (--json lists them)", trace.paths.len() - with);
        }
        if trace.more_paths {
            outln!("there are more paths than were followed; choose with --from and --to");
        }
        if let Some(file) = &self.perfetto {
            outln!("{}: opens in ui.perfetto.dev and chrome://tracing", file.display());
        }
        Ok(Exit::Done)
    }
}

fn ms(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |v| format!("{v:.2}"))
}

fn blamed(blame: &[Blame]) -> String {
    blame.iter().take(2).map(Blame::text).collect::<Vec<_>>().join(", ")
}

fn overview(paths: &[PathFigures], listed: &[usize]) -> Columns {
    let head = [
        (Side::Right, "path"),
        (Side::Left, "from"),
        (Side::Left, "to"),
        (Side::Right, "hops"),
        (Side::Right, "arrived"),
        (Side::Right, "p50 ms"),
        (Side::Right, "p90"),
        (Side::Right, "p99"),
        (Side::Right, "worst"),
    ];
    let mut table = Columns::new(head);
    for number in listed {
        let path = &paths[*number];
        table.row([
            (number + 1).to_string(),
            path.from.clone(),
            path.to.clone(),
            path.operators.len().to_string(),
            format!("{} of {}", path.arrived, path.samples),
            ms(path.total_ms.p50),
            ms(path.total_ms.p90),
            ms(path.total_ms.p99),
            ms(path.total_ms.max),
        ]);
    }
    table
}

/// One path, operator by operator.
fn print_path(number: usize, path: &PathFigures) {
    outln!("path {number}: {}", path.path);
    for lost in &path.lost {
        outln!("  {} of {} samples end at {}: {}", lost.samples, path.samples, lost.operator, lost.why);
    }
    if path.arrived == 0 {
        return;
    }
    let head = [(Side::Left, "operator")].into_iter().chain(
        ["waited p50 ms", "p99", "worst", "stepped p50", "p99", "worst", "since acquisition p50", "worst"]
            .map(|name| (Side::Right, name)),
    );
    let mut table = Columns::new(head);
    for hop in &path.hops {
        table.row([
            hop.operator.clone(),
            ms(hop.wait_ms.p50),
            ms(hop.wait_ms.p99),
            ms(hop.wait_ms.max),
            ms(hop.step_ms.p50),
            ms(hop.step_ms.p99),
            ms(hop.step_ms.max),
            ms(hop.since_ms.p50),
            ms(hop.since_ms.max),
        ]);
    }
    out!("{table}");
    print_laps(path);
    let blame =
        if path.blame.is_empty() { "none took longer than usual".to_owned() } else { blamed(&path.blame) };
    outln!("to blame for the {} longest: {blame}", path.worst.len());
    for worst in path.worst.iter().filter(|w| w.beyond_ms > 0.0).take(3) {
        let lap = worst.lap.as_ref().map_or_else(String::new, |lap| format!(", most in {lap}"));
        outln!(
            "  sample {}: {:.2} ms, {} took {:.2} ms more than its median ({}{lap})",
            worst.sequence,
            worst.total_ms,
            worst.operator,
            worst.beyond_ms,
            worst.part.word()
        );
    }
}

/// The laps of the steps on a path, where there are any.
fn print_laps(path: &PathFigures) {
    let names = [(Side::Left, "operator"), (Side::Left, "lap")];
    let times = ["p50 ms", "p90", "p99", "worst"].map(|name| (Side::Right, name));
    let mut table = Columns::new(names.into_iter().chain(times));
    let laps: Vec<_> = path.hops.iter().flat_map(|hop| hop.laps.iter().map(move |lap| (hop, lap))).collect();
    for (hop, lap) in &laps {
        let names = [hop.operator.clone(), lap.lap.clone()];
        let time = &lap.time_ms;
        table.row(names.into_iter().chain([time.p50, time.p90, time.p99, time.max].map(ms)));
    }
    if !laps.is_empty() {
        out!("{table}");
    }
}
